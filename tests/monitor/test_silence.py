"""A node that owes something is asked how far it has reported; time and answers by hand."""

from __future__ import annotations

import pytest

from moon.verdict import Cause
from tests.monitor import hand_driven
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

    def count(self, *numbers: int) -> None:
        """Level sends ``numbers``, two a second, and answers after each."""
        for number in numbers:
            self.order += 1
            self.message(number, source="Level", order=self.order)
            if "Level" in self.asked:
                self.answer()
            self.pass_time(500)

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


COUNTING = """\
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Level" initial="on">
  <ros_topic_publisher topic="/battery" type="t/Level"/>
  {declared}
  <datamodel><data id="count" type="int32" expr="0"/></datamodel>
  <state id="on">
    {begins}
    <{taken} target="on">
      <assign location="count" expr="count + 1"/>
      <ros_topic_publish name="/battery"><field name="data" expr="count"/></ros_topic_publish>
    </{closed}>
  </state>
</scxml>
"""
TIMERS = {
    "rate": COUNTING.format(
        declared='<ros_time_rate name="beat" rate_hz="2"/>',
        begins="",
        taken='ros_rate_callback name="beat"',
        closed="ros_rate_callback",
    ),
    "delay": COUNTING.format(
        declared="",
        begins='<onentry><send event="beat" delay="500ms"/></onentry>',
        taken='transition event="beat"',
        closed="transition",
    ),
}


@pytest.mark.parametrize("timer", TIMERS)
@pytest.mark.parametrize("stands_still_s", [1.7, 3.2, 9.2])
def test_a_node_that_goes_on_after_it_stood_still_was_silent_once(
    tmp_path, monkeypatch: pytest.MonkeyPatch, timer: str, stands_still_s: float
) -> None:
    """What comes late is what was expected, and not something else."""
    monkeypatch.setattr(hand_driven, "LEVEL", TIMERS[timer])
    it = Numbering(tmp_path)
    it.pass_time(100)
    it.node("Level", True)
    it.pass_time(500)
    it.count(1, 2, 3, 4)
    assert it.outcomes == ["conforming"]
    it.pass_time(round(stands_still_s * 1000))
    it.answer()
    assert it.watch.violations == 1
    it.count(5, 6, 7, 8, 9)
    (wrong,) = [verdict for verdict in it.verdicts if verdict.explanation]
    assert wrong.cause is Cause.UNRESPONSIVE
    it.count(20)
    assert it.watch.violations == 2


@pytest.mark.parametrize("late_s", [1.7, 3.2, 9.2])
def test_an_answer_that_comes_late_is_late_once(it, late_s: float) -> None:
    it.request(2)
    it.pass_time(DEADLINE_MS + 20)
    it.answer()
    it.pass_time(round(late_s * 1000) - DEADLINE_MS)
    it.respond(2, status=0)
    for call in range(3, 6):
        it.pass_time(500)
        it.request(call)
        it.respond(call, status=0)
    it.pass_time(500)
    (wrong,) = [verdict for verdict in it.verdicts if verdict.explanation]
    assert wrong.cause is Cause.UNRESPONSIVE


def test_a_node_that_leaves_something_out_and_goes_on_did_so_once(
    tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hand_driven, "LEVEL", TIMERS["rate"])
    it = Numbering(tmp_path)
    it.pass_time(100)
    it.node("Level", True)
    it.pass_time(500)
    it.count(1, 2, 3)
    it.pass_time(500)
    it.count(5, 6, 7)
    assert it.watch.violations == 1


@pytest.mark.parametrize("says_what_it_takes", [False, True])
@pytest.mark.parametrize("period_ms", [100, 500])
@pytest.mark.parametrize("stands_still_ms", [1700, 3000, 6000])
def test_a_node_that_does_late_what_it_was_given_meanwhile_was_silent_once(
    relay: HandDriven, says_what_it_takes: bool, period_ms: int, stands_still_ms: int
) -> None:
    relay.node("Level", True, since=relay.now - S)
    relay.node("Battery", True, since=relay.now - S)
    relay.pass_time(6500)

    def tell(level: int, call: int) -> None:
        if says_what_it_takes:
            kind = ObservationKind.MESSAGE_TAKEN
            place = {"client": "Battery", "call": call, "sequence": -1}
            relay.hear("/battery", kind, "t/msg/Level", None, "Level", **place)
        data = {"data": level}
        relay.hear("/told", ObservationKind.MESSAGE, "t/msg/Level", data, "Level")

    for call in range(6):
        relay.message(call)
        tell(call, call)
        relay.pass_time(500)
    given = range(6, 6 + stands_still_ms // period_ms)
    for call in given:
        relay.message(call)
        relay.pass_time(period_ms)
    for call in given:
        tell(call, call)
        relay.pass_time(3)
    for call in range(given.stop, given.stop + 6):
        relay.message(call)
        tell(call, call)
        relay.pass_time(500)
    relay.pass_time(1500)
    wrong = [verdict.cause for verdict in relay.verdicts if verdict.explanation]
    # it may say later when it took something
    assert len(wrong) == (not says_what_it_takes)
    assert all(cause is Cause.UNRESPONSIVE for cause in wrong)
