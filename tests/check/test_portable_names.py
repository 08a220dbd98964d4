"""Names of nodes and channels that a middleware does not take are refused before anything runs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog, Position
from m2c.model.naming import ANYWHERE, Naming, check_channel
from transports.interface import TransportError
from transports.registry import name_rules
from transports.ros_names import MOST, refusal
from transports.zenoh.names import key_of

MODEL = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="{name}">
  <ros_topic_publisher name="level" topic="{topic}" type="std_msgs/Int32"/>
  <state id="idle"><onentry>
    <ros_topic_publish name="level"><field name="data" expr="1"/></ros_topic_publish>
  </onentry></state>
</scxml>
"""
ON_ROS2 = Naming(name_rules(), chosen=True)
ANY = Naming(name_rules())


def findings(folder: Path, naming: Naming, name: str = "Tank", topic: str = "/level") -> list[str]:
    path = folder / "tank.scxml"
    path.write_text(MODEL.format(name=name, topic=topic))
    log = DiagnosticLog()
    read_and_check([path], [], log, naming=naming)
    return [str(item).removeprefix(f"{path}:") for item in log.diagnostics]


@pytest.mark.parametrize(
    ("topic", "fault", "instead"),
    [
        ("/tank/**", "has `*`, which no transport takes in a name", "/tank"),
        ("/tank/a*b", "has `*`, which no transport takes in a name", "/tank/a_b"),
        ("/tank#1", "has `#`, which no transport takes in a name", "/tank_1"),
        ("/what?", "has `?`, which no transport takes in a name", "/what"),
        ("/$x", "has `$`, which no transport takes in a name", "/x"),
        ("/@x/y", "has a part that begins with @, `@x`, which no transport takes", "/x/y"),
        ("//x//", "has an empty part", "/x"),
        ("/*", "has `*`, which no transport takes in a name", "/node/value"),
    ],
)
@pytest.mark.parametrize("naming", [ANYWHERE, ANY, ON_ROS2, Naming(chosen=True)])
def test_a_channel_that_no_transport_takes_is_an_error_wherever_it_is_to_run(
    tmp_path: Path, topic: str, fault: str, instead: str, naming: Naming
) -> None:
    assert findings(tmp_path, naming, topic=topic) == [
        f"2:3: error: the channel `{topic}` {fault}; write it like {instead} [bad-name]"
    ]
    assert findings(tmp_path, ON_ROS2, topic=instead) == []


@pytest.mark.parametrize(
    ("topic", "fault", "instead"),
    [
        ("/tank/fill it-é", "it has a blank; a-z, A-Z, 0-9 and _ may be in it", "/tank/fill_it_e"),
        ("/tank/1st", "its part `1st` begins with a digit", "/tank/n1st"),
        ("/漢字/level", "it has `漢`; a-z, A-Z, 0-9 and _ may be in it", "/level"),
        ("/~", "it has `~`; a-z, A-Z, 0-9 and _ may be in it", "/name"),
    ],
)
def test_a_channel_that_ros2_does_not_take_is_an_error_there_and_else_a_warning(
    tmp_path: Path, topic: str, fault: str, instead: str
) -> None:
    said = f"the ros2 transport does not take the topic `{topic}`: {fault}; write {instead}"
    assert findings(tmp_path, ON_ROS2, topic=topic) == [f"2:3: error: {said} [bad-name]"]
    assert findings(tmp_path, ANY, topic=topic) == [f"2:3: warning: {said} [unportable-name]"]
    assert findings(tmp_path, Naming(chosen=True), topic=topic) == []
    assert findings(tmp_path, ON_ROS2, topic=instead) == []


def test_a_machine_whose_name_ros2_does_not_take_for_a_node_is_an_error_there(
    tmp_path: Path,
) -> None:
    said = (
        "<scxml>: the ros2 transport does not take the name of a node `Füll-en`: it has `ü`; a-z, A-Z, "
        "0-9 and _ may be in it; write Full_en"
    )
    assert findings(tmp_path, ON_ROS2, name="Füll-en") == [f"1:1: error: {said} [bad-name]"]
    assert findings(tmp_path, ANY, name="Füll-en") == [f"1:1: warning: {said} [unportable-name]"]
    assert findings(tmp_path, Naming(chosen=True), name="Füll-en") == []
    assert findings(tmp_path, ON_ROS2, name="Full_en") == []


@pytest.mark.parametrize("kind", MOST)
def test_ros2_takes_names_up_to_a_length_that_leaves_room_for_what_belongs_to_them(
    kind: str,
) -> None:
    slash = "" if kind == "node" else "/"
    longest = slash + "x" * (MOST[kind] - len(slash))
    assert refusal(kind, longest) is None
    found = refusal(kind, f"{longest}x")
    assert found == (
        f"it has {MOST[kind] + 1} characters; at most {MOST[kind]} are allowed",
        "",
    )


