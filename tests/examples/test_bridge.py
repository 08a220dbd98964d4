"""The bridge: what is handed on from transport to transport, and one monitor of both sides."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from examples.bridge.sides import AllSides, Side
from moon.monitor.reading import read_checked
from transports.conformance import COUNTING, DOUBLE, NUMBERS, Answer, Ask, Number, Text
from transports.interface import (
    CallOutcome,
    CallResult,
    GoalEvents,
    GoalHandle,
    GoalStatus,
    Observation,
    ObservationKind,
)
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld
from transports.timers import Timer

ROOT = Path(__file__).parents[2]
BRIDGE = ROOT / "examples" / "bridge"
SYSTEM = ROOT / "examples" / "lab_tour" / "system.xml"
FAULTS = ROOT / "examples" / "lab_tour" / "faults"


@pytest.fixture
def imported() -> Iterator[Callable[[str], ModuleType]]:
    """The example's scripts, which find one another beside them."""
    sys.path.insert(0, str(BRIDGE))
    names: list[str] = []

    def load(name: str) -> ModuleType:
        names.append(name)
        return __import__(name)

    yield load
    sys.path.remove(str(BRIDGE))
    for name in names:
        sys.modules.pop(name, None)


class TwoWorlds:
    """Two simulated middlewares, and a node of a bridge on each."""

    def __init__(self) -> None:
        self.here, self.there = SimulatedWorld(1, Conditions()), SimulatedWorld(2, Conditions())
        self.bridge_here = SimulatedTransport(self.here, "bridge")
        self.bridge_there = SimulatedTransport(self.there, "bridge")

    def run(self, seconds: float) -> None:
        """Let time pass in both: a hundredth of a second in the one, then in the other."""
        for _ in range(round(seconds * 100)):
            self.here.run_for(0.01)
            self.there.run_for(0.01)


@pytest.fixture
def worlds() -> TwoWorlds:
    return TwoWorlds()


class Home:
    """As much of a transport as waiting takes."""

    def every(self, period_s: float, look: Callable[[], None]) -> Timer:
        self.look = look
        return Timer(0, 0, look)

    def spin(self, until: Callable[[], bool]) -> None:
        while not until():
            self.look()


