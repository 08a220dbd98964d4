"""``m2c generate --transport ros2``: the same code as elsewhere, packed for a ROS 2 workspace."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import pytest
from catkin_pkg.package import parse_package
from click.testing import CliRunner, Result

from m2c.codegen.command import generate
from m2c.codegen.writer import HASH_LIST, is_edited
from m2c.rosidl.build import build_interfaces
from tests.transports import ros2_network

ROOT = Path(__file__).parents[2]
LAB_TOUR = ROOT / "examples" / "lab_tour"
PACKAGING = re.compile(
    r"(package\.xml|setup\.py|setup\.cfg|resource/\w+|pyproject\.toml|generated\.sha256"
    r"|lab_tour_bringup/.*)$"
)
M2C = Path(sys.executable).parent / "m2c"
LIMIT_S = 100
"""A process that runs longer is killed, and its test fails."""

TWO_SKILLS = """<roaml>
  <parameters><bt_tick_rate value="20"/></parameters>
  <behavior_tree><input type="bt.cpp-xml" src="policy.xml"/></behavior_tree>
  <node_models>
    <input type="node-ascxml" src="{0}/skills/BatteryLevelSkill.scxml"/>
    <input type="node-ascxml" src="{0}/skills/WaitSkill.scxml"/>
  </node_models>
  <interfaces><input type="ros-interfaces" src="{0}/interfaces"/></interfaces>
</roaml>
"""
POLICY = """<root><BehaviorTree ID="M"><Sequence>
  <Condition ID="ROS2Condition" name="BatteryLevel" interface="ROS2SERVICE"/>
  <Action ID="ROS2Action" name="Wait" interface="ROS2SERVICE"/>
</Sequence></BehaviorTree></root>
"""


def generated(path: Path, output: Path, transport: str = "ros2", *options: str) -> Result:
    arguments = [str(path), "-o", str(output), "--transport", transport, *options]
    return CliRunner().invoke(generate, arguments)


def contents(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.fixture(scope="module")
def tour(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ros2") / "tour"
    done = generated(LAB_TOUR / "system.xml", folder)
    assert done.exit_code == 0, done.output
    return folder


def test_the_outputs_for_zenoh_and_ros_2_differ_in_packaging_only(tour: Path, tmp_path) -> None:
    assert generated(LAB_TOUR / "system.xml", tmp_path / "zenoh", "zenoh").exit_code == 0
    zenoh, ros2 = contents(tmp_path / "zenoh"), contents(tour)
    only_here = {name for name in zenoh.keys() ^ ros2.keys() if not PACKAGING.search(name)}
    assert only_here == set()
    differing = {name for name in zenoh.keys() & ros2.keys() if zenoh[name] != ros2[name]}
    assert {Path(name).name for name in differing} == {"__main__.py", HASH_LIST}
    assert sum(name.endswith("/machine.py") for name in ros2) == 17


def test_each_package_is_one_that_ros_2_accepts(tour: Path) -> None:
    folders = sorted(path for path in tour.iterdir() if path.is_dir())
    assert len(folders) == 19
    for folder in folders:
        package = parse_package(str(folder / "package.xml"))
        package.validate()
        assert package.name == folder.name
        assert package.get_build_type() == "ament_python"
        assert (folder / "resource" / folder.name).read_bytes() == b""


def depends(folder: Path) -> set[str]:
    package = parse_package(str(folder / "package.xml"))
    return {depend.name for depend in package.exec_depends}


def test_a_package_depends_on_the_interfaces_that_its_machine_uses(tour: Path) -> None:
    assert depends(tour / "wait_skill") == {"rclpy", "std_msgs", "bt_interfaces"}
    tours_types = {"bt_interfaces", "tour_interfaces", "navigation_interfaces"}
    assert depends(tour / "go_to_poi_skill") == {"rclpy", "std_msgs", "action_msgs", *tours_types}
    assert depends(tour / "lab_tour_policy") == {"rclpy", "std_msgs", "bt_interfaces"}
    started = {path.name for path in tour.iterdir() if path.is_dir()} - {"lab_tour_bringup"}
    assert depends(tour / "lab_tour_bringup") == {*started, "launch", "launch_ros", "ros2launch"}


def test_every_file_is_sealed_and_comes_out_the_same_again(tour: Path) -> None:
    lines = (tour / HASH_LIST).read_text().splitlines()
    listed = {name: digest for digest, name in (line.split("  ") for line in lines)}
    for name, content in contents(tour).items():
        if name.endswith((".py", ".toml")):
            assert not is_edited(content.decode()), name
        elif name != HASH_LIST:
            assert listed[name] == hashlib.sha256(content).hexdigest()
    again = generated(LAB_TOUR / "system.xml", tour)
    assert "(0 files written, 167 unchanged)" in again.output


@pytest.mark.parametrize("name", ["setup.cfg", "setup.py", "package.xml", "resource/wait_skill"])
def test_an_edited_packaging_file_is_not_overwritten(name: str, tmp_path: Path) -> None:
    model = LAB_TOUR / "skills" / "WaitSkill.scxml"
    assert generated(model, tmp_path).exit_code == 0
    with (tmp_path / "wait_skill" / name).open("a") as file:
        file.write("# mine\n")
    done = generated(model, tmp_path)
    assert done.exit_code == 2
    assert "edited by hand" in done.output
    assert generated(model, tmp_path, "ros2", "--force").exit_code == 0


@pytest.mark.parametrize(("first", "second"), [("zenoh", "ros2"), ("ros2", "zenoh")])
def test_packages_for_two_transports_do_not_mix_in_one_folder(first, second, tmp_path) -> None:
    model = LAB_TOUR / "skills" / "WaitSkill.scxml"
    assert generated(model, tmp_path, first).exit_code == 0
    before = contents(tmp_path)
    done = generated(model, tmp_path, second)
    assert done.exit_code == 2
    assert f"give those for {second} a folder of their own" in done.output
    assert contents(tmp_path) == before


def test_the_packaging_is_formatted_and_clean(tour: Path) -> None:
    for arguments in (["format", "--check"], ["check", "--select", "E,F,UP,B"]):
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "ruff",
                *arguments,
                "--isolated",
                "--line-length",
                "100",
                str(tour),
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout


# --- the launch file --------------------------------------------------------------------------------


class Recorded:
    """Something of ROS 2's launch: what it was made with."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self.arguments = arguments
        self.named = named