@given(st.text(st.sampled_from("aZ0_/ -é漢*$?#@~.{"), max_size=8))
def test_zenoh_takes_every_channel_that_the_check_lets_pass(written: str) -> None:
    log = DiagnosticLog()
    check_channel("topic", f"/{written}", Position("m"), "", ANYWHERE, log)
    try:
        key_of(f"/{written}")
        taken = True
    except TransportError:
        taken = False
    if not log.has_errors:
        assert taken
    assert "/ " in f"/{written}" or taken is not log.has_errors


POLICY = """<root BTCPP_format="4"><BehaviorTree ID="Main">{leaf}</BehaviorTree></root>"""
PLUGIN = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Ask">
  <bt_declare_port_in key="topic" type="string"/>
  <ros_topic_publisher name="out" type="std_msgs/Int32"><topic><bt_get_input key="topic"/></topic>
  </ros_topic_publisher>
  <state id="a"><bt_tick>
    <ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish>
    <bt_return_status status="SUCCESS"/>
  </bt_tick></state>
</scxml>
"""
SYSTEM = """<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/>
<input type="bt-plugin-ascxml" src="ask.scxml"/></behavior_tree></roaml>
"""


def system(folder: Path, leaf: str) -> Path:
    (folder / "policy.xml").write_text(POLICY.format(leaf=leaf))
    (folder / "ask.scxml").write_text(PLUGIN)
    tick = folder / "interfaces" / "t" / "srv" / "TickAction.srv"
    tick.parent.mkdir(parents=True, exist_ok=True)
    tick.write_text("---\nint8 status\n")
    path = folder / "system.xml"
    path.write_text(SYSTEM)
    return path


@pytest.mark.parametrize(
    "leaf",
    [
        '<Action ID="Ask" name="Ask" topic="{}"/>',
        '<Action ID="ROS2Action" name="Go" service_name="{}"/>',
    ],
)
def test_a_channel_that_only_the_policy_names_is_checked_too(tmp_path: Path, leaf: str) -> None:
    def rules(channel: str, naming: Naming) -> list[str]:
        log = DiagnosticLog()
        read_and_check([system(tmp_path, leaf.format(channel))], [], log, naming=naming)
        return [f"{item.severity} {item.rule}" for item in log.diagnostics if "name" in item.rule]

    assert rules("/tank/level", ON_ROS2) == []
    assert rules("/tank/**", ANYWHERE) == ["error bad-name"]
    assert rules("/tank/fill-it", ON_ROS2) == ["error bad-name"]
    assert rules("/tank/fill-it", ANY) == ["warning unportable-name"]
    assert rules("/tank/fill-it", Naming(chosen=True)) == []


def test_a_channel_from_a_port_is_absolute_as_one_that_a_model_writes(tmp_path: Path) -> None:
    from m2c.policy.program import read_policy

    log = DiagnosticLog()
    leaf = '<Action ID="Ask" name="Ask" topic="level"/>'
    read = read_and_check([system(tmp_path, leaf)], [], log)
    assert read is not None
    assert read.policy is not None
    policy = read_policy(read.policy, read, log)
    assert policy is not None
    assert [port.value for port in policy.leaves[0].inputs] == ["/level"]


def command(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-c", "from m2c.cli import main; main()", *arguments]
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.run(
        program, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_every_command_that_is_told_the_transport_refuses_what_it_does_not_take(
    tmp_path: Path,
) -> None:
    (tmp_path / "tank.scxml").write_text(MODEL.format(name="Tank", topic="/fill-level"))
    (tmp_path / "s.xml").write_text(
        '<roaml><node_models><input type="node-ascxml" src="tank.scxml"/></node_models></roaml>'
    )
    ros2 = ("--transport", "ros2")
    for arguments in (
        ("check", "tank.scxml", *ros2),
        ("generate", "tank.scxml", "-o", "g", *ros2),
        ("run", "s.xml", *ros2),
    ):
        ended = command(*arguments, folder=tmp_path)
        assert ended.returncode == 2
        assert "tank.scxml:2:3: error: the ros2 transport does not" in ended.stdout + ended.stderr
    assert command("check", "tank.scxml", "--transport", "zenoh", folder=tmp_path).returncode == 0
    assert "unportable-name" in command("check", "tank.scxml", folder=tmp_path).stdout
    unknown = command("check", "tank.scxml", "--transport", "rso2", folder=tmp_path)
    assert unknown.returncode == 2
    assert unknown.stderr.startswith("error: no transport `rso2` is installed; installed: ")
