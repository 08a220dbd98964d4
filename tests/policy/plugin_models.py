"""Models of plugins for tests, and a system that uses them."""

from __future__ import annotations

from pathlib import Path

from m2c.check import check_system
from m2c.model import DiagnosticLog, System, load
from m2c.policy.program import Policy, read_policy

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="{initial}">'

INVERT = (
    HEAD.format(name="Invert", initial="wait")
    + """
<bt_declare_port_in key="CHILDREN_COUNT" type="int8"/>
<datamodel><data id="count" type="int8"><expr><bt_get_input key="CHILDREN_COUNT"/></expr></data></datamodel>
<state id="wait">
  <transition target="error" cond="count != 1"/>
  <bt_tick target="ticked"/>
  <bt_halt target="halting"/>
</state>
<state id="ticked">
  <onentry><bt_tick_child id="0"/></onentry>
  <bt_child_status id="0" cond="_bt.status == SUCCESS" target="wait"><bt_return_status status="FAILURE"/></bt_child_status>
  <bt_child_status id="0" cond="_bt.status == FAILURE" target="wait"><bt_return_status status="SUCCESS"/></bt_child_status>
  <bt_child_status id="0" cond="_bt.status == RUNNING" target="wait"><bt_return_status status="RUNNING"/></bt_child_status>
</state>
<state id="halting">
  <onentry><bt_halt_child id="0"/></onentry>
  <bt_child_halted id="0" target="wait"><bt_return_halted/></bt_child_halted>
</state>
<state id="error"/>
</scxml>"""
)

IN_TURN = (
    HEAD.format(name="InTurn", initial="wait")
    + """
<bt_declare_port_in key="CHILDREN_COUNT" type="int8"/>
<datamodel>
  <data id="count" type="int8"><expr><bt_get_input key="CHILDREN_COUNT"/></expr></data>
  <data id="current" type="int8" expr="0"/>
</datamodel>
<state id="wait">
  <bt_tick target="next"><assign location="current" expr="0"/></bt_tick>
</state>
<state id="next">
  <onentry><if cond="current &lt; count"><bt_tick_child id="current"/></if></onentry>
  <transition cond="current == count" target="wait"><bt_return_status status="SUCCESS"/></transition>
  <bt_child_status id="current" cond="_bt.status == SUCCESS" target="next">
    <assign location="current" expr="current + 1"/>
  </bt_child_status>
  <bt_child_status id="current" cond="_bt.status == FAILURE" target="wait">
    <bt_return_status status="FAILURE"/>
  </bt_child_status>
  <bt_child_status id="current" cond="_bt.status == RUNNING" target="wait">
    <bt_return_status status="RUNNING"/>
  </bt_child_status>
</state>
</scxml>"""
)

ADD = (
    HEAD.format(name="Add", initial="wait")
    + """
<bt_declare_port_in key="to" type="int32"/>
<bt_declare_port_in key="step" type="int32"/>
<bt_declare_port_out key="sum" type="int32"/>
<datamodel>
  <data id="total" type="int32" expr="0"/>
  <data id="step" type="int32" expr="0"/>
</datamodel>
<state id="wait">
  <bt_tick target="wait">
    <assign location="total"><expr><bt_get_input key="to"/></expr></assign>
    <assign location="step"><expr><bt_get_input key="step"/></expr></assign>
    <assign location="total" expr="total + step"/>
    <bt_set_output key="sum" expr="total"/>
    <bt_return_status status="SUCCESS"/>
  </bt_tick>
</state>
</scxml>"""
)

SCRIPTED = (
    HEAD.format(name="Once", initial="wait")
    + """
<state id="wait">
  <bt_tick target="running"><bt_return_status status="RUNNING"/></bt_tick>
</state>
<state id="running">
  <bt_tick target="wait"><bt_return_status status="SUCCESS"/></bt_tick>
  <bt_halt target="wait"><log label="halted" expr="'Once'"/><bt_return_halted/></bt_halt>
</state>
</scxml>"""
)

DEAF = (
    HEAD.format(name="Deaf", initial="wait")
    + """
<state id="wait">
  <bt_tick target="running"><bt_return_status status="RUNNING"/></bt_tick>
  <bt_halt target="wait"><bt_return_halted/></bt_halt>
</state>
<state id="running">
  <bt_tick target="wait"><bt_return_status status="SUCCESS"/></bt_tick>
</state>
</scxml>"""
)

HASTY = (
    HEAD.format(name="Hasty", initial="wait")
    + """
<state id="wait">
  <bt_tick target="wait"><bt_tick_child id="0"/></bt_tick>
  <bt_child_status id="0" target="wait"><bt_return_status status="SUCCESS"/></bt_child_status>
</state>
</scxml>"""
)

TWICE = (
    HEAD.format(name="Twice", initial="wait")
    + """
<state id="wait">
  <bt_tick target="wait">
    <bt_return_status status="RUNNING"/>
    <bt_return_status status="SUCCESS"/>
    <send event="later"/>
  </bt_tick>
  <transition event="later" target="wait"><bt_return_status status="FAILURE"/></transition>
</state>
</scxml>"""
)

FAR = (
    HEAD.format(name="Far", initial="wait")
    + """
<datamodel><data id="child" type="int8" expr="7"/></datamodel>
<state id="wait"><bt_tick target="wait"><bt_tick_child id="child"/></bt_tick></state>
</scxml>"""
)

MARKED = (
    HEAD.format(name="Marked", initial="wait")
    + """
<bt_declare_port_in key="isMonitored" type="bool"/>
<datamodel><data id="marked" type="bool" expr="false"/></datamodel>
<state id="wait">
  <bt_tick target="told"><assign location="marked"><expr><bt_get_input key="isMonitored"/></expr></assign></bt_tick>
</state>
<state id="told">
  <transition cond="marked" target="wait"><bt_return_status status="SUCCESS"/></transition>
  <transition target="wait"><bt_return_status status="FAILURE"/></transition>
</state>
</scxml>"""
)

PLUGINS = {
    "Invert": INVERT,
    "InTurn": IN_TURN,
    "Add": ADD,
    "Once": SCRIPTED,
    "Far": FAR,
    "Deaf": DEAF,
    "Hasty": HASTY,
    "Twice": TWICE,
    "Marked": MARKED,
}


def written(folder: Path, trees: str) -> Path:
    (folder / "policy.xml").write_text(f'<root main_tree_to_execute="M">{trees}</root>')
    inputs = ""
    for name, text in PLUGINS.items():
        (folder / f"{name}.scxml").write_text(text)
        inputs += f'<input type="bt-plugin-ascxml" src="{name}.scxml"/>'
    (folder / "Node.scxml").write_text(
        HEAD.format(name="Node", initial="a") + '<state id="a"/></scxml>'
    )
    system = folder / "system.xml"
    system.write_text(
        '<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/>'
        f"{inputs}</behavior_tree><node_models>"
        '<input type="node-ascxml" src="Node.scxml"/></node_models></roaml>'
    )
    return system


def loaded(folder: Path, body: str) -> tuple[System, Policy | None, list[str]]:
    trees = body if "<BehaviorTree" in body else f'<BehaviorTree ID="M">{body}</BehaviorTree>'
    log = DiagnosticLog()
    system = load([written(folder, trees)], log)
    assert system is not None
    check_system(system, log)
    assert not log.has_errors, log.diagnostics
    assert system.policy is not None
    faults = DiagnosticLog()
    policy = read_policy(system.policy, system, faults)
    return system, policy, [str(f).replace(f"{folder}/", "") for f in faults.diagnostics]
