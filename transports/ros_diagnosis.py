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
from xml.parsers import expat

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
_BUILTIN_TRANSPORTS = (
    *("NONE", "DEFAULT", "DEFAULTv6", "SHM", "UDPv4", "UDPv6"),
    *("LARGE_DATA", "LARGE_DATAv6"),
)
_VALUES = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT"),
    "ROS_LOCALHOST_ONLY": ("0", "1"),
    "ROS_SECURITY_ENABLE": ("true", "false"),
    "ROS_SECURITY_STRATEGY": ("Enforce", "Permissive"),
    "RMW_FASTRTPS_PUBLICATION_MODE": ("SYNCHRONOUS", "ASYNCHRONOUS", "AUTO"),
    "RMW_FASTRTPS_USE_QOS_FROM_XML": ("0", "1"),
    "SKIP_DEFAULT_XML_FILE": ("0", "1"),
    "FASTDDS_BUILTIN_TRANSPORTS": _BUILTIN_TRANSPORTS,
}
"""What a variable may say; another value is taken for the default without an error, or fails later."""
_DEFAULT_RMW = "rmw_fastrtps_cpp"
_PROFILES, _ENVIRONMENT = "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_ENVIRONMENT_FILE"
_URIS = "CYCLONEDDS_URI", "ZENOH_SESSION_CONFIG_URI", "ZENOH_ROUTER_CONFIG_URI"
_READ_BY = {
    _PROFILES: "rmw_fastrtps",
    _ENVIRONMENT: "rmw_fastrtps",
    "FASTDDS_BUILTIN_TRANSPORTS": "rmw_fastrtps",
    "SKIP_DEFAULT_XML_FILE": "rmw_fastrtps",
    "RMW_FASTRTPS_PUBLICATION_MODE": "rmw_fastrtps",
    "RMW_FASTRTPS_USE_QOS_FROM_XML": "rmw_fastrtps",
    "ROS_DISCOVERY_SERVER": "rmw_fastrtps",
    "ROS_SUPER_CLIENT": "rmw_fastrtps",
    "CYCLONEDDS_URI": "rmw_cyclonedds",
    "ZENOH_SESSION_CONFIG_URI": "rmw_zenoh",
    "ZENOH_ROUTER_CONFIG_URI": "rmw_zenoh",
}
"""How the middleware is called that reads a variable which the others ignore (their documentation)."""
_RENAMED = {"FASTDDS_DEFAULT_PROFILES_FILE": "FASTRTPS_DEFAULT_PROFILES_FILE"}
"""Names of later versions, and what the version in Jazzy reads instead (Fast DDS 2.14)."""
_PREFIXES = ("ROS_", "RMW_", "FASTRTPS_", "FASTDDS_", "CYCLONEDDS_", "SKIP_DEFAULT_XML_FILE")
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
    """What is to be said of the variables of ``environment`` that ROS 2 and its middleware read."""
    rmw = environment.get("RMW_IMPLEMENTATION") or _DEFAULT_RMW
    looked_at = (*_PREFIXES, "ZENOH_") if rmw.startswith("rmw_zenoh") else _PREFIXES
    for name in sorted(name for name in environment if name.startswith(looked_at)):
        value = environment[name]
        reader = _READ_BY.get(name, "")
        is_read = rmw.startswith(reader)
        wrong = _wrong(name, value, environment) if is_read else None
        if wrong is not None:
            yield Finding(State.WRONG, "variable", f"{name}={value}: {wrong[0]}", wrong[1])
        elif not is_read:
            text = f"{name}={value}: {reader}_cpp reads it, and {rmw} is used"
            mend = f"export RMW_IMPLEMENTATION={reader}_cpp, or unset {name}"
            yield Finding(State.NOTE, "variable", text, mend)
        elif name in _RENAMED:
            text = f"{name}={value}: the Fast DDS of ROS 2 {DISTRO.title()} does not read it"
            yield Finding(State.NOTE, "variable", text, f"export {_RENAMED[name]}={value}")
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


def _wrong(name: str, value: str, environment: Mapping[str, str]) -> tuple[str, str] | None:
    """What is wrong with a variable's value, and what mends it."""
    known = _VALUES.get(name)
    if known is not None and value.partition("?")[0] not in known:  # options of Fast DDS follow it
        meant = [one for one in known if one.lower() == value.lower()]
        mend = f"export {name}={meant[0]}" if meant else f"unset {name}"
        return f"it is {', '.join(known[:-1])} or {known[-1]}", mend
    if name in (_PROFILES, _ENVIRONMENT, *_URIS):
        return _unreadable(name, value)
    match name:
        case "ROS_DOMAIN_ID":
            if not re.fullmatch("[0-9]{1,4}", value) or int(value) > MOST_DOMAIN:
                return f"a domain is a number from 0 to {MOST_DOMAIN}", f"export {name}=0"
            return _crowded(int(value))
        case "ROS_AUTOMATIC_DISCOVERY_RANGE" if value == "OFF":
            return "no node finds another", f"export {name}=LOCALHOST"
        case "ROS_DISTRO" if value != DISTRO:
            mend = f"begin a new shell, and . /opt/ros/{DISTRO}/setup.bash"
            return f"this project is for {DISTRO}", mend
        case "ROS_VERSION" if value != "2":
            return "the setup of ROS 1 was sourced", "begin a new shell"
        case "RMW_IMPLEMENTATION" if value and not _has_rmw(value):
            mend = f"pip install ros-{DISTRO}-{value.replace('_', '-')}, or unset {name}"
            return f"the package {value} is not installed", mend
        case "ROS_SECURITY_ENABLE" if value == "true":
            keystore = environment.get("ROS_SECURITY_KEYSTORE", "")
            if not Path(keystore).is_dir() or not keystore:
                text = f"ROS_SECURITY_KEYSTORE={keystore} is no folder: unless ROS_SECURITY_STRATEGY=Enforce"
                mend = "ros2 security create_keystore DIR; export ROS_SECURITY_KEYSTORE=DIR"
                return f"{text}, nodes start without security", mend
    return None


def _unreadable(name: str, value: str) -> tuple[str, str] | None:
    """That a file of a middleware's configuration cannot be read.

    In ``CYCLONEDDS_URI`` files are separated by commas; what begins with a ``<`` is the configuration itself.
    """
    paths = value.partition("<")[0].split(",") if name in _URIS else [value]
    for path in filter(None, (path.strip().removeprefix("file://") for path in paths)):
        try:
            text = Path(path).read_bytes()
            if name == _PROFILES:
                expat.ParserCreate().Parse(text, True)
            elif name == _ENVIRONMENT:
                msgspec.json.decode(text)
        except OSError as error:
            return f"{path}: {error.strerror}", f"unset {name}, or name a file that is there"
        except (expat.ExpatError, msgspec.DecodeError) as error:
            return f"Fast DDS goes on without {path}: {error}", f"unset {name}, or mend the file"
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