def launch_description(path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The entities of a launch file, read with doubles of launch and launch_ros in place."""
    made = ["LaunchDescription", "DeclareLaunchArgument", "Shutdown", "LaunchConfiguration", "Node"]
    doubles = {name: type(name, (Recorded,), {}) for name in made}
    for name in (
        "launch",
        "launch.actions",
        "launch.substitutions",
        "launch_ros",
        "launch_ros.actions",
    ):
        module = types.ModuleType(name)
        vars(module).update(doubles)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("launched", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entities: list[Any]
    (entities,) = module.generate_launch_description().arguments
    return entities


def test_the_launch_file_starts_every_node_and_the_policy_after_them(
    tour: Path, monkeypatch
) -> None:
    path = tour / "lab_tour_bringup" / "launch" / "lab_tour.launch.py"
    entities = launch_description(path, monkeypatch)
    nodes = [item.named for item in entities if type(item).__name__ == "Node"]
    packages = {path.name for path in tour.iterdir() if path.is_dir()} - {"lab_tour_bringup"}
    assert {node["package"] for node in nodes} == packages
    assert all(node["executable"] == node["package"] for node in nodes)
    policy = nodes[-1]
    assert policy["package"] == "lab_tour_policy"
    assert type(policy["on_exit"]).__name__ == "Shutdown"
    waited_for = policy["arguments"][4:]
    assert waited_for[::2] == ["--wait-for"] * 17
    assert "BatteryLevelSkill" in waited_for[1::2]
    declared = [item for item in entities if type(item).__name__ == "DeclareLaunchArgument"]
    assert {item.arguments[0]: item.named["default_value"] for item in declared} == {
        "use_sim_time": "false",
        "rate": "5.0",
        "ticks": "0",
    }


def test_a_launch_file_without_a_policy_starts_the_node(tmp_path: Path, monkeypatch) -> None:
    assert generated(LAB_TOUR / "skills" / "WaitSkill.scxml", tmp_path).exit_code == 0
    path = tmp_path / "wait_skill_bringup" / "launch" / "wait_skill.launch.py"
    named = [item.named for item in launch_description(path, monkeypatch)]
    assert [node["package"] for node in named if "package" in node] == ["wait_skill"]


def test_where_launch_is_not_installed_the_launch_file_says_what_to_do(tour: Path) -> None:
    path = tour / "lab_tour_bringup" / "launch" / "lab_tour.launch.py"
    done = subprocess.run(
        [sys.executable, "-S", str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "m2c run FOLDER --transport ros2" in done.stderr
    assert "Traceback" not in done.stderr


# --- in a workspace ---------------------------------------------------------------------------------


@pytest.mark.ros2
@pytest.mark.slow
def test_a_workspace_of_generated_packages_builds_with_colcon_and_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ros2_network.have_ticks(monkeypatch)
    (tmp_path / "system.xml").write_text(TWO_SKILLS.format(LAB_TOUR))
    (tmp_path / "policy.xml").write_text(POLICY)
    system = tmp_path / "two"
    done = generated(tmp_path / "system.xml", system)
    assert done.exit_code == 0, done.output
    install = build_interfaces([system], tmp_path / "workspace")
    assert {"battery_level_skill", "wait_skill"} < set(install.packages)
    program = Path(executable(install.prefix, "wait_skill")).read_text()
    assert program.startswith("#!/usr/bin/env python3\n")  # the shell's, not colcon's
    with ros2_network.own_domain():
        environment = install.environment()
        environment["PATH"] = f"{M2C.parent}{os.pathsep}{os.environ['PATH']}"
        nodes = [
            subprocess.Popen([executable(install.prefix, name)], env=environment)
            for name in ("battery_level_skill", "wait_skill")
        ]
        (policy_package,) = (name for name in install.packages if name.endswith("_policy"))
        waited_for = ["--wait-for", "BatteryLevelSkill", "--wait-for", "WaitSkill"]
        run([executable(install.prefix, policy_package), "--ticks", "3", *waited_for,
             "--ros-args", "-r", "__node:=tree", "-p", "use_sim_time:=false"], environment)  # fmt: skip
        for node in nodes:
            node.terminate()
        assert [node.wait(LIMIT_S) for node in nodes] == [0, 0]
        # the folder is still one that m2c runs
        run([str(M2C), "run", str(system), "--transport", "ros2", "--ticks", "3"], environment)


def executable(prefix: Path, package: str) -> str:
    """Where ``ros2 run`` looks for the program of ``package``."""
    return str(prefix / package / "lib" / package / package)


def run(command: list[str], environment: dict[str, str]) -> None:
    done = subprocess.run(
        command,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
