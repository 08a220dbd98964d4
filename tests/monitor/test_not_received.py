"""A channel that a tap cannot receive, or a node may not take: who uses it is not judged."""

from __future__ import annotations

import pytest

from tests.monitor.hand_driven import HandDriven, S
from tests.monitor.test_properties import Watched
from transports.interface import ObservationKind

WHY = "/told is not received: its type cannot be loaded"
TOLD = """\
ports:
  battery: {topic: /battery, field: data}
  told: {topic: /told}
properties:
  - {id: P, pattern: response, request: battery < 30, response: told, within: 1 s}
"""


@pytest.mark.parametrize("is_received", [False, True])
def test_a_machine_that_sends_on_it_is_not_judged(relay: HandDriven, is_received: bool) -> None:
    if not is_received:
        relay.unread = {"/told": WHY}
    relay.node("Level", True, since=relay.now - S)
    relay.node("Battery", True, since=relay.now - S)
    relay.pass_time(6500)
    relay.message(70)
    relay.pass_time(3000)
    said = any("unresponsive" in verdict.reason for verdict in relay.verdicts)
    assert said == is_received


@pytest.mark.parametrize("channel", ["/battery", "/told", "/other"])
@pytest.mark.parametrize("taker", ["Level", "Battery"])
def test_a_machine_is_not_judged_by_what_it_may_not_take(
    relay: HandDriven, channel: str, taker: str
) -> None:
    relay.unsure = {(channel, taker): "messages may be dropped: it subscribes with best effort"}
    relay.node("Level", True, since=relay.now - S)
    relay.node("Battery", True, since=relay.now - S)
    relay.pass_time(6500)
    relay.message(70)
    relay.pass_time(3000)
    said = any("unresponsive" in verdict.reason for verdict in relay.verdicts)
    assert said == ((channel, taker) != ("/battery", "Level"))


@pytest.mark.parametrize("is_received", [False, True])
def test_a_property_about_it_is_not_violated(tmp_path, is_received: bool) -> None:
    watched = Watched(tmp_path, TOLD)
    if not is_received:
        watched.unread = {"/told": WHY}
    for name in ("Level", "Battery", "policy"):
        watched.node(name, True)
    watched.message(90)
    watched.pass_time(500)
    watched.message(20)
    watched.pass_time(3000)
    assert (watched.of("P")[-1] == "violated") == is_received


def test_what_nobody_uses_changes_nothing(tmp_path) -> None:
    watched = Watched(tmp_path, TOLD)
    watched.unread = {f"/camera{number}": "no such type" for number in range(100)}
    for name in ("Level", "Battery", "policy"):
        watched.node(name, True)
    watched.message(90)
    watched.tick(1, 0)
    watched.pass_time(500)
    watched.message(20)
    watched.tick(2, 1)
    watched.pass_time(3000)
    assert watched.of("P") == ["conforming", "violated"]
    assert watched.outcomes.count("inconclusive") == 0


CALL = (
    (ObservationKind.REQUEST_SENT, "policy"),
    (ObservationKind.REQUEST_RECEIVED, "Level"),
    (ObservationKind.RESPONSE_SENT, "Level"),
    (ObservationKind.RESPONSE_RECEIVED, "policy"),
)


@pytest.mark.parametrize("has_contents", [False, True])
def test_calls_of_which_the_contents_are_not_shown_accuse_nobody(
    tmp_path, has_contents: bool
) -> None:
    """Service introspection may show that there was a call only. A request has nothing to show here."""
    it = HandDriven(tmp_path)
    for name in ("Level", "Battery", "policy"):
        it.node(name, True, since=it.now - S)
    it.pass_time(6500)
    it.message(20)
    it.pass_time(500)
    for call in range(1, 6):
        for kind, source in CALL:
            is_answer = "response" in kind
            data = {"status": 0} if is_answer and has_contents else None
            type_name = f"t/srv/Tick_{'Response' if is_answer else 'Request'}"
            it.hear("/Level/tick", kind, type_name, data, source, call=call)
        it.pass_time(500)
        it.message(20)
    assert ("violated" in it.outcomes) == has_contents
    if has_contents:
        (wrong,) = {verdict.explanation.expected for verdict in it.verdicts if verdict.explanation}
        assert "status: 1" in wrong[0]
