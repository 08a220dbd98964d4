"""A node that stood still: of a timer's times in which it slept, it takes one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pytest
from msgspec.structs import replace

from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from tests.oracle.machines import library, read
from transports.interface import Observation, ObservationKind

COUNTS = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="counting">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="4"/>
  <state id="counting">
    <ros_rate_callback name="beat">
      <ros_topic_publish name="out"><field name="data" expr="n"/></ros_topic_publish>
      <assign location="n" expr="n + 1"/>
    </ros_rate_callback>
    <ros_service_handle_request name="/Probe/ask">
      <assign location="n" expr="_req.value"/>
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""
BEGAN_NS = 10**18
SLEPT = ((0.25, 0), (0.5, 1), (1.15, 2), (1.25, 3), (1.5, 4))
"""When the counts come (s): the node stood still from 0.6 to 1.15, and skipped the time 1.0."""


def seen(kind: ObservationKind, at_s: float, data: object, number: int) -> Observation:
    stamp_ns = BEGAN_NS + round(at_s * 1e9)
    is_count = kind is ObservationKind.MESSAGE
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns + 1000,
        channel="/out" if is_count else "/Probe/ask",
        kind=kind,
        type_name="std_msgs/msg/Int32" if is_count else "probe_interfaces/srv/Ask_",
        data=data,
        source="Probe",
        sequence=number,
        client="" if is_count else "somebody",
        call=0 if is_count else 1,
    )


def ask(oracle: Oracle, at_s: float, call: int) -> None:
    """The node is asked to go on from 100, and answers at once."""
    found = [
        seen(ObservationKind.REQUEST_RECEIVED, at_s, {"value": 100}, 2 * call),
        seen(ObservationKind.RESPONSE_SENT, at_s + 0.0001, {"value": 1, "ok": False}, 2 * call + 1),
    ]
    for one in found:
        oracle.feed(replace(one, call=call + 1))


def outcome(counts: Iterable[tuple[float, int]], asked_s: Sequence[float]) -> Outcome:
    """What is said of a node that counts like this, is asked at those times, and goes on."""
    oracle = Oracle(read(COUNTS), library(), "Probe")
    oracle.start(BEGAN_NS, whole=True)
    number = 0
    for number, (at_s, count) in enumerate(counts):
        oracle.feed(seen(ObservationKind.MESSAGE, at_s, {"data": count}, number))
    for call, at_s in enumerate(asked_s):
        ask(oracle, at_s, call)
    first_s = (int(asked_s[-1] * 4) + 1) / 4
    for count in range(8):
        number += 1
        at_s = first_s + count * 0.25
        oracle.feed(seen(ObservationKind.MESSAGE, at_s, {"data": 100 + count}, number))
    return oracle.outcome


@pytest.mark.parametrize("asked_s", [1.51, 1.6, 1.69, 1.73])
def test_times_in_which_the_node_slept_are_skipped(asked_s: float) -> None:
    assert outcome(SLEPT, [asked_s]) is Outcome.CONFORMING


def test_a_tick_is_missing_where_the_node_did_not_sleep() -> None:
    """It answered all the while, so that it did not stand still for longer than the latency bound."""
    counts = ((0.25, 0), (0.5, 1), (0.75, 2))
    assert outcome(counts, [0.9, 0.99, 1.12, 1.24]) is Outcome.VIOLATED
    assert outcome(counts, [0.9, 0.99]) is Outcome.CONFORMING
