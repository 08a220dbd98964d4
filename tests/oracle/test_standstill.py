"""A node that stood still for longer than the latency bound takes what is overdue afterwards, in any order."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import pytest

from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from tests.oracle.machines import library, read
from transports.interface import Observation, ObservationKind

BEGAN_NS = 10**18
MACHINE = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="counting">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_topic_publisher name="first" topic="/first" type="std_msgs/Int32"/>
  <ros_topic_publisher name="second" topic="/second" type="std_msgs/Int32"/>
  <ros_time_rate name="one" rate_hz="1"/>
  <ros_time_rate name="other" rate_hz="1"/>
  <state id="counting">
    <ros_rate_callback name="one">{one}</ros_rate_callback>
    <ros_rate_callback name="other">{other}</ros_rate_callback>
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="n"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""
PUBLISHES = '<ros_topic_publish name="{}"><field name="data" expr="n"/></ros_topic_publish>'
COUNTS = '<assign location="n" expr="n + 1"/>'
NOTHING = ""

Seen = tuple[float, str, ObservationKind, object]
SENT = ObservationKind.REQUEST_SENT
RECEIVED = ObservationKind.REQUEST_RECEIVED
ANSWERED = ObservationKind.RESPONSE_SENT
MESSAGE = ObservationKind.MESSAGE
ASKED = {"value": 0}


def observation(at_s: float, channel: str, kind: ObservationKind, data: object) -> Observation:
    stamp_ns = BEGAN_NS + round(at_s * 1e9)
    is_call = kind is not MESSAGE
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns + 1000,
        channel=channel,
        kind=kind,
        type_name="probe_interfaces/srv/Ask_" if is_call else "std_msgs/msg/Int32",
        data=data,
        source="somebody" if kind is SENT else "Probe",
        sequence=-1,
        client="somebody" if is_call else "",
        call=1 if is_call else 0,
    )


def outcome(one: str, other: str, seen: Iterable[Seen]) -> Outcome:
    """What is said of a machine whose timers do this, of which that is seen."""
    machine = read(MACHINE.replace("{one}", one).replace("{other}", other))
    oracle = Oracle(machine, library(), "Probe")
    oracle.start(BEGAN_NS, whole=True)
    last_s = 0.0
    for at_s, channel, kind, data in seen:
        while last_s + 0.05 < at_s:  # as a monitor does that looks at its clock
            last_s += 0.05
            oracle.advance(BEGAN_NS + round(last_s * 1e9))
        oracle.feed(observation(at_s, channel, kind, data))
    oracle.advance(BEGAN_NS + 3 * 10**9)
    return oracle.outcome


@pytest.mark.parametrize("awake_s", [1.1, 1.35, 1.7])
def test_of_two_timers_that_are_overdue_each_keeps_its_phase(awake_s: float) -> None:
    seen: list[Seen] = [
        (awake_s, "/first", MESSAGE, {"data": 0}),
        (awake_s + 1e-6, "/second", MESSAGE, {"data": 0}),
        (2.0, "/first", MESSAGE, {"data": 0}),
        (2.0 + 1e-6, "/second", MESSAGE, {"data": 0}),
    ]
    one, other = PUBLISHES.format("first"), PUBLISHES.format("second")
    assert outcome(one, other, seen) is Outcome.CONFORMING
    assert outcome(one, other, [*seen[:2], (1.9, *seen[2][1:])]) is Outcome.VIOLATED


def test_a_request_is_taken_before_a_tick_that_is_overdue() -> None:
    seen: list[Seen] = [
        (1.35, "/Probe/ask", RECEIVED, ASKED),
        (1.3501, "/Probe/ask", ANSWERED, {"value": 0, "ok": False}),
        (1.3502, "/first", MESSAGE, {"data": 0}),
        (2.0, "/first", MESSAGE, {"data": 0}),
    ]
    one = PUBLISHES.format("first")
    assert outcome(one, NOTHING, seen) is Outcome.CONFORMING
    assert outcome(one, NOTHING, seen[:2]) is Outcome.VIOLATED


def test_a_request_that_waited_is_taken_before_a_tick_that_nobody_sees() -> None:
    seen: list[Seen] = [
        (0.99, "/Probe/ask", SENT, ASKED),
        (1.35, "/Probe/ask", RECEIVED, ASKED),
        (1.3501, "/Probe/ask", ANSWERED, {"value": 0, "ok": False}),
    ]
    assert outcome(COUNTS, NOTHING, seen) is Outcome.CONFORMING


def test_a_tick_is_missing_where_nothing_shows_that_the_node_stood_still() -> None:
    seen: list[Seen] = [
        (1.34, "/Probe/ask", SENT, ASKED),
        (1.35, "/Probe/ask", RECEIVED, ASKED),
        (1.3501, "/Probe/ask", ANSWERED, {"value": 0, "ok": False}),
    ]
    assert outcome(COUNTS, NOTHING, seen) is Outcome.VIOLATED


FOUND = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="s">
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher name="first" topic="/first" type="std_msgs/Int32"/>
  <state id="s">
    <ros_topic_callback name="in"><ros_topic_publish name="first"><field name="data" expr="1"/></ros_topic_publish>
    </ros_topic_callback>
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""


@pytest.mark.parametrize("acts_s", [0.1, 0.29])
def test_a_machine_that_is_found_while_it_stands_still_takes_late_what_was_sent_before(
    acts_s: float,
) -> None:
    """``acts_s``: when it took something last before it took what had been sent 0.25 s before."""
    oracle = Oracle(read(FOUND), library(), "Probe", synchronised=False)
    oracle.listen(BEGAN_NS)
    asked = [
        (at_s + later_s, "/Probe/ask", kind, {"value": value})
        for at_s in sorted({0.1, acts_s, 0.4})
        for later_s, kind, value in ((0.0, RECEIVED, 0), (1e-6, ANSWERED, 1))
    ]
    seen = [(0.15, "/in", MESSAGE, {"data": 0}), (0.4003, "/first", MESSAGE, {"data": 1}), *asked]
    last_s = 0.0
    for at_s, channel, kind, data in sorted(seen, key=lambda item: item[0]):
        while last_s + 0.01 < at_s:
            last_s += 0.01
            oracle.advance(BEGAN_NS + round(last_s * 1e9))
        one = observation(at_s, channel, kind, data)
        source = "somebody" if channel == "/in" else "Probe"
        number = round(at_s * 100) if one.call else 0
        oracle.feed(msgspec.structs.replace(one, source=source, call=number))
    oracle.advance(BEGAN_NS + 3 * 10**9)
    assert (oracle.outcome is Outcome.VIOLATED) == (acts_s > 0.1)


RESTS = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="resting">
  <ros_topic_publisher name="first" topic="/first" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="1"/>
  <state id="resting"><transition after="300ms" target="waiting"/></state>
  <state id="waiting">
    <ros_rate_callback name="beat" target="resting">
      <ros_topic_publish name="first"><field name="data" expr="0"/></ros_topic_publish>
    </ros_rate_callback>
  </state>
</scxml>
"""
JOINS = [(n / 100, until_s) for until_s in (1.15, 1.25, 1.3, 1.6) for n in range(90, 116, 2)]


