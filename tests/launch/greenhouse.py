"""A system of a new user's size: nine nodes, an action, a topic of booleans, interfaces of its own; and five faults."""

from __future__ import annotations

from pathlib import Path

import msgspec

INTERFACES = {
    "action/Water.action": "int32 bed\n---\nbool done\nstring reason\n---\nfloat64 litres\n",
    "srv/Fill.srv": "int32 level\n---\nbool is_ok\nstring reason\n",
    "srv/Plant.srv": "string kind\nfloat64 space\n---\nbool is_ok\nint32 count\n",
    "msg/Seedling.msg": "string kind\nfloat64 space\n",
    "msg/Bed.msg": "greenhouse_interfaces/Seedling[] seedlings\nint32 count\nfloat64 space\n",
}
HEAD = '<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="{first}">'
ANSWER = (
    '<ros_service_send_response name="{name}"><field name="status" expr="{status}"/>'
    '<field name="is_ok" expr="true"/></ros_service_send_response>'
)
HALTED = '<ros_service_send_response name="halt"><field name="is_ok" expr="true"/></ros_service_send_response>'


def _ticked(status: str, target: str = "", more: str = "") -> str:
    to = f' target="{target}"' if target else ""
    answer = ANSWER.format(name="tick", status=status)
    return (
        f'<ros_service_handle_request name="tick"{to}>{more}{answer}</ros_service_handle_request>'
    )


def _halted(target: str = "") -> str:
    to = f' target="{target}"' if target else ""
    return f'<ros_service_handle_request name="halt"{to}>{HALTED}</ros_service_handle_request>'


def _skill(name: str, first: str, kind: str, body: str) -> str:
    halt = (
        f'<ros_service_server name="halt" service_name="/{name}/halt" type="bt_interfaces/HaltAction"/>'
        if kind == "Action"
        else ""
    )
    return f"""{HEAD.format(name=name, first=first)}
<ros_service_server name="tick" service_name="/{name}/tick" type="bt_interfaces/Tick{kind}"/>{halt}
{body}</ascxml>"""


