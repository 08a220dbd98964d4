"""Interface packages that nodes on ROS 2 import, and that are not installed where they are checked.

m2c knows the definitions of ROS 2's standard packages without them; rclpy needs the packages.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator

from m2c.diagnostics import DiagnosticLog
from m2c.language.datatypes import Array, DataType, Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Interface, InterfaceKind
from m2c.model.standard import standard_texts
from m2c.model.system import System

_OF_THE_EXTRA = frozenset(
    {
        *(
            "action_msgs",
            "builtin_interfaces",
            "diagnostic_msgs",
            "geometry_msgs",
            "lifecycle_msgs",
        ),
        *(
            "rcl_interfaces",
            "rmw_dds_common",
            "rosgraph_msgs",
            "service_msgs",
            "std_msgs",
            "std_srvs",
        ),
        *("type_description_interfaces", "unique_identifier_msgs"),
    }
)
"""What ``pip install 'm2c-moon[ros2]'`` brings."""
_WITHOUT_WHEEL = frozenset(
    {"example_interfaces", "rosbag2_interfaces", "statistics_msgs", "tf2_msgs"}
)


def check_packages(system: System, log: DiagnosticLog) -> None:
    """Warn (``missing-package``) of each standard package that is needed and lacking, once."""
    told: set[str] = set()
    for machine in (*system.nodes, *system.plugins):
        for interface in machine.interfaces:
            for package in sorted(_packages_of(interface, system.library) - told):
                told.add(package)
                if package in _OF_THE_EXTRA or _is_installed(package):
                    continue
                what = f"{interface.type_name} needs the package {package}, which is not installed here"
                hint = f"pip install ros-jazzy-{package.replace('_', '-')}"
                if package in _WITHOUT_WHEEL:
                    hint = "it has no wheel: source a workspace of ROS 2 Jazzy that has it"
                log.warning("missing-package", interface.position, "", what, hint)


def _is_installed(package: str) -> bool:
    spec = importlib.util.find_spec(package)
    return spec is not None and spec.origin is not None


def _packages_of(interface: Interface, library: InterfaceLibrary) -> set[str]:
    """The standard packages that the type of ``interface`` is of, and made of."""
    full = interface.type_name
    if interface.kind is InterfaceKind.TIMER or not full:
        return set()
    parts = {
        "srv": ("_Request", "_Response"),
        "action": ("_Goal", "_Result", "_Feedback"),
    }.get(full.split("/")[1] if full.count("/") == 2 else "", ("",))
    found = [library.structure(f"{full}{part}") for part in parts]
    names = {full, *(name for made in found if made is not None for name in _names_in(made))}
    standard = standard_texts()
    return {name.partition("/")[0] for name in names if name in standard and not library.file(name)}


def _names_in(kind: DataType) -> Iterator[str]:
    while isinstance(kind, Array):
        kind = kind.element
    if isinstance(kind, Structure):
        yield kind.name
        for _, inner in kind.fields:
            yield from _names_in(inner)
