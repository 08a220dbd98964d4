"""Where a machine's own node tells in what order it did things, nothing is waited for."""

from __future__ import annotations

from typing import Any

import pytest

from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.oracle.progress import KEPT_AHEAD, Progress
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
LISTENS = '<ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>'


def test_without_a_gap_all_is_heard_until_the_last():
    progress = Progress()
    for order, stamp in enumerate((10, 20, 30)):
        progress.take(order, stamp, 0)
        assert progress.heard == stamp


def test_what_comes_after_a_gap_waits_for_what_is_missing():
    progress = Progress()
    progress.take(0, 10, 0)
    progress.take(3, 40, 0)
    progress.take(2, 30, 0)
    assert progress.heard == 10
    progress.take(1, 20, 0)
    assert progress.heard == 40


def test_what_is_missing_for_longer_than_the_bound_is_not_waited_for():
    progress = Progress()
    progress.take(5, 50, 0)  # a tap that joins later: no first number
    progress.take(6, 60, 0)
    assert progress.heard == 0
    progress.take(8, 80, 55)
    assert progress.heard == 60
    progress.take(7, 70, 55)
    assert progress.heard == 80


def test_a_number_that_came_before_changes_nothing():
    progress = Progress()
    progress.take(0, 10, 0)
    progress.take(1, 20, 0)
    progress.take(0, 99, 0)
    assert progress.heard == 20


def test_what_is_ahead_of_a_gap_is_bounded():
    progress = Progress()
    for order in range(1, 3 * KEPT_AHEAD):
        progress.take(order, order, 0)
    assert len(progress.ahead) <= KEPT_AHEAD


class Asked:
    """The oracle of a machine that answers questions, and what it hears; nothing comes late."""

    def __init__(self, more: str = "") -> None:
        machine = read(ASKS.format(more=more))
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


@pytest.mark.parametrize("more", ["", LISTENS])
def test_a_wrong_answer_waits_for_the_bound_where_something_may_be_under_way(more: str):
    asked = Asked(more)
    asked.question(1)
    missing = {} if more else {"order": 7}  # a gap in the order, none in the channel's own numbers
    assert asked.answer(1, 3, **missing) == []
    stamp = asked.now - 2 * MS
    assert asked.oracle.advance(stamp + 199 * MS) == []
    assert [v.outcome for v in asked.oracle.advance(stamp + 200 * MS)] == [Outcome.VIOLATED]


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
