"""What works of ROS 2 on this host (see :mod:`transports.diagnosis`).

Beside the package ``transports.ros2``, which can be imported only where rclpy can.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from queue import Empty
from typing import ClassVar

import msgspec

from transports.descriptions import described
from transports.diagnosis import Finding, State
from transports.interface import Connection, Topic, TransportError
from transports.registry import connect
from transports.work_queue import WorkQueue

NAME = "ros2"
DISTRIBUTION = "m2c-moon"
"""Whose extra of the name of the transport lists the wheels."""
WAIT_S = 10.0
"""How long two nodes of one process may take to discover one another."""
DISTRO = "jazzy"
MOST_DOMAIN = 232
"""Beyond it DDS's port numbers would not fit (RTPS 9.6.1.1)."""
_PORTS = 7400, 250
"""The first UDP port of domain 0, and how many each domain has (RTPS 9.6.1.1)."""
_RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
_EPHEMERAL = Path("/proc/sys/net/ipv4/ip_local_port_range")
_MAY_BE_SET = frozenset(
    {
        *(
            "ROS_DOMAIN_ID",
            "ROS_AUTOMATIC_DISCOVERY_RANGE",
            "ROS_LOCALHOST_ONLY",
            "ROS_STATIC_PEERS",
        ),
        *("ROS_DISTRO", "ROS_VERSION", "ROS_PYTHON_VERSION", "ROS_HOME", "ROS_LOG_DIR"),
        *("ROS_SECURITY_ENABLE", "ROS_SECURITY_STRATEGY", "ROS_SECURITY_KEYSTORE"),
        *("ROS_SECURITY_ENCLAVE_OVERRIDE", "ROS_DISABLE_LOANED_MESSAGES", "ROS_OS_OVERRIDE"),
        "ROS_PACKAGE_PATH",
    }
)
"""What ROS 2 Jazzy or its tools read; the last is ROS 1's, whose setup may have been sourced before."""
_OF_DISCOVERY_SERVERS = ("ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT")
"""What Fast DDS reads by itself (its documentation, "Environment variables")."""


class _Text(msgspec.Struct):
    data: str = ""
    __type_name__: ClassVar[str] = "std_msgs/msg/String"


def diagnose(options: Mapping[str, str]) -> Iterator[Finding]:
    """What is found of ROS 2: its packages, variables, ports, and two nodes that talk."""
    yield from variables(os.environ)
    if importlib.util.find_spec("rclpy") is None:
        mend = described(NAME).needs.partition(": ")[2]
        yield Finding(State.MISSING, NAME, "rclpy is not installed", mend)
        return
    yield Finding(State.WORKS, NAME, f"rclpy is in {_folder_of('rclpy')}")
    missing = missing_wheels(importlib.metadata.requires(DISTRIBUTION) or ())
    if missing and _is_installed("ros-jazzy-rclpy"):
        text = f"{len(missing)} of the wheels of m2c-moon[{NAME}] are not installed"
        yield Finding(State.MISSING, "wheels", text, f"pip install {' '.join(missing)}")
    elif not missing:
        yield Finding(State.WORKS, "wheels", f"all of m2c-moon[{NAME}] are installed")
    yield talk()


def variables(environment: Mapping[str, str]) -> Iterator[Finding]:
    """What is to be said of the variables of ``environment`` that ROS 2 reads."""
    for name in sorted(name for name in environment if name.startswith(("ROS_", "RMW_"))):
        value = environment[name]
        wrong = _wrong(name, value)
        if wrong is not None:
            yield Finding(State.WRONG, "variable", f"{name}={value}: {wrong[0]}", wrong[1])
        elif name in _OF_DISCOVERY_SERVERS:
            what = "Fast DDS reads it: nodes find each other by a discovery server only, which has to run"
            yield Finding(State.NOTE, "variable", f"{name}={value}: {what}", f"unset {name}")
        elif name.startswith("ROS_") and name not in _MAY_BE_SET:
            text = f"{name}={value}: ROS 2 {DISTRO.title()} does not read it"
            yield Finding(State.NOTE, "variable", text, f"unset {name}")
        elif name == "ROS_LOCALHOST_ONLY":
            better = (
                f"export ROS_AUTOMATIC_DISCOVERY_RANGE={'LOCALHOST' if value == '1' else 'SUBNET'}"
            )
            text = f"{name}={value}: it works, and is deprecated since ROS 2 Iron"
            yield Finding(State.NOTE, "variable", text, f"unset {name}; {better}")
        else:
            yield Finding(State.WORKS, "variable", f"{name}={value}")
    for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
        gone = [part for part in environment.get(name, "").split(os.pathsep) if part]
        gone = [part for part in gone if not Path(part).is_dir()]
        if gone:
            text = f"{name} names folders that do not exist: {', '.join(gone)}"
            mend = "begin a new shell, and source what is there"
            yield Finding(State.WRONG, "variable", text, mend)


