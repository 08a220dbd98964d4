"""A small system that works: a tank, a skill that fills it, a condition, and the tree that ticks them."""

from __future__ import annotations

TANK = "models/tank.scxml"
FILL = "models/fill.scxml"
FULL = "models/is_full.scxml"
POLICY = "policy.xml"
SYSTEM = "system.xml"
POUR = "interfaces/tank_msgs/srv/Pour.srv"
TICK = "interfaces/tank_msgs/srv/TickAction.srv"
LEVEL = "interfaces/tank_msgs/msg/Level.msg"

FILES: dict[str, str] = {
    SYSTEM: """\
<?xml version="1.0" encoding="UTF-8"?>
<roaml>
  <parameters><bt_tick_rate value="5"/></parameters>
  <behavior_tree>
    <input type="bt.cpp-xml" src="policy.xml"/>
    <input type="bt-plugin-ros-scxml" src="models/is_full.scxml"/>
  </behavior_tree>
  <node_models>
    <input type="ros-scxml" src="models/tank.scxml"/>
    <input type="ros-scxml" src="models/fill.scxml"/>
  </node_models>
  <interfaces><input type="ros-interfaces" src="interfaces"/></interfaces>
</roaml>
""",
    POLICY: """\
<?xml version="1.0" encoding="UTF-8"?>
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Fallback>
      <Condition ID="IsFull" name="IsFull" limit="3"/>
      <Action ID="ROS2Action" name="Fill" service_name="/fill/tick"/>
    </Fallback>
  </BehaviorTree>
</root>
""",
    TANK: """\
<?xml version="1.0" encoding="UTF-8"?>
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Tank" initial="ready">
  <ros_topic_publisher name="level" topic="/tank/level" type="tank_msgs/Level"/>
  <ros_service_server name="pour" service_name="/tank/pour" type="tank_msgs/Pour"/>
  <ros_time_rate name="clock" rate_hz="4"/>
  <datamodel>
    <data id="litres" type="int32" expr="0"/>
    <data id="done" type="bool" expr="false"/>
  </datamodel>
  <state id="ready">
    <ros_rate_callback name="clock">
      <ros_topic_publish name="level">
        <field name="litres" expr="litres"/>
      </ros_topic_publish>
    </ros_rate_callback>
    <ros_service_handle_request name="pour" target="pouring">
      <if cond="litres + _req.litres &lt;= 10">
        <assign location="litres" expr="litres + _req.litres"/>
        <assign location="done" expr="true"/>
      <else/>
        <assign location="done" expr="false"/>
      </if>
    </ros_service_handle_request>
  </state>
  <state id="pouring">
    <onentry>
      <ros_service_send_response name="pour">
        <field name="done" expr="done"/>
      </ros_service_send_response>
    </onentry>
    <transition target="ready"/>
  </state>
</scxml>
""",
    FILL: """\
<?xml version="1.0" encoding="UTF-8"?>
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Fill" initial="idle">
  <ros_service_server name="tick" service_name="/fill/tick" type="tank_msgs/TickAction"/>
  <ros_service_client name="pour" service_name="/tank/pour" type="tank_msgs/Pour"/>
  <datamodel>
    <data id="status" type="int8" expr="1"/>
  </datamodel>
  <state id="idle">
    <ros_service_handle_request name="tick" target="asking"/>
  </state>
  <state id="asking">
    <onentry>
      <ros_service_send_request name="pour">
        <field name="litres" expr="1"/>
      </ros_service_send_request>
    </onentry>
    <ros_service_handle_response name="pour" cond="_res.done" target="told">
      <assign location="status" expr="0"/>
    </ros_service_handle_response>
    <ros_service_handle_response name="pour" target="told">
      <assign location="status" expr="1"/>
    </ros_service_handle_response>
    <ros_service_handle_request name="tick">
      <ros_service_send_response name="tick"><field name="status" expr="2"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
  <state id="told">
    <onentry>
      <ros_service_send_response name="tick"><field name="status" expr="status"/></ros_service_send_response>
    </onentry>
    <transition target="idle"/>
  </state>
</scxml>
""",
    FULL: """\
<?xml version="1.0" encoding="UTF-8"?>
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="IsFull" initial="watching">
  <bt_declare_port_in key="limit" type="int32"/>
  <ros_topic_subscriber name="level" topic="/tank/level" type="tank_msgs/Level"/>
  <datamodel>
    <data id="litres" type="int32" expr="0"/>
    <data id="limit" type="int32" expr="0"/>
  </datamodel>
  <state id="watching">
    <ros_topic_callback name="level">
      <assign location="litres" expr="_msg.litres"/>
    </ros_topic_callback>
    <bt_tick target="judging">
      <assign location="limit"><expr><bt_get_input key="limit"/></expr></assign>
    </bt_tick>
  </state>
  <state id="judging">
    <transition cond="litres &gt;= limit" target="watching">
      <bt_return_status status="SUCCESS"/>
    </transition>
    <transition target="watching">
      <bt_return_status status="FAILURE"/>
    </transition>
  </state>
</scxml>
""",
    POUR: "int32 litres\n---\nbool done\n",
    TICK: "---\nint8 SUCCESS=0\nint8 FAILURE=1\nint8 RUNNING=2\nint8 status\n",
    LEVEL: "int32 litres\n",
}
"""By path, relative to the system's folder."""
