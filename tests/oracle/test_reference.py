"""The reference itself, on cases small enough to be judged by hand."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from m2c.model import Machine
from tests.oracle.machines import read
from tests.oracle.reference import conforms
from tests.oracle.steps import UnsupportedError
from transports.interface import Observation, ObservationKind

LATENCY = 200
DEADLINE = 1000
LATER = 5000


def machine(body: str, initial: str = "s") -> Machine:
    return read(
        f"""<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="{initial}">
  <datamodel><data id="level" type="int32" expr="9"/><data id="n" type="int32" expr="0"/></datamodel>
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
  <ros_topic_subscriber topic="/other_in" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_service_client service_name="/Other/ask" type="probe_interfaces/Ask"/>
  {body}
</scxml>"""
    )


def publish(value: str) -> str:
    return f'<ros_topic_publish name="/out"><field name="data" expr="{value}"/></ros_topic_publish>'


def respond(value: str, ok: str = "true") -> str:
    return (
        f'<ros_service_send_response name="/Probe/ask"><field name="value" expr="{value}"/>'
        f'<field name="ok" expr="{ok}"/></ros_service_send_response>'
    )


LEVEL = machine(f"""<state id="s">
  <ros_topic_callback name="/in"><assign location="level" expr="_msg.data"/></ros_topic_callback>
  <ros_service_handle_request name="/Probe/ask">{respond("level")}</ros_service_handle_request>
</state>""")
"""Answers with the last level that it heard, like BatteryLevelSkill."""

ECHO = machine(f"""<state id="s">
  <ros_topic_callback name="/in">{publish("_msg.data")}</ros_topic_callback>
  <ros_topic_callback name="/other_in">{publish("_msg.data + 10")}</ros_topic_callback>
</state>""")


def heard(
    kind: ObservationKind, stamp: int, channel: str, data: Any, source: str, **more: Any
) -> Observation:
    return Observation(
        stamp_ns=stamp,
        received_ns=stamp,
        channel=channel,
        kind=kind,
        type_name="",
        data=data,
        source=source,
        **more,
    )


def message(stamp: int, value: int, channel: str = "/in", source: str = "a") -> Observation:
    return heard(ObservationKind.MESSAGE, stamp, channel, {"data": value}, source)


def out(stamp: int, value: int, channel: str = "/out") -> Observation:
    return heard(ObservationKind.MESSAGE, stamp, channel, {"data": value}, "Probe")


def asked(stamp: int, value: int = 0, call: int = 1) -> Observation:
    kind = ObservationKind.REQUEST_RECEIVED
    return heard(kind, stamp, "/Probe/ask", {"value": value}, "Probe", client="p", call=call)


def answered(stamp: int, value: int, ok: bool = True, call: int = 1) -> Observation:
    kind = ObservationKind.RESPONSE_SENT
    data = {"value": value, "ok": ok}
    return heard(kind, stamp, "/Probe/ask", data, "Probe", client="p", call=call)


def called(stamp: int, value: int) -> Observation:
    return heard(ObservationKind.REQUEST_SENT, stamp, "/Other/ask", {"value": value}, "Probe")


def returned(stamp: int, value: int = 0, ok: bool = True, error: str = "") -> Observation:
    data = None if error else {"value": value, "ok": ok}
    kind = ObservationKind.RESPONSE_RECEIVED
    return heard(kind, stamp, "/Other/ask", data, "Probe", error=error)


def judge(model: Machine, *trace: Observation, end: int = LATER, **options: Any) -> bool:
    return conforms(model, trace, LATENCY, DEADLINE, end, **options)


# -- one input, one output ------------------------------------------------------------------------


def test_nothing_heard_conforms_to_a_machine_that_says_nothing() -> None:
    assert judge(LEVEL)


def test_the_right_answer_conforms_and_a_wrong_one_does_not() -> None:
    assert judge(LEVEL, asked(100), answered(110, 9))
    assert not judge(LEVEL, asked(100), answered(110, 8))
    assert not judge(LEVEL, asked(100), answered(110, 9, ok=False))


def test_a_boolean_is_not_a_number() -> None:
    assert not judge(
        LEVEL,
        asked(100),
        heard(ObservationKind.RESPONSE_SENT, 110, "/Probe/ask", {"value": 9, "ok": 1}, "Probe"),
    )


def test_an_answer_before_its_question_does_not_conform() -> None:
    assert not judge(LEVEL, answered(90, 9), asked(100))


def test_an_answer_that_nobody_asked_for_does_not_conform() -> None:
    assert not judge(LEVEL, answered(110, 9))
    assert not judge(LEVEL, asked(100), answered(110, 9), answered(120, 9))


def test_an_answer_is_overdue_only_after_the_deadline() -> None:
    assert judge(LEVEL, asked(100), end=1100)
    assert not judge(LEVEL, asked(100), end=1101)
    assert judge(LEVEL, asked(100), answered(1100, 9))
    assert not judge(LEVEL, asked(100), answered(1101, 9))


def test_what_others_say_is_not_the_machines_output() -> None:
    assert judge(ECHO, heard(ObservationKind.MESSAGE, 50, "/out", {"data": 3}, "somebody"))
    assert judge(LEVEL, heard(ObservationKind.REQUEST_SENT, 50, "/Probe/ask", {}, "policy"))


def test_an_output_on_a_channel_that_the_model_does_not_have_does_not_conform() -> None:
    assert not judge(ECHO, message(100, 1), out(150, 1, "/outt"))


def test_a_field_that_the_model_does_not_set_is_zero() -> None:
    silent = machine("""<state id="s"><ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"/></ros_service_handle_request></state>""")
    assert judge(silent, asked(100), answered(110, 0, ok=False))
    assert not judge(silent, asked(100), answered(110, 1, ok=False))
    assert not judge(silent, asked(100), answered(110, 0))


