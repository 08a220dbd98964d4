"""The files of a generated system: a package per node, the policy, and a launch description."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable

from m2c.codegen.ament import launch_files
from m2c.codegen.interfaces import class_names, interface_module, needed_structures
from m2c.codegen.layout import INDENT, WIDTH, fit
from m2c.codegen.machine import MachineWriter
from m2c.codegen.names import camel, distinct, snake
from m2c.codegen.node import NodeWriter
from m2c.codegen.packaging import Distribution, Packaging, project_files, starter
from m2c.codegen.ports import PortNames
from m2c.codegen.writer import sealed
from m2c.model.datatypes import Array, DataType, Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Interface, InterfaceKind, Machine
from m2c.model.system import System

LAUNCH_FORMAT = 1

_MACHINE_RUNTIME = ("EndlessLoopError", "ExecutionError", "matches", "seconds")


def system_files(system: System, packaging: Packaging = Packaging.WHEEL) -> dict[str, str]:
    """Every file of the generated ``system``: relative path → content, sealed with its hash."""
    files: dict[str, str] = {}
    nodes = []
    packages: list[str] = []
    for machine in system.nodes:
        package = distinct(snake(machine.name), packages)
        packages.append(package)
        nodes.append({"name": machine.name, "package": package, "path": package})
        for path, content in node_package(machine, system.library, package, packaging).items():
            files[f"{package}/{path}"] = content
    policy = None
    if system.policy is not None:
        from m2c.policy.generate import policy_package

        name = distinct(f"{snake(system.name)}_policy", packages)
        policy = {"name": "policy", "package": name, "path": name}
        for path, content in policy_package(system, name, packaging).items():
            files[f"{name}/{path}"] = content
        for plugin in system.plugins:
            inner = f"{name}.plugins.{snake(plugin.name)}"
            for path, content in node_modules(plugin, system.library, inner).items():
                files[f"{name}/{name}/plugins/{snake(plugin.name)}/{path}"] = content
    launch = {
        "format": LAUNCH_FORMAT,
        "system": system.name,
        "tick_rate_hz": system.tick_rate_hz,
        "nodes": nodes,
        "policy": policy,
    }
    files["launch.json"] = json.dumps(launch, indent=2) + "\n"
    if packaging is Packaging.AMENT:
        taken = [*packages, *([policy["package"]] if policy else [])]
        name = distinct(f"{snake(system.name)}_bringup", taken)
        bringup = launch_files(
            name,
            system.name,
            {node["package"]: node["name"] for node in nodes},
            policy["package"] if policy else None,
            system.tick_rate_hz,
            snake(system.name),
        )
        files |= {f"{name}/{path}": content for path, content in bringup.items()}
    return files


def node_package(
    machine: Machine,
    library: InterfaceLibrary,
    package: str,
    packaging: Packaging = Packaging.WHEEL,
) -> dict[str, str]:
    """The files of one installable node package."""
    files = {
        f"{package}/{path}": content
        for path, content in node_modules(machine, library, package).items()
    }
    node = f"{_class_name(machine)}Node"
    head = (
        f'"""Runs ``{machine.name}`` as a process."""\n\n'
        f"from m2c.runtime.main import main\n"
        f"from {package}.node import {node}\n\n"
    )
    files[f"{package}/__main__.py"] = starter(packaging, head, f'{node}, "{machine.name}"')
    description = f"{machine.name}, generated from its model"
    distribution = Distribution(package, description, type_names([machine]))
    return files | project_files(packaging, distribution)


def type_names(machines: Iterable[Machine]) -> tuple[str, ...]:
    """The ROS types of the channels of ``machines``."""
    names = {interface.type_name for machine in machines for interface in machine.interfaces}
    return tuple(sorted(names - {""}))


def node_modules(machine: Machine, library: InterfaceLibrary, package: str) -> dict[str, str]:
    """``__init__``, ``interfaces``, ``machine`` and ``node`` of one machine."""
    names = PortNames(machine, library)
    structures = needed_structures(_structures(machine, library))
    class_of = class_names(structures)
    class_name = _class_name(machine)
    writers = [MachineWriter(machine, library, names, class_of, class_name)]
    for index, thread in enumerate(machine.threads):
        suffix = "Thread" if index == 0 else f"Thread{index + 1}"
        writers.append(
            MachineWriter(
                thread.machine, library, names, class_of, class_name + suffix, is_thread=True
            )
        )
    bodies = [writer.lines() for writer in writers]
    node = NodeWriter(machine, library, names, class_of, class_name)
    node.extra_outputs = _extra_outputs("\n".join(line for body in bodies for line in body))
    node.ports_users = frozenset(
        writer.class_name
        for writer, body in zip(writers, bodies, strict=True)
        if any("ports: Mapping" in line for line in body)
    )
    return {
        "__init__.py": sealed(f'"""``{machine.name}``, generated from its model."""\n'),
        "interfaces.py": _interfaces_text(machine, structures, class_of),
        "machine.py": _machine_text(machine, package, writers, bodies, node, class_of),
        "node.py": _node_text(machine, package, writers, node, class_of),
    }


def _class_name(machine: Machine) -> str:
    return camel(machine.name)


def _extra_outputs(text: str) -> tuple[str, ...]:
    methods = ("start_delay", "stop_delay", "send_self", "cancel_send", "log")
    return tuple(method for method in methods if f"self._outputs.{method}(" in text)


def _interfaces_text(
    machine: Machine, structures: list[Structure], class_of: dict[str, str]
) -> str:
    lines, integers = interface_module(structures, class_of)
    text = "\n".join(lines)
    head = [f'"""The messages of ``{machine.name}``, from its interface definitions."""']
    if structures:
        typing = [name for name in ("Annotated", "ClassVar") if name in text]
        head += ["", f"from typing import {', '.join(typing)}"]
        if "msgspec." in text:
            head += ["", "import msgspec"]
        imported = sorted([*integers, "TypedMessage"])
        head += ["", f"from m2c.runtime.messages import {', '.join(imported)}"]
    return sealed("\n".join([*head, *fit(lines)]) + "\n")


def _machine_text(
    machine: Machine,
    package: str,
    writers: list[MachineWriter],
    bodies: list[list[str]],
    node: NodeWriter,
    class_of: dict[str, str],
) -> str:
    protocol = node.output_protocol()
    body = "\n".join(fit([line for lines in [protocol, *bodies] for line in ["", "", *lines]]))
    head = [
        f'"""The state machine of ``{machine.name}``.',
        "",
        "Compiled from its model: one method per event, each a run to completion (W3C SCXML).",
        "It knows no middleware; ``node.py`` binds it to channels.",
        '"""',
        "",
        "from __future__ import annotations",
        "",
    ]
    standard = []
    if "copy.deepcopy(" in body:
        standard.append("import copy")
    if "random.random" in body:
        standard.append("import random")
    if "deque(" in body:
        standard.append("from collections import deque")
    abstract = [name for name in ("Callable", "Mapping") if f"{name}[" in body]
    if abstract:
        standard.append(f"from collections.abc import {', '.join(abstract)}")
    standard.append("from enum import Enum")
    typing = [
        name
        for name in ("Any", "Final", "Protocol")
        if (name in ("Protocol",))
        or (name == "Final" and ": Final =" in body)
        or (name == "Any" and _word(body, "Any"))
    ]
    standard.append(f"from typing import {', '.join(typing)}")
    head += standard
    own = []
    if "ecmascript." in body:
        own.append("from m2c.runtime import ecmascript")
    runtime = [name for name in _MACHINE_RUNTIME if _word(body, name)]
    if runtime:
        own.append(f"from m2c.runtime.machine import {', '.join(runtime)}")
    third = _import_from(
        f"{package}.interfaces", [name for name in class_of.values() if _word(body, name)]
    )
    generated_first = package.partition(".")[0] < "m2c"
    own = [*third, *own] if generated_first else [*own, *third]
    if own:
        head += ["", *own]
    return sealed("\n".join(head) + "\n" + body + "\n")