@pytest.mark.parametrize(("joins_s", "until_s"), JOINS)
def test_who_joins_about_a_standstill_takes_no_late_ring_for_one_in_time(
    joins_s: float, until_s: float
) -> None:
    """A node stands still from 0.9 s to ``until_s``; its timer is due at 1.0 s, and once a second after that."""
    rings_s = [until_s, 2.0, 3.0]
    assert joined(joins_s, rings_s) is not Outcome.VIOLATED
    assert joined(joins_s, [*rings_s, 3.4, 3.8]) is Outcome.VIOLATED


def joined(joins_s: float, rings_s: Iterable[float]) -> Outcome:
    """What is said of a machine that is listened to since ``joins_s``, before it would ring again."""
    oracle = Oracle(read(RESTS), library(), "Probe", synchronised=False)
    oracle.listen(BEGAN_NS + round(joins_s * 1e9))
    looked_s = joins_s
    for at_s in rings_s:
        while looked_s + 0.01 < at_s:
            looked_s += 0.01
            oracle.advance(BEGAN_NS + round(looked_s * 1e9))
        oracle.feed(observation(at_s, "/first", MESSAGE, {"data": 0}))
    oracle.advance(BEGAN_NS + round((looked_s + 0.5) * 1e9))
    return oracle.outcome


AWAKENED = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="idle">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_topic_publisher name="first" topic="/first" type="std_msgs/Int32"/>
  <ros_time_rate name="tick" rate_hz="2"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask" cond="n == 0">
      <assign location="n" expr="1"/>
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_request>
    <ros_service_handle_request name="/Probe/ask" target="busy">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
  <state id="busy">
    <ros_rate_callback name="tick">
      <ros_topic_publish name="first"><field name="data" expr="1"/></ros_topic_publish>
    </ros_rate_callback>
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""


@pytest.mark.parametrize("ticks_s", [(1.5, 2.0, 2.5), (1.5, 2.0), (1.5,)])
def test_a_timer_that_begins_to_matter_has_rung_any_number_of_times_while_the_node_stood_still(
    ticks_s: tuple[float, ...],
) -> None:
    """It may as well have been its link that was slow: then the tick of 1 s was taken when it was due."""
    oracle = Oracle(read(AWAKENED), library(), "Probe")
    oracle.start(BEGAN_NS, whole=True)
    seen: list[Seen] = [(0.55, "/Probe/ask", SENT, ASKED)]
    for at_s in (0.45, 1.2, 1.35, 1.65, 1.75):
        seen.append((at_s, "/Probe/ask", RECEIVED, ASKED))
        seen.append((at_s + 1e-6, "/Probe/ask", ANSWERED, {"value": 1}))
    seen += [(at_s, "/first", MESSAGE, {"data": 1}) for at_s in ticks_s]
    calls = {0.45: 1, 0.55: 2, 1.2: 2, 1.35: 3, 1.65: 4, 1.75: 5}
    for at_s, channel, kind, data in sorted(seen, key=lambda item: item[0]):
        oracle.advance(BEGAN_NS + round(at_s * 1e9))
        one = observation(at_s, channel, kind, data)
        oracle.feed(msgspec.structs.replace(one, call=calls.get(round(at_s, 3), 0)))
    until_s = 4.2 if ticks_s[-1] < 2.5 else 2.9
    oracle.advance(BEGAN_NS + round(until_s * 1e9))
    assert (oracle.outcome is Outcome.VIOLATED) == (until_s > 3)