# -- topics against everything else ---------------------------------------------------------------


def test_a_message_shortly_before_a_question_may_or_may_not_have_been_taken() -> None:
    assert judge(LEVEL, message(50, 3), asked(100), answered(110, 3))
    assert judge(LEVEL, message(50, 3), asked(100), answered(110, 9))
    assert not judge(LEVEL, message(50, 3), asked(100), answered(110, 5))


def test_a_message_older_than_the_latency_bound_has_been_taken() -> None:
    assert judge(LEVEL, message(50, 3), asked(250), answered(260, 9))
    assert not judge(LEVEL, message(50, 3), asked(251), answered(260, 9))
    assert judge(LEVEL, message(50, 3), asked(251), answered(260, 3))


def test_a_message_after_the_question_comes_too_late_for_it() -> None:
    assert not judge(LEVEL, asked(100), message(101, 3), answered(150, 3))
    assert judge(LEVEL, asked(100), message(101, 3), answered(150, 9))


def test_what_was_heard_of_a_message_holds_for_what_follows() -> None:
    both = (message(50, 3), asked(100), answered(110, 3), asked(120, call=2))
    assert judge(LEVEL, *both, answered(130, 3, call=2))
    assert not judge(LEVEL, *both, answered(130, 9, call=2))


def test_messages_of_one_source_stay_in_order() -> None:
    assert judge(LEVEL, message(50, 3), message(60, 4), asked(100), answered(110, 4))
    assert judge(LEVEL, message(50, 3), message(60, 4), asked(100), answered(110, 3))
    later = (asked(400, call=2), answered(410, 3, call=2))
    assert not judge(LEVEL, message(50, 3), message(60, 4), *later)


def test_messages_of_two_sources_may_overtake_each_other() -> None:
    two = (message(50, 3, source="a"), message(60, 4, source="b"))
    assert judge(LEVEL, *two, asked(400), answered(410, 3))
    assert judge(LEVEL, *two, asked(400), answered(410, 4))


