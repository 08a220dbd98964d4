"""Interface packages that nodes on ROS 2 need and that are not installed here."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check import packages
from m2c.check.system import check_system
from m2c.model import DiagnosticLog, load
from m2c.naming import naming_of

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="M" initial="a">'
ONE = '<ros_topic_subscriber topic="/{0}" type="{1}"/>'
INSTALLED = {"std_msgs", "nav_msgs"}


def missing(folder: Path, *types: str, transport: str | None = "ros2") -> list[str]:
    """What is said of the packages of a machine that subscribes to messages of ``types``."""
    topics = "".join(ONE.format(f"t{number}", kind) for number, kind in enumerate(types))
    (folder / "m.scxml").write_text(f'{HEAD}{topics}<state id="a"/></scxml>')
    log = DiagnosticLog()
    system = load([folder / "m.scxml"], log)
    assert system is not None
    check_system(system, log, naming_of(transport))
    return [f"{f.message}; {f.hint}" for f in log.diagnostics if f.rule == "missing-package"]


@pytest.fixture(autouse=True)
def some_are_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "_is_installed", INSTALLED.__contains__)


@pytest.mark.parametrize(
    ("kind", "package"),
    [
        ("sensor_msgs/Image", "sensor-msgs"),
        ("shape_msgs/msg/Plane", "shape-msgs"),
        ("trajectory_msgs/JointTrajectoryPoint", "trajectory-msgs"),
    ],
)
def test_a_package_that_is_not_installed_is_told_with_its_pip_name(
    tmp_path: Path, kind: str, package: str
) -> None:
    (said,) = missing(tmp_path, kind, kind, "std_msgs/Int32", "nav_msgs/Odometry")
    name = package.replace("-", "_")
    assert f"needs the package {name}, which is not installed here; " in said
    assert said.endswith(f"; pip install ros-jazzy-{package}")


def test_a_package_without_a_wheel_is_said_to_have_none(tmp_path: Path) -> None:
    (said,) = missing(tmp_path, "example_interfaces/Int32")
    assert said.endswith("; it has no wheel: source a workspace of ROS 2 Jazzy that has it")


def test_what_a_type_of_ones_own_is_made_of_is_needed_too(tmp_path: Path) -> None:
    path = tmp_path / "interfaces" / "p" / "msg" / "Seen.msg"
    path.parent.mkdir(parents=True)
    path.write_text("sensor_msgs/Image[] seen\n")
    (said,) = missing(tmp_path, "p/Seen")
    assert said == (
        "p/msg/Seen needs the package sensor_msgs, which is not installed here; "
        "pip install ros-jazzy-sensor-msgs"
    )


@pytest.mark.parametrize("transport", [None, "zenoh", "simulated"])
def test_no_other_transport_needs_packages(tmp_path: Path, transport: str | None) -> None:
    assert missing(tmp_path, "sensor_msgs/Image", transport=transport) == []


def test_a_package_that_the_system_brings_is_built_with_it(tmp_path: Path) -> None:
    path = tmp_path / "interfaces" / "sensor_msgs" / "msg" / "Image.msg"
    path.parent.mkdir(parents=True)
    path.write_text("int8 a\n")
    assert missing(tmp_path, "sensor_msgs/Image") == []
