"""``moon monitor`` and the lab tour, each process of its own, on real Zenoh over loopback."""

from __future__ import annotations

import json
import signal
import subprocess
import threading
from pathlib import Path

import pytest

from moon.sinks.topic import VERDICTS
from tests.monitor.processes import BIN, WAIT_S, Monitor, Process, free_endpoint, router
from transports.networks import spinning
from transports.zenoh import connect

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]
SYSTEM = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
SKILL = SYSTEM.parent / "skills" / "BatteryLevelSkill.scxml"
RATE = 10
"""Ticks a second: twice the tour's, so that tests are half as long."""


@pytest.fixture(scope="module")
def tour(tmp_path_factory) -> Path:
    """The generated tour."""
    folder = tmp_path_factory.mktemp("tour") / "generated"
    command = [str(BIN / "m2c"), "generate", "--transport", "zenoh", str(SYSTEM), "-o", str(folder)]
    subprocess.run(command, check=True, capture_output=True, timeout=WAIT_S)
    return folder


@pytest.fixture
def silent(tmp_path) -> Path:
    """A BatteryLevelSkill that does not answer any more from its tenth tick on."""
    model = tmp_path / "silent.scxml"
    text = SKILL.read_text()
    text = text.replace("<datamodel>", '<datamodel><data id="ticks" type="int32" expr="0"/>')
    text = text.replace('cond="percentage', 'cond="ticks &lt; 10 &amp;&amp; percentage')
    text = text.replace("<else/>", '<elseif cond="ticks &lt; 10"/>')
    text = text.replace(
        '<transition target="idle"/>',
        '<transition target="idle"><assign location="ticks" expr="ticks + 1"/></transition>',
    )
    model.write_text(text)
    return model


def run_arguments(*arguments: object) -> tuple[object, ...]:
    return ("m2c", "run", *arguments, "--rate", RATE)


def test_a_nominal_tour_heard_from_its_start_conforms(start, tour, tmp_path) -> None:
    with router(tmp_path) as (endpoint, config):
        monitor = start(Monitor, SYSTEM, "--endpoint", endpoint)
        monitor.until_listening()
        run = start(
            Process, *run_arguments(tour, "--ticks", 60, "--quiet", "--zenoh-config", config)
        )
        assert run.end() == 0, run.said
        monitor.until(lambda: "no longer linked to any node" in monitor.said)  # the last has come
        assert monitor.end(signal.SIGINT) == 0, monitor.said
    assert monitor.violated == set()
    verdicts = {item["machine"]: item["verdict"] for item in monitor.summary["machines"]}
    assert set(verdicts.values()) == {"conforming"}, monitor.said
    assert len(verdicts) == 18
    (level,) = [m for m in monitor.summary["machines"] if m["machine"] == "BatteryLevelSkill"]
    assert level["outputs"] == 60
    assert level["inputs"] > 60


def test_a_monitor_that_comes_in_the_middle_synchronises_and_raises_nothing(start, tour) -> None:
    endpoint = free_endpoint()
    run = start(Process, *run_arguments(tour, "--ticks", 200, "--endpoint", endpoint))
    run.until(lambda: any("tick    5" in line for line in run.out))
    monitor = start(Monitor, SYSTEM, "--endpoint", endpoint)
    working = ("BatteryLevelSkill", "BatteryComponent", "VisitorsFollowingRobotSkill")
    for name in working:
        monitor.until(lambda name=name: monitor.of(name)[-1:] == ["conforming"])
        assert monitor.of(name)[0] == "inconclusive"
    run.until(lambda: any("tick   70" in line for line in run.out))
    assert monitor.end(signal.SIGINT) == 0, monitor.said
    assert monitor.violated == set()


def test_a_wrong_answer_is_found_at_once_and_explained(start, wrong, tmp_path) -> None:
    log = tmp_path / "verdicts.jsonl"
    with router(tmp_path) as (endpoint, config):
        monitor = start(
            Monitor, SYSTEM, "--endpoint", endpoint, "--log", log, "--exit-on-violation"
        )
        monitor.until_listening()
        start(
            Process,
            *run_arguments(
                SYSTEM, "--replace", f"BatteryLevelSkill={wrong}", "--zenoh-config", config
            ),
        )
        assert monitor.end() == 1, monitor.said
    assert monitor.violated == {"BatteryLevelSkill"}
    (found,) = [v for v in monitor.verdicts if v["outcome"] == "violated"]
    why = found["explanation"]
    assert why["expected"] == [
        "response on /BatteryLevelSkill/tick {status: SUCCESS (0), is_ok: true} to policy"
    ]
    assert (
        why["observed"] == "response on /BatteryLevelSkill/tick {status: FAILURE (1), is_ok: true}"
    )
    assert why["states"][0].startswith("idle (percentage=")
    assert why["evidence"][-1]["text"] == "request 1 of policy to /BatteryLevelSkill/tick {}"
    assert why["evidence"][-1]["stamp_ns"] <= found["stamp_ns"]
    file, line, _ = why["places"][0].rsplit(":", 2)
    assert Path(file).name == "BatteryLevelSkill.scxml"
    assert "ros_service_handle_request" in SKILL.read_text().splitlines()[int(line) - 1]
    logged = [json.loads(text) for text in log.read_text().splitlines()]
    assert [{"event": "verdict", **verdict} for verdict in logged] == monitor.verdicts