def test_messages_further_apart_than_the_latency_bound_do_not_overtake_each_other() -> None:
    two = (message(50, 3, source="a"), message(251, 4, source="b"))
    assert judge(LEVEL, *two, asked(600), answered(610, 4))
    assert not judge(LEVEL, *two, asked(600), answered(610, 3))


def test_messages_on_two_channels_may_be_taken_in_either_order() -> None:
    two = (message(50, 1), message(60, 2, "/other_in"))
    assert judge(ECHO, *two, out(100, 1), out(110, 12))
    assert judge(ECHO, *two, out(100, 12), out(110, 1))
    assert not judge(ECHO, *two, out(100, 1), out(110, 2))


def test_an_output_does_not_come_from_a_message_that_was_not_sent_yet() -> None:
    two = (message(50, 1), message(60, 2, "/other_in"))
    assert not judge(ECHO, *two, out(55, 12), out(110, 1))
    assert not judge(ECHO, message(50, 1), out(50, 1))


def test_a_message_that_may_not_have_been_taken_yet_owes_nothing_yet() -> None:
    assert judge(ECHO, message(4900, 1))
    assert judge(ECHO, message(100, 1), end=300)


# -- order of outputs, calls ----------------------------------------------------------------------

CALLS = machine(f"""<state id="s">
  <ros_service_handle_request name="/Probe/ask" target="asking">
    <ros_service_send_request name="/Other/ask"><field name="value" expr="_req.value"/></ros_service_send_request>
  </ros_service_handle_request>
</state>
<state id="asking">
  <ros_service_handle_response name="/Other/ask" cond="_res.ok" target="s">{respond("_res.value")}</ros_service_handle_response>
  <ros_service_handle_response name="/Other/ask" target="s">{respond("7")}</ros_service_handle_response>
  <ros_service_handle_error name="/Other/ask" target="s">{respond("8", "false")}</ros_service_handle_error>
  <ros_service_handle_request name="/Probe/ask">{respond("6")}</ros_service_handle_request>
</state>""")


def test_a_call_in_between_is_owed_before_the_answer() -> None:
    begin = (asked(100, 5), called(110, 5))
    assert judge(CALLS, *begin, returned(200, 4), answered(210, 4))
    assert judge(CALLS, *begin, returned(200, 4, ok=False), answered(210, 7))
    assert judge(CALLS, *begin, returned(200, error="timeout: 5 s"), answered(210, 8, ok=False))
    assert not judge(CALLS, asked(100, 5), answered(210, 4))
    assert not judge(CALLS, *begin, answered(190, 4), returned(200, 4))
    assert not judge(CALLS, *begin, returned(200, 4))


def test_an_answer_need_not_come_while_the_call_is_open() -> None:
    assert judge(CALLS, asked(100, 5), called(110, 5))


def test_a_second_question_is_answered_first_and_the_calls_can_be_checked() -> None:
    trace = (
        asked(100, 5, call=1),
        called(110, 5),
        asked(120, 5, call=2),
        answered(130, 6, call=2),
        returned(200, 4),
        answered(210, 4, call=1),
    )
    assert judge(CALLS, *trace, check_calls=True)
    mixed_up = (*trace[:3], answered(130, 6, call=1), trace[4], answered(210, 4, call=2))
    assert judge(CALLS, *mixed_up)
    assert not judge(CALLS, *mixed_up, check_calls=True)


def test_a_discarded_question_is_not_answered() -> None:
    deaf = machine("""<state id="s"><ros_topic_callback name="/in" target="t"/></state>
    <state id="t"><ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"/></ros_service_handle_request></state>""")
    assert judge(deaf, asked(100))
    assert not judge(deaf, asked(100), answered(110, 0, ok=False))
    assert judge(deaf, message(50, 0), asked(100), answered(110, 0, ok=False))
    assert not judge(deaf, message(50, 0), asked(300))


