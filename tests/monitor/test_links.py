"""A network that is cut: what was under way is charged to nobody; what a node that is reached did not take is."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.feed.reachability import Reachability
from tests.monitor.hand_driven import MS, HandDriven, S

LATENCY = 200 * MS


@pytest.fixture
def hand(tmp_path: Path) -> HandDriven:
    """The skill has answered ticks, and knows its level."""
    hand = HandDriven(tmp_path)
    for name in ("Level", "policy", "Battery"):
        hand.node(name, True)
    for call in range(1, 4):
        hand.message(90)
        hand.tick(call, status=0)
        hand.pass_time(100)
    return hand


def ask(hand: HandDriven, call: int) -> None:
    """The policy's request, which nobody receives."""
    hand.hear("/Level/tick", "request_sent", "t/srv/Tick_Request", {}, "policy", call=call)


def violations(hand: HandDriven) -> list[str]:
    return [verdict.reason for verdict in hand.verdicts if verdict.outcome == "violated"]


@pytest.mark.parametrize("is_slow", [False, True])
def test_a_request_under_way_through_a_network_that_is_cut_is_not_charged(
    hand: HandDriven, is_slow: bool
) -> None:
    """Or that was slow, while both ends were heard in time, and was held up by the cut then."""
    ask(hand, 4)
    if is_slow:
        hand.pass_time(300)
        hand.hear("/other", "request_sent", "t/srv/Tick_Request", {}, "policy", call=1)
        for kind, part, data in (
            ("request_received", "Request", {}),
            ("response_sent", "Response", {"status": 0}),
        ):
            more = {"call": 1, "client": "somebody"}
            hand.hear("/Level/tick", kind, f"t/srv/Tick_{part}", data, "Level", **more)
    hand.pass_time(3000)  # of the side of the skill, nothing comes
    assert {"Level", "policy"} <= set(hand.asked)
    for kind in ("request_received", "response_sent"):  # the network is there again
        data = {} if kind == "request_received" else {"status": 0}
        part = "Request" if kind == "request_received" else "Response"
        hand.hear("/Level/tick", kind, f"t/srv/Tick_{part}", data, "Level", call=4)
    hand.pass_time(2000)
    assert violations(hand) == []
    assert any("the link between policy and Level was down or slow" in text for text in hand.said)


# --- what is counted on --------------------------------------------------------------------------


def test_nodes_are_reached_once_all_were_heard_in_time() -> None:
    reach = Reachability(LATENCY)
    reach.heard("a", 10 * S, 2 * MS)
    assert reach.reached_ns(["a", "b"], 10 * S) is None
    reach.heard("b", 11 * S, 2 * MS)
    assert reach.reached_ns(["a", "b"], 10 * S) == 11 * S
    assert reach.reached_ns(["a", "b"], 10 * S + 1) is None


def test_who_was_heard_late_is_not_counted_on_for_as_long_once_more() -> None:
    reach = Reachability(LATENCY)
    reach.heard("a", 10 * S, 3 * S)  # received at 13 s
    reach.heard("a", 14 * S, MS)
    assert reach.reached_ns(["a"], 10 * S) is None
    reach.heard("a", 17 * S, MS)
    assert reach.reached_ns(["a"], 10 * S) == 17 * S


def test_names_without_end_are_not_kept_without_end() -> None:
    reach = Reachability(LATENCY)
    for number in range(5_000):
        reach.heard(f"n{number}", S, MS)
    assert reach.reached_ns(["n4999"], 0) is None
    assert reach.reached_ns(["n1"], 0) == S
