"""How generated code is packed: as a Python distribution, or as a package of a ROS 2 workspace.

The code is the same; what differs are the files around it and how ``__main__.py`` is started. What a
package of a ROS 2 workspace consists of: https://docs.ros.org/en/jazzy/How-To-Guides/
Developing-a-ROS-2-Package.html; the format of ``package.xml``: REP 149.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

from m2c.codegen.program import PackageProgram
from m2c.codegen.source import Source, name
from m2c.model.machine import Machine
from transports.descriptions import described

_TRANSPORT_PACKAGES = ("rclpy", "std_msgs")
"""What every node needs on ROS 2: what the tools tell each other travels in std_msgs/String."""


class Packaging(StrEnum):
    """What a generated package is installed with; its value is ``transport`` in templates."""

    WHEEL = "zenoh"
    """pip; nodes run on Zenoh unless told otherwise."""
    AMENT = "ros2"
    """colcon (``ament_python``); nodes run on ROS 2 unless told otherwise."""


MARKS = {Packaging.WHEEL: "pyproject.toml", Packaging.AMENT: "package.xml"}
"""The file that each packaging has and the other does not. Both in one folder: setuptools would
take a part of what it installs from the one, and a part from the other."""

FILES = {
    Packaging.WHEEL: ("pyproject.toml",),
    Packaging.AMENT: ("package.xml", "setup.py", "setup.cfg"),
}
"""The files around a package's code; each has a template of its name."""


def packaging_of(transport: str) -> Packaging:
    """How nodes for ``transport`` are packed."""
    return Packaging.AMENT if described(transport).needs_packages else Packaging.WHEEL


def code_package(
    package: str, description: str, types: Iterable[str], is_nested: bool = False
) -> PackageProgram:
    """The facts of a package with code.

    Args:
        package: its name.
        description: one line.
        types: the ROS types that its code uses, ``std_msgs/msg/Int32``; their packages it depends on.
        is_nested: whether it has packages and data files within.
    """
    needed = {*_TRANSPORT_PACKAGES}
    for type_name in types:
        owner, kind, _ = type_name.split("/")
        needed |= {owner, "action_msgs"} if kind == "action" else {owner}
    return PackageProgram(
        name(package),
        Source(package.replace("_", "-")),
        description,
        tuple(name(owner) for owner in sorted(needed)),
        is_nested,
    )


def launch_package(
    package: str, description: str, started: Iterable[str], file: str
) -> PackageProgram:
    """The facts of the package that starts the packages ``started`` by the launch file ``file``."""
    needed = (*sorted(started), "launch", "launch_ros", "ros2launch")
    depends = tuple(name(owner) for owner in needed)
    return PackageProgram(name(package), name(package), description, depends, launch=file)


def type_names(machines: Iterable[Machine]) -> tuple[str, ...]:
    """The ROS types of the channels of ``machines``."""
    names = {interface.type_name for machine in machines for interface in machine.interfaces}
    return tuple(sorted(names - {""}))
