"""What each operator makes of a small machine, written out."""

from __future__ import annotations

from collections import defaultdict

from m2c.language.expressions import Unary
from m2c.model import DiagnosticLog, InterfaceLibrary
from m2c.model.machine import Emit, Machine
from m2c.model.nesting import lowered
from m2c.model.reader import machine_of
from m2c.model.xml import parse_xml
from tests.mutation import equivalence, mutants
from tests.mutation.shape import Shapes

GATE = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Gate" initial="shut">
  <datamodel>
    <data id="seen" type="int32" expr="0"/>
    <data id="last" type="int32" expr="0"/>
    <data id="LIMIT" type="int32" expr="3"/>
  </datamodel>
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/spare" type="std_msgs/Int32"/>
  <state id="shut">
    <ros_topic_callback name="/in" cond="_msg.data &gt; LIMIT" target="open">
      <assign location="seen" expr="seen + 1"/>
      <assign location="last" expr="_msg.data"/>
      <ros_topic_publish name="/out"><field name="data" expr="seen"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
  <state id="open">
    <ros_topic_callback name="/in">
      <ros_topic_publish name="/out"><field name="data" expr="_msg.data"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
</scxml>
"""


def read(text: str) -> Machine:
    log = DiagnosticLog()
    root = parse_xml(text.encode(), "gate.scxml", log)
    assert root is not None
    machine = machine_of(root, log, InterfaceLibrary())
    assert machine is not None
    assert not log.has_errors, log.diagnostics
    return machine


def described(text: str = GATE) -> dict[str, list[str]]:
    found: dict[str, list[str]] = defaultdict(list)
    for mutant in mutants(read(text)):
        found[mutant.operator].append(mutant.description.removeprefix("gate.scxml:"))
    return found


def test_a_transition_is_dropped() -> None:
    assert described()["dropped transition"] == [
        "11: transition of `shut` on message /in dropped",
        "18: transition of `open` on message /in dropped",
    ]


def test_a_transition_leads_to_every_other_state() -> None:
    assert described()["redirected transition"] == [
        "11: transition of `shut` on message /in leads to `shut` instead of `open`",
        "18: transition of `open` on message /in leads to `shut` instead of staying",
    ]


def test_a_condition_is_negated_and_its_boundary_constant_and_relation_are_moved() -> None:
    found = described()
    assert found["negated condition"] == ["11: condition negated"]
    assert found["shifted condition"] == [
        "11: `>` became `>=`",
        "11: `>` became `<`",
        "11: `LIMIT` became `4` in a condition",
        "11: `LIMIT` became `2` in a condition",
    ]


def test_an_output_is_dropped_sent_twice_and_altered() -> None:
    found = described()
    assert found["dropped output"] == ["14: publish /out dropped", "19: publish /out dropped"]
    assert found["duplicated output"] == [
        "14: publish /out sent twice",
        "19: publish /out sent twice",
    ]
    assert found["altered output"] == [
        "14: publish /out: field `data`: `seen` became `last`",
        "14: publish /out: field `data`: `seen` became `LIMIT`",
        "19: publish /out: field `data` left out",
    ]


def test_an_output_leaves_by_another_channel_and_channels_are_misspelt() -> None:
    assert described()["wrong channel"] == [
        "14: publish /out leaves by /spare instead",
        "19: publish /out leaves by /spare instead",
        "7: subscriber /in misspelt as /inn",
        "8: publisher /out misspelt as /outt",
        "9: publisher /spare misspelt as /sparee",
    ]


def test_an_input_ignored_everywhere_is_more_than_one_dropped_transition() -> None:
    assert described()["ignored input"] == ["11: message /in is ignored everywhere"]


def test_assignments_are_swapped_and_dropped() -> None:
    found = described()
    assert found["swapped assignments"] == ["12: the assignments to `seen` and `last` swapped"]
    assert found["dropped assignment"] == [
        "12: the assignment to `seen` dropped",
        "13: the assignment to `last` dropped",
    ]


def test_what_is_inside_an_if_and_an_action_thread_is_changed_too() -> None:
    text = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Server" initial="idle">
  <datamodel><data id="busy" type="bool" expr="false"/></datamodel>
  <ros_topic_publisher topic="/out" type="std_msgs/Bool"/>
  <ros_action_server name="run" action_name="/run" type="example_interfaces/Fibonacci"/>
  <ros_action_thread name="run" n_threads="1" initial="wait">
    <datamodel><data id="deep" type="int32" expr="0"/></datamodel>
    <state id="wait">
      <ros_action_handle_thread_start name="run">
        <if cond="deep &lt; 2"><assign location="deep" expr="deep + 1"/><else/>
          <ros_topic_publish name="/out"><field name="data" expr="true"/></ros_topic_publish></if>
      </ros_action_handle_thread_start>
    </state>
  </ros_action_thread>
  <state id="idle">
    <ros_action_handle_goal name="run"><assign location="busy" expr="true"/></ros_action_handle_goal>
  </state>
</scxml>"""
    found = described(text)
    assert found["dropped output"] == ["10: publish /out dropped"]
    assert found["altered output"] == ["10: publish /out: field `data`: `true` became `false`"]
    assert "9: the assignment to `deep` dropped" in found["dropped assignment"]
    assert found["negated condition"] == ["9: condition negated"]


