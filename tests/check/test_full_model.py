"""The earlier tool's entry: a full model and an interface list, read and cross-checked."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main

NS = 'xmlns="http://www.w3.org/2005/07/scxml" version="1.0"'
BATTERY = (
    f'<scxml {NS} name="Battery" initial="a"><ros_topic_publisher topic="/Battery/level" '
    'type="std_msgs/Int32"/><state id="a"><onentry><ros_topic_publish name="/Battery/level">'
    '<field name="data" expr="1"/></ros_topic_publish></onentry></state></scxml>'
)
SKILL = (
    f'<scxml {NS} name="Level" initial="a"><ros_service_server service_name="/Level/tick" '
    'type="t/TickCondition"/><ros_topic_subscriber topic="/Battery/level" type="std_msgs/Int32"/>'
    '<state id="a"><ros_topic_callback name="/Battery/level"/>'
    '<ros_service_handle_request name="/Level/tick"><ros_service_send_response name="/Level/tick">'
    '<field name="status" expr="0"/></ros_service_send_response></ros_service_handle_request>'
    "</state></scxml>"
)
POLICY = (
    '<root BTCPP_format="4"><BehaviorTree ID="Main">'
    '<Condition ID="ROS2Condition" name="Level" service_name="/Level/tick"/>'
    "</BehaviorTree></root>"
)
DECLARATIONS = """<specification><model>
<skillList taskPlan="Policy">
<skillDeclaration id="Policy" interface="skills"><skillDefinition moc="bt" path="policy.xml"/></skillDeclaration>
<skillDeclaration id="Level" interface="skills"><skillDefinition moc="fsm" path="level.scxml"/></skillDeclaration>
</skillList>
<componentList>
<componentDeclaration id="Battery" interface="battery"><componentDefinition moc="fsm" path="battery.scxml"/></componentDeclaration>
<componentDeclaration id="Navigation" interface="battery"><componentDefinition/></componentDeclaration>
</componentList></model></specification>"""
ELEMENTS = """<specification><model>
<taskPlan id="Policy" moc="bt" path="policy.xml"/>
<skills><skill id="Level" moc="fsm" path="level.scxml"/></skills>
<components><component id="Battery" moc="fsm" path="battery.scxml"/></components>
</model></specification>"""


def interface_list(level: str = "topic", name: str = "level") -> str:
    def function(key: str, kind: str) -> str:
        return (
            f'<function id="{key}"><protocol><ROS2data><interface type="{kind}"/></ROS2data></protocol>'
            "</function>"
        )

    return (
        f'<interfaces>\n<interface id="skills">{function("tick", "sync-service")}</interface>\n'
        f'<interface id="battery">{function(name, level)}</interface></interfaces>'
    )


@pytest.fixture(params=[DECLARATIONS, ELEMENTS], ids=["declarations", "elements"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    types = tmp_path / "interfaces" / "t" / "srv"
    types.mkdir(parents=True)
    (types / "TickCondition.srv").write_text("---\nint8 status\n")
    for name, text in {
        "full.xml": request.param,
        "list.xml": interface_list(),
        "battery.scxml": BATTERY,
        "level.scxml": SKILL,
        "policy.xml": POLICY,
    }.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def entry(folder: Path, command: str, *options: str) -> tuple[int, str]:
    given = ["--model", str(folder / "full.xml"), "--interfaces", str(folder / "list.xml")]
    result = CliRunner().invoke(main, [command, *given, *options])
    return result.exit_code, result.output.replace(f"{folder}/", "")


def test_the_earlier_tool_s_entry_checks_the_whole_system(folder: Path) -> None:
    assert entry(folder, "check", "--strict") == (0, "2 models, 0 errors, 0 warnings\n")


def test_the_earlier_tool_s_entry_generates_the_whole_system(folder: Path) -> None:
    code, output = entry(folder, "generate", "-o", str(folder / "out"))
    assert code == 0, output
    assert output.startswith("full: 2 nodes, 1 policy in out (")
    assert {path.name for path in (folder / "out").iterdir()} >= {"battery", "level", "full_policy"}


def test_a_channel_that_the_list_does_not_declare_is_reported(folder: Path) -> None:
    (folder / "list.xml").write_text(interface_list(name="levels"))
    for command in (["check"], ["generate", "-o", str(folder / "out")]):
        code, output = entry(folder, *command)
        assert code == 0
        assert (
            "battery.scxml:1:89: warning: Battery uses /Battery/level, which the interface list does not "
            "declare; did you mean levels? [undeclared-function]\n"
            "level.scxml:1:158: warning: Level uses /Battery/level, which the interface list does not "
            "declare; did you mean levels? [undeclared-function]\n"
        ) in output


def test_a_topic_that_the_list_calls_a_service_is_reported(folder: Path) -> None:
    (folder / "list.xml").write_text(interface_list("async-service"))
    _, output = entry(folder, "check")
    assert (
        "battery.scxml:1:89: warning: Battery uses /Battery/level as a topic; the interface list "
        "declares level as a service [function-kind]\n"
    ) in output


def test_an_interface_that_the_list_does_not_have_is_reported(folder: Path) -> None:
    path = folder / "full.xml"
    if "skillDeclaration" not in path.read_text():
        path.write_text(DECLARATIONS)
    path.write_text(
        path.read_text().replace('"Battery" interface="battery"', '"Battery" interface="batery"')
    )
    _, output = entry(folder, "check")
    assert output.splitlines()[0] == (
        "full.xml:7:47: warning: <componentDeclaration>: the interface list does not declare `batery`; "
        "did you mean battery? [undeclared-list-entry]"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<interfaces", "1:1: error: malformed XML: unclosed token [malformed-xml]"),
        (
            "<specification/>",
            "1:1: error: <specification>: not an interface list; its root is <interfaces> [unknown-tag]",
        ),
        (
            interface_list("topik"),
            "3:83: error: <interface>: unknown kind `topik`; did you mean topic? [bad-interface]",
        ),
        (
            "<interfaces><interface/></interfaces>",
            "1:13: error: <interface>: the attribute `id` is missing [missing-attribute]",
        ),
    ],
)
def test_a_faulty_interface_list_is_one_error(folder: Path, text: str, message: str) -> None:
    (folder / "list.xml").write_text(text)
    code, output = entry(folder, "check")
    assert code == 2
    assert f"list.xml:{message}" in output.splitlines()


def test_a_full_model_that_names_a_missing_file_is_an_error(folder: Path) -> None:
    (folder / "level.scxml").rename(folder / "lvl.scxml")
    code, output = entry(folder, "check")
    assert code == 2
    assert "level.scxml does not exist; did you mean lvl.scxml? [missing-file]" in output
