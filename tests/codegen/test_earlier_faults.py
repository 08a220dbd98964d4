"""What the earlier tool got wrong on real models, one test each."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.codegen.harness import Generated

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Skill" initial="idle">'
TICK = {"bt/srv/Tick.srv": "---\nint8 status\nbool is_ok\n"}
GO = {"nav/action/Go.action": "int32 poi\n---\nbool is_ok\n---\nint32 status\n"}
SERVER = '<ros_service_server service_name="/Skill/tick" type="bt/Tick"/>'


def answer(status: int) -> str:
    return (
        '<ros_service_send_response name="/Skill/tick">'
        f'<field name="status" expr="{status}"/><field name="is_ok" expr="true"/>'
        "</ros_service_send_response>"
    )


def test_both_branches_of_a_goal_response_fire(tmp_path: Path) -> None:
    text = f"""{HEAD}<ros_action_client name="go" action_name="/nav/go" type="nav/Go"/>
      <state id="idle"><ros_action_handle_goal_response name="go" accept="yes" reject="no"/></state>
      <state id="yes"/><state id="no"/></scxml>"""
    made = Generated(tmp_path, text, GO)
    made.it.on_go_accepted(1)
    assert made.it.state.value == "yes"
    made.it.state = type(made.it.state)("idle")
    made.it.on_go_rejected(1)
    assert made.it.state.value == "no"


CALLER = {"bt/srv/Ask.srv": "int32 key\n---\nint32 value\nbool is_ok\n"}
CLIENT = '<ros_service_client service_name="/Box/get" type="bt/Ask"/>'


def test_a_response_field_used_only_in_a_cond_is_delivered(tmp_path: Path) -> None:
    text = f"""{HEAD}{CLIENT}<state id="idle">
      <ros_service_handle_response name="/Box/get" cond="_res.value == 7" target="seven"/>
      </state><state id="seven"/></scxml>"""
    made = Generated(tmp_path, text, CALLER)
    made.it.on_get_response(made.interfaces.AskResponse(value=3))
    assert made.it.state.value == "idle"
    made.it.on_get_response(made.interfaces.AskResponse(value=7))
    assert made.it.state.value == "seven"


def test_res_inside_an_if_cond_is_read(tmp_path: Path) -> None:
    text = f"""{HEAD}{CLIENT}<datamodel><data id="n" type="int32" expr="0"/></datamodel><state id="idle">
      <ros_service_handle_response name="/Box/get"><if cond="_res.is_ok">
      <assign location="n" expr="_res.value"/><else/><assign location="n" expr="-1"/></if>
      </ros_service_handle_response></state></scxml>"""
    made = Generated(tmp_path, text, CALLER)
    made.it.on_get_response(made.interfaces.AskResponse(value=5, is_ok=True))
    assert made.it.n == 5
    made.it.on_get_response(made.interfaces.AskResponse(value=5, is_ok=False))
    assert made.it.n == -1


def test_after_is_a_delay_and_is_cancelled_on_leaving(tmp_path: Path) -> None:
    text = f"""{HEAD}<state id="idle"><transition after="5s" target="late"/>
      <transition event="go" target="early"/></state>
      <state id="late"/><state id="early"/></scxml>"""
    made = Generated(tmp_path, text)
    assert made.it.state.value == "idle"
    assert made.outputs.sent == [("start_delay", "idle#0", 5.0, made.it.on_elapsed)]
    made.it.on_event("go")
    assert made.it.state.value == "early"
    assert made.outputs.sent[-1] == ("stop_delay", "idle#0", made.it.on_elapsed)
    made.it.on_elapsed("idle#0")
    assert made.it.state.value == "early"


def test_the_interface_comes_from_the_type_not_from_the_services_name(tmp_path: Path) -> None:
    text = f"""{HEAD}<ros_service_client service_name="/X/Something" type="bt/Ask"/><state id="idle">
      <ros_service_handle_response name="/X/Something"/></state></scxml>"""
    made = Generated(tmp_path, text, CALLER)
    assert made.node.SOMETHING.type_name == "bt/srv/Ask"


def test_two_services_with_the_same_last_name_stay_apart(tmp_path: Path) -> None:
    text = f"""{HEAD}<ros_service_client service_name="/A/get" type="bt/Ask"/>
      <ros_service_client service_name="/B/get" type="bt/Ask"/>
      <state id="idle"><ros_service_handle_response name="/A/get" target="a"/>
      <ros_service_handle_response name="/B/get" target="b"/></state><state id="a"/><state id="b"/></scxml>"""
    made = Generated(tmp_path, text, CALLER)
    made.it.on_b_get_response(made.interfaces.AskResponse())
    assert made.it.state.value == "b"
    assert made.node.A_GET.name == "/A/get"
    assert made.node.B_GET.name == "/B/get"


def test_the_second_call_site_keeps_its_fields(tmp_path: Path) -> None:
    def ask(key: int) -> str:
        return (
            '<ros_service_send_request name="/Box/get">'
            f'<field name="key" expr="{key}"/></ros_service_send_request>'
        )

    text = f"""{HEAD}{CLIENT}<state id="idle"><transition event="e" target="two">{ask(1)}</transition></state>
      <state id="two"><transition event="e">{ask(2)}</transition></state></scxml>"""
    made = Generated(tmp_path, text, CALLER)
    made.it.on_event("e")
    made.it.on_event("e")
    assert [item[1].key for item in made.outputs.sent] == [1, 2]


def test_publishers_servers_and_timers_are_not_dropped(tmp_path: Path) -> None:
    text = f"""{HEAD}{SERVER}<ros_topic_publisher topic="/t" type="std_msgs/Int32"/>
      <ros_time_rate name="clock" rate_hz="4"/><state id="idle">
      <ros_rate_callback name="clock"><ros_topic_publish name="/t"><field name="data" expr="3"/>
      </ros_topic_publish></ros_rate_callback>
      <ros_service_handle_request name="/Skill/tick">{answer(0)}</ros_service_handle_request></state></scxml>"""
    made = Generated(tmp_path, text, TICK)
    made.it.on_clock_timer()
    assert made.it.on_tick_request(made.interfaces.TickRequest())
    assert made.outputs.names() == ["publish_t", "respond_tick"]
    assert 'binding.timer(4.0, self.machine.on_clock_timer, "clock")' in made.files["node.py"]


def test_success_abort_and_cancel_of_a_goal_are_told_apart(tmp_path: Path) -> None:
    text = f"""{HEAD}<ros_action_client name="go" action_name="/nav/go" type="nav/Go"/><state id="idle">
      <ros_action_handle_success_result name="go" target="done"/>
      <ros_action_handle_aborted_result name="go" target="failed"/>
      <ros_action_handle_canceled_result name="go" target="stopped"/></state>
      <state id="done"/><state id="failed"/><state id="stopped"/></scxml>"""
    for method, state in (("succeeded", "done"), ("aborted", "failed"), ("canceled", "stopped")):
        folder = tmp_path / method
        folder.mkdir()
        made = Generated(folder, text, GO)
        getattr(made.it, f"on_go_{method}")(made.interfaces.GoResult(), 1, 4)
        assert made.it.state.value == state


def test_feedback_is_delivered(tmp_path: Path) -> None:
    text = f"""{HEAD}<ros_action_client name="go" action_name="/nav/go" type="nav/Go"/>
      <datamodel><data id="n" type="int32" expr="0"/></datamodel><state id="idle">
      <ros_action_handle_feedback name="go"><assign location="n" expr="_feedback.status"/>
      </ros_action_handle_feedback></state></scxml>"""
    made = Generated(tmp_path, text, GO)
    made.it.on_go_feedback(made.interfaces.GoFeedback(status=9), 1)
    assert made.it.n == 9


def test_halt_cancels_the_goal(tmp_path: Path) -> None:
    text = f"""{HEAD}<ros_action_client name="go" action_name="/nav/go" type="nav/Go"/>
      <ros_service_server service_name="/Skill/halt" type="bt/Tick"/><state id="idle">
      <ros_service_handle_request name="/Skill/halt"><ros_action_send_cancel name="go"/>
      </ros_service_handle_request></state></scxml>"""
    made = Generated(tmp_path, text, {**GO, **TICK})
    made.it.on_halt_request(made.interfaces.TickRequest())
    assert made.outputs.sent == [("send_cancel_go", None)]


def test_a_request_that_the_state_discards_is_reported_to_the_node(tmp_path: Path) -> None:
    text = f"""{HEAD}{SERVER}<state id="idle"><ros_service_handle_request name="/Skill/tick" target="busy"/>
      </state><state id="busy"/></scxml>"""
    made = Generated(tmp_path, text, TICK)
    assert made.it.on_tick_request(made.interfaces.TickRequest()) is True
    assert made.it.on_tick_request(made.interfaces.TickRequest()) is False


def test_output_is_the_same_each_time(tmp_path: Path) -> None:
    text = f"{HEAD}{CLIENT}<state id='idle'><ros_service_handle_response name='/Box/get'/></state></scxml>"
    folders = [tmp_path / "one", tmp_path / "two"]
    made = []
    for folder in folders:
        folder.mkdir()
        made.append(Generated(folder, text, CALLER))
    for name, content in made[0].files.items():
        other = made[1].files[name].replace(made[1].package, made[0].package)
        strip = content.split("\n", 1)[1], other.split("\n", 1)[1]
        assert strip[0] == strip[1]


@pytest.mark.parametrize("draw", [0.1, 0.6])
def test_a_probabilistic_target_is_drawn(tmp_path: Path, draw: float) -> None:
    text = f"""{HEAD}<state id="idle"><transition event="e"><target id="low" prob="0.5"/>
      <target id="high" prob="0.5"/></transition></state><state id="low"/><state id="high"/></scxml>"""
    made = Generated(tmp_path, text)
    made.it._random = lambda: draw
    made.it.on_event("e")
    assert made.it.state.value == ("low" if draw < 0.5 else "high")


def test_an_index_out_of_range_queues_error_execution(tmp_path: Path) -> None:
    text = f"""{HEAD}<datamodel><data id="xs" type="int32[]" expr="[1]"/><data id="n" type="int32" expr="0"/>
      </datamodel><state id="idle"><transition event="grow"><assign location="xs[xs.length]" expr="5"/></transition>
      <transition event="bad"><assign location="xs[-1]" expr="5"/><assign location="n" expr="1"/></transition>
      <transition event="error.execution" target="broken"/></state><state id="broken"/></scxml>"""
    made = Generated(tmp_path, text)
    made.it.on_event("grow")
    assert made.it.xs == [1, 5]
    made.it.on_event("bad")
    assert made.it.state.value == "broken"
    assert made.it.n == 0
