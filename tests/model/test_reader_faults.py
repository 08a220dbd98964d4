"""Every further fault of a single model, with everything that is said of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.model.test_reader_messages import HEAD, findings

FAULTS = [
    # (body from line 2 on, all findings)
    ('<state id="a"><onentry><send eventexpr="x"/></onentry></state></scxml>', ['2:41: error: <send>: the attribute `eventexpr` is not part of the language; use `event` [unsupported-element]']),
    ('<state id="a"><onentry><send event="e" type="http"/></onentry></state></scxml>', ['2:46: error: <send>: the attribute `type` is not part of the language; use `event` [unsupported-element]']),
    ('<state id="a"><onentry><send event="e" target="other"/></onentry></state></scxml>', ['2:24: warning: <send>: `e` is sent to `other`, and no such machine was read; read it together with this [unknown-machine]']),
    *(
        (f'<state id="a"><onentry><send event="e" target="{target}"/></onentry></state></scxml>', [f'2:48: error: <send>: the target `{target}` is not part of the language; name a machine of the system, or #_internal; without a target, every machine that has a transition for the event gets it [unsupported-element]'])
        for target in ("#_parent", "#_scxml_7", "http://example.org/", "#_internal_")
    ),
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
    ('<state id="a" initial="b"/></scxml>', ['2:24: error: <state>: state `a` has an initial state: compound states are not part of the language; remove the attribute [unsupported-element]']),
    ('<state id="a"><invoke/></state></scxml>', ['2:15: error: <invoke>: not supported; invoked machines are not part of the language; use a service or an action [unsupported-element]']),
    ('<state id="a"/><final id="f"><transition target="a"/></final></scxml>', ['2:30: error: <transition>: the machine ends in the final state `f`, which takes no event; make it a <state> [unknown-tag]']),
    ('<state id="a"/><final id="f"><bt_tick/></final></scxml>', ['2:30: error: <bt_tick>: the machine ends in the final state `f`, which takes no event; make it a <state> [unknown-tag]']),
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