def _node_text(
    machine: Machine,
    package: str,
    writers: list[MachineWriter],
    node: NodeWriter,
    class_of: dict[str, str],
) -> str:
    lines = node.lines()
    body = "\n".join(fit(lines))
    head = [
        f'"""Binds ``{machine.name}`` to its channels, on any transport."""',
        "",
        "from __future__ import annotations",
        "",
    ]
    if _word(body, "Mapping"):
        head.append("from collections.abc import Mapping")
        head.append("from types import MappingProxyType")
    if _word(body, "Any"):
        head.append("from typing import Any")
    if head[-1]:
        head.append("")
    runtime = [
        name
        for name in ("DEFAULT_SETTINGS", "Binding", "GoalHandlers", "NodeSettings")
        if _word(body, name)
    ]
    transport = [
        name
        for name in ("Action", "Reliability", "Service", "Topic", "Transport")
        if _word(body, name)
    ]
    own = [
        (f"{package}.interfaces", [name for name in class_of.values() if _word(body, name)]),
        (f"{package}.machine", [writer.class_name for writer in writers]),
        ("m2c.runtime.binding", runtime),
        ("m2c.runtime.tree_side", ["TreeSide"] if _word(body, "TreeSide") else []),
        ("transports.interface", transport),
    ]
    for module, names in sorted(own):
        head += _import_from(module, names)
    return sealed("\n".join(head) + "\n\n" + _after_imports(body) + "\n")


def _after_imports(body: str) -> str:
    """A constant follows the imports after one blank line, a class after two."""
    text = body.lstrip("\n")
    return f"\n{text}" if text.startswith("class ") else text


def _import_from(module: str, names: list[str]) -> list[str]:
    if not names:
        return []
    ordered = sorted(names, key=lambda name: (not name.isupper(), name.islower(), name))
    flat = f"from {module} import {', '.join(ordered)}"
    if len(flat) <= WIDTH:
        return [flat]
    return [f"from {module} import (", *(f"{INDENT}{name}," for name in ordered), ")"]


def _word(text: str, name: str) -> bool:
    return re.search(rf"(?<![\w\"]){re.escape(name)}(?!\w)", text) is not None


def _structures(machine: Machine, library: InterfaceLibrary) -> list[Structure]:
    found: list[Structure] = []
    for interface in machine.interfaces:
        found += _interface_structures(interface, library)
    for owner in [machine, *(thread.machine for thread in machine.threads)]:
        for data in owner.data:
            found += _contained(data.type)
    return found


def _contained(kind: DataType) -> list[Structure]:
    if isinstance(kind, Array):
        return _contained(kind.element)
    return [kind] if isinstance(kind, Structure) and kind.name else []


def _interface_structures(interface: Interface, library: InterfaceLibrary) -> list[Structure]:
    match interface.kind:
        case InterfaceKind.PUBLISHER | InterfaceKind.SUBSCRIBER:
            return [library.message(interface.type_name)]
        case InterfaceKind.SERVER | InterfaceKind.CLIENT:
            service = library.service(interface.type_name)
            return [service.request, service.response]
        case InterfaceKind.ACTION_SERVER | InterfaceKind.ACTION_CLIENT:
            action = library.action(interface.type_name)
            return [action.goal, action.result, action.feedback]
        case InterfaceKind.TIMER:
            return []
