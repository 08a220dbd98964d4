"""The same tour on Zenoh, on ROS 2 and in virtual time: what is heard is the same but for stamps and sources."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from m2c.model.machine import InterfaceKind
from m2c.model.system import System
from moon.monitor.models import ModelMonitor
from moon.monitor.reading import read_checked
from moon.oracle.bounds import Bounds
from moon.verdict import Outcome
from transports.interface import Observation, ObservationKind

pytestmark = [pytest.mark.ros2, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
TOUR = ROOT / "examples" / "lab_tour"
TRANSPORTS = ("simulated", "zenoh", "ros2")
SECONDS = 28
"""A whole tour; whatever is done in it at all is done by then."""
MILLISECOND = 1_000_000

Heard = dict[str, list[Observation]]
"""By transport, in the order of the stamps."""


@pytest.fixture(scope="module")
def system() -> System:
    return read_checked([TOUR / "system.xml"])


@pytest.fixture(scope="module")
def heard(tmp_path_factory: pytest.TempPathFactory) -> Heard:
    """The tour as it is, recorded on each transport, on all at the same time: mostly it waits."""
    folder = tmp_path_factory.mktemp("recorded")
    command = [sys.executable, str(TOUR / "faults" / "run.py"), "--nominal", str(SECONDS)]
    command += ["--record", str(folder)]
    runs = [
        subprocess.Popen(
            [*command, "--transport", name],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in TRANSPORTS
    ]
    for run in runs:
        said = run.communicate()
        assert run.returncode in (0, 1), said
    decoder = msgspec.json.Decoder(Observation)
    return {
        name: decoder.decode_lines((folder / f"nominal-{name}.jsonl").read_bytes())
        for name in TRANSPORTS
    }


def of_models(system: System, seen: Iterable[Observation]) -> list[Observation]:
    """What happened on the models' channels: each middleware has some of its own, and ROS 2's nodes do not
    report what they take.
    """
    channels = {
        interface.channel
        for machine in system.nodes
        for interface in machine.interfaces
        if interface.kind is not InterfaceKind.TIMER
    }
    return [
        item
        for item in seen
        if item.channel.partition("/_action/")[0] in channels
        and item.kind is not ObservationKind.MESSAGE_TAKEN
    ]


def shape(data: Any) -> Any:
    """Fields and their types, in order."""
    if isinstance(data, dict):
        return tuple((name, shape(value)) for name, value in data.items())
    if isinstance(data, list):
        return ("list", *sorted({shape(item) for item in data}, key=repr))
    return type(data).__name__


@pytest.mark.timeout(400)
def test_each_channel_carries_the_same_kinds_types_and_fields(system: System, heard: Heard) -> None:
    found = {
        name: {
            (item.channel, item.kind, item.type_name, shape(item.data))
            for item in of_models(system, seen)
            if not item.channel.endswith("/_action/status")  # lists may be empty or not
        }
        for name, seen in heard.items()
    }
    assert found["ros2"] == found["zenoh"] == found["simulated"]


@pytest.mark.timeout(400)
def test_each_call_has_the_same_four_events_at_the_same_two_ends(
    system: System, heard: Heard
) -> None:
    assert ends(system, heard["ros2"]) == ends(system, heard["zenoh"])
    assert ends(system, heard["ros2"]) == ends(system, heard["simulated"])


def ends(system: System, seen: Iterable[Observation]) -> set[Any]:
    """Of each complete call, its channel and the sequence of its events, each with who told it."""
    calls: dict[Any, list[Any]] = {}
    for item in of_models(system, seen):
        if item.kind is not ObservationKind.MESSAGE:
            call = (item.channel, item.client, item.call)
            calls.setdefault(call, []).append((item.kind, item.source, bool(item.error)))
    return {
        (channel, client, tuple(sorted(events)))
        for (channel, client, _), events in calls.items()
        if len(events) == 4  # the last ones are cut off by the end of the recording
    }


@pytest.mark.timeout(400)
def test_what_changes_on_a_channel_changes_in_the_same_order(system: System, heard: Heard) -> None:
    """Up to where the shorter recording ends: of each source what it sent, without repetitions."""
    lanes = {name: changes(system, heard[name]) for name in TRANSPORTS}
    compared = 0
    for lane, here in lanes["ros2"].items():
        for name in ("zenoh", "simulated"):
            mine, theirs = together(here, lanes[name].get(lane, []))
            common = min(len(mine), len(theirs))
            assert mine[:common] == theirs[:common], (lane, name)
            compared += common
    assert compared > 50


def together(here: list[Any], there: list[Any]) -> tuple[list[Any], list[Any]]:
    """Both from where the later one begins: a tap may find a node when it has begun to send."""
    if here and here[0] in there:
        return here, there[there.index(here[0]) :]
    if there and there[0] in here:
        return here[here.index(there[0]) :], there
    return here, there


def changes(system: System, seen: Iterable[Observation]) -> dict[Any, list[Any]]:
    """What each node published, one after the other; what is repeated counts once."""
    lanes: dict[Any, list[Any]] = {}
    for item in of_models(system, seen):
        # goals have identifiers
        if item.kind is ObservationKind.MESSAGE and "/_action/" not in item.channel:
            lane = lanes.setdefault((item.channel, item.source), [])
            if not lane or lane[-1] != item.data:
                lane.append(item.data)
    return lanes


@pytest.mark.timeout(400)
def test_replayed_into_the_oracle_all_recordings_have_the_same_verdicts(
    system: System, heard: Heard
) -> None:
    verdicts = {name: replayed(system, heard[name]) for name in TRANSPORTS}
    said = list(verdicts["ros2"].values())
    assert Outcome.VIOLATED not in said
    assert said.count(Outcome.CONFORMING) >= 16  # of 17: one has a single tick, at the end
    assert verdicts["ros2"] == verdicts["zenoh"] == verdicts["simulated"]


@pytest.mark.timeout(400)
@pytest.mark.parametrize("name", TRANSPORTS)
def test_an_answer_that_is_changed_in_a_recording_is_found_whatever_it_was_recorded_on(
    system: System, heard: Heard, name: str
) -> None:
    seen = list(heard[name])
    answers = [
        index
        for index, item in enumerate(seen)
        if item.channel == "/IsPoiDone1Skill/tick" and item.kind is ObservationKind.RESPONSE_SENT
    ]
    index = answers[10]  # by then it is known what the skill does
    data = seen[index].data
    seen[index] = msgspec.structs.replace(seen[index], data={**data, "status": 1 - data["status"]})
    found = {node for node, outcome in replayed(system, seen).items() if outcome == "violated"}
    assert found == {"IsPoiDone1Skill"}


def replayed(system: System, seen: Sequence[Observation]) -> dict[str, Outcome]:
    """What the models' monitors say of each machine, told everything when it happened.

    They are not told that they heard each machine's beginning: on a busy machine a tap on ROS 2 may not.
    """
    latency_ns = 200 * MILLISECOND
    bounds = Bounds(latency=latency_ns, deadline=1000 * MILLISECOND)
    monitor = ModelMonitor(system.nodes, system.library, bounds, synchronised=False)
    for item in seen:
        now_ns = item.stamp_ns
        monitor.advance(now_ns)
        monitor.feed(msgspec.structs.replace(item, received_ns=now_ns))
    violated = {name for name, oracle in monitor.oracles.items() if oracle.outcome == "violated"}
    return {
        name: Outcome.VIOLATED if name in violated else oracle.outcome
        for name, oracle in monitor.oracles.items()
    }
