"""The overhead comparison at work, as small as it can be: real nodes, monitors and Zenoh."""

from __future__ import annotations

import argparse
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.processes import ROOT as REPOSITORY
from benchmarks.processes import Child, ChildError, say
from benchmarks.ticking import WHOLE, MiddlewareMissingError, Order, middleware
from examples.overhead import __main__ as command
from examples.overhead import blocks, brief, measuring, results
from examples.overhead.blocks import SERIES
from examples.overhead.middle import LocalOracle, ManInTheMiddle, monitored
from examples.overhead.observers import CONFIGURATIONS
from examples.overhead.plant import Plant, generate, read_system
from examples.overhead.routes import MONITORED, rerouted
from m2c.model.machine import InterfaceKind
from m2c.runtime.messages import message_class
from transports.interface import CallOutcome, ObservationKind, Service
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SKILL = "BatteryLevelSkill"


# -- the man in the middle --------------------------------------------------------------------------


def tick_service(name: str) -> Service:
    system = read_system()
    kind = system.library.service("bt_interfaces/srv/TickCondition")
    return Service(name, kind.name, message_class(kind.request), message_class(kind.response))


def call_through_the_middle(serve: bool) -> tuple[list[str], CallOutcome, ManInTheMiddle]:
    """One tick of BatteryLevelSkill by way of the monitor: what happened, in order, and its end."""
    system = read_system()
    world = SimulatedWorld(1, Conditions(delay_s=(0.001, 0.001)))
    happened: list[str] = []
    tick = tick_service(f"/{SKILL}/tick")
    if serve:
        skill = SimulatedTransport(world, SKILL)

        def answer(request) -> None:
            happened.append("the server was called")
            request.respond(tick.response(status=1, is_ok=True))

        skill.serve(tick, answer)
    oracle = LocalOracle(system)

    def ask(seen) -> bool:
        happened.append(f"the oracle was asked: {seen.kind} {seen.channel} {seen.error}".strip())
        return oracle.ask(seen)

    middle = ManInTheMiddle(
        SimulatedTransport(world, "middle"), monitored(system), system.library, ask
    )
    policy = SimulatedTransport(world, "policy")
    policy_tick = tick_service(rerouted(f"/{SKILL}/tick"))
    outcomes: list[CallOutcome] = []
    policy.client(policy_tick).call(
        tick.request(), lambda result: outcomes.append(result.outcome), timeout_s=8.0
    )
    world.run_for(10.0)
    happened.append("the policy had its answer")
    world.close()
    return happened, outcomes[0], middle


def test_the_oracle_is_asked_before_the_server_is_called_and_before_the_answer_goes_back() -> None:
    happened, outcome, middle = call_through_the_middle(serve=True)
    assert happened == [
        f"the oracle was asked: request_received /{SKILL}/tick",
        "the server was called",
        f"the oracle was asked: response_sent /{SKILL}/tick",
        "the policy had its answer",
    ]
    assert outcome is CallOutcome.RESPONSE
    assert (middle.forwarded, middle.failed) == (1, 0)


def test_a_call_that_fails_behind_the_monitor_fails_in_front_of_it() -> None:
    happened, outcome, middle = call_through_the_middle(serve=False)
    assert happened[0] == f"the oracle was asked: request_received /{SKILL}/tick"
    assert "response_sent" in happened[1]
    assert "unavailable" in happened[1]
    assert outcome is CallOutcome.REMOTE_ERROR
    assert (middle.forwarded, middle.failed) == (1, 1)


def test_only_what_a_monitored_skill_calls_is_rerouted(tmp_path: Path) -> None:
    direct, middle = (
        generate(tmp_path / name, rerouted_) for name, rerouted_ in (("d", False), ("m", True))
    )
    changed = {
        path.relative_to(direct).parts[0]
        for path in direct.rglob("*.py")
        if path.read_bytes() != (middle / path.relative_to(direct)).read_bytes()
    }
    assert changed == {"alarm_skill", "is_poi_done1_skill", "set_poi1_skill"}
    calls = {
        interface.channel
        for machine in read_system().nodes
        if machine.name in MONITORED
        for interface in machine.interfaces
        if interface.kind is InterfaceKind.CLIENT
    }
    text = "".join(path.read_text(encoding="utf-8") for path in middle.rglob("node.py"))
    assert all(f'"{rerouted(channel)}"' in text for channel in calls)


# -- the plant --------------------------------------------------------------------------------------


@pytest.fixture
def plant(tmp_path: Path) -> Iterator[Plant]:
    with middleware("zenoh") as where:
        folder = generate(tmp_path / "generated", through_the_middle=False)
        with Plant(where, folder) as running:
            yield running


@pytest.mark.zenoh
def test_ticks_that_fail_are_counted_and_keep_their_time(plant: Plant) -> None:
    good = plant.run(Order(3, 0.0, 2, rest=True))
    assert {name: len(values) for name, values in good.micros.items()} == dict.fromkeys(SERIES, 3)
    assert not any(good.failures.values())
    plant.nodes["BlackboardComponent"].stop()
    bad = plant.run(Order(3, 0.0, 0, rest=True))
    assert bad.failures["IsPoiDone1"] == 3
    assert bad.failures[WHOLE] == 3
    assert bad.failures["BatteryLevel"] == 0
    assert len(bad.micros["IsPoiDone1"]) == len(bad.micros[WHOLE]) == 3
    assert bad.reasons[0].startswith("IsPoiDone1: ")


