"""Where a machine's node reports which messages it took, its machine is judged without a latency bound."""

from __future__ import annotations

from typing import Any

import pytest

from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.confirmation import Publishers
from moon.oracle.in_transit import KEPT_MESSAGES
from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from moon.verdict import Outcome
from tests.oracle.machines import library, read
from transports.interface import Observation, ObservationKind

MS = 1_000_000
START = 10**18
BOUNDS = Bounds()
MESSAGE, TAKEN = ObservationKind.MESSAGE, ObservationKind.MESSAGE_TAKEN

DOUBLES = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe"
    initial="idle">
  <datamodel><data id="last" type="int32" expr="0"/></datamodel>
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
  <ros_topic_subscriber topic="/set" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <state id="idle">
    <ros_topic_callback name="/in">
      <ros_topic_publish name="/out"><field name="data" expr="_msg.data * 2 + last"/></ros_topic_publish>
    </ros_topic_callback>
    <ros_topic_callback name="/set"><assign location="last" expr="_msg.data"/></ros_topic_callback>
  </state>
</scxml>
"""


class Probe:
    """The oracle of a machine that takes two topics; times in ms since its start."""

    def __init__(self, *, whole: bool = True, shared: Shared | None = None) -> None:
        machine = read(DOUBLES)
        self.oracle = Oracle(machine, library(), bounds=BOUNDS, synchronised=whole, shared=shared)
        if whole:
            self.oracle.start(START, whole=True)
        self.numbers: dict[tuple[str, str, bool], int] = {}
        self.order = -1

    def see(
        self, kind: ObservationKind, channel: str, data: Any, at: float, now: float, **fields: Any
    ) -> list[Outcome]:
        source = fields.setdefault("source", "Probe")
        place = (source, channel, kind is MESSAGE)
        if "sequence" not in fields:
            fields["sequence"] = self.numbers[place] = self.numbers.get(place, -1) + 1
        if source == "Probe":
            self.order += 1
            fields.setdefault("order", self.order)
        seen = Observation(
            stamp_ns=START + int(at * MS), received_ns=START + int(now * MS), channel=channel,
            kind=kind, type_name="std_msgs/msg/Int32", data=data, **fields,
        )  # fmt: skip
        return [verdict.outcome for verdict in self.oracle.feed(seen)]

    def published(self, value: int, at: float, now: float, **fields: Any) -> list[Outcome]:
        fields = {"source": "other", "channel": "/in", **fields}
        return self.see(MESSAGE, fields.pop("channel"), {"data": value}, at, now, **fields)

    def took(self, number: int, at: float, now: float, **fields: Any) -> list[Outcome]:
        fields = {"client": "other", "call": number, "channel": "/in", **fields}
        return self.see(TAKEN, fields.pop("channel"), None, at, now, **fields)

    def sent(self, value: int, at: float, now: float, **fields: Any) -> list[Outcome]:
        return self.see(MESSAGE, "/out", {"data": value}, at, now, **fields)

    def passed(self, now: float) -> list[Outcome]:
        return [verdict.outcome for verdict in self.oracle.advance(START + int(now * MS))]

    def follow(self) -> None:
        """The node is known to report what it takes."""
        self.published(1, 1, 2)
        self.took(0, 3, 6)
        self.sent(2, 4, 6)


def test_what_follows_from_a_message_that_was_taken_is_judged_at_once() -> None:
    probe = Probe()
    probe.follow()
    assert probe.published(5, 10, 11) == []
    assert probe.took(1, 12, 15) == []
    assert probe.sent(11, 13, 15) == [Outcome.VIOLATED]  # 10 would be right


def test_what_is_right_stays_right_however_late_reports_come() -> None:
    probe = Probe()
    probe.follow()
    said = []
    for number in range(1, 200):
        at = 10 * number
        said += probe.published(number, at, at + 1)
        said += probe.took(number, at + 2, at + 40)
        said += probe.sent(2 * number, at + 3, at + 40)
    assert said + probe.passed(5000) == []
    assert probe.oracle.outcome is Outcome.CONFORMING


@pytest.mark.parametrize(("value", "expected"), [(10, []), (110, [Outcome.VIOLATED])])
def test_the_order_in_which_messages_were_taken_is_what_the_node_says(
    value: int, expected: list[Outcome]
) -> None:
    """Published the other way round: without the reports, both orders would have to be allowed."""
    probe = Probe()
    probe.follow()
    probe.published(100, 10, 11, channel="/set", source="third")
    probe.published(5, 11, 12)
    probe.took(1, 12, 15)
    assert probe.sent(value, 13, 15) == expected
    probe.took(0, 14, 16, channel="/set", client="third")


def test_contents_may_be_received_after_the_report_that_a_message_was_taken() -> None:
    for value, expected in ((10, []), (11, [Outcome.VIOLATED])):
        probe = Probe()
        probe.follow()
        assert probe.took(1, 12, 15) == []
        assert probe.sent(value, 13, 15) == []
        assert probe.published(5, 10, 30) == expected


@pytest.mark.parametrize("lives", [1, 2])
def test_a_message_that_is_received_before_it_is_known_that_its_taker_is_up_is_its_input(
    lives: int,
) -> None:
    probe = Probe(whole=False)
    if lives == 2:
        probe.oracle.start(START - 5_000 * MS)
        probe.follow()
        probe.order = -1
    number = lives - 1
    probe.published(20, 20, 21, sequence=number)
    probe.oracle.start(START + 10 * MS)  # the news that the node is up come last
    said = probe.took(number, 22, 40, sequence=0)
    said += probe.sent(40, 23, 40, sequence=0)
    said += probe.passed(5000)
    assert said == []
    assert probe.oracle.outcome is Outcome.CONFORMING


def test_contents_that_never_come_leave_the_machine_unknown_and_nobody_accused() -> None:
    probe = Probe()
    probe.follow()
    probe.took(1, 12, 15)
    probe.sent(77, 13, 15)
    assert probe.passed(400) == [Outcome.INCONCLUSIVE]


def test_messages_that_are_never_taken_are_a_violation() -> None:
    probe = Probe()
    probe.follow()
    for number in range(2):
        probe.published(5 + number, 10 + number, 11 + number)
    late = 11 + BOUNDS.deadline / MS
    assert probe.passed(late + 100) == []  # the node has not reported so far
    until_ns = START + round((late + 200) * MS)
    said = probe.oracle.reported(probe.order + 1, until_ns, until_ns + MS)
    assert [verdict.outcome for verdict in said] == [Outcome.VIOLATED]
    assert "message 2 of other on /in to be taken" in said[0].reason


@pytest.mark.parametrize("after_ms", [5, 2500])
def test_a_message_that_is_lost_on_its_way_is_a_finding_of_the_link(after_ms: float) -> None:
    probe = Probe()
    probe.follow()
    probe.published(5, 10, 11)
    said = probe.passed(10 + after_ms - 1)
    at = 10 + after_ms
    probe.published(6, at, at + 1)
    said += probe.took(2, at + 2, at + 20)
    said += probe.sent(12, at + 3, at + 20)
    said += probe.passed(5000)
    assert said == []
    assert probe.oracle.outcome is Outcome.CONFORMING
    assert probe.oracle.take_findings(0) == [
        "the link between other and Probe lost message 1 on /in, or was slow"
    ]


def test_a_node_that_says_it_did_nothing_more_owes_what_it_did_not_send() -> None:
    probe = Probe()
    probe.follow()
    probe.published(5, 10, 11)
    probe.took(1, 12, 15)
    due = probe.oracle.silent_ns
    assert due == START + 12 * MS + BOUNDS.deadline
    answered = [
        v.outcome for v in probe.oracle.reported(probe.order + 1, due + 2 * MS, due + 3 * MS)
    ]
    assert answered == [Outcome.VIOLATED]
    assert probe.oracle.verdict().reason.startswith("unresponsive")


def test_an_answer_that_names_more_than_was_received_waits_for_the_rest() -> None:
    probe = Probe()
    probe.follow()
    probe.published(5, 10, 11)
    probe.took(1, 12, 15)
    due = probe.oracle.silent_ns
    assert probe.oracle.reported(probe.order + 2, due + 2 * MS, due + 3 * MS) == []
    assert probe.sent(10, 13, due / MS - START / MS + 4) == []
    assert probe.oracle.outcome is Outcome.CONFORMING
    assert probe.oracle.silent_ns == FOREVER


def test_a_stranger_whose_messages_have_no_numbers_is_judged_by_the_latency_bound() -> None:
    probe = Probe()
    probe.follow()
    assert probe.published(5, 10, 11, sequence=-1, source="stranger") == []
    assert probe.sent(10, 13, 15) == []
    assert probe.passed(1000) == []
    assert probe.sent(11, 1013, 1015) + probe.passed(2000) == [Outcome.VIOLATED]


def test_a_message_in_the_name_of_nobody_known_need_not_be_taken() -> None:
    probe = Probe(shared=Shared(publishers=Publishers(callers=["other"])))
    probe.follow()
    probe.published(5, 10, 11, source="evil")
    assert probe.published(6, 3000, 3001) == []
    assert probe.took(1, 3002, 3020) + probe.sent(12, 3003, 3020) == []


def test_a_lost_report_leaves_the_machine_unknown_and_nobody_accused() -> None:
    probe = Probe()
    probe.follow()
    probe.published(5, 10, 11)
    probe.order += 1  # the report that it took it
    probe.numbers["Probe", "/in", False] += 1
    said = probe.sent(10, 13, 15) + probe.passed(3000)
    assert Outcome.VIOLATED not in said


def test_found_in_the_middle_a_node_that_reports_is_known_when_it_takes_something() -> None:
    probe = Probe(whole=False)
    probe.oracle.listen(START)
    probe.numbers["other", "/in", True] = 6
    probe.order = 40
    for number in range(7, 60):
        at = 10 * number
        probe.published(1, at, at + 1)
        probe.took(number, at + 2, at + 5)
        assert Outcome.VIOLATED not in probe.sent(2, at + 3, at + 5)
        probe.passed(at + 6)
    assert probe.oracle.is_synchronised


def test_what_is_kept_of_messages_has_a_limit() -> None:
    probe = Probe()
    probe.follow()
    for number in range(1, 2 * KEPT_MESSAGES):
        probe.published(number, 10 + number / 1000, 11 + number / 1000)
    assert len(probe.oracle._takes._contents) == KEPT_MESSAGES


@pytest.mark.parametrize("late", [0, 150])
def test_a_message_judged_before_the_first_report_is_not_judged_twice(late: int) -> None:
    """The node's first report comes when the message has been judged by when it was published."""
    probe = Probe()
    probe.published(1, 1, 2)
    probe.passed(1 + BOUNDS.latency / MS + 10)
    at = 1 + BOUNDS.latency / MS - 5
    said = probe.took(0, at, at + 10 + late) + probe.sent(2, at + 1, at + 10 + late)
    assert said + probe.passed(3000) == []


def test_a_message_that_was_presumed_taken_and_was_taken_later_leaves_the_machine_unknown() -> None:
    """What was under way for longer than the latency bound, before its taker is known to report what it takes."""
    probe = Probe()
    probe.published(1, 1, 2)
    probe.passed(1 + BOUNDS.latency / MS + 10)
    at = 1 + BOUNDS.latency / MS + 50
    said = probe.took(0, at, at + 1) + probe.sent(2, at + 1, at + 1) + probe.passed(at + 1000)
    assert said == [Outcome.INCONCLUSIVE]


def test_a_message_that_is_never_taken_is_one_though_the_node_goes_on_to_take_others() -> None:
    """What is judged at once does not make it forgotten when the message is overdue."""
    probe = Probe()
    probe.follow()
    probe.published(5, 10, 11)
    probe.published(6, 10, 11, channel="/set", source="third")
    probe.took(0, 12, 15, channel="/set", client="third")
    due = START + 10 * MS + BOUNDS.deadline
    assert probe.oracle.wake <= due
