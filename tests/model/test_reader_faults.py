"""Every further fault of a single model, with everything that is said of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.model.test_reader_messages import HEAD, findings

FAULTS = [
    # (body from line 2 on, all findings)
    ('<state id="a"><onentry><send eventexpr="x"/></onentry></state></scxml>', ['2:41: error: <send>: unknown attribute `eventexpr`; an event has a name; write `event` [unknown-attribute]']),
    ('<state id="a"><onentry><send event="e" targetexpr="x"/></onentry></state></scxml>', ['2:52: error: <send>: unknown attribute `targetexpr`; a machine has a name; write `target` [unknown-attribute]']),
    ('<state id="a"><onentry><send event="e" typeexpr="x"/></onentry></state></scxml>', ['2:50: error: <send>: unknown attribute `typeexpr`; events travel in one way; leave it out [unknown-attribute]']),
    ('<state id="a"><onentry><send event="e" delay="1s" idlocation="x"/></onentry></state></scxml>', ['2:63: error: <send>: unknown attribute `idlocation`; a name is given by `id` [unknown-attribute]']),
    ('<state id="a"><onentry><cancel sendidexpr="x"/></onentry></state></scxml>', ['2:44: error: <cancel>: unknown attribute `sendidexpr`; what is sent has a name; write `sendid` [unknown-attribute]']),
    ('<datamodel><data id="x" src="x.json"/></datamodel><state id="a"/></scxml>', ['2:30: error: <data>: unknown attribute `src`; a value stands in `expr` [unknown-attribute]']),
    ('<state id="a"><onentry><send event="e" type="http"/></onentry></state></scxml>', ['2:46: error: <send>: the type `http` is not part of the language; leave it out: an event goes to machines [unsupported-element]']),
    *(
        (f'<state id="a"><onentry><send event="e" type="{way}"/></onentry><transition event="e"/></state></scxml>', [])
        for way in ("scxml", "http://www.w3.org/TR/scxml/#SCXMLEventProcessor", "http://www.w3.org/TR/scxml/#SCXMLEventProcessor/")
    ),
    *(
        (f'<state id="a"><onentry><assign location="{name}" expr="1"/></onentry></state></scxml>', [f'2:42: error: <assign>: `{name}` is not declared; {hint} [undeclared-variable]'])
        for name, hint in (
            ("_name", "it is the machine's name, and is not assigned"),
            ("_sessionid", "of SCXML's own variables the language has _event and _name; a machine is addressed by its name"),
        )
    ),
    ('<state id="a"><transition cond="_x.y == 1"/></state></scxml>', ["2:33: error: <transition>: `_x` is not declared; of SCXML's own variables the language has _event and _name; a machine is addressed by its name [undeclared-variable]"]),
    ('<state id="a"><onentry><send event="e" target="other"/></onentry></state></scxml>', ['2:24: warning: <send>: `e` is sent to `other`, and no such machine was read; read it together with this [unknown-machine]']),
    *(
        (f'<state id="a"><onentry><send event="e" target="{target}"/></onentry></state></scxml>', [f'2:48: error: <send>: the target `{target}` is not part of the language; name a machine of the system, or #_internal; without a target, every machine that has a transition for the event gets it [unsupported-element]'])
        for target in ("#_parent", "#_scxml_7", "http://example.org/", "#_internal_")
    ),
    ('<state id="a"><onentry><send event="e" delayexpr="1e300"/></onentry></state></scxml>', ["2:51: error: <send>: `1e+300` is not a time such as 5s or 200ms; write it like '5s', or a number of milliseconds [bad-duration]"]),
    ('<state id="a"><onentry><send event="e" delayexpr="true"/></onentry></state></scxml>', ["2:51: error: <send>: `true` is not a time such as 5s or 200ms; write it like '5s', or a number of milliseconds [bad-duration]"]),
    ('<state id="a"><onentry><send event="e" delay="soon"/></onentry></state></scxml>', ['2:47: error: <send>: `soon` is not a time; write it like 5s or 200ms [bad-duration]']),
    ('<state id="a"><onentry><send event="e" delay="1s" delayexpr="2"/></onentry></state></scxml>', ['2:62: error: <send>: `delay` and `delayexpr` exclude each other; write one of them [unknown-attribute]']),
    ('<state id="a"><onentry><send event="e" target="#_internal" delay="0s"/></onentry></state></scxml>', ["2:48: error: <send>: an internal event has no delay; leave the target out: a delayed event is the machine's own [unknown-attribute]"]),
    ('<state id="a"><onentry><send event="e" delayexpr="0" target="#_internal"/></onentry></state></scxml>', ["2:62: error: <send>: an internal event has no delay; leave the target out: a delayed event is the machine's own [unknown-attribute]"]),
    ('<datamodel><data id="x" type="int8"/></datamodel><state id="a"><onentry><send event="e"><param name="p" location="x" expr="1"/></send></onentry></state></scxml>', ['2:115: error: <param>: `expr` and `location` exclude each other; write one of them [unknown-attribute]']),
    ('<datamodel><data id="x" type="int8"/></datamodel><state id="a"><onentry><send event="e" namelist="x"><param name="x" expr="1"/></send></onentry></state></scxml>', ['2:99: error: <send>: `x` is set twice [duplicate-field]']),
    ('<state id="a"><onentry><send event="e" namelist="x"/></onentry></state></scxml>', ['2:50: error: <param>: `x` is not declared; declare it with <data> [undeclared-variable]']),
    ('<state id="a"><onentry><if cond="true"><else/><elseif cond="true"/></if></onentry></state></scxml>', ['2:47: error: <elseif>: <elseif> after <else> [unknown-tag]']),
    ('<state id="a"><onentry><if cond="true"><else><log label="x"/></else></if></onentry></state></scxml>', ['2:46: error: <log>: content inside <else>; <else/> is empty; its content follows it [unknown-tag]']),
    ('<state id="a"><onentry><if><log label="x"/></if></onentry></state></scxml>', ['2:24: error: <if>: the attribute `cond` is missing [missing-attribute]']),
    ('<state id="a"><onentry><foreach item="x"/></onentry></state></scxml>', ['2:24: error: <foreach>: the attribute `array` is missing [missing-attribute]']),
    ('<state id="a"><onentry><lgo/></onentry></state></scxml>', ['2:24: error: <lgo>: not an element of <executable content>; did you mean log? [unknown-tag]']),
    ('<state id="a"><onentry><assign expr="1"/></onentry></state></scxml>', ['2:24: error: <assign>: the attribute `location` is missing [missing-attribute]']),
    ('<state id="a"><invoke/></state></scxml>', ['2:15: error: <invoke>: not supported; invoked machines are not part of the language; use a service or an action [unsupported-element]']),
    ('<state id="a"/><final id="f"><transition target="a"/></final></scxml>', ['2:30: error: <transition>: nothing leads out of the final state `f`, and nothing stands in it; make it a <state> [unknown-tag]']),
    ('<state id="a"/><final id="f"><bt_tick/></final></scxml>', ['2:30: error: <bt_tick>: nothing leads out of the final state `f`, and nothing stands in it; make it a <state> [unknown-tag]']),
    ('<state id="a"><transitoin/></state></scxml>', ['2:15: error: <transitoin>: not an element of <state>; did you mean transition? [unknown-tag]']),
    ('<state id="a" final="true"/></scxml>', ['2:22: error: <state>: unknown attribute `final`; a final state is an element of its own, <final id="…"/> [unknown-attribute]']),
    ('<state id="a"><transition after="1s" event="e"/></state></scxml>', ['2:45: error: <transition>: `after` and `event` exclude each other; write one of them [unknown-attribute]']),
    ('<state id="a"><transition event="e" target="a"><target id="a"/></transition></state></scxml>', ['2:45: error: <transition>: a `target` attribute and <target> elements exclude each other [unknown-attribute]']),
    ('<state id="a"><transition event="e"><target id="a" prob="2"/><target id="a"/></transition></state></scxml>', ['2:58: error: <target>: `2` is not a probability; a number from 0 to 1 [bad-probability]']),
    ('<state id="a"><transition event="e"><target id="b"/></transition></state></scxml>', ['2:49: error: <target>: the target state `b` does not exist; known: a [unknown-target]']),
    ('<ros_topic_publisher type="std_msgs/Int32"/><state id="a"/></scxml>', ['2:1: error: <ros_topic_publisher>: the attribute `topic` is missing; write topic="/…" [missing-attribute]']),
    ('<ros_topic_publisher topic="/t"/><state id="a"/></scxml>', ['2:1: error: <ros_topic_publisher>: the attribute `type` is missing [missing-attribute]']),
    ('<bt_declare_port_in key="k" type="intt8"/><state id="a"/></scxml>', ['2:35: error: <bt_declare_port_in>: unknown type `intt8`; did you mean int8? [unknown-type]']),
    ('<datamodel><date id="x"/></datamodel><state id="a"/></scxml>', ['2:12: error: <date>: not an element of <datamodel>; did you mean data? [unknown-tag]']),
    ('<datamodel><data id="x" type="p/Msg"/></datamodel><state id="a"/></scxml>', ['2:31: error: <data>: unknown type `p/Msg`; give the folder of its definition with --interfaces [unknown-type]']),
    *(
        (f'<datamodel><data id="x" expr="{first}"/><data id="y" expr="1"/></datamodel><state id="a"/></scxml>', [f'2:31: error: <data>: `{first}` has no value yet; variables begin in the order of their <data> [undeclared-variable]'])
        for first in "xy"
    ),
    ('<datamodel><data id="x" expr="y"/></datamodel><state id="a"/></scxml>', ['2:31: error: <data>: `y` is not declared; declare it with <data> [undeclared-variable]']),
    ('<datamodel><data id="x"><bt_get_input key="k"/></data></datamodel><state id="a"/></scxml>', ['2:25: error: <data>: port `k` is not declared; declare it with <bt_declare_port_in> [undeclared-port]']),
    ('<datamodel><data id="x" type="int8"/></datamodel><state id="a"><onentry><assign location="x.y" expr="1"/></onentry></state></scxml>', ['2:91: error: <assign>: a value of type int8 has no `y` [unknown-field]']),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"><onentry><ros_topic_publish name="/t"><field name="data.x" expr="1"/></ros_topic_publish></onentry></state></scxml>', ['2:108: error: <field>: int32 has no field `x`; it has no fields [unknown-field]']),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"><onentry><ros_topic_publish name="/t"><field name="data" expr="\'x\'"/></ros_topic_publish></onentry></state></scxml>', ['2:133: error: <field>: a value of type string where int32 is declared; a value of type int32 is needed [type-mismatch]']),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"><onentry><ros_topic_publish name="/t"><param name="data" expr="1"/></ros_topic_publish></onentry></state></scxml>', ['2:108: error: <param>: not an element of <ros_topic_publish>; known: field [unknown-tag]']),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"><onentry><ros_topic_publish/></onentry></state></scxml>', ['2:79: error: <ros_topic_publish>: the attribute `name` is missing [missing-attribute]']),
    ('<ros_service_client service_name="/s" type="std_srvs/Trigger"/><state id="a"><onentry><ros_service_send_request name="/s"><field name="x" expr="1"/></ros_service_send_request></onentry><ros_service_handle_response name="/s"/></state></scxml>', ['2:123: error: <field>: std_srvs/srv/Trigger_Request has no field `x`; it has no fields [unknown-field]']),
    ('<state id="a"><onentry><bt_return_halted><field name="x" expr="1"/></bt_return_halted></onentry></state></scxml>', ['2:42: error: <field>: this output has no field `x` [unknown-field]']),
    ('<state id="a"><ros_service_handle_error name="/s"/></state></scxml>', ['2:47: error: <ros_service_handle_error>: no client called `/s` is declared; declare a client at the top of the machine [undeclared-interface]']),
    ('<state id="a"><ros_action_handle_goal_response name="/s"/></state></scxml>', ['2:54: error: <ros_action_handle_goal_response>: no action client called `/s` is declared; declare an action client at the top of the machine [undeclared-interface]', '2:15: error: <ros_action_handle_goal_response>: the attribute `accept` is missing [missing-attribute]', '2:15: error: <ros_action_handle_goal_response>: the attribute `reject` is missing [missing-attribute]']),
    ('<ros_service_client service_name="/s" type="std_srvs/Trigger"/><state id="a"><onentry><ros_service_send_request name="/s"/></onentry></state></scxml>', ['2:1: warning: the client /s: its responses are never read; handle it with <ros_service_handle_response> [unread-input]']),
    ('<ros_service_server service_name="/s" type="std_srvs/Trigger"/><state id="a"/></scxml>', ['2:1: warning: the server /s: its requests are never answered; handle it, or remove the declaration [unread-input]']),
    ('<ros_service_server service_name="/s" type="std_srvs/Trigger"/><state id="a"><onentry><ros_service_send_response name="/s"><field name="success" expr="true"/><field name="message" expr="\'\'"/></ros_service_send_response></onentry></state></scxml>', ['2:1: warning: the server /s: its requests are never answered; handle it, or remove the declaration [unread-input]']),
    ('<ros_time_rate name="t" rate_hz="1"/><state id="a"/></scxml>', ['2:1: warning: the timer t: its callbacks are never handled; handle it, or remove the declaration [unread-input]']),
    ('<ros_action_server name="g" action_name="/g" type="nav2_msgs/Spin"/><state id="a"/></scxml>', ['2:1: error: unknown type nav2_msgs/action/Spin; give the folder of its definition with --interfaces [unknown-type]']),
    ('<ros_service_client service_name="/s" type="std_srvs/Trigger"/><state id="a"/></scxml>', ['2:1: warning: the client /s is declared and never used; use it, or remove the declaration [unused-interface]']),
]  # fmt: skip


@pytest.mark.parametrize(("body", "expected"), FAULTS, ids=[str(i) for i in range(len(FAULTS))])
def test_a_fault_is_reported_once_and_alone(tmp_path: Path, body: str, expected: list[str]) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(HEAD + body)
    assert findings(path) == expected


NESTED = [
    # (body from line 2 on, all findings)
    ('<state id="a" initial="b"/></scxml>', ['2:24: error: <state>: state `a` has an initial state, and no states inside; leave that out [unknown-target]']),
    ('<state id="a"><initial><transition target="a"/></initial></state></scxml>', ['2:15: error: <state>: state `a` has an initial state, and no states inside; leave that out [unknown-target]']),
    ('<state id="a" initial="b"><state id="c"/></state><state id="b"/></scxml>', ['2:24: error: <state>: `b` is not a state inside `a`; known: c [unknown-target]']),
    ('<state id="a" initial="b"><state id="b" initial="a"><state id="c"/></state></state></scxml>', ['2:50: error: <state>: `a` is not a state inside `b`; known: c [unknown-target]']),
    ('<state id="a" initial="x"><state id="b"/></state></scxml>', ['2:24: error: <state>: the state `x` does not exist; known: a, b [unknown-target]']),
    ('<state id="a" initial="b c"><state id="b"/><state id="c"/></state></scxml>', ['2:24: error: <state>: 2 states are named, which can be active together in a <parallel> only; parallel states are not part of the language: name one state [unsupported-element]']),
    ('<state id="a"><transition event="e" target="b c"/><state id="b"/><state id="c"/></state></scxml>', ['2:45: error: <transition>: 2 states are named, which can be active together in a <parallel> only; parallel states are not part of the language: name one state [unsupported-element]']),
    ('<state id="a" initial="b"><initial><transition target="b"/></initial><state id="b"/></state></scxml>', ['2:27: error: <initial>: state `a` has an initial state already; write one of them [unknown-tag]']),
    ('<state id="a"><initial/><state id="b"/></state></scxml>', ['2:15: error: <initial>: <initial> has no transition; write <initial><transition target="…"/></initial> [missing-element]']),
    ('<state id="a"><initial><transition event="e" cond="true" target="b"/></initial><state id="b"/></state></scxml>', ['2:43: error: <transition>: the transition of <initial> waits for nothing, and always holds; leave `event` out [unknown-attribute]', '2:52: error: <transition>: the transition of <initial> waits for nothing, and always holds; leave `cond` out [unknown-attribute]']),
    ('<history id="h"/><state id="a"/></scxml>', ['2:1: error: <history>: not an element of <scxml>; it stands in a compound state, of which it remembers the last state [unknown-tag]']),
    ('<state id="a"><history id="h"/><state id="b"/></state></scxml>', ['2:15: error: <history>: <history> has no transition; write <history><transition target="…"/></history> [missing-element]']),
    ('<state id="a"><history id="h" type="full"><transition target="b"/></history><state id="b"/></state></scxml>', ['2:37: error: <history>: `full` is no type of a history; write shallow or deep [unknown-attribute]']),
    ('<state id="a"><history id="h"><transition target="c"/></history><state id="b"/></state><state id="c"/></scxml>', ['2:51: error: <transition>: `c` is not a state inside `a`; known: b [unknown-target]']),
    ('<state id="a"><history id="g"><transition target="h"/></history><history id="h"><transition target="g"/></history><state id="b"/></state></scxml>', ['2:51: error: <transition>: `h` is not a state inside `a`; known: b [unknown-target]', '2:101: error: <transition>: `g` is not a state inside `a`; known: b [unknown-target]']),
    ('<state id="a"><history id="b"><transition target="b"/></history><state id="b"/></state></scxml>', ['2:15: error: <history>: a second state is called `b`; state ids are unique in a machine [duplicate-state]']),
    ('<state id="a"><state id="b"/></state><state id="b"/></scxml>', ['2:38: error: <state>: a second state is called `b`; state ids are unique in a machine [duplicate-state]']),
    ('<state id="a"><transition event="e" type="inner" target="b"/><state id="b"/></state></scxml>', ['2:43: error: <transition>: `inner` is no type of a transition; write internal or external [unknown-attribute]']),
    ('<state id="a"><transition event="e" target="p1"/><parallel id="p"><state id="p1"/><state id="p2"/></parallel></state></scxml>', ['2:50: error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]']),
    ('<parallel id="p"><state id="p1"/><state id="p2"/></parallel></scxml>', ['2:1: error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]']),
    ('<state id="a"><transition event="e" target="p1 p2"/></state><parallel id="p"><state id="p1"/><state id="p2"/></parallel></scxml>', ['2:61: error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]']),
    ('<state id="a"><initial><transition target="p1 p2"/></initial><parallel id="p"><state id="p1"/><state id="p2"/></parallel></state></scxml>', ['2:62: error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]']),
    ('<state id="a"><transition event="e" target="h"/></state><parallel id="p"><history id="h"><transition target="p1 p2"/></history><state id="p1"/><state id="p2"/></parallel></scxml>', ['2:57: error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]']),
    ('<parallel id="p"><parallel id="q"><state id="p1"/><state id="p2"/></parallel><state id="a"/></parallel></scxml>', ['2:1: error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]']),
    ('<state id="a"><transition event="e" target="p"/></state><parallel id="p"><state id="a"/><state><transition target="nowhere" cond="1 +"/></state><bogus/></parallel></scxml>', ['2:57: error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]']),
    ('<state id="a"><transition event="e" cond="In(\'z\')" target="b"/><state id="b"/></state></scxml>', ["2:43: error: the state `z` does not exist; known: a, b [unknown-target]"]),
    ('<state id="a"><transition event="e" cond="In(a)" target="a"/></state></scxml>', ["2:43: error: <transition>: `In(a)`: In takes the id of one state; write the id of a state in quotes, In('moving') [unsupported-expression]"]),
    ('<state id="a"/><final id="f"><donedata><param name="x" expr="1"/></donedata></final></scxml>', ['2:30: error: <donedata>: the machine has nobody to give data to when it is done; it stands in the final state of a compound state [unsupported-element]']),
    ('<state id="a"><state id="b"/><final id="f"><donedata><content expr="1"/></donedata></final></state></scxml>', ['2:54: error: <content>: not an element of <donedata>; known: param [unknown-tag]']),
    ('<state id="a"><final id="f"><state id="b"/></final></state></scxml>', ['2:29: error: <state>: nothing leads out of the final state `f`, and nothing stands in it; make it a <state> [unknown-tag]']),
    ('<state id="a"><onentry><assign location="x" expr="_msg.data"/></onentry><state id="b"/></state></scxml>', ['2:42: error: <assign>: `x` is not declared; declare it with <data> [undeclared-variable]', '2:51: error: <assign>: `_msg` is not available here; no event data is, outside a handler [event-data-not-available]']),
    ('<ros_topic_subscriber name="t" topic="/t" type="std_msgs/Int32"/><datamodel><data id="x" type="int32"/></datamodel><state id="a"><onentry><assign location="x" expr="_msg.data"/></onentry><state id="b"/></state><state id="c"><ros_topic_callback name="t" target="a"/></state></scxml>', ['2:166: error: <assign>: `_msg` is not available here; no event data is, outside a handler [event-data-not-available]', '2:211: warning: <state>: state `c` cannot be reached from `a/b` [unreachable-state]']),
    # findings of copies are merged; what is right in one state is right
    ('<state id="a"><transition event="e" cond="1 == 2" target="b"/><state id="b"/><state id="c"/><transition event="f" target="c"/></state></scxml>', ['2:43: warning: <transition>: never taken: its condition never holds; correct the condition, or remove the transition [never-taken]']),
    ('<state id="a"><transition event="e" target="b"/><transition event="e" target="c"/><state id="b"/><state id="c"/><transition event="f" target="c"/></state></scxml>', ['2:49: warning: <transition>: never taken: the transition at 2:15 takes the same event and has no condition; put it before that one, or give that one a condition [shadowed-transition]']),
    ('<state id="a"><transition event="e" target="c"/><state id="b"><transition event="e" target="c"/></state><state id="c"/></state></scxml>', []),
    ('<state id="a"><transition event="e" cond="In(\'c\')" target="b"/><transition event="e" target="c"/><state id="b"/><state id="c"/></state></scxml>', []),
    ('<state id="a"/><state id="b"><state id="c"/><state id="d"/></state></scxml>', ['2:16: warning: <state>: state `b` cannot be reached from `a` [unreachable-state]']),
    ('<state id="a"><transition event="e" cond="x" target="b"/><state id="b"/><state id="c"/><transition event="f" target="c"/></state></scxml>', ['2:43: error: <transition>: `x` is not declared; declare it with <data> [undeclared-variable]']),
    ('<ros_service_server name="s" service_name="/s" type="std_srvs/Trigger"/><state id="a"><ros_service_handle_request name="s"/><state id="b"><transition event="f" target="c"/></state><state id="c"/></state></scxml>', ['2:87: warning: <ros_service_handle_request>: state `a` takes a request to /s that no path ever answers: its caller would never be answered; add <ros_service_send_response> to a path from here [request-unanswered]']),
]  # fmt: skip


@pytest.mark.parametrize(("body", "expected"), NESTED, ids=[str(i) for i in range(len(NESTED))])
def test_what_is_wrong_with_compound_states_is_reported_once(
    tmp_path: Path, body: str, expected: list[str]
) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(HEAD + body)
    assert findings(path) == expected


@pytest.mark.parametrize("depth", [62, 10_000])
def test_what_is_nested_deep_is_read_or_refused_once(tmp_path: Path, depth: int) -> None:
    path = tmp_path / "model.scxml"
    inside = "".join(f'<state id="{"s" if n else "a"}{n or ""}">' for n in range(depth))
    path.write_text(f"{HEAD}{inside}{'</state>' * depth}</scxml>")
    found = findings(path)
    assert len(found) == (depth > 62)
    assert all("elements are nested more than 64 deep" in one for one in found)


def test_a_machine_that_would_become_huge_is_refused_once(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    inside = "".join(f'<state id="s{n}"/>' for n in range(3_000))
    ways = '<transition event="e" cond="In(\'s7\')" target="s1"/>' * 10
    path.write_text(f'{HEAD}<state id="a">{ways}{inside}</state></scxml>')
    (found,) = findings(path)
    assert "more than 20000 transitions, those of compound states counted for each state" in found
