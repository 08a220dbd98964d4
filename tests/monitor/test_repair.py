"""A monitor that was held up, on a middleware that sends again what it could not take meanwhile."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.recording.entries import Began, Entry
from moon.sources.played import Player
from moon.sources.recorded import RecordedConnection
from tests.monitor import hand_driven
from tests.monitor.hand_driven import HandDriven, S
from transports.interface import ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld

BEATING = """\
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Level" initial="on">
  <ros_topic_publisher topic="/battery" type="t/Level"/>
  <ros_time_rate name="beat" rate_hz="2"/>
  <state id="on">
    <ros_rate_callback name="beat">
      <ros_topic_publish name="/battery"><field name="data" expr="0"/></ros_topic_publish>
    </ros_rate_callback>
  </state>
</scxml>
"""


class Repairing(HandDriven):
    """As Fast DDS: what came while a process stood still is there at the latest 3.2 s after."""

    repair_s = 3.2


@pytest.fixture
def held_up(tmp_path: Path) -> Repairing:
    hand = Repairing(tmp_path)
    hand.node("Level", True)
    hand.pass_time(1000)
    hand.message(90)
    hand.tick(1, status=0)
    hand.pass_time(1000)
    assert hand.watch.violations == 0
    hand.jump(3 * S)
    return hand


@pytest.mark.parametrize("is_repaired", [True, False])
def test_nobody_is_blamed_while_something_may_still_be_sent_again(
    held_up: Repairing, is_repaired: bool
) -> None:
    held_up.pass_time(1000)
    held_up.message(90, sequence=2)
    held_up.pass_time(1000)
    held_up.tick(2, status=1)  # the level of 20 before it is still to be sent again
    held_up.pass_time(1000)
    assert not held_up.said
    if is_repaired:
        held_up.message(20, sequence=1, stamp_ns=held_up.now - 4 * S)
    held_up.pass_time(3000)
    assert held_up.watch.violations == 0
    assert held_up.watch.summary().counts.stalls == (not is_repaired)
    assert any("stood still for 3.0 s" in text for text in held_up.said)


def test_what_happens_after_that_is_judged_again(held_up: Repairing) -> None:
    held_up.pass_time(1000)
    held_up.message(90, sequence=2)
    held_up.pass_time(2500)
    assert held_up.watch.summary().counts.stalls == 1
    held_up.message(90, sequence=3)
    held_up.pass_time(5000)  # the battery, which announces nothing, is linked for sure
    held_up.tick(2, status=1)  # a level before the first one may have been lost
    held_up.confirm()
    held_up.confirm()
    held_up.tick(3, status=1)  # one message may have been lost on its way
    held_up.confirm()
    held_up.confirm()
    held_up.tick(4, status=1)
    held_up.confirm()
    assert held_up.watch.violations == 1


def test_what_a_node_that_starts_sends_may_be_heard_seconds_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its channels are subscribed to one by one: silence counts where it was heard, else after 5 s."""
    monkeypatch.setattr(hand_driven, "LEVEL", BEATING)
    late, silent, stops = (Repairing(tmp_path / name) for name in ("late", "silent", "stops"))
    for hand in (late, silent, stops):
        hand.pass_time(100)
        hand.node("Level", True)
    for hand in (late, stops):
        hand.pass_time(3200)
        for _ in range(8):
            hand.message(0, source="Level")
            hand.pass_time(500)
        assert hand.watch.violations == 0
        assert hand.status.verdict == "conforming"
    stops.pass_time(1500)
    assert "unresponsive" in stops.verdicts[-1].reason
    silent.pass_time(5000)
    assert not any("unresponsive" in verdict.reason for verdict in silent.verdicts)
    silent.pass_time(3000)
    assert "unresponsive" in silent.verdicts[-1].reason


@pytest.mark.parametrize("is_claimed", [False, True])
def test_silence_before_several_nodes_claim_a_name_may_be_the_end_of_one(
    tmp_path: Path, is_claimed: bool
) -> None:
    """DDS shows one that was killed for 20 s, beside the one that was started in its name."""
    hand = Repairing(tmp_path)
    hand.node("Level", True)
    hand.pass_time(1000)
    hand.message(90)
    hand.tick(1, status=0)
    hand.pass_time(6000)
    hand.tick(2)
    hand.pass_time(2000)
    hand.contested = ("Level",) if is_claimed else ()
    for call in range(3, 20):
        hand.message(90)
        hand.tick(call, status=0)
        hand.pass_time(500)
    hand.contested = ()
    for call in range(20, 30):
        hand.message(90)
        hand.tick(call, status=0)
        hand.pass_time(500)
    assert hand.watch.violations == (not is_claimed)