def _wrong(name: str, value: str) -> tuple[str, str] | None:
    """What is wrong with a variable's value, and what mends it."""
    match name:
        case "ROS_DOMAIN_ID":
            if not re.fullmatch("[0-9]{1,4}", value) or int(value) > MOST_DOMAIN:
                return f"a domain is a number from 0 to {MOST_DOMAIN}", f"export {name}=0"
            return _crowded(int(value))
        case "ROS_AUTOMATIC_DISCOVERY_RANGE" if value not in _RANGES:
            return f"it is one of {', '.join(_RANGES)}", f"export {name}=LOCALHOST"
        case "ROS_AUTOMATIC_DISCOVERY_RANGE" if value == "OFF":
            return "no node finds another", f"export {name}=LOCALHOST"
        case "ROS_LOCALHOST_ONLY" if value not in ("0", "1"):
            return "it is 0 or 1", f"unset {name}"
        case "ROS_DISTRO" if value != DISTRO:
            mend = f"begin a new shell, and . /opt/ros/{DISTRO}/setup.bash"
            return f"this project is for {DISTRO}", mend
        case "ROS_VERSION" if value != "2":
            return "the setup of ROS 1 was sourced", "begin a new shell"
        case "RMW_IMPLEMENTATION" if value and not _has_rmw(value):
            mend = f"pip install ros-{DISTRO}-{value.replace('_', '-')}, or unset {name}"
            return f"the package {value} is not installed", mend
    return None


def _crowded(domain: int) -> tuple[str, str] | None:
    """That the ports of ``domain`` are among those that the kernel gives to anybody."""
    try:
        low, high = map(int, _EPHEMERAL.read_text().split())
    except (OSError, ValueError):
        return None  # not Linux
    first = _PORTS[0] + _PORTS[1] * domain
    if first <= high and first + _PORTS[1] > low:
        text = f"its UDP ports, from {first} on, are among those that any process may be given"
        return f"{text} ({low} to {high})", "export ROS_DOMAIN_ID=0 (any of 0 to 101)"
    return None


def _has_rmw(name: str) -> bool:
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders = [Path(part) for part in prefixes if part]
    place = Path("share/ament_index/resource_index/packages") / name
    return any((folder / place).exists() for folder in folders) or _is_installed(
        f"ros-{DISTRO}-{name.replace('_', '-')}"
    )


def missing_wheels(requirements: Iterator[str] | list[str] | tuple[str, ...]) -> list[str]:
    """Of the requirements of the extra, those that are not installed, as pip takes them."""
    needed = [r.partition(";") for r in requirements]
    of_extra = [text.strip() for text, _, when in needed if re.search(rf"extra == .{NAME}\b", when)]
    return [text for text in of_extra if not _is_installed(re.split(r"[<>=!~\[ ]", text)[0])]


def _is_installed(distribution: str) -> bool:
    try:
        importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _folder_of(package: str) -> str:
    spec = importlib.util.find_spec(package)
    origin = None if spec is None else spec.origin
    return "an unknown place" if origin is None else str(Path(origin).parent.parent)


def talk() -> Finding:
    """Whether a message of one node reaches another in the domain of the environment."""
    topic = Topic(f"/m2c_doctor_{os.getpid()}", _Text.__type_name__, _Text, transient_local=True)
    received: WorkQueue[str] = WorkQueue()
    try:
        with connect(NAME, f"m2c_doctor_{os.getpid()}", {}) as one, _other() as other:
            other.subscribe(topic, lambda message: received.put(message.data))
            one.publisher(topic).publish(_Text("arrived"))
            got = None
            other.after(WAIT_S, lambda: received.put(""))
            other.spin(lambda: not received.empty())
            got = received.get(0)
    except TransportError as error:
        return Finding(State.WRONG, NAME, f"no node can be made: {error}")
    except Empty:
        got = ""
    if got:
        return Finding(State.WORKS, NAME, "a message of one node reaches another")
    text = f"no message of one node reached another within {WAIT_S:g} s"
    return Finding(State.WRONG, NAME, text, "export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")


def _other() -> Connection:
    return connect(NAME, f"m2c_doctor_{os.getpid()}_other", {})