def test_outputs_leave_in_the_order_owed() -> None:
    two = machine(f"""<state id="s"><ros_topic_callback name="/in">
      {publish("1")}{publish("2")}</ros_topic_callback></state>""")
    assert judge(two, message(50, 0), out(100, 1), out(110, 2))
    assert not judge(two, message(50, 0), out(100, 2), out(110, 1))
    assert not judge(two, message(50, 0), out(100, 1))
    assert judge(two, message(50, 0), out(100, 1), end=900)


# -- chance, time, macrosteps ---------------------------------------------------------------------


def test_every_outcome_of_chance_conforms_and_nothing_else() -> None:
    drawn = machine(f"""<state id="s"><ros_topic_callback name="/in">
      <assign location="n" expr="Math.random() &lt; 0.3 ? 1 : 2"/>{publish("n")}</ros_topic_callback></state>""")
    assert judge(drawn, message(50, 0), out(100, 1))
    assert judge(drawn, message(50, 0), out(100, 2))
    assert not judge(drawn, message(50, 0), out(100, 3))


def test_a_drawn_number_is_one_number_however_often_it_is_used() -> None:
    kept = machine(f"""<state id="s"><ros_topic_callback name="/in">
      <assign location="n" expr="Math.floor(Math.random() * 3)"/>{publish("n")}{publish("n + 10")}
      </ros_topic_callback></state>""")
    for value in (0, 1, 2):
        assert judge(kept, message(50, 0), out(100, value), out(110, value + 10))
    assert not judge(kept, message(50, 0), out(100, 1), out(110, 12))
    assert not judge(kept, message(50, 0), out(100, 3), out(110, 13))


def test_every_target_with_a_probability_is_possible() -> None:
    forked = machine(f"""<state id="s"><ros_topic_callback name="/in">
        <target id="s" prob="0.5"/><target id="t" prob="0.5"/></ros_topic_callback></state>
      <state id="t"><onentry>{publish("5")}</onentry></state>""")
    assert judge(forked, message(50, 0), out(100, 5))
    assert judge(forked, message(50, 0))
    assert not judge(forked, message(50, 0), out(100, 5), out(110, 5))


CLOCK_TEXT = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="s">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <ros_time_rate name="clock" rate_hz="10000000"/>
  <state id="s"><ros_rate_callback name="clock"><assign location="n" expr="n + 1"/>
    <ros_topic_publish name="/out"><field name="data" expr="n"/></ros_topic_publish></ros_rate_callback></state>