@pytest.mark.parametrize(("first", "violations"), [(1, 1), (13, 0)])
def test_of_a_node_whose_first_calls_were_missed_the_state_is_not_known(
    tmp_path: Path, first: int, violations: int
) -> None:
    """A middleware that links channel by channel may link a node to its callers before the monitor."""
    hand = Repairing(tmp_path)
    hand.message(90)
    for node in ("policy", "Level"):
        hand.node(node, True)
    hand.pass_time(100)
    hand.tick(first, status=1)
    for _ in range(2):
        hand.confirm()
    assert hand.watch.violations == violations
    reasons = [verdict.reason for verdict in hand.verdicts]
    assert ("the first calls of policy to /Level/tick were missed" in reasons) == (first > 1)


@pytest.mark.parametrize("end", ["policy", "Level"])
def test_of_a_node_that_answered_before_it_was_heard_to_be_asked_the_state_is_not_known(
    tmp_path: Path, end: str
) -> None:
    """Who reports a response first has not reported the request: nobody listened to it then."""
    hand = Repairing(tmp_path)
    hand.message(90)
    for node in ("policy", "Level"):
        hand.node(node, True)
    hand.pass_time(100)
    kind = ObservationKind.RESPONSE_RECEIVED if end == "policy" else ObservationKind.RESPONSE_SENT
    hand.hear("/Level/tick", kind, "t/srv/Tick_Response", {"status": 0}, end, call=1)
    for _ in range(2):
        hand.confirm()
    hand.pass_time(6000)
    assert hand.watch.violations == 0
    reasons = [verdict.reason for verdict in hand.verdicts]
    assert f"what {end} did first in calls of /Level/tick was missed" in reasons


@pytest.mark.parametrize("is_received", [False, True], ids=["missed", "received_later"])
def test_a_call_that_failed_was_made_before(tmp_path: Path, is_received: bool) -> None:
    """What a client reports of a call that failed has no number, and comes to who listens late; on ROS 2 it
    may also come before the request, which is on another topic.
    """
    hand = Repairing(tmp_path)
    hand.message(90)
    for node in ("policy", "Level"):
        hand.node(node, True)
    hand.pass_time(100)
    request_ns, service = hand.now, ("/Level/tick", "t/srv/Tick")
    hand.hear(
        service[0],
        ObservationKind.RESPONSE_RECEIVED,
        f"{service[1]}_Response",
        None,
        "policy",
        call=1,
        error="timeout",
        sequence=-1,
    )
    if is_received:
        hand.pass_time(30)
        kind = ObservationKind.REQUEST_SENT
        hand.hear(
            service[0],
            kind,
            f"{service[1]}_Request",
            {},
            "policy",
            call=1,
            sequence=0,
            stamp_ns=request_ns,
        )
    for _ in range(2):
        hand.confirm()
    reasons = [verdict.reason for verdict in hand.verdicts]
    assert ("what policy did first in calls of /Level/tick was missed" in reasons) != is_received
    assert hand.watch.violations == 0


def test_a_server_that_starts_again_had_no_earlier_calls_in_this_life(tmp_path: Path) -> None:
    hand = Repairing(tmp_path)
    for node in ("policy", "Level"):
        hand.node(node, True)
    hand.message(90)
    hand.tick(1, status=0)
    hand.confirm()
    hand.node("Level", False)
    hand.pass_time(1000)
    hand.forget_numbers("Level")
    hand.node("Level", True)
    hand.tick(100, status=1)
    assert not any("were missed" in verdict.reason for verdict in hand.verdicts)
    hand.confirm()
    hand.confirm()
    assert hand.watch.violations == 1


def test_a_recording_keeps_how_long_the_middleware_repairs() -> None:
    connection = SimulatedTransport(SimulatedWorld(1), "monitor")
    connection.repair_s = 3.2
    entries: list[Entry] = []
    recorded = RecordedConnection(connection, entries.append, "simulated")
    recorded.tap([], lambda _: None)
    assert recorded.repair_s == 3.2
    began, _ = entries
    assert isinstance(began, Began)
    player = Player(early_ns=0)
    player.start(began, lambda: None)
    assert player.repair_s == 3.2