def test_who_is_never_ready_is_not_waited_for_for_ever(
    tmp_path: Path, imported: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = imported("run")
    monkeypatch.setattr(run, "START_S", 0.5)
    placement = run.read_placement(BRIDGE / "placement.yaml", read_checked([SYSTEM]))
    processes = run._Processes(tmp_path, SYSTEM, placement, "", Home())
    # it stays until it is stopped, or for a minute at most if the test cannot stop it
    speak = "import time; print('waiting for others', flush=True); time.sleep(60)"
    try:
        processes.start("zenoh", [sys.executable, "-c", speak])
        with pytest.raises(
            run.RunError, match=r"zenoh was not ready in 0\.5 s; it said:\nwaiting for"
        ):
            processes.wait("zenoh", "nodes are up")
    finally:
        processes.stop()


def test_messages_cross_in_their_order(worlds: TwoWorlds, imported: Any) -> None:
    imported("forward").forward_topic(NUMBERS, worlds.bridge_here, worlds.bridge_there)
    heard: list[int] = []
    SimulatedTransport(worlds.there, "node").subscribe(NUMBERS, lambda m: heard.append(m.value))
    publisher = SimulatedTransport(worlds.here, "node").publisher(NUMBERS)
    worlds.run(0.1)
    for value in range(5):
        publisher.publish(Number(value))
    worlds.run(0.2)
    assert heard == list(range(5))


def called(worlds: TwoWorlds, handler: Any, timeout_s: float = 5.0) -> CallResult:
    """How a call ends whose server, if there is one, is on the other side."""
    if handler is not None:
        SimulatedTransport(worlds.there, "server").serve(DOUBLE, handler)
    results: list[CallResult] = []
    client = SimulatedTransport(worlds.here, "client").client(DOUBLE)
    worlds.run(0.1)
    client.call(Ask(4), results.append, timeout_s)
    worlds.run(timeout_s + 1.0)
    (result,) = results
    return result


def test_a_call_crosses_and_its_answer_comes_back(worlds: TwoWorlds, imported: Any) -> None:
    imported("forward").forward_service(DOUBLE, worlds.bridge_there, worlds.bridge_here)
    result = called(worlds, lambda request: request.respond(Answer(2 * request.data.value)))
    assert (result.outcome, result.response) == (CallOutcome.RESPONSE, Answer(8))


def test_a_call_that_fails_there_says_here_how(worlds: TwoWorlds, imported: Any) -> None:
    imported("forward").forward_service(DOUBLE, worlds.bridge_there, worlds.bridge_here)
    result = called(worlds, lambda request: request.fail("no"))
    assert result.outcome is CallOutcome.REMOTE_ERROR
    assert "remote_error behind the bridge: no" in result.error


def test_a_call_that_nobody_serves_there_ends_as_an_error(worlds: TwoWorlds, imported: Any) -> None:
    imported("forward").forward_service(DOUBLE, worlds.bridge_there, worlds.bridge_here)
    result = called(worlds, None)
    assert result.outcome is CallOutcome.REMOTE_ERROR
    assert "unavailable behind the bridge" in result.error


def test_a_call_that_is_not_answered_there_times_out_here(worlds: TwoWorlds, imported: Any) -> None:
    imported("forward").forward_service(DOUBLE, worlds.bridge_there, worlds.bridge_here)
    assert called(worlds, lambda request: None, 0.5).outcome is CallOutcome.TIMEOUT


class Pursued:
    """A goal sent here to a server there, and what was heard of it."""

    def __init__(self, worlds: TwoWorlds, goal: Callable[[GoalHandle], None]) -> None:
        self.heard: list[Any] = []
        self.cancelled: list[GoalHandle] = []
        SimulatedTransport(worlds.there, "server").serve_action(
            COUNTING, goal, self.cancelled.append
        )
        self.client = SimulatedTransport(worlds.here, "client").action_client(COUNTING)
        worlds.run(0.1)
        self.id = self.client.send_goal(
            Number(3),
            GoalEvents(
                accepted=lambda _: self.heard.append("accepted"),
                rejected=lambda _: self.heard.append("rejected"),
                feedback=lambda _, message: self.heard.append(message.value),
                result=lambda _, status, message: self.heard.append((status, message.text)),
                failed=lambda _, why: self.heard.append(why),
            ),
        )
        worlds.run(0.5)


@pytest.mark.parametrize(
    ("end", "status"),
    [("succeed", GoalStatus.SUCCEEDED), ("abort", GoalStatus.ABORTED)],
)
def test_a_goal_crosses_with_its_feedback_and_its_end(
    worlds: TwoWorlds, imported: Any, end: str, status: GoalStatus
) -> None:
    imported("forward").forward_action(COUNTING, worlds.bridge_there, worlds.bridge_here)

    def count(handle: GoalHandle) -> None:
        handle.accept()
        for value in range(handle.goal.value):
            handle.publish_feedback(Number(value))
        getattr(handle, end)(Text("done"))

    assert Pursued(worlds, count).heard == ["accepted", 0, 1, 2, (status, "done")]


def test_a_goal_that_is_rejected_there_is_rejected_here(worlds: TwoWorlds, imported: Any) -> None:
    imported("forward").forward_action(COUNTING, worlds.bridge_there, worlds.bridge_here)
    assert Pursued(worlds, lambda handle: handle.reject()).heard == ["rejected"]


def test_a_cancel_request_crosses_and_the_goal_ends_canceled(
    worlds: TwoWorlds, imported: Any
) -> None:
    imported("forward").forward_action(COUNTING, worlds.bridge_there, worlds.bridge_here)
    pursued = Pursued(worlds, lambda handle: handle.accept())
    pursued.client.cancel(pursued.id)
    worlds.run(0.2)
    (handle,) = pursued.cancelled
    handle.canceled(Text("enough"))
    worlds.run(0.2)
    assert pursued.heard == ["accepted", (GoalStatus.CANCELED, "enough")]


@pytest.mark.parametrize(
    "end", [lambda handle: handle.succeed(Text("done")), lambda handle: handle.abort(Text("no"))]
)
def test_a_goal_that_has_ended_there_is_not_cancelled_any_more(
    worlds: TwoWorlds, imported: Any, end: Callable[[GoalHandle], None]
) -> None:
    imported("forward").forward_action(COUNTING, worlds.bridge_there, worlds.bridge_here)
    kept: list[GoalHandle] = []

    def goal(handle: GoalHandle) -> None:
        handle.accept()
        kept.append(handle)

    pursued = Pursued(worlds, goal)
    pursued.client.cancel(pursued.id)
    end(kept[0])  # at the same moment, over there
    worlds.run(0.5)
    assert pursued.cancelled == []
    assert len(pursued.heard) == 2


def test_a_bridge_whose_other_side_fails_ends() -> None:
    code = (
        "import sys\n"
        "import transports.registry as registry\n"
        "connect = registry.connect\n"
        "def fail():\n"
        "    raise RuntimeError('the other side fails')\n"
        "def connect_and_fail(name, node, options):\n"
        "    made = connect('zenoh', node, {})\n"
        "    if name == 'ros2':\n"
        "        made.post(fail)\n"
        "    return made\n"
        "registry.connect = connect_and_fail\n"
        f"sys.path.insert(0, {str(BRIDGE)!r})\n"
        f"sys.argv[1:] = [{str(SYSTEM)!r}, {str(BRIDGE / 'placement.yaml')!r}, '--endpoint', '']\n"
        "import bridge\n"
        "sys.exit(bridge.main())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 1
    assert "the other side fails" in done.stderr


def test_what_crosses_is_what_is_given_on_one_side_and_taken_on_the_other(imported: Any) -> None:
    routes = imported("routes")
    system = read_checked([SYSTEM])
    placement = routes.read_placement(BRIDGE / "placement.yaml", system)
    found = {
        (route.channel.name, route.given, route.taken) for route in routes.routes(system, placement)
    }
    assert ("/PeopleDetectorComponent/is_followed", "ros2", "zenoh") in found
    assert ("/NavigationComponent/GoToPoi", "ros2", "zenoh") in found
    assert ("/BlackboardComponent/GetInt", "zenoh", "ros2") in found
    assert ("/WaitSkill/tick", "ros2", "zenoh") in found  # the policy ticks it
    assert ("/WaitSkill/halt", "ros2", "zenoh") in found
    assert not any(name == "/BatteryComponent/level" for name, _, _ in found)  # stays on its side


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("WaitSkill]", "]", "not placed: WaitSkill"),
        ("WaitSkill]", "WaitSkill, WaltSkill]", "not in the system: WaltSkill"),
        ("WaitSkill]", "WaitSkill, policy]", "placed twice: policy"),
        ("  ros2:", "  third: []\n  ros2:", "3 sides; a bridge has two"),
        ("sides:", "sites:", "unknown field `sites`"),
    ],
)
def test_a_placement_that_cannot_be_is_refused(
    imported: Any, tmp_path: Path, old: str, new: str, problem: str
) -> None:
    routes = imported("routes")
    text = (BRIDGE / "placement.yaml").read_text()
    path = tmp_path / "placement.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(routes.PlacementError, match=re.escape(problem)):
        routes.read_placement(path, read_checked([SYSTEM]))


