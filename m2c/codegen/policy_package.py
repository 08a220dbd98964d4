"""The policy's package: the tree, its leaves, and the program that runs them."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from m2c.codegen.draft import Draft
from m2c.codegen.names import distinct, machine_class, snake
from m2c.codegen.nodes import node_program
from m2c.codegen.packaging import code_package, type_names
from m2c.codegen.program import PluginClass, PolicyProgram
from m2c.codegen.source import name
from m2c.diagnostics import DiagnosticLog, ModelError
from m2c.model.machine import Machine
from m2c.model.naming import ANYWHERE, Naming
from m2c.model.system import System
from m2c.policy.program import read_policy


def add_policy_package(
    draft: Draft, system: System, package: str, naming: Naming = ANYWHERE
) -> frozenset[str]:
    """Add the package of the policy of ``system``, its plugins' modules included.

    Returns:
        The services that its leaves call.

    Raises:
        ModelError: the policy cannot be used.
    """
    assert system.policy is not None
    log = DiagnosticLog()
    policy = read_policy(system.policy, system, log, naming)
    if policy is None:
        raise ModelError(log.diagnostics)
    modules = plugin_modules(system.plugins)
    folder = f"{package}/{package}/"
    for plugin in system.plugins:
        module = modules[plugin.name]
        facts = node_program(plugin, system.library, f"{package}.plugins.{module}")
        draft.add_node(f"{folder}plugins/{module}/", facts)
    used: dict[str, PluginClass] = {}
    for plugin_name in sorted({leaf.plugin for leaf in policy.leaves if leaf.plugin}):
        class_name = f"{machine_class(plugin_name)}Node"
        alias = distinct(class_name, [str(other.alias) for other in used.values()])
        module = f"{package}.plugins.{modules[plugin_name]}.node"
        used[plugin_name] = PluginClass(plugin_name, name(module), name(class_name), name(alias))
    facts_of_policy = PolicyProgram(system.name, name(package), tuple(used.values()))
    templates = {"__init__.py": "policy_init.py.j2", "__main__.py": "policy_main.py.j2"}
    if system.plugins:
        templates["plugins/__init__.py"] = "policy_plugins.py.j2"
    for path, template in templates.items():
        draft.add(f"{folder}{path}", template, system.name, policy=facts_of_policy)
    draft.put(f"{folder}policy.xml", policy.xml)
    draft.put(
        f"{folder}policy.json", msgspec.json.format(msgspec.json.encode(policy)).decode() + "\n"
    )
    types = {leaf.tick_type for leaf in policy.leaves} | {leaf.halt_type for leaf in policy.leaves}
    types |= set(type_names(system.plugins))
    description = f"The policy of {system.name}, generated from its behaviour tree"
    around = code_package(package, description, types - {""}, is_nested=True)
    draft.add_around(f"{package}/", around, system.name)
    return frozenset(
        channel for leaf in policy.leaves for channel in (leaf.tick, leaf.halt) if channel
    )


def plugin_modules(plugins: Iterable[Machine]) -> dict[str, str]:
    """The module (a part of the policy's package) of each plugin, by the plugin's name."""
    found: dict[str, str] = {}
    for plugin in plugins:
        found[plugin.name] = distinct(snake(plugin.name), found.values())
    return found