def test_wrong_answers_are_found_by_a_monitor_that_comes_in_the_middle(start, wrong) -> None:
    endpoint = free_endpoint()
    run = start(
        Process,
        *run_arguments(SYSTEM, "--replace", f"BatteryLevelSkill={wrong}", "--endpoint", endpoint),
    )
    run.until(lambda: any("tick   10" in line for line in run.out))
    monitor = start(Monitor, SYSTEM, "--endpoint", endpoint, "--exit-on-violation")
    assert monitor.end() == 1, monitor.said
    assert monitor.violated == {"BatteryLevelSkill"}


def test_a_missing_answer_is_found(start, silent, tmp_path) -> None:
    """At its deadline, or before, when the machine takes its next message without having answered."""
    with router(tmp_path) as (endpoint, config):
        monitor = start(Monitor, SYSTEM, "--endpoint", endpoint, "--deadline", 0.7)
        monitor.until_listening()
        start(
            Process,
            *run_arguments(
                SYSTEM, "--replace", f"BatteryLevelSkill={silent}", "--zenoh-config", config
            ),
        )
        monitor.until(lambda: monitor.violated)
        assert monitor.end(signal.SIGINT) == 1, monitor.said
    assert monitor.violated == {"BatteryLevelSkill"}
    found = next(v for v in monitor.verdicts if v["outcome"] == "violated")
    assert "expected response on /BatteryLevelSkill/tick" in found["reason"]
    observed = found["explanation"]["observed"]
    assert observed.startswith(("nothing in time", "message taken on /BatteryComponent/level"))
    asked = [item["text"] for item in found["explanation"]["evidence"]]
    assert [text for text in asked if text.startswith("request ")]


@pytest.mark.soak
def test_a_missing_answer_is_found_by_a_monitor_that_comes_in_the_middle(start, silent) -> None:
    endpoint = free_endpoint()
    run = start(
        Process,
        *run_arguments(SYSTEM, "--replace", f"BatteryLevelSkill={silent}", "--endpoint", endpoint),
    )
    run.until(lambda: any("tick   11" in line for line in run.out))
    monitor = start(Monitor, SYSTEM, "--endpoint", endpoint, "--exit-on-violation")
    assert monitor.end() == 1, monitor.said
    assert monitor.violated == {"BatteryLevelSkill"}


def test_two_monitors_agree_and_killing_one_harms_nobody(start, wrong, tmp_path) -> None:
    log = tmp_path / "killed.jsonl"
    with router(tmp_path) as (endpoint, config):
        first = start(Monitor, SYSTEM, "--endpoint", endpoint, "--log", log)
        second = start(Monitor, SYSTEM, "--endpoint", endpoint)
        told = []
        heard = threading.Event()
        listener = connect("listener", {"endpoint": endpoint})
        listener.subscribe(VERDICTS, lambda message: (told.append(message), heard.set()))
        with spinning(listener):
            for monitor in (first, second):
                monitor.until_listening()
            run = start(
                Process,
                *run_arguments(
                    SYSTEM,
                    *("--replace", f"BatteryLevelSkill={wrong}", "--zenoh-config", config),
                    *("--ticks", 60),
                ),
            )
            for monitor in (first, second):
                monitor.until(lambda monitor=monitor: monitor.violated)
            assert heard.wait(WAIT_S)
            first.end(signal.SIGKILL)
            at_kill = len(run.out)
            assert run.end() == 0, run.said
            assert len(run.out) > at_kill
        assert second.end(signal.SIGINT) == 1
    assert first.violated == second.violated == {"BatteryLevelSkill"}
    logged = [json.loads(text) for text in log.read_text().splitlines()]
    assert "violated" in {verdict["outcome"] for verdict in logged}
    assert log.read_text().endswith("\n")
    (message, *_) = [m for m in told if m.outcome == "violated"]
    assert message.node == "BatteryLevelSkill"
    assert message.observed.startswith("response on /BatteryLevelSkill/tick")
    assert message.places[0].split(":")[0].endswith("BatteryLevelSkill.scxml")
    answered = [line for line in run.out if "tick " in line]
    assert "60" in answered[-1]
    assert "taken as FAILURE" not in run.said


def test_a_stopped_monitor_holds_nobody_up_goes_on_and_has_no_doubt_at_a_clean_end(
    start, tour, tmp_path
) -> None:
    with router(tmp_path) as (endpoint, config):
        monitor = start(Monitor, SYSTEM, "--endpoint", endpoint)
        monitor.until_listening()
        run = start(Process, *run_arguments(tour, "--zenoh-config", config))

        def ticked(number: int) -> bool:
            return any(f"tick {number:4}" in line for line in run.out)

        run.until(lambda: ticked(20))
        monitor.send(signal.SIGSTOP)
        run.until(lambda: ticked(50))
        monitor.send(signal.SIGCONT)
        monitor.until(lambda: any("stood still for" in line for line in monitor.err))
        monitor.send(signal.SIGSTOP)  # in its place: a machine on which all end at once
        assert run.end(signal.SIGINT) == 0, run.said
        monitor.send(signal.SIGCONT)
        monitor.until(lambda: any("no longer linked to any node" in line for line in monitor.err))
        assert monitor.end(signal.SIGINT) == 0, monitor.said
    assert monitor.violated == set()
    standing = {(item["verdict"], *item["states"]) for item in monitor.summary["machines"]}
    assert standing == {("conforming", "(gone)")}, monitor.said
    assert "taken as FAILURE" not in run.said
