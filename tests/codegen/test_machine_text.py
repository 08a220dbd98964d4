"""What a person reads in a generated machine: nothing that never runs, nothing twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.codegen.machines import _without_last_done
from m2c.codegen.program import Branch, Call, Done, Guard, If, Statement
from m2c.codegen.source import Source
from tests.codegen.harness import Generated

INTERFACES = {
    "lab/srv/Ask.srv": "int32 number\n---\nbool is_ok\n",
    "lab/msg/Level.msg": "int32 data\n",
}
ANSWER = """
  <ros_service_handle_request name="/ask" {attributes}>
    <ros_service_send_response name="/ask"><field name="is_ok" expr="true"/></ros_service_send_response>
  </ros_service_handle_request>"""


def machine(folder: Path, states: str, data: str = "") -> Generated:
    """A machine that serves ``/ask``, hears ``/level`` and has these states."""
    text = f"""<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Skill" initial="a">
      <datamodel>{data}</datamodel>
      <ros_service_server service_name="/ask" type="lab/Ask"/>
      <ros_topic_subscriber topic="/level" type="lab/Level"/>
      {states}
    </scxml>"""
    return Generated(folder, text, INTERFACES)


def test_states_that_do_the_same_share_a_branch(tmp_path: Path) -> None:
    stay, leave = ANSWER.format(attributes=""), ANSWER.format(attributes='target="a"')
    made = machine(
        tmp_path,
        f'<state id="a">{stay}<ros_topic_callback name="/level" target="b"/></state>'
        f'<state id="b">{leave}<ros_topic_callback name="/level" target="c"/></state>'
        f'<state id="c">{stay}<ros_topic_callback name="/level" target="a"/></state>',
    )
    text = made.files["machine.py"]
    assert "if self.state in (SkillState.A, SkillState.C):" in text
    assert text.count("self._outputs.respond_ask(") == 2
    for state, following in (("a", "a"), ("b", "a"), ("c", "c")):
        while made.it.state.value != state:
            made.it.on_level_message(made.interfaces.Level())
        assert made.it.on_ask_request(made.interfaces.AskRequest())
        assert made.it.state.value == following
        assert made.outputs.names() == ["respond_ask"]


def test_a_machine_that_waits_for_no_internal_event_has_no_queue_of_them(tmp_path: Path) -> None:
    data = '<data id="values" type="int32[]" expr="[]"/>'
    fails = """<ros_topic_callback name="/level">
        <assign location="values[_msg.data]" expr="1"/></ros_topic_callback>"""
    made = machine(tmp_path, f'<state id="a">{ANSWER.format(attributes="")}{fails}</state>', data)
    text = made.files["machine.py"]
    assert "_internal" not in text
    assert "_complete_macrostep" not in text
    made.it.on_level_message(made.interfaces.Level(data=-1))
    assert [item[:2] for item in made.outputs.sent] == [("fault", "model.scxml:9:9")]


def test_a_machine_and_a_message_of_one_name_have_classes_of_their_own(tmp_path: Path) -> None:
    text = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Level" initial="a">
      <ros_topic_subscriber topic="/level" type="lab/Level"/>
      <state id="a"><ros_topic_callback name="/level" target="b"/></state><state id="b"/>
    </scxml>"""
    made = Generated(tmp_path, text, INTERFACES)
    assert type(made.it).__name__ == "Level"
    assert made.interfaces.LabLevel.__type_name__ == "lab/msg/Level"
    made.it.on_level_message(made.interfaces.LabLevel())
    assert made.it.state.value == "b"


def test_a_machine_that_waits_for_error_execution_gets_it(tmp_path: Path) -> None:
    data = '<data id="values" type="int32[]" expr="[]"/>'
    fails = """<ros_topic_callback name="/level">
        <assign location="values[_msg.data]" expr="1"/></ros_topic_callback>
        <transition event="error.execution" target="b"/>"""
    answer = ANSWER.format(attributes="")
    made = machine(
        tmp_path, f'<state id="a">{answer}{fails}</state><state id="b">{answer}</state>', data
    )
    made.it.on_level_message(made.interfaces.Level(data=-1))
    assert made.it.state.value == "b"


def test_an_event_that_a_machine_sends_itself_and_never_takes_is_accepted(tmp_path: Path) -> None:
    made = machine(
        tmp_path,
        f'<state id="a"><onentry><send event="later" delay="1s"/></onentry>'
        f"{ANSWER.format(attributes='')}</state>",
    )
    assert made.outputs.names() == ["send_self"]
    made.it.on_event("later")
    assert made.it.state.value == "a"


def test_what_is_taken_and_does_nothing_needs_no_code(tmp_path: Path) -> None:
    hears = '<ros_topic_callback name="/level"/>'
    made = machine(tmp_path, f'<state id="a">{ANSWER.format(attributes="")}{hears}</state>')
    assert "pass" not in made.files["machine.py"]
    made.it.on_level_message(made.interfaces.Level())
    assert made.outputs.sent == []


DONE = Done("return")
X, Y, Z = (Call(Source(name)) for name in "xyz")


def when(test: str | None, *body: Statement) -> Branch:
    return Branch(Source(test) if test is not None else None, body)


@pytest.mark.parametrize(
    ("written", "kept"),
    [
        ((If((when("a", X, DONE),)),), (If((when("a", X),)),)),
        ((If((when("a", DONE), when("b", Y))),), (If((when("a"), when("b", Y))),)),
        ((If((when("a", DONE),)), Y), (If((when("a", DONE),)), Y)),
        ((If((when("a", If((when("b", X, DONE),)), Y),)),),) * 2,
        (
            (If((when("a", If((when("b", X, DONE),))), when(None, Z))),),
            (If((when("a", If((when("b", X),))), when(None, Z))),),
        ),
        ((Guard((X,), "m.scxml:1:1"), DONE), (Guard((X,), "m.scxml:1:1"),)),
    ],
)
def test_a_return_goes_only_where_nothing_would_run_after_it(
    written: tuple[Statement, ...], kept: tuple[Statement, ...]
) -> None:
    assert _without_last_done(written) == kept
