"""A monitor that joins a running system begins when its tap is complete."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from moon.sources.live import Joining
from moon.tap.completeness import AT_MOST_S
from tests.monitor.hand_driven import HandDriven, S
from transports.interface import Observation, ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld


class Slow(SimulatedTransport):
    """Its tap is complete when a test says so."""

    def __init__(self, world: SimulatedWorld) -> None:
        super().__init__(world, "monitor")
        self.is_complete = False
        self.hear: Callable[[Observation], None] | None = None

    def tap(self, channels, handler):
        self.hear = handler
        return self

    def problems(self):
        return ()


def seen(data: int) -> Observation:
    return Observation(
        stamp_ns=0, received_ns=0, channel="/c", kind=ObservationKind.MESSAGE,
        type_name="t/msg/T", data={"data": data}, source="n",
    )  # fmt: skip


@pytest.fixture
def world() -> SimulatedWorld:
    return SimulatedWorld(1)


def test_what_comes_before_the_tap_is_complete_is_left_out(world: SimulatedWorld) -> None:
    slow = Slow(world)
    SimulatedTransport(world, "early").announce()
    joining = Joining(slow)
    heard: list[object] = []
    nodes: list[tuple[str, bool]] = []

    def begin() -> None:
        joining.tap([], lambda item: heard.append(item.data))
        joining.watch_nodes(lambda name, up: nodes.append((name, up)))

    joining.when_complete(begin, pytest.fail)
    world.run_for(0.5)
    slow.hear(seen(1))
    assert not heard
    slow.is_complete = True
    world.run_for(0.5)
    slow.hear(seen(2))
    assert heard == [{"data": 2}]
    assert nodes == [("early", True)]
    SimulatedTransport(world, "late").announce()
    world.run_for(0.5)
    assert nodes == [("early", True), ("late", True)]


def test_a_graph_that_goes_on_changing_is_not_waited_for_without_end(world: SimulatedWorld) -> None:
    said: list[str] = []
    begun: list[int] = []
    Joining(Slow(world)).when_complete(lambda: begun.append(world.now_ns), said.append)
    world.run_for(AT_MOST_S + 1)
    assert len(begun) == 1
    assert said == [
        "warning: the graph still changes: monitoring begins before all nodes are known"
    ]


def test_a_request_to_a_node_that_was_just_found_may_have_been_taken_up_unheard(tmp_path) -> None:
    hand = HandDriven(tmp_path)
    hand.pass_time(100)
    hand.node("Level", True, since=hand.now - 10 * S)
    hand.tick(1, status=0)
    hand.pass_time(500)
    ask(hand, 2)
    hand.pass_time(5000)
    assert hand.watch.violations == 0
    ask(hand, 3)
    hand.pass_time(1500)
    hand.confirm()
    assert hand.watch.violations == 1


def ask(hand: HandDriven, call: int) -> None:
    hand.hear("/Level/tick", "request_sent", "t/srv/Tick_Request", {}, "policy", call=call)


def test_a_callback_that_somebody_wrote_may_take_until_the_deadline(tmp_path: Path) -> None:
    """Of a plain node of ROS 2 nobody says that it is there, and its answers may take a while."""
    it = HandDriven(tmp_path)
    it.repair_s = 0.2

    def call(number: int, takes_ms: int) -> None:
        asked = ("/Level/tick", "request_received", "t/srv/Tick_Request", {})
        it.hear(*asked, "Level", call=number)
        it.pass_time(takes_ms)
        answer(number)

    def answer(number: int) -> None:
        answered = ("/Level/tick", "response_sent", "t/srv/Tick_Response", {"status": 1})
        it.hear(*answered, "Level", call=number)

    it.pass_time(6500)
    it.message(20)
    it.pass_time(300)
    answer(1)  # of what was asked before anything was received of it
    it.pass_time(90)
    for number in range(2, 12):
        call(number, 400)
        it.pass_time(600)
        it.message(20)
    assert "violated" not in it.outcomes
    assert it.outcomes[-1] == "conforming"


@pytest.mark.parametrize("takes_ms", [50, 300, 500, 700])
def test_a_callback_that_takes_a_message_may_take_until_the_deadline(
    relay: HandDriven, takes_ms: int
) -> None:
    it = relay
    it.pass_time(6000 + 995 - takes_ms)
    for level in range(50, 70):
        it.message(level)
        it.pass_time(takes_ms)
        it.hear("/told", "message", "t/msg/Level", {"data": level}, "Level")
        it.pass_time(1001 - takes_ms)
    assert "violated" not in it.outcomes
    assert it.outcomes[-1] == "conforming"
