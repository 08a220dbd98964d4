"""A node that owes something is asked how far it has reported; time and answers by hand."""

from __future__ import annotations

import pytest

from tests.monitor.hand_driven import MS, HandDriven, S
from transports.interface import Answer, ObservationKind

DEADLINE_MS = 1000
"""Of the models, as it is by default."""


class Numbering(HandDriven):
    """A system whose Level numbers all that it reports."""

    order = -1

    def own(self, kind: ObservationKind, call: int, status: int | None = None) -> None:
        self.order += 1
        part = "Request" if status is None else "Response"
        data = {} if status is None else {"status": status}
        self.hear(
            "/Level/tick", kind, f"t/srv/Tick_{part}", data, "Level", call=call, order=self.order
        )

    def request(self, call: int) -> None:
        self.own(ObservationKind.REQUEST_RECEIVED, call)

    def respond(self, call: int, status: int) -> None:
        self.own(ObservationKind.RESPONSE_SENT, call, status)

    def answer(self, number: int | None = None) -> None:
        """Level answers that it has done ``number`` things (None: those that were received) until now."""
        answered = self.asked.pop("Level")
        answered(Answer(self.now, self.order + 1 if number is None else number))


@pytest.fixture
def it(tmp_path) -> Numbering:
    it = Numbering(tmp_path)
    it.pass_time(100)
    it.node("Level", True)
    it.answer()
    it.pass_time(500)
    it.request(1)
    it.respond(1, status=0)
    it.pass_time(500)
    assert it.outcomes == ["conforming"]
    return it


def test_a_node_that_comes_up_is_asked(tmp_path) -> None:
    it = Numbering(tmp_path)
    it.pass_time(100)
    assert not it.asked
    it.node("Level", True)
    assert list(it.asked) == ["Level"]


def test_what_did_not_come_is_a_violation_as_soon_as_its_node_answers(it) -> None:
    it.request(2)
    asked_ns = it.now
    it.pass_time(DEADLINE_MS - 20)
    assert not it.asked
    it.pass_time(40)
    it.answer()
    (wrong,) = [verdict for verdict in it.verdicts if verdict.explanation]
    assert it.watch.violations == 1
    assert wrong.reason.startswith("unresponsive: ")
    assert it.now - asked_ns < S + 30 * MS


def test_what_was_sent_before_the_answer_and_is_received_after_it_is_no_violation(it) -> None:
    it.request(2)
    it.pass_time(DEADLINE_MS + 20)
    it.answer(it.order + 2)
    sent = it.now - 30 * MS  # in time
    it.pass_time(5)
    it.order += 1
    it.hear(
        "/Level/tick", ObservationKind.RESPONSE_SENT, "t/srv/Tick_Response", {"status": 0}, "Level",
        call=2, order=it.order, stamp_ns=sent,
    )  # fmt: skip
    it.pass_time(2000)
    assert it.watch.violations == 0


def test_a_node_that_does_not_answer_is_judged_by_the_latency_bound(it) -> None:
    it.request(2)
    it.pass_time(DEADLINE_MS + 20)
    it.asked.pop("Level")(None)
    assert it.outcomes == ["conforming"]
    it.pass_time(300)
    assert it.outcomes == ["conforming", "inconclusive"]  # as nobody shows that nothing is missing


def test_a_node_is_asked_once_for_each_thing_that_is_due(it) -> None:
    it.request(2)
    it.pass_time(DEADLINE_MS + 20)
    assert it.asked.pop("Level")
    it.pass_time(100)
    assert not it.asked


def test_a_node_that_owes_nothing_is_not_asked(it) -> None:
    for call in range(2, 50):
        it.request(call)
        it.respond(call, status=0)
        it.pass_time(100)
    it.pass_time(5000)
    assert not it.asked
