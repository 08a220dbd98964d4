"""Where a machine's own node tells in what order it did things, nothing is waited for."""

from __future__ import annotations

from typing import Any

import pytest

from moon.feed.progress import KEPT_AHEAD, KEPT_HOLES, Progress
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from tests.oracle.machines import library, read
from transports.interface import Observation, ObservationKind

MS = 1_000_000
START = 10**18

ASKS = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe"
    initial="idle">
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  {more}
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask">
        <field name="value" expr="_req.value + 1"/>
      </ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""
CALLS = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe"
    initial="idle">
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_service_client service_name="/Other/ask" type="probe_interfaces/Ask"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask" target="asking">
      <ros_service_send_request name="/Other/ask"><field name="value" expr="1"/></ros_service_send_request>
    </ros_service_handle_request>
  </state>
  <state id="asking">
    <ros_service_handle_response name="/Other/ask" target="idle">
      <ros_service_send_response name="/Probe/ask">
        <field name="value" expr="2"/>
      </ros_service_send_response>
    </ros_service_handle_response>
  </state>
</scxml>
"""
LISTENS = """
  <datamodel><data id="last" type="int32" expr="0"/></datamodel>
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
"""
ADDS = ASKS.replace("""_req.value + 1"/>""", """_req.value + 1 + last"/>""").replace(
    """    </ros_service_handle_request>""",
    """    </ros_service_handle_request>
    <ros_topic_callback name="/in"><assign location="last" expr="_msg.data"/></ros_topic_callback>""",
)
"""Messages on the topic make a difference to its answers."""


def test_without_a_gap_all_is_heard_until_the_last():
    progress = Progress()
    for order, stamp in enumerate((10, 20, 30)):
        progress.take(order, stamp, 0)
        assert progress.reported_ns == stamp


def test_what_comes_after_a_gap_waits_for_what_is_missing():
    progress = Progress()
    progress.take(0, 10, 0)
    progress.take(3, 40, 0)
    progress.take(2, 30, 0)
    assert progress.reported_ns == 10
    progress.take(1, 20, 0)
    assert progress.reported_ns == 40


def test_what_is_missing_for_longer_than_the_bound_is_not_waited_for():
    progress = Progress()
    progress.take(5, 50, 0)  # a tap that joins later: no first number
    progress.take(6, 60, 0)
    assert progress.reported_ns == 0
    progress.take(8, 80, 55)
    assert progress.reported_ns == 60
    assert progress.gap == 50
    progress.take(7, 70, 55)
    assert progress.reported_ns == 80


def test_a_number_that_came_before_changes_nothing():
    progress = Progress()
    progress.take(0, 10, 0)
    progress.take(1, 20, 0)
    progress.take(0, 99, 0)
    assert progress.reported_ns == 20


def test_what_is_ahead_of_a_gap_is_bounded():
    progress = Progress()
    for order in range(1, 3 * KEPT_AHEAD):
        progress.take(order, order, 0)
    assert len(progress.ahead) <= KEPT_AHEAD


class Asked:
    """The oracle of a machine that answers questions, and what it hears; nothing comes late."""

    def __init__(self, more: str = "") -> None:
        machine = read((ADDS if more else ASKS).format(more=more))
        self.oracle = Oracle(machine, library(), bounds=Bounds())
        self.oracle.start(START, whole=True)
        self.now = START
        self.order = self.number = -1

    def hear(self, kind: ObservationKind, data: Any, call: int, **changes: Any) -> list[Outcome]:
        """The outcomes said at once when this is heard, 2 ms after it happened."""
        self.now += 10 * MS
        self.order += 1
        self.number += 1
        fields = {
            "stamp_ns": self.now - 2 * MS,
            "received_ns": self.now,
            "sequence": self.number,
            "order": self.order,
            "client": "somebody",
        } | changes
        seen = Observation(
            channel="/Probe/ask", kind=kind, type_name="", data=data, source="Probe", call=call,
            **fields,
        )  # fmt: skip
        return [verdict.outcome for verdict in self.oracle.feed(seen)]

    def question(self, call: int, **changes: Any) -> list[Outcome]:
        return self.hear(ObservationKind.REQUEST_RECEIVED, {"value": 1}, call, **changes)

    def answer(self, call: int, total: int, **changes: Any) -> list[Outcome]:
        return self.hear(
            ObservationKind.RESPONSE_SENT, {"value": total, "ok": False}, call, **changes
        )