MODELS = {
    "VentOpenSkill": _skill("VentOpenSkill", "waiting", "Condition", f"""
<ros_topic_subscriber name="open" topic="/vent/is_open" type="std_msgs/Bool"/>
<datamodel><data id="is_open" type="bool" expr="false"/></datamodel>
<state id="waiting">
  <ros_topic_callback name="open"><assign location="is_open" expr="_msg.data"/></ros_topic_callback>
  {_ticked("is_open ? 0 : 1")}
</state>"""),
    "TankOkSkill": _skill("TankOkSkill", "waiting", "Condition", f"""
<ros_topic_subscriber name="level" topic="/tank/level" type="std_msgs/Int32"/>
<datamodel><data id="level" type="int32" expr="100"/></datamodel>
<state id="waiting">
  <ros_topic_callback name="level"><assign location="level" expr="_msg.data"/></ros_topic_callback>
  {_ticked("level &gt;= 20 ? 0 : 1")}
</state>"""),
    "RefillSkill": _skill("RefillSkill", "idle", "Action", f"""
<ros_service_client name="fill" service_name="/tank/fill" type="greenhouse_interfaces/Fill"/>
<datamodel><data id="status" type="int8" expr="2"/></datamodel>
<state id="idle">
  {_ticked("2", "asking", '<ros_service_send_request name="fill"><field name="level" expr="50"/></ros_service_send_request>')}
  {_halted()}
</state>
<state id="asking">
  <ros_service_handle_response name="fill" cond="_res.is_ok" target="done"><assign location="status" expr="0"/></ros_service_handle_response>
  <ros_service_handle_response name="fill" target="done"><assign location="status" expr="1"/></ros_service_handle_response>
  <ros_service_handle_error name="fill" target="done"><assign location="status" expr="1"/></ros_service_handle_error>
  {_ticked("2")}{_halted("idle")}
</state>
<state id="done">{_ticked("status", "idle")}{_halted("idle")}</state>"""),
    "PlantSkill": _skill("PlantSkill", "idle", "Action", f"""
<ros_service_client name="plant" service_name="/bed/plant" type="greenhouse_interfaces/Plant"/>
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<state id="idle">
  <ros_service_handle_request name="tick" target="asking">
    <assign location="n" expr="n + 1"/>
    <ros_service_send_request name="plant"><field name="kind" expr="'P' + n"/><field name="space" expr="0.5"/></ros_service_send_request>
  </ros_service_handle_request>
  {_halted()}
</state>
<state id="asking">
  <ros_service_handle_response name="plant" target="idle">{ANSWER.format(name="tick", status="_res.is_ok ? 0 : 1")}</ros_service_handle_response>
  <ros_service_handle_error name="plant" target="idle">{ANSWER.format(name="tick", status="1")}</ros_service_handle_error>
</state>"""),
    "WaterSkill": _skill("WaterSkill", "idle", "Action", f"""
<ros_action_client name="water" action_name="/sprinkler/water" type="greenhouse_interfaces/Water"/>
<datamodel><data id="litres" type="float64" expr="0"/></datamodel>
<state id="idle">
  {_ticked("2", "starting", '<ros_action_send_goal name="water"><field name="bed" expr="2"/></ros_action_send_goal>')}
  {_halted()}
</state>
<state id="starting">
  <ros_action_handle_goal_response name="water" accept="watering" reject="failed"/>
  {_ticked("2")}{_halted("aborting")}
</state>
<state id="aborting">
  <ros_action_handle_goal_response name="water" accept="canceling" reject="idle"/>
  {_ticked("1")}{_halted()}
</state>
<state id="watering">
  <ros_action_handle_feedback name="water"><assign location="litres" expr="_feedback.litres"/></ros_action_handle_feedback>
  <ros_action_handle_success_result name="water" cond="_wrapped_result.result.done" target="succeeded"/>
  <ros_action_handle_aborted_result name="water" target="failed"/>
  <ros_action_handle_canceled_result name="water" target="failed"/>
  {_ticked("litres &gt; 9 ? 1 : 2")}{_halted("canceling")}
</state>
<state id="canceling">
  <onentry><ros_action_send_cancel name="water"/></onentry>
  <ros_action_handle_success_result name="water" target="idle"/>
  <ros_action_handle_aborted_result name="water" target="idle"/>
  <ros_action_handle_canceled_result name="water" target="idle"/>
  {_ticked("1")}{_halted()}
</state>
<state id="succeeded">{_ticked("0", "idle")}{_halted("idle")}</state>
<state id="failed">{_ticked("1", "idle")}{_halted("idle")}</state>"""),
    "VentSensor": f"""{HEAD.format(name="VentSensor", first="closed")}
<ros_topic_publisher name="open" topic="/vent/is_open" type="std_msgs/Bool"/>
<ros_time_rate name="sample" rate_hz="3"/>
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<state id="closed">
  <ros_rate_callback name="sample" cond="n &lt; 3">
    <assign location="n" expr="n + 1"/><ros_topic_publish name="open"><field name="data" expr="false"/></ros_topic_publish>
  </ros_rate_callback>
  <ros_rate_callback name="sample" target="opened">
    <assign location="n" expr="0"/><ros_topic_publish name="open"><field name="data" expr="true"/></ros_topic_publish>
  </ros_rate_callback>
</state>
<state id="opened">
  <ros_rate_callback name="sample" cond="n &lt; 25">
    <assign location="n" expr="n + 1"/><ros_topic_publish name="open"><field name="data" expr="true"/></ros_topic_publish>
  </ros_rate_callback>
  <ros_rate_callback name="sample" target="closed">
    <assign location="n" expr="0"/><ros_topic_publish name="open"><field name="data" expr="false"/></ros_topic_publish>
  </ros_rate_callback>
</state></ascxml>""",
    "Tank": f"""{HEAD.format(name="Tank", first="idle")}
<ros_service_server name="fill" service_name="/tank/fill" type="greenhouse_interfaces/Fill"/>
<ros_topic_publisher name="level" topic="/tank/level" type="std_msgs/Int32"/>
<ros_time_rate name="leak" rate_hz="4"/>
<datamodel><data id="level" type="int32" expr="40"/></datamodel>
<state id="idle">
  <ros_service_handle_request name="fill">
    <assign location="level" expr="_req.level"/>
    <ros_service_send_response name="fill"><field name="is_ok" expr="true"/><field name="reason" expr="'filled'"/></ros_service_send_response>
  </ros_service_handle_request>
  <ros_rate_callback name="leak">
    <if cond="level &gt; 0"><assign location="level" expr="level - 1"/></if>
    <ros_topic_publish name="level"><field name="data" expr="level"/></ros_topic_publish>
  </ros_rate_callback>
</state></ascxml>""",
    "Bed": f"""{HEAD.format(name="Bed", first="growing")}
<ros_service_server name="plant" service_name="/bed/plant" type="greenhouse_interfaces/Plant"/>
<ros_topic_publisher name="bed" topic="/bed/plants" type="greenhouse_interfaces/Bed"/>
<datamodel>
  <data id="seedlings" type="greenhouse_interfaces/Seedling[]" expr="[]"/>
  <data id="space" type="float64" expr="0"/>
</datamodel>
<state id="growing">
  <ros_service_handle_request name="plant">
    <assign location="seedlings[seedlings.length]" expr="{{kind: _req.kind, space: _req.space}}"/>
    <assign location="space" expr="space + _req.space"/>
    <ros_service_send_response name="plant"><field name="is_ok" expr="true"/><field name="count" expr="seedlings.length"/></ros_service_send_response>
    <ros_topic_publish name="bed">
      <field name="seedlings" expr="seedlings"/><field name="count" expr="seedlings.length"/><field name="space" expr="space"/>
    </ros_topic_publish>
  </ros_service_handle_request>
</state></ascxml>""",
    "Sprinkler": f"""{HEAD.format(name="Sprinkler", first="idle")}
<ros_action_server name="water" action_name="/sprinkler/water" type="greenhouse_interfaces/Water"/>
<ros_time_rate name="step" rate_hz="5"/>
<datamodel><data id="goal" type="int32" expr="0"/><data id="litres" type="float64" expr="0"/></datamodel>
<state id="idle">
  <ros_action_handle_goal name="water" target="watering">
    <assign location="goal" expr="_action.goal_id"/><assign location="litres" expr="0"/>
    <ros_action_accept_goal name="water" goal_id="_action.goal_id"/>
  </ros_action_handle_goal>
</state>
<state id="watering">
  <ros_action_handle_cancel name="water" target="idle">
    <ros_action_canceled name="water" goal_id="goal"><field name="done" expr="false"/><field name="reason" expr="'canceled'"/></ros_action_canceled>
  </ros_action_handle_cancel>
  <ros_rate_callback name="step" cond="litres &lt; 1">
    <assign location="litres" expr="litres + 0.25"/>
    <ros_action_feedback name="water" goal_id="goal"><field name="litres" expr="litres"/></ros_action_feedback>
  </ros_rate_callback>
  <ros_rate_callback name="step" target="idle">
    <ros_action_succeed name="water" goal_id="goal"><field name="done" expr="true"/><field name="reason" expr="'ok'"/></ros_action_succeed>
  </ros_rate_callback>
</state></ascxml>""",
}  # fmt: skip
TREE = """<root BTCPP_format="4" main_tree_to_execute="Care"><BehaviorTree ID="Care">
<Sequence name="care">
  <Fallback name="water">
    <Condition ID="TankOk" name="TankOk" interface="ROS2SERVICE"/>
    <RetryUntilSuccessful num_attempts="3"><Action ID="Refill" name="Refill" interface="ROS2SERVICE"/></RetryUntilSuccessful>
  </Fallback>
  <Action ID="Plant" name="Plant" interface="ROS2SERVICE"/>
  <Fallback name="vent">
    <Inverter><Inverter><Condition ID="VentOpen" name="VentOpen" interface="ROS2SERVICE"/></Inverter></Inverter>
    <ForceFailure><Sleep msec="200"/></ForceFailure>
  </Fallback>
  <Action ID="Water" name="Water" interface="ROS2SERVICE"/>
</Sequence></BehaviorTree></root>"""
SYSTEM = """<roaml>
<parameters><bt_tick_rate value="5"/></parameters>
<behavior_tree><input type="bt.cpp-xml" src="./policy.xml"/></behavior_tree>
<node_models>{inputs}</node_models>
<interfaces><input type="ros-interfaces" src="./interfaces"/></interfaces>
</roaml>"""


