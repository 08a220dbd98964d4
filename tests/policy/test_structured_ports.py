"""Ports of plugins that hold structures and arrays: JSON on the blackboard."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import pytest

from m2c.model.interfaces import InterfaceLibrary
from m2c.policy.plugins import PortValue, json_of, value_of_json
from m2c.policy.ticking import read_port, write_port, written_value
from m2c.runtime.messages import message_class
from tests.policy.simulated import HEAD, checked, simulated, statuses, written

MAKE = (
    HEAD.format("Make", "a")
    + """
<bt_declare_port_in key="x" type="float64"/>
<bt_declare_port_out key="pose" type="geometry_msgs/Pose"/>
<bt_declare_port_out key="numbers" type="int16[]"/>
<datamodel>
  <data id="pose" type="geometry_msgs/Pose" expr="{}"/>
  <data id="numbers" type="int16[]" expr="[]"/>
</datamodel>
<state id="a"><bt_tick>
  <assign location="pose.position.x"><expr><bt_get_input key="x"/></expr></assign>
  <assign location="numbers[numbers.length]" expr="numbers.length + 1"/>
  <bt_set_output key="pose" expr="pose"/>
  <bt_set_output key="numbers" expr="numbers"/>
  <bt_return_status status="SUCCESS"/>
</bt_tick></state></scxml>"""
)
LOOK = (
    HEAD.format("Look", "a")
    + """
<bt_declare_port_in key="pose" type="geometry_msgs/Pose"/>
<bt_declare_port_in key="numbers" type="int16[]"/>
<bt_declare_port_in key="x" type="float64"/>
<datamodel>
  <data id="pose" type="geometry_msgs/Pose" expr="{}"/>
  <data id="numbers" type="int16[]" expr="[]"/>
  <data id="x" type="float64" expr="0"/>
</datamodel>
<state id="a"><bt_tick target="b">
  <assign location="pose"><expr><bt_get_input key="pose"/></expr></assign>
  <assign location="numbers"><expr><bt_get_input key="numbers"/></expr></assign>
  <assign location="x"><expr><bt_get_input key="x"/></expr></assign>
</bt_tick></state>
<state id="b">
  <transition target="a" cond="pose.position.x == x &amp;&amp; numbers.length == 2 &amp;&amp; numbers[1] == 2">
    <bt_return_status status="SUCCESS"/>
  </transition>
  <transition target="a"><bt_return_status status="FAILURE"/></transition>
