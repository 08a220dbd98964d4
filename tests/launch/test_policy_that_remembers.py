"""``m2c run --monitor`` of a policy that counts, waits and reads what its plugin wrote."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from moon.cli import main as moon

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="s">'
SKILL = (
    HEAD
    + """
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<ros_service_server name="tick" service_name="/{name}/tick" type="bt_interfaces/TickCondition"/>
<state id="s"><ros_service_handle_request name="tick" target="s">
  <assign location="n" expr="n + 1"/>
  <ros_service_send_response name="tick"><field name="status" expr="{status}"/>
    <field name="is_ok" expr="true"/></ros_service_send_response>
</ros_service_handle_request></state></scxml>"""
)
COUNT = (
    HEAD.format(name="Count")
    + """
<bt_declare_port_out key="n" type="int32"/>
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<state id="s"><bt_tick target="s">
  <assign location="n" expr="n + 1"/>
  <bt_set_output key="n" expr="n"/>
  <bt_return_status status="SUCCESS"/>
</bt_tick></state></scxml>"""
)
TREE = """<root BTCPP_format="4"><BehaviorTree ID="T"><Sequence>
<Action ID="Count" n="{n}"/>
<RetryUntilSuccessful num_attempts="4"><Condition ID="B" name="B" interface="ROS2SERVICE"/></RetryUntilSuccessful>
<Fallback><ScriptCondition code="n - 3 &gt; 0"/><Condition ID="A" name="A" interface="ROS2SERVICE"/></Fallback>
<Repeat num_cycles="2"><Timeout msec="700"><Delay delay_msec="300">
  <ForceSuccess><Condition ID="A" name="A" interface="ROS2SERVICE"/></ForceSuccess>
</Delay></Timeout></Repeat>
<Sleep msec="500"/>
</Sequence></BehaviorTree></root>"""


@pytest.fixture
def system(tmp_path: Path) -> Path:
    for name, status in (("A", "n == 2 ? 0 : 1"), ("B", "n % 2")):
        text = SKILL.format(name=f"{name}Skill", status=status)
        (tmp_path / f"{name}.scxml").write_text(text)
    (tmp_path / "Count.scxml").write_text(COUNT)
    (tmp_path / "p.xml").write_text(TREE)
    path = tmp_path / "system.xml"
    path.write_text(
        '<roaml><parameters><bt_tick_rate value="5"/></parameters>'
        '<behavior_tree><input type="bt-plugin-ascxml" src="Count.scxml"/>'
        '<input type="bt.cpp-xml" src="p.xml"/></behavior_tree>'
        '<node_models><input type="node-ascxml" src="A.scxml"/>'
        '<input type="node-ascxml" src="B.scxml"/></node_models></roaml>'
    )
    return path


def test_it_conforms(system: Path) -> None:
    done = CliRunner().invoke(
        m2c,
        [
            *("run", str(system), "--transport", "simulated", "--ticks", "200"),
            *("--monitor", "--quiet"),
        ],
    )
    assert done.exit_code == 0, done.output
    assert "3 conforming" in done.output
    assert "inconclusive" not in done.output


def test_what_it_is_judged_by_is_explained(system: Path) -> None:
    done = CliRunner().invoke(moon, ["explain", str(system), "--only", "policy"])
    assert done.exit_code == 0, done.output
    lines = [" ".join(line.split()) for line in done.output.splitlines()]
    assert lines[0].startswith("policy p ")
    assert "and its ticks (/policy/ticks), without which it is inconclusive" in lines[2]
    assert "2:1 Count what its plugin answers and writes is not checked: anything is right" in lines
    assert any("Sleep" in line and "when its time is over" in line for line in lines)