@pytest.mark.zenoh
@pytest.mark.soak
def test_the_table_is_measured_in_every_way_of_monitoring() -> None:
    names = ("none", "both", "models-in-process", "models-websocket")
    plan = measuring.Plan(1, {20.0: 4, 0.0: 4}, names, settle=2, warm_up=2, run_in=0)
    said: list[str] = []
    measured = list(measuring.measure("zenoh", plan, said.append))
    assert {(b.configuration, b.rate_hz) for b in measured} == {
        (name, rate_hz) for name in names for rate_hz in (20.0, 0.0)
    }
    for block in measured:
        assert {name: len(values) for name, values in block.values.items()} == dict.fromkeys(
            SERIES, 4
        )
        # all was heard: four requests and responses of skills, three of what is behind them, a tick
        assert not block.deaf
    assert not any(cell.failures for cell in blocks.cells(measured))


# -- the command ------------------------------------------------------------------------------------


def overhead(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "examples.overhead", *arguments],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_results_file_that_is_none_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text('{"machine": 3}', encoding="utf-8")
    done = overhead("--from", str(tmp_path / "results.json"))
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert "results.json: not the results of a run: Expected `str`" in done.stderr
    assert "Traceback" not in done.stderr


def test_libraries_that_are_not_installed_are_named(monkeypatch, capsys) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert command.main(["--quick"]) == 2
    assert "pip install '.[overhead]'" in capsys.readouterr().err


def test_ros_2_that_is_not_installed_is_one_clear_error(monkeypatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with (
        pytest.raises(MiddlewareMissingError, match=r"pip install '\.\[ros2\]'"),
        middleware("ros2"),
    ):
        pass


@pytest.mark.zenoh
@pytest.mark.slow
def test_what_the_command_measured_can_be_shown_again(tmp_path: Path, monkeypatch, capsys) -> None:
    tiny = measuring.Plan(1, {0.0: 3}, ("none", "both"), settle=2, warm_up=1, run_in=0)
    monkeypatch.setattr(command, "QUICK", tiny)
    assert command.main(["--quick", "-o", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "both, passive" in shown
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "overhead.md"}
    found = blocks.cells(results.read(tmp_path / "results.json").blocks)
    assert {cell.series for cell in found} == set(SERIES)
    assert {cell.transport for cell, _ in blocks.targets(found)} == {"zenoh"}
    assert command.main(["--from", str(tmp_path / "results.json")]) == 0
    assert capsys.readouterr().out == shown


def test_targets_alone_are_measured_without_monitors_in_the_middle() -> None:
    chosen = argparse.Namespace(full=True, targets=True, rounds=3, seed=1)
    fast, slow = command.plans(chosen)
    assert fast.names == slow.names == measuring.CORE
    assert (fast.rounds, set(fast.ticks)) == (3, {10.0, 0.0})
    assert (slow.rounds, set(slow.ticks)) == (3, {1.0})
    chosen.targets = False
    fast, _ = command.plans(chosen)
    assert list(fast.names) == [item.name for item in CONFIGURATIONS]


@pytest.mark.zenoh
@pytest.mark.slow
def test_the_demos_three_lines_are_measured(monkeypatch) -> None:
    tiny = measuring.Plan(1, {0.0: 3}, brief.NAMES, settle=2, warm_up=1, run_in=0)
    monkeypatch.setattr(brief, "PLAN", tiny)
    ours, middle, paper = brief.three_lines()
    assert re.match(
        r"a tick of four skills: [\d,]+ µs, with all of it monitored passively [\d,]+ µs", ours
    )
    assert middle.endswith("times)")
    assert "864,467 µs with (28.9 times)" in paper


# -- children ---------------------------------------------------------------------------------------


def test_a_child_that_dies_is_told_with_its_last_lines() -> None:
    with (
        Child("the child", ["-c", "raise SystemExit('no luck')"]) as child,
        pytest.raises(ChildError, match="the child ended by itself:\nno luck"),
    ):
        child.answer()


def test_a_child_that_says_nothing_is_told_after_the_time_is_over() -> None:
    with (
        Child("the child", ["-c", "import sys; sys.stdin.read()"]) as child,
        pytest.raises(ChildError, match="does not answer within"),
    ):
        child.answer(timeout_s=0.2)


def test_a_child_answers_questions_and_says_its_last_word() -> None:
    script = (
        "import json, signal, sys\n"
        "def end(*_): print(json.dumps({'last': 1})); sys.exit()\n"
        "signal.signal(signal.SIGTERM, end)\n"
        "for line in sys.stdin: print(json.dumps({'got': json.loads(line)}), flush=True)\n"
    )
    child = Child("the child", ["-c", script])
    try:
        assert child.ask({"a": 1}) == {"got": {"a": 1}}
        assert child.processor_s() > 0
        assert child.last_lines == '{"got": {"a": 1}}'
    finally:
        said = child.stop()
    assert said == [{"last": 1}]


def answer_twice(number: int, words: list[str]) -> None:
    """What a child of the next test calls."""
    say({"twice": number * 2, "words": words})


def test_a_function_is_called_in_a_child_with_arguments_of_json() -> None:
    with Child.calling("the child", answer_twice, 21, ["a 'word'"]) as child:
        assert child.answer() == {"twice": 42, "words": ["a 'word'"]}


def test_kinds_of_observations_are_the_machines_own_ends() -> None:
    happened, _, _ = call_through_the_middle(serve=True)
    kinds = [line.split()[4] for line in happened if line.startswith("the oracle")]
    assert kinds == [str(ObservationKind.REQUEST_RECEIVED), str(ObservationKind.RESPONSE_SENT)]