def test_a_wrong_answer_is_said_when_it_is_heard():
    asked = Asked()
    assert asked.question(1) == []
    assert asked.answer(1, 2) == []
    asked.question(2)
    assert asked.answer(2, 3) == [Outcome.VIOLATED]


def test_a_wrong_answer_waits_for_the_bound_where_something_may_be_under_way():
    asked = Asked(LISTENS)
    asked.question(1)
    assert asked.answer(1, 3) == []
    stamp = asked.now - 2 * MS
    assert asked.oracle.advance(stamp + 199 * MS) == []
    assert [v.outcome for v in asked.oracle.advance(stamp + 200 * MS)] == [Outcome.VIOLATED]


def test_a_wrong_answer_after_a_gap_in_the_order_is_no_violation():
    asked = Asked()
    asked.question(1)
    assert asked.answer(1, 3, order=7) == []  # none is missing in the channel's own numbers
    stamp = asked.now - 2 * MS
    assert asked.oracle.advance(stamp + 199 * MS) == []
    assert [v.outcome for v in asked.oracle.advance(stamp + 200 * MS)] == [Outcome.INCONCLUSIVE]
    assert asked.question(2, order=8) == []  # what is missing came first on a channel of its own
    assert asked.answer(2, 2, order=9) == []
    assert asked.oracle.violations == 0


@pytest.mark.parametrize("late", [False, True])
def test_an_answer_whose_question_was_not_heard_is_no_violation(late: bool):
    asked = Asked()
    asked.question(1)
    asked.answer(1, 2)
    missing = asked.now + 5 * MS  # another question, on which the next answer depends
    told = asked.answer(2, 3, order=3, sequence=2)
    told += [v.outcome for v in asked.oracle.advance(asked.now + 200 * MS)]
    assert told == [Outcome.INCONCLUSIVE]
    asked.number = asked.order = 3
    if late:
        told += asked.question(2, order=2, sequence=2, stamp_ns=missing)
    for call in range(3, 60):
        asked.number += call == 3 and not late  # the gap shows
        told += asked.question(call)
        told += asked.answer(call, 2)
    assert Outcome.VIOLATED not in told
    assert asked.oracle.outcome is Outcome.CONFORMING


def test_a_machine_is_not_found_anew_before_what_was_heard_and_given_up():
    """What one node told of two channels came 200 ms late, and one channel's before the other's."""
    machine = read(CALLS)
    oracle = Oracle(machine, library(), bounds=Bounds(latency=150 * MS))
    oracle.start(START, whole=True)
    received, sent = ObservationKind.REQUEST_RECEIVED, ObservationKind.REQUEST_SENT
    answered, got = ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED
    own, other = "/Probe/ask", "/Other/ask"
    told = []
    for channel, kind, stamp, at, number, order in (
        (own, received, 1000, 1202, 0, 0),
        (own, answered, 1004, 1202, 1, 3),
        (own, received, 1200, 1202, 2, 4),
        (other, sent, 1001, 1202, 0, 1),
        (other, got, 1003, 1202, 1, 2),
        (other, sent, 1201, 1202, 2, 5),
        (other, got, 1203, 1206, 3, 6),
        (own, answered, 1204, 1207, 3, 7),
    ):
        oracle.advance(START + (at - 20) * MS)
        is_request = kind in (received, sent)
        seen = Observation(
            stamp_ns=START + stamp * MS,
            received_ns=START + at * MS,
            channel=channel,
            kind=kind,
            type_name="",
            data={"value": 1} if is_request else {"value": 2, "ok": False},
            source="Probe",
            sequence=number,
            order=order,
            client="Probe" if channel == other else "somebody",
            call=0 if stamp < 1100 else 1,
        )
        told += oracle.feed(seen)
    told += oracle.advance(START + 1400 * MS)
    assert Outcome.VIOLATED not in [verdict.outcome for verdict in told], told


def test_an_answer_that_is_heard_before_its_question_is_no_violation():
    asked = Asked()
    told = asked.answer(1, 2, order=1, sequence=0, stamp_ns=START + 9 * MS)
    told += asked.question(1, order=0, sequence=-1, stamp_ns=START + 8 * MS)
    assert told == []
    assert asked.oracle.advance(asked.now + 1000 * MS) == []


def test_a_stamp_from_the_future_does_not_make_what_follows_late():
    asked = Asked()
    asked.question(1, stamp_ns=START + 3_600_000 * MS)
    asked.answer(1, 2, stamp_ns=START + 3_600_000 * MS + 1)
    asked.question(2)
    asked.answer(2, 2)
    assert asked.oracle.late == 0