class Fault(msgspec.Struct, frozen=True):
    """What is wrong in one node.

    Attributes:
        node: which.
        right: a part of its model.
        wrong: what stands there instead.
    """

    node: str
    right: str
    wrong: str


FAULTS = {
    "a condition is answered the wrong way round": Fault(
        "VentOpenSkill", "is_open ? 0 : 1", "is_open ? 1 : 0"
    ),
    "a topic is misspelt": Fault("VentOpenSkill", "/vent/is_open", "/vent/open"),
    "a sensor is off by one": Fault("Tank", 'name="data" expr="level"', 'name="data" expr="level + 1"'),
    "feedback is wrong": Fault("Sprinkler", 'name="litres" expr="litres"', 'name="litres" expr="2 * litres"'),
    "a list is counted wrong": Fault(
        "Bed", 'name="is_ok" expr="true"/><field name="count" expr="seedlings.length"',
        'name="is_ok" expr="true"/><field name="count" expr="seedlings.length + 1"',
    ),
}  # fmt: skip


def write(folder: Path) -> Path:
    """The system as files in ``folder``; the system file."""
    for name, text in INTERFACES.items():
        path = folder / "interfaces" / "greenhouse_interfaces" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for name, text in MODELS.items():
        (folder / f"{name}.ascxml").write_text(text)
    (folder / "policy.xml").write_text(TREE)
    inputs = "".join(f'<input type="node-ascxml" src="./{name}.ascxml"/>' for name in MODELS)
    path = folder / "system.xml"
    path.write_text(SYSTEM.format(inputs=inputs))
    return path


def write_faulty(folder: Path, fault: Fault) -> Path:
    """The model of the node that has ``fault``, in a folder of its own in ``folder``."""
    text = MODELS[fault.node]
    assert text.count(fault.right) == 1, fault
    path = folder / "faulty" / f"{fault.node}.ascxml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text.replace(fault.right, fault.wrong))
    return path
