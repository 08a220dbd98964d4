"""The files of a generated system: a package per node, the policy, and a launch description."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

import msgspec

from m2c.codegen.draft import MODULES, STEPWISE, Draft
from m2c.codegen.event_package import event_package
from m2c.codegen.names import distinct, package_name, snake
from m2c.codegen.nodes import node_program
from m2c.codegen.packaging import Packaging, code_package, launch_package, type_names
from m2c.codegen.policy_package import add_policy_package
from m2c.codegen.program import LaunchProgram
from m2c.codegen.rendering import Templates, our_templates
from m2c.codegen.source import Source, name
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import InterfaceKind, Machine
from m2c.model.naming import ANYWHERE, Naming
from m2c.model.system import System
from m2c.model.walk import with_threads

LAUNCH_FORMAT = 1

_SERVES = (InterfaceKind.SERVER, InterfaceKind.ACTION_SERVER)
_CALLS = (InterfaceKind.CLIENT, InterfaceKind.ACTION_CLIENT)


def system_files(
    system: System,
    packaging: Packaging = Packaging.WHEEL,
    templates: Templates | None = None,
    naming: Naming = ANYWHERE,
) -> dict[str, str]:
    """Every file of the generated ``system``: relative path → content, sealed with its hash.

    Args:
        system: what is generated, without errors.
        packaging: what its packages are installed with.
        templates: what they are made from; ours by default.
        naming: the transports that must take the channels that the policy names.

    Raises:
        ModelError: the policy cannot be used.
        TemplateFault: a template cannot be used.
    """
    draft = Draft(templates or our_templates(), packaging)
    used = {owner.partition("/")[0] for owner in type_names([*system.nodes, *system.plugins])}
    nodes: dict[str, str] = {}
    for machine in system.nodes:
        package = package_name(machine.name, {*used, *nodes})
        nodes[package] = machine.name
        _add_node_package(draft, machine, system.library, package, f"{package}/")
    policy, called = None, frozenset[str]()
    if system.policy is not None:
        policy = distinct(f"{snake(system.name)}_policy", {*used, *nodes})
        called = add_policy_package(draft, system, policy, naming)
    machines = (*system.nodes, *system.plugins)
    for path, text in event_package(machines, system.library, packaging).items():
        draft.put(path, text)
    launch: dict[str, object] = {
        "format": LAUNCH_FORMAT,
        "system": system.name,
        "tick_rate_hz": system.tick_rate_hz,
        "nodes": [
            {"name": node, "package": package, "path": package} for package, node in nodes.items()
        ],
        "policy": {"name": "policy", "package": policy, "path": policy} if policy else None,
        "called": _called(system, called),
        "channels": sorted(system.channels),
    }
    if system.deployment:
        launch["deployment"] = msgspec.to_builtins(system.deployment)
    draft.put("launch.json", json.dumps(launch, indent=2) + "\n")
    if packaging is Packaging.AMENT:
        _add_bringup(draft, system, nodes, policy, used)
    return draft.files()


def _called(system: System, by_policy: Iterable[str]) -> list[str]:
    """The nodes that a tick reaches by calls: of the policy, and of those that it calls, and so on."""
    interfaces = {
        machine.name: [item for owner in with_threads(machine) for item in owner.interfaces]
        for machine in system.nodes
    }
    found: set[str] = set()
    asked = {
        *by_policy,
        *(i.channel for p in system.plugins for i in p.interfaces if i.kind in _CALLS),
    }
    while asked:
        new = {
            name
            for name, own in interfaces.items()
            if any(i.kind in _SERVES and i.channel in asked for i in own)
        } - found
        found |= new
        asked = {i.channel for name in new for i in interfaces[name] if i.kind in _CALLS}
    return [machine.name for machine in system.nodes if machine.name in found]


def _add_bringup(
    draft: Draft, system: System, nodes: Mapping[str, str], policy: str | None, used: Iterable[str]
) -> None:
    """The package that starts a system by ``ros2 launch``."""
    started = [*nodes, *([policy] if policy else [])]
    package = distinct(f"{snake(system.name)}_bringup", {*started, *used})
    file = f"{snake(system.name)}.launch.py"
    description = f"Starts {system.name}, generated from its models"
    facts = launch_package(package, description, started, f"launch/{file}")
    draft.add_around(f"{package}/", facts, system.name)
    launch = LaunchProgram(
        system.name, name(package), Source(file), tuple(nodes.items()), policy, system.tick_rate_hz
    )
    draft.add(f"{package}/launch/{file}", "launch.py.j2", system.name, system=launch)


def _add_node_package(
    draft: Draft, machine: Machine, library: InterfaceLibrary, package: str, folder: str
) -> None:
    node = node_program(machine, library, package)
    draft.add_node(f"{folder}{package}/", node)
    draft.add(f"{folder}{package}/__main__.py", "node_main.py.j2", machine.name, node=node)
    description = f"{machine.name}, generated from its model"
    draft.add_around(
        folder, code_package(package, description, type_names([machine])), machine.name
    )


def node_texts(
    machine: Machine, library: InterfaceLibrary, package: str, is_stepwise: bool = False
) -> dict[str, str]:
    """The modules of one machine's node as their templates make them: to be run, not to be read.

    ``is_stepwise``: in steps, as AS2FM has it (``docs/semantics.md``).
    """
    draft = Draft(our_templates())
    node = node_program(machine, library, package, is_stepwise)
    draft.add_node("", node, STEPWISE if is_stepwise else MODULES)
    return draft.texts()
