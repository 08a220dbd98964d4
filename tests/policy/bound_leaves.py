"""A system whose leaves are bound to interfaces, with a server for each."""

from __future__ import annotations

from pathlib import Path

NAVIGATE = """<leaf ID="Navigate" action="/navigate" type="nav_interfaces/action/Navigate">
  <field name="pose" port="goal"/>
  <field name="planner" expr="'grid'"/>
  <feedback name="remaining" port="remaining"/>
  <result name="error_code" port="error"/>
  <result name="path" port="driven"/>
</leaf>"""
CLEAR = """<leaf ID="Clear" service="{service_name}" type="nav_interfaces/srv/Clear" cond="_res.success">
  <field name="around.x" port="x"/>
  <result name="cleared" port="cleared"/>
</leaf>"""
LOW = """<leaf ID="BatteryLow" topic="battery" type="nav_interfaces/Battery" cond="_msg.level &lt; min">
  <bt_declare_port_in key="min" type="float64"/>
  <result name="level" port="level"/>
  <result port="battery"/>
</leaf>"""
LEAVES = NAVIGATE + CLEAR + LOW

_HEAD = '<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{}" initial="idle">'
SERVER = (
    _HEAD.format("Navigator")
    + """
<ros_action_server name="navigate" action_name="/navigate" type="nav_interfaces/action/Navigate"/>
<ros_service_server name="clear" service_name="/clear" type="nav_interfaces/srv/Clear"/>
<ros_topic_publisher name="battery" topic="/battery" type="nav_interfaces/Battery"/>
<ros_time_rate name="every" rate_hz="4"/>
<datamodel>
  <data id="goal" type="int64" expr="0"/>
  <data id="pose" type="geometry_msgs/PoseStamped" expr="{}"/>
  <data id="level" type="float64" expr="1"/>
  <data id="left" type="int32" expr="0"/>
</datamodel>
<state id="idle">
  <ros_action_handle_goal name="navigate" target="idle" cond="_goal.pose.pose.position.x &lt; 0 || _goal.planner != 'grid'">
    <ros_action_reject_goal name="navigate" goal_id="_action.goal_id"/>
  </ros_action_handle_goal>
  <ros_action_handle_goal name="navigate" target="driving">
    <assign location="goal" expr="_action.goal_id"/>
    <assign location="pose" expr="_goal.pose"/>
    <assign location="left" expr="3"/>
    <ros_action_accept_goal name="navigate" goal_id="_action.goal_id"/>
  </ros_action_handle_goal>
  <ros_service_handle_request name="clear">
    <ros_service_send_response name="clear">
      <field name="success" expr="_req.around.x &lt; 10"/><field name="cleared" expr="[_req.around, {x: 2}]"/>
    </ros_service_send_response>
  </ros_service_handle_request>
  <ros_rate_callback name="every">
    <assign location="level" expr="level - 0.125"/>
    <ros_topic_publish name="battery"><field name="level" expr="level"/></ros_topic_publish>
  </ros_rate_callback>
</state>
<state id="driving">
  <ros_rate_callback name="every" cond="left > 0">
    <assign location="left" expr="left - 1"/>
    <ros_action_feedback name="navigate" goal_id="goal"><field name="remaining" expr="left"/></ros_action_feedback>
  </ros_rate_callback>
  <ros_rate_callback name="every" target="idle" cond="pose.pose.position.x > 50">
    <ros_action_aborted name="navigate" goal_id="goal"><field name="error_code" expr="207"/></ros_action_aborted>
  </ros_rate_callback>
  <ros_rate_callback name="every" target="idle">
    <ros_action_succeed name="navigate" goal_id="goal"><field name="path" expr="[pose, pose]"/></ros_action_succeed>
  </ros_rate_callback>
  <ros_action_handle_cancel name="navigate" target="idle">
    <log label="canceled" expr="goal"/>
    <ros_action_canceled name="navigate" goal_id="goal"/>
  </ros_action_handle_cancel>
</state>
</ascxml>"""
)
DEFINITIONS = {
    "action/Navigate.action": "geometry_msgs/PoseStamped pose\nstring planner\n---\n"
    "uint16 error_code\ngeometry_msgs/PoseStamped[] path\n---\nfloat32 remaining\n",
    "srv/Clear.srv": "geometry_msgs/Point around\n---\nbool success\ngeometry_msgs/Point[] cleared\n",
    "msg/Battery.msg": "float32 level\n",
}


def written(folder: Path, tree: str, leaves: str = LEAVES, more: str = "") -> Path:
    """The system file of ``tree`` with these elements of ``<behavior_tree>``; ``more`` are trees and models."""
    for name, text in DEFINITIONS.items():
        path = folder / "interfaces" / "nav_interfaces" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (folder / "Navigator.ascxml").write_text(SERVER)
    (folder / "policy.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="M">'
        f'<BehaviorTree ID="M">{tree}</BehaviorTree>{more}</root>'
    )
    system = folder / "system.xml"
    system.write_text(
        '<roaml><parameters><bt_tick_rate value="4"/></parameters>\n<behavior_tree>'
        f'<input type="bt.cpp-xml" src="policy.xml"/>\n{leaves}</behavior_tree>\n'
        '<node_models><input type="node-ascxml" src="Navigator.ascxml"/></node_models>\n'
        '<interfaces><input type="ros-interfaces" src="interfaces"/></interfaces></roaml>'
    )
    return system