def test_what_is_missing_happened_where_numbers_are() -> None:
    progress = Progress()
    progress.take(0, 100, 0)
    progress.take(1, 200, 0)
    progress.answered(2, 250)
    progress.take(3, 400, 0)
    assert progress.missing(100, 400) == [(250, 400)]
    progress.advance(400)
    progress.take(4, 500, 400)
    assert progress.missing(100, 600) == [(250, 400)]
    assert progress.missing(300, 600) == [(300, 400)]
    assert progress.missing(100, 350) == [(250, 350)]
    assert progress.missing(450, 600) == [(450, 600)]  # numbers do not show it
    progress.take(6, 700, 700)
    assert progress.missing(100, 800) == [(250, 400), (500, 700)]


def test_what_a_node_says_to_have_reported_and_never_comes_is_missing() -> None:
    progress = Progress()
    progress.take(0, 100, 0)
    progress.answered(3, 250)
    progress.advance(249)
    assert (progress.reported_ns, progress.gap, progress.is_whole) == (100, 0, True)
    progress.take(2, 230, 240)
    progress.advance(250)
    assert (progress.next, progress.reported_ns, progress.gap) == (3, 250, 230)
    assert not progress.is_whole
    progress.answered(4, 400)
    progress.advance(400)
    assert (progress.next, progress.reported_ns, progress.gap) == (4, 400, 401)
    progress.take(4, 500, 400)
    assert progress.missing(0, 600) == [(100, 230), (250, 401)]


def test_what_was_said_before_what_came_is_not_waited_for() -> None:
    progress = Progress()
    progress.answered(3, 250)
    progress.take(3, 300, 100)
    progress.take(4, 350, 100)
    progress.advance(250)
    assert (progress.next, progress.reported_ns, progress.gap) == (5, 350, 251)


@pytest.mark.parametrize("before", [0, 1])
def test_reports_that_are_lost_and_shown_by_an_answer_alone_leave_nothing_certain(before: int):
    """The last ones, after which nothing comes, or all since the node has started."""
    asked = Asked()
    for call in range(1, before + 1):
        asked.question(call)
        asked.answer(call, 2)
    asked.now += 10 * MS
    assert asked.oracle.reported(2 * before + 2, asked.now, asked.now + MS) == []
    assert asked.oracle.outcome is Outcome.CONFORMING
    told = [verdict.outcome for verdict in asked.oracle.advance(asked.now + 200 * MS)]
    assert told == [Outcome.INCONCLUSIVE]


def test_an_answer_that_comes_before_what_it_counts_changes_nothing():
    asked = Asked()
    asked.oracle.reported(2, START + 15 * MS, START + 16 * MS)
    asked.question(1)
    asked.answer(1, 2)
    assert asked.oracle.advance(asked.now + 300 * MS) == []
    assert asked.oracle.outcome is Outcome.CONFORMING


def test_what_a_node_reported_before_it_was_heard_is_not_missing():
    """It is found in the middle, and says how many reports it has sent by then."""
    oracle = Oracle(read(ASKS.format(more="")), library(), bounds=Bounds(), synchronised=False)
    oracle.listen(START)
    oracle.reported(57, START + 5 * MS, START + 6 * MS)
    assert oracle.advance(START + 200 * MS) == []


def test_what_is_not_known_to_be_lost_yet_may_have_happened_until_now() -> None:
    progress = Progress()
    progress.take(0, 100, 0)
    progress.take(2, 300, 0)
    assert progress.missing(50, 300) == [(100, 300)]
    progress.advance(300)
    progress.take(4, 500, 300)
    assert progress.missing(50, 600) == [(100, 300), (300, 600)]
    assert progress.missing(50, 300) == [(100, 300)]  # all before is known
    progress.take(3, 400, 300)
    assert progress.missing(50, 600) == [(100, 300)]


def test_what_was_missing_before_all_that_is_remembered_may_have_been_anywhere() -> None:
    progress = Progress()
    progress.take(0, 100, 0)
    for number in range(KEPT_HOLES + 1):
        stamp = 200 + 100 * number
        progress.take(2 + 2 * number, stamp, stamp)
    assert progress.missing(50, 10_000)[:2] == [(50, 200), (200, 300)]
    assert progress.missing(250, 350) == [(250, 300), (300, 350)]