</state></scxml>"""
)
PLUGINS = {"Make": MAKE, "Look": LOOK}
POSE = '{"position": {"x": 2.5}}'


def ran(folder: Path, tree: str) -> list[str]:
    return statuses(simulated(written(folder, tree, PLUGINS), 2.5))


def faults(folder: Path, tree: str) -> list[str]:
    return [line for line in checked(written(folder, tree, PLUGINS))[1] if ": error:" in line]


def test_what_one_plugin_writes_another_reads(tmp_path: Path) -> None:
    tree = (
        '<Sequence><Make x="2.5" pose="{p}" numbers="{n}"/>'
        '<SubTree ID="S" pose="{p}" many="{n}"/></Sequence>'
        '</BehaviorTree><BehaviorTree ID="S"><Look pose="{pose}" numbers="{many}" x="2.5"/>'
    )
    tree = f'<BehaviorTree ID="M">{tree}</BehaviorTree>'
    assert ran(tmp_path, tree) == ["FAILURE", "SUCCESS", "FAILURE"]


@pytest.mark.parametrize("pose", [POSE, f"json:{POSE}"])
def test_a_value_is_written_as_json(tmp_path: Path, pose: str) -> None:
    tree = f"""<Look pose='{pose}' numbers="[1, 2]" x="2.5"/>"""
    assert ran(tmp_path, tree)[0] == "SUCCESS"


def test_a_script_may_set_one(tmp_path: Path) -> None:
    tree = f"""<Sequence><Script code="p := '{POSE.replace('"', "&quot;")}'"/>
    <SetBlackboard value="[1, 2]" output_key="n"/><Look pose="{{p}}" numbers="{{n}}" x="2.5"/></Sequence>"""
    assert ran(tmp_path, tree)[0] == "SUCCESS"


@pytest.mark.parametrize(
    "text",
    ["[1, 2", "'[1]'", '["a"]', "[[1]]", '{"a": 1}', "7", "[" * 100_000],
)
def test_what_is_not_of_the_type_is_a_failure_of_the_leaf(
    tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    value = text.replace('"', "&quot;")
    tree = f"""<Sequence><SetBlackboard value="json:{value}" output_key="n"/>
    <Look pose='{POSE}' numbers="{{n}}" x="2.5"/></Sequence>"""
    assert ran(tmp_path, tree)[0] == "FAILURE"
    assert (
        "its port `numbers` cannot be read from the blackboard entry `n` as int16[]" in caplog.text
    )


@pytest.mark.parametrize(
    ("written_value", "why"),
    [
        ("[1, 2", "Expecting"),
        ('["a"]', "'a' where int16"),
        ('{"x": 1}', "object"),
        ("", "Expecting"),
        ("[" * 5_000, ""),
    ],
)
def test_a_written_value_that_is_not_of_the_type_is_refused(
    tmp_path: Path, written_value: str, why: str
) -> None:
    value = written_value.replace('"', "&quot;")
    (fault,) = faults(tmp_path, f"""<Look pose='{POSE}' numbers="{value}" x="2.5"/>""")
    assert "the port has type int16[], as JSON: " in fault
    assert "[leaf-port]" in fault
    assert why in fault
    assert len(fault) < 600


@pytest.mark.parametrize(
    "tree",
    [
        '<Sequence><Make x="1" pose="{p}" numbers="{n}"/><Look pose="{n}" numbers="[]" x="1"/></Sequence>',
        '<Sequence><Make x="1" pose="{p}" numbers="{n}"/><Look pose="{}" numbers="[]" x="{n}"/></Sequence>',
        '<Sequence><Look pose="{e}" numbers="{e}" x="1"/></Sequence>',
    ],
)
def test_an_entry_has_one_type(tmp_path: Path, tree: str) -> None:
    (fault,) = faults(tmp_path, tree)
    assert "an entry has one type" in fault
    assert "leaf-port" in fault


def test_what_is_reported_of_an_output_is_the_value_that_was_written() -> None:
    kind = InterfaceLibrary().message("geometry_msgs/Point")
    point = message_class(kind)(x=1.0, z=-2.5)
    held: dict[str, str] = {}
    board = SimpleNamespace(set_string=held.__setitem__, get_string=held.__getitem__)
    node = SimpleNamespace(config=lambda: SimpleNamespace(blackboard=board))
    port = PortValue(key="at", kind="json", type=kind, entry="place")
    reported = write_port(port, point, node)
    said = held["place"]
    assert write_port(port, written_value(port, reported), node) == said == reported
    assert read_port(port, node) == {"x": 1.0, "y": 0.0, "z": -2.5}


def test_what_json_has_no_number_for_is_kept() -> None:
    back = value_of_json(json_of([math.nan, math.inf, -math.inf, 2**63]))
    assert math.isnan(back[0])
    assert back[1:] == [math.inf, -math.inf, 2**63]


@pytest.mark.parametrize("prefix", ["", "json:"])
def test_an_object_is_no_entry_where_the_library_reads_the_value(
    tmp_path: Path, prefix: str
) -> None:
    value = prefix + POSE.replace('"', "&quot;")
    tree = (
        f'<BehaviorTree ID="M"><Sequence><SetBlackboard value="{value}" output_key="p"/>'
        f'<Look pose="{{p}}" numbers="[1, 2]" x="2.5"/><SubTree ID="S" pose="{value}"/></Sequence>'
        '</BehaviorTree><BehaviorTree ID="S"><Look pose="{pose}" numbers="[1, 2]" x="2.5"/></BehaviorTree>'
    )
    assert ran(tmp_path, tree)[0] == "SUCCESS"