def test_what_differs_only_by_its_place_in_the_file_has_one_shape() -> None:
    shapes = Shapes()
    moved = read(GATE.replace("<datamodel>", "\n\n<datamodel>"))
    assert moved != read(GATE)
    assert shapes.of(moved) == shapes.of(read(GATE))


def test_the_original_is_not_touched() -> None:
    machine = read(GATE)
    dropped = [mutant.machine for mutant in mutants(machine) if mutant.operator == "dropped output"]
    assert machine == read(GATE)
    remaining = [isinstance(item, Emit) for item in dropped[0].state("shut").transitions[0].body]
    assert remaining == [False, False]


NESTED = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Drive" initial="on">
  <datamodel><data id="mode" type="string" expr="'idle'"/></datamodel>
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/out" type="std_msgs/String"/>
  <state id="off"><ros_topic_callback name="/in" target="last"/></state>
  <state id="on">
    <initial><transition target="b"/></initial>
    <history id="last"><transition target="a"><log label="first"/></transition></history>
    <onentry>
      <ros_topic_publish name="/out"><field name="data" expr="mode"/></ros_topic_publish></onentry>
    <ros_topic_callback name="/in" cond="_msg.data &gt; 3" target="off"/>
    <state id="a"><ros_topic_callback name="/in" target="b"/></state>
    <state id="b"><onexit><assign location="mode" expr="'b'"/></onexit></state>
  </state>
</scxml>
"""


def nested_mutants() -> dict[str, Machine]:
    found = mutants(read(NESTED))
    return {item.description.removeprefix("gate.scxml:"): item.machine for item in found}


def test_compound_states_are_changed_as_they_were_written() -> None:
    found = nested_mutants()
    assert described(NESTED)["dropped transition"] == [
        "5: transition of `off` on message /in dropped",
        "11: transition of `on` on message /in dropped",
        "12: transition of `a` on message /in dropped",
    ]
    assert described(NESTED)["ignored input"] == ["5: message /in is ignored everywhere"]
    assert described(NESTED)["negated condition"] == ["11: condition negated"]
    assert described(NESTED)["dropped output"] == ["10: publish /out dropped"]
    assert described(NESTED)["altered output"] == ["10: publish /out: field `data` left out"]
    for mutated in found.values():
        assert lowered(mutated).states == mutated.states
        assert {state.name for state in mutated.states} == {"off", "on/a", "on/b"}
    dropped = found["11: transition of `on` on message /in dropped"]
    assert [len(state.transitions) for state in dropped.states] == [3, 1, 0]
    negated = found["11: condition negated"]
    own = [item.cond for state in negated.states for item in state.transitions if item.of]
    assert [isinstance(cond, Unary) for cond in own] == [True, True]


def test_transitions_lead_to_histories_and_ways_into_a_state_lead_elsewhere_in_it() -> None:
    found = described(NESTED)["redirected transition"]
    of_on = [text for text in found if text.startswith("11: transition of `on`")]
    assert [text.partition(" leads to ")[2] for text in of_on] == [
        "`on` instead of `off`",
        "`last` instead of `off`",
        "`a` instead of `off`",
    ]  # to `b` is to `on`
    assert [text for text in found if "the " in text] == [
        "7: the initial transition of `on` leads to `last` instead of `b`",
        "7: the initial transition of `on` leads to `a` instead of `b`",
        "8: the default transition of `last` leads to `b` instead of `a`",
    ]


def test_a_nested_machine_is_compared_with_its_mutants_as_it_runs() -> None:
    never_taken = '\n<ros_topic_callback name="/in"/></state>\n    <state id="b">'
    machine = read(NESTED.replace('</state>\n    <state id="b">', never_taken))
    told = [item.description for item in mutants(machine) if equivalence(machine, item.machine)]
    assert "gate.scxml:13: transition of `a` on message /in dropped" in told
    assert all(text.startswith("gate.scxml:13: ") for text in told)
