"""Instances: one model as several nodes, each with a name, values and channels of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

import m2c
import moon
from m2c.check.reading import findings_of
from m2c.cli import main as m2c_command
from m2c.codegen.generation import write_system
from m2c.diagnostics import DiagnosticLog, ModelError
from m2c.language.expressions import Literal
from m2c.model.machine import Machine
from m2c.model.naming import ANYWHERE
from m2c.model.system import System, read_with_reference
from m2c.naming import naming_for
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

GO_TO = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="GoToSkill" initial="idle">
<datamodel>
  <data id="poi" type="int16" expr="0"/><data id="next" type="int16" expr="poi + 1"/>
  <data id="place" type="string" expr="''"/><data id="spare" type="int16" expr="7"/>
</datamodel>
<ros_service_server service_name="/GoToSkill/tick" type="t/TickAction"/>
<ros_service_server service_name="/GoToSkill/halt" type="t/HaltAction"/>
<ros_topic_publisher topic="/goal" type="std_msgs/Int16"/>
<ros_topic_publisher name="own" topic="/GoToSkill/place" type="std_msgs/String"/>
<state id="idle">
  <ros_service_handle_request name="/GoToSkill/tick" target="idle">
    <ros_topic_publish name="/goal"><field name="data" expr="poi + next"/></ros_topic_publish>
    <ros_topic_publish name="own"><field name="data" expr="place"/></ros_topic_publish>
    <ros_service_send_response name="/GoToSkill/tick"><field name="status" expr="0"/></ros_service_send_response>
  </ros_service_handle_request>
  <ros_service_handle_request name="/GoToSkill/halt" target="idle">
    <ros_service_send_response name="/GoToSkill/halt"><field name="is_ok" expr="true"/></ros_service_send_response>
  </ros_service_handle_request>
</state>
</scxml>
"""
POLICY = """<root><BehaviorTree ID="M"><Sequence>
<Action ID="A" name="GoToDock" interface="ROS2SERVICE"/><Action ID="A" name="GoToKitchen" interface="ROS2SERVICE"/>
</Sequence></BehaviorTree></root>
"""
SYSTEM = """<roaml>
<behavior_tree><input type="bt.cpp-xml" src="policy.xml"/></behavior_tree>
<node_models>
<input type="node-ascxml" src="GoToSkill.ascxml" {}</input>
<input type="node-ascxml" src="GoToSkill.ascxml" name="GoToKitchenSkill"><param name="poi" expr="5"/></input>
</node_models>
<interfaces><input type="ros-interfaces" src="interfaces"/></interfaces>
</roaml>
"""
DOCK = (
    'name="GoToDockSkill"><param name="poi" expr="3"/><param name="place" expr="\'dock\'"/>'
    '<remap from="/goal" to="dock/goal"/>'
)
ACTION = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Arm" initial="idle">
<ros_action_server name="move" action_name="/Arm/move" type="t/Move"/>
<ros_action_thread name="move"><ros_topic_publisher name="at" topic="/Arm/at" type="std_msgs/Int16"/>
<state id="free"/></ros_action_thread>
<state id="idle"/>
</scxml>
"""


def system_file(folder: Path, dock: str = DOCK) -> Path:
    types = folder / "interfaces" / "t" / "srv"
    types.mkdir(parents=True)
    (types / "TickAction.srv").write_text("---\nint8 status\n")
    (types / "HaltAction.srv").write_text("---\nbool is_ok\n")
    actions = folder / "interfaces" / "t" / "action"
    actions.mkdir()
    (actions / "Move.action").write_text("int16 to\n---\nbool is_ok\n---\nint16 at\n")
    (folder / "GoToSkill.ascxml").write_text(GO_TO)
    (folder / "Arm.ascxml").write_text(ACTION)
    (folder / "policy.xml").write_text(POLICY)
    path = folder / "system.xml"
    path.write_text(SYSTEM.format(dock))
    return path


def channels(machine: Machine) -> set[str | None]:
    return {item.channel for item in machine.interfaces}


def found(system: System) -> list[str]:
    """What is said of ``system``: place in its file, message, rule."""
    return [
        f"{Path(one.position.file).name}:{one.position.line}: {one.message}; {one.hint} [{one.rule}]"
        for one in findings_of(system, naming_for("ros2"))
    ]


def test_each_instance_has_a_name_values_and_channels_of_its_own(tmp_path: Path):
    system = m2c.read_system(system_file(tmp_path))
    dock, kitchen = system.nodes
    assert [dock.name, kitchen.name] == ["GoToDockSkill", "GoToKitchenSkill"]
    assert channels(dock) == {
        "/GoToDockSkill/tick",
        "/GoToDockSkill/halt",
        "/dock/goal",
        "/GoToDockSkill/place",
    }
    assert channels(kitchen) == {
        "/GoToKitchenSkill/tick",
        "/GoToKitchenSkill/halt",
        "/goal",
        "/GoToKitchenSkill/place",
    }
    assert findings_of(system) == []
    assert system.sources.count(tmp_path / "GoToSkill.ascxml") == 1


def test_a_plain_machine_is_read_by_the_channels_of_instances(tmp_path: Path):
    """It names no types: they are those of whoever declares the channel, by the name that an instance gives."""
    path = system_file(tmp_path)
    (tmp_path / "Watch.scxml").write_text(
        """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Watch" initial="s">
        <datamodel><data id="last" expr="0"/></datamodel>
        <state id="s"><transition event="dock.goal.Sub">
        <assign location="last" expr="_event.data.data"/></transition></state></scxml>"""
    )
    models = "<node_models>"
    watch = '<input type="node-ascxml" src="Watch.scxml"/>'
    path.write_text(path.read_text().replace(models, f"{models}{watch}"))
    watching = m2c.read_system(path).node("Watch")
    assert watching is not None
    (heard,) = watching.interfaces
    assert (heard.channel, heard.type_name) == ("/dock/goal", "std_msgs/msg/Int16")


def test_each_instance_runs_with_its_own_values(tmp_path: Path):
    world = SimulatedWorld(1, Conditions())
    heard: list[Observation] = []
    SimulatedTransport(world, "listener").tap([], heard.append)
    run = SimulatedRun(compile_system(m2c.read_system(system_file(tmp_path))), world)
    run.run(3.0)
    world.close()
    sent = {
        (seen.channel, seen.source, seen.data["data"])
        for seen in heard
        if seen.kind is ObservationKind.MESSAGE and seen.source.startswith("GoTo")
    }
    assert sent == {
        ("/dock/goal", "GoToDockSkill", 7),
        ("/GoToDockSkill/place", "GoToDockSkill", "dock"),
        ("/goal", "GoToKitchenSkill", 11),
        ("/GoToKitchenSkill/place", "GoToKitchenSkill", ""),
    }


def test_each_instance_is_a_package_of_its_own(tmp_path: Path):
    system = m2c.read_system(system_file(tmp_path))
    write_system(system, tmp_path / "generated", "zenoh", None, ANYWHERE)
    dock, kitchen = (
        (tmp_path / "generated" / name / name / "machine.py").read_text()
        for name in ("go_to_dock_skill", "go_to_kitchen_skill")
    )
    assert "poi: Final = 3" in dock
    assert "poi: Final = 5" in kitchen


def test_what_executes_goals_is_renamed_with_its_machine(tmp_path: Path):
    arm = '<input type="node-ascxml" src="Arm.ascxml" name="Left"><remap from="/Arm/at" to="/at"/></input>'
    path = system_file(tmp_path)
    path.write_text(SYSTEM.format(DOCK).replace("<node_models>", f"<node_models>{arm}"))
    left = m2c.read_system(path).nodes[0]
    assert channels(left) == {"/Left/move"}
    thread = left.threads[0].machine
    assert (thread.name, channels(thread)) == ("LeftThread", {"/Left/move", "/at"})


def replaced(path: Path, model: Path, node: str = "GoToDockSkill") -> Machine:
    machine = read_with_reference(model, m2c.read_system(path), node, log := DiagnosticLog())
    assert machine is not None, log.diagnostics
    log.raise_if_errors()
    return machine


@pytest.mark.parametrize("name", ["GoToSkill", "GoToSlowly", "GoToDockSkill", ""])
def test_a_model_in_an_instances_place_has_its_name_values_and_channels(tmp_path: Path, name: str):
    """Whether the model is called as the one that it replaces, or has channels below its own name."""
    path = system_file(tmp_path)
    other = tmp_path / "GoToSlowly.ascxml"
    for channel in ("GoToSkill", name):
        text = GO_TO.replace("/GoToSkill", f"/{channel or other.stem}").replace("poi + next", "poi")
        other.write_text(text.replace('name="GoToSkill"', f'name="{name}"' if name else ""))
        dock = replaced(path, other)
        assert dock.name == "GoToDockSkill"
        assert channels(dock) == channels(m2c.read_system(path).nodes[0])
        assert machine_values(dock) == {"poi": 3, "next": None, "place": "dock", "spare": 7}


def test_a_plain_model_in_an_instances_place_has_its_channels(tmp_path: Path):
    """Its events mean the channels of the model that it replaces, which the instance renames."""
    other = tmp_path / "Silent.scxml"
    other.write_text(
        """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="SilentSkillAction" initial="s">
        <datamodel><data id="poi" type="int16" expr="0"/><data id="place" type="string" expr="''"/></datamodel>
        <state id="s"><transition event="CMD_TICK"><send event="goal.of.Pub"><param name="data" expr="poi"/></send>
        <send event="TICK_RESPONSE"><param name="status" expr="poi"/></send></transition></state></scxml>"""
    )
    dock = DOCK.replace('from="/goal" to="dock/goal"', 'from="/goal/of" to="dock/goal"')
    path = system_file(tmp_path, dock)
    model = tmp_path / "GoToSkill.ascxml"
    model.write_text(GO_TO.replace('"/goal"', '"/goal/of"'))
    machine = replaced(path, other)
    assert (machine.name, channels(machine)) == (
        "GoToDockSkill",
        {"/GoToDockSkill/tick", "/dock/goal"},
    )
    assert machine_values(machine) == {"poi": 3, "place": "dock"}


def test_a_model_in_an_instances_place_lacks_what_the_instance_gives(tmp_path: Path):
    """That is said where the instance gives it, as it is of the model that it replaces."""
    path = system_file(tmp_path)
    other = tmp_path / "Other.ascxml"
    other.write_text(GO_TO.replace('id="place"', 'id="plaice"').replace('"place"', '"plaice"'))
    log = DiagnosticLog()
    read_with_reference(other, m2c.read_system(path), "GoToDockSkill", log)
    (said,) = log.diagnostics
    assert (said.rule, said.position.line, said.hint) == (
        "unknown-parameter",
        4,
        "did you mean plaice?",
    )


def test_what_runs_in_an_instances_place_is_given_its_values(tmp_path: Path):
    other = tmp_path / "Other.ascxml"
    other.write_text(GO_TO.replace("poi + next", "spare * 100 + poi"))
    run = ["run", str(system_file(tmp_path)), "--transport", "simulated", "--ticks", "2"]
    run += ["--replace", f"GoToDockSkill={other}", "--param", "GoToDockSkill.spare=2"]
    made = CliRunner().invoke(
        m2c_command, [*run, "--quiet", "--record", str(tmp_path / "run.mcap")]
    )
    assert made.exit_code == 0, made.output
    recording = moon.Recording.open(
        tmp_path / "run.mcap", m2c.read_system(tmp_path / "system.xml").library
    )
    heard = [entry for entry in recording.entries() if isinstance(entry, Observation)]
    sent = {(one.channel, one.data["data"]) for one in heard if "goal" in one.channel}
    assert sent == {("/dock/goal", 203), ("/goal", 11)}


def machine_values(machine: Machine) -> dict[str, object]:
    """What the data of ``machine`` begin with; None for what is no literal."""
    begin = {data.name: data.initial for data in machine.data}
    return {name: one.value if isinstance(one, Literal) else None for name, one in begin.items()}


def test_what_two_instances_have_in_common_is_found_once(tmp_path: Path):
    path = system_file(tmp_path)
    model = tmp_path / "GoToSkill.ascxml"
    model.write_text(GO_TO.replace("</scxml>", '<state id="far"/></scxml>'))
    said = found(m2c.read_system(path))
    assert len([line for line in said if "unreachable-state" in line]) == 1


@pytest.mark.parametrize(
    ("dock", "expected"),
    [
        ('><param name="pio" expr="1"/>', "`GoToSkill` has no data `pio`; did you mean poi?"),
        (
            '><param name="poi" expr="true"/>',
            "a value of type bool where int16 is declared",
        ),
        ('><param name="poi" expr="40000"/>', "40000 does not fit int16"),
        ('><param name="poi" expr="1 +"/>', "`1 +`: not an expression"),
        ('><param name="poi" expr="spare"/>', "`spare` has no value yet"),
        ('><param name="poi"/>', "the attribute `expr` is missing"),
        ('><param expr="1"/>', "the attribute `name` is missing"),
        ('><param name="poi" value="1"/>', "unknown attribute `value`; known: name, expr"),
        ('><param name="poi" expr="1"/><param name="poi" expr="1"/>', "`poi` is given twice"),
        (
            '><remap from="/gaol" to="/x"/>',
            "`GoToSkill` has no channel `/gaol`; did you mean /goal",
        ),
        ('><remap from="/goal"/>', "the attribute `to` is missing"),
        ('><remap from="goal" to="/x"/><remap from="/goal" to="/y"/>', "`/goal` is given twice"),
        ('><remap from="/goal" to="/a b"/>', "does not take the topic `/a b`"),
        ('><parameter name="poi" expr="1"/>', "not an element of <input>; did you mean param?"),
        ('name="1 x">', "does not take the name of a node `1 x`"),
        ('name="GoToKitchenSkill">', "a second node is called `GoToKitchenSkill`"),
        (
            'name="GoToKitchenSkill"><param name="poi" expr="5"/>',
            "a second instance is called `GoToKitchenSkill`",
        ),
        ('name="policy">', "the node that ticks the policy is called `policy`, too"),
    ],
)
def test_what_is_wrong_with_an_instance_is_told_at_its_place(
    dock: str, expected: str, tmp_path: Path
):
    path = system_file(tmp_path, dock)
    try:
        said = found(m2c.read_system(path))
    except ModelError as error:
        said = [
            f"{Path(one.position.file).name}:{one.position.line}: {one.message}; {one.hint}"
            for one in error.diagnostics
        ]
    line = 5 if "a second" in expected else 4
    assert [one for one in said if expected in one and one.startswith(f"system.xml:{line}:")], said


@pytest.mark.parametrize("value", ["true", "40000", "spare", "1 / 0"])
def test_what_is_wrong_with_a_value_is_said_of_its_param(value: str, tmp_path: Path):
    system = m2c.read_system(system_file(tmp_path, f'><param name="poi" expr="{value}"/>'))
    said = [
        one.element for one in findings_of(system, naming_for("ros2")) if one.severity == "error"
    ]
    assert said == ["param"]


def test_a_second_node_of_the_same_name_is_told_at_its_input(tmp_path: Path):
    path = system_file(tmp_path, ">")
    text = path.read_text()
    again = '<input type="node-ascxml" src="./GoToSkill.ascxml">{}</input>'
    inputs = [again.format(f'<param name="poi" expr="{n}"/>') for n in (1, 2)]
    path.write_text(text.replace("</node_models>", f"\n{inputs[0]}\n{inputs[1]}\n</node_models>"))
    said = found(m2c.read_system(path))
    assert [one for one in said if "a second node is called" in one], said
    assert all(one.startswith("system.xml:") for one in said if "a second node" in one), said