</scxml>"""
CLOCK = read(CLOCK_TEXT)
"""Counts every 100 ns."""


def test_a_timer_ticks_at_its_period() -> None:
    assert judge(CLOCK, out(105, 1), out(205, 2), end=250)
    assert not judge(CLOCK, out(95, 1), end=250)
    assert judge(CLOCK, out(95, 1), end=250, tolerance_ns=10)
    assert not judge(CLOCK, out(105, 1), out(150, 2), end=250, tolerance_ns=10)
    assert not judge(CLOCK, out(105, 2), end=250)


def test_a_tick_may_be_taken_late_but_not_later_than_a_message() -> None:
    slow = read(CLOCK_TEXT.replace("10000000", "1000000"))  # every 1000 ns
    assert judge(slow, out(1200, 1), end=1300)
    assert not judge(slow, out(1201, 2), end=1300)
    assert judge(slow, end=2200)
    assert judge(slow, out(2200, 1), end=2300)
    assert not judge(slow, out(2201, 1), end=2300)


def test_a_timer_that_stopped_is_overdue() -> None:
    assert judge(CLOCK, out(105, 1), end=1150)
    assert not judge(CLOCK, out(105, 1), end=1401)


def test_what_is_sent_on_entering_the_initial_state_is_owed_from_the_start() -> None:
    greeting = machine(f"""<state id="s"><onentry>{publish("1")}</onentry></state>""")
    assert judge(greeting, out(5, 1))
    assert not judge(greeting)
    assert judge(greeting, end=1000)
    assert not judge(greeting, end=1001)
    assert judge(greeting, end=1001, start_ns=500)


def test_a_macrostep_takes_entries_exits_eventless_and_internal_in_order() -> None:
    full = machine(f"""<state id="s"><onexit>{publish("1")}</onexit>
      <ros_topic_callback name="/in" target="t">{publish("2")}<raise event="note"/></ros_topic_callback></state>
    <state id="t"><onentry>{publish("3")}</onentry>
      <transition cond="n == 0" target="u"><assign location="n" expr="1"/>{publish("4")}</transition></state>
    <state id="u"><transition event="note" target="s">{publish("5")}</transition></state>""")
    right = [out(100 + index, value) for index, value in enumerate((1, 2, 3, 4, 5))]
    assert judge(full, message(50, 0), *right)
    assert not judge(full, message(50, 0), *right[:4])


def test_an_error_ends_its_block_and_is_an_event() -> None:
    failing = machine(f"""<state id="s">
      <ros_topic_callback name="/in">{publish("1")}
        <assign location="n" expr="_msg.none.deeper"/>{publish("2")}</ros_topic_callback>
      <transition event="error.execution">{publish("3")}</transition></state>""")
    assert judge(failing, message(50, 0), out(100, 1), out(110, 3))
    assert not judge(failing, message(50, 0), out(100, 1), out(110, 2))


def test_a_delayed_transition_comes_after_its_delay_unless_its_state_is_left() -> None:
    waiting = machine(f"""<state id="s">
      <transition after="0.0003ms" target="t">{publish("1")}</transition>
      <ros_topic_callback name="/in" target="s"/></state><state id="t"/>""")
    assert judge(waiting, out(301, 1))
    assert judge(waiting, out(499, 1)), "it may be taken late"
    assert not judge(waiting, out(299, 1))
    assert not judge(waiting), "it came, and nothing was heard"
    assert judge(waiting, message(250, 0), out(551, 1)), "it begins anew"
    assert judge(waiting, message(250, 0), out(301, 1)), "the message may be taken after it"
    assert not judge(waiting, message(100, 0), out(301, 1), out(401, 1))


def test_a_delayed_event_comes_wherever_the_machine_is_unless_it_is_cancelled() -> None:
    sending = machine(f"""<state id="s">
      <ros_service_handle_request name="/Probe/ask" target="t">
        <send event="later" delay="0.0003ms" id="one"/>{respond("0")}</ros_service_handle_request></state>
    <state id="t">
      <ros_topic_callback name="/in"><cancel sendid="one"/></ros_topic_callback>
      <ros_topic_callback name="/other_in" target="s"/>
      <transition event="later">{publish("1")}</transition></state>""")
    called = (asked(100), answered(110, 0))
    assert judge(sending, *called, out(401, 1))
    assert not judge(sending, *called)
    assert not judge(sending, *called, out(399, 1))
    assert judge(sending, *called, message(120, 0)), "it is cancelled"
    assert not judge(sending, *called, message(120, 0), out(401, 1))
    assert judge(sending, *called, message(250, 0), out(401, 1)), "too late to cancel it"
    assert judge(sending, *called, message(120, 0, "/other_in")), "nobody takes it"


def test_what_the_reference_does_not_know_is_refused() -> None:
    sending = machine("""<state id="s"><ros_topic_callback name="/in">
      <send event="later"/></ros_topic_callback>
      <transition event="later"/></state>""")
    with pytest.raises(UnsupportedError, match="Raise"):
        judge(sending, message(50, 0))


def test_the_order_of_the_list_does_not_matter_only_the_stamps() -> None:
    assert judge(LEVEL, answered(110, 3), asked(100), message(50, 3))


def test_contents_that_are_not_known_are_not_held_against_the_machine() -> None:
    assert judge(LEVEL, asked(100), msgspec.structs.replace(answered(110, 1), data=None))