def test_what_a_bridge_repeats_is_left_out_of_what_all_sides_do(
    worlds: TwoWorlds, imported: Any
) -> None:
    forward = imported("forward")
    forward.forward_topic(NUMBERS, worlds.bridge_here, worlds.bridge_there)
    monitor_here = SimulatedTransport(worlds.here, "monitor")
    monitor_there = SimulatedTransport(worlds.there, "monitor")
    sides = [Side(monitor_here, monitor_here), Side(monitor_there, monitor_here)]
    once: list[Observation] = []
    twice: list[Observation] = []
    AllSides(sides, ["bridge"]).tap([], once.append)
    AllSides(sides, []).tap([], twice.append)
    publisher = SimulatedTransport(worlds.here, "node").publisher(NUMBERS)
    worlds.run(0.1)
    publisher.publish(Number(7))
    worlds.run(0.2)
    assert [seen.source for seen in once] == ["node"]
    published = [seen for seen in twice if seen.kind is ObservationKind.MESSAGE]
    assert sorted(seen.source for seen in published) == ["bridge", "node"]


def test_a_node_is_asked_on_whichever_side_it_is(worlds: TwoWorlds) -> None:
    monitors = [SimulatedTransport(world, "monitor") for world in (worlds.here, worlds.there)]
    sides = [Side(monitor, monitors[0]) for monitor in monitors]
    listener = AllSides(sides, ["bridge"]).tap([], lambda seen: None)
    SimulatedTransport(worlds.there, "node").announce()
    answers: list[object] = []
    listener.ask("node", answers.append)
    listener.ask("nobody", answers.append)
    worlds.run(0.1)
    assert sorted(answer is None for answer in answers) == [False, True]


@pytest.mark.ros2
@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("arguments", "violated"),
    [
        pytest.param([], set(), marks=pytest.mark.soak),
        (["--replace", f"AlarmSkill={FAULTS / 'T4-AlarmSkill.scxml'}"], {"AlarmSkill"}),
    ],
    ids=["as it is", "T4"],
)
def test_a_fault_behind_the_bridge_is_found_and_nobody_else_is_blamed(
    arguments: list[str], violated: set[str]
) -> None:
    """T4 is in AlarmSkill, on ROS 2; the policy that ticks it is on Zenoh."""
    done = subprocess.run(
        [sys.executable, str(BRIDGE / "run.py"), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    said = done.stdout + done.stderr
    assert done.returncode == (1 if violated else 0), said
    lines = [line.split() for line in done.stdout.splitlines() if line]
    assert {line[0] for line in lines if line[1:2] == ["violated"]} == violated, said
    assert ["policy", "conforming"] in [line[:2] for line in lines], said
