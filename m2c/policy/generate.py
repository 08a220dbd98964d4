"""The policy's package: the tree, its leaves, and the program that runs them."""

from __future__ import annotations

import msgspec

from m2c.codegen.names import camel, snake
from m2c.codegen.writer import sealed
from m2c.model.diagnostics import DiagnosticLog, ModelError
from m2c.model.system import System
from m2c.policy.leaves import Leaf, bind_leaves
from m2c.policy.main import LeafEntry, LeafService, PolicyTable
from m2c.policy.normalise import normalised
from m2c.policy.reader import read_policy
from m2c.policy.tree import LeafKind

_STANDARD_PLUGINS = frozenset({"ROS2Condition", "ROS2Action"})
"""Plugins that only forward a tick to a skill: the runner calls the skill itself, which saves two
thread switches a tick and cannot be left waiting by a call that failed."""


def policy_table(system: System, log: DiagnosticLog) -> PolicyTable | None:
    """The policy of ``system``, ready to run; None after an error was reported to ``log``."""
    assert system.policy is not None
    before = len(log.diagnostics)
    policy = read_policy(system.policy, log, [plugin.name for plugin in system.plugins])
    if policy is None:
        return None
    leaves = bind_leaves(policy, system, log)
    if any(found.severity == "error" for found in log.diagnostics[before:]):
        return None
    unique = {leaf.name: leaf for leaf in leaves.values()}
    entries = tuple(_entry(leaf, system) for leaf in unique.values())
    xml = normalised(policy, leaves)
    return PolicyTable(system.policy.stem, xml, entries, system.tick_rate_hz)


def policy_package(system: System, package: str) -> dict[str, str]:
    """The files of the policy package, without its plugins' modules.

    Raises:
        ModelError: the policy cannot be used.
    """
    log = DiagnosticLog()
    table = policy_table(system, log)
    if table is None:
        raise ModelError(log.diagnostics)
    used = sorted({leaf.plugin for leaf in table.leaves if leaf.plugin})
    imports = "".join(
        f"from {package}.plugins.{snake(name)}.node import {camel(name)}Node\n" for name in used
    )
    entries = "".join(f'    "{name}": {camel(name)}Node,\n' for name in used)
    plugins = f"PLUGINS = {{\n{entries}}}\n" if used else "PLUGINS = {}\n"
    main = (
        f'"""Runs the policy of ``{system.name}`` as a process."""\n\n'
        "from pathlib import Path\n\n"
        f"{imports}from m2c.policy.main import main\n\n"
        f'{plugins}\nif __name__ == "__main__":\n    main(Path(__file__).parent, PLUGINS)\n'
    )
    project = (
        '[build-system]\nrequires = ["setuptools>=77"]\n'
        'build-backend = "setuptools.build_meta"\n\n'
        f'[project]\nname = "{package.replace("_", "-")}"\nversion = "0.1.0"\n'
        f'description = "The policy of {system.name}, generated from its behaviour tree"\n'
        'requires-python = ">=3.11"\ndependencies = ["m2c-moon"]\n\n'
        f'[tool.setuptools.packages.find]\ninclude = ["{package}*"]\n\n'
        '[tool.setuptools.package-data]\n"*" = ["*.xml", "*.json"]\n'
    )
    files = {
        f"{package}/__init__.py": sealed(f'"""The policy of ``{system.name}``."""\n'),
        f"{package}/__main__.py": sealed(main),
        f"{package}/policy.xml": table.xml,
        f"{package}/policy.json": msgspec.json.format(msgspec.json.encode(table)).decode() + "\n",
        "pyproject.toml": sealed(project),
    }
    if system.plugins:
        files[f"{package}/plugins/__init__.py"] = sealed('"""The behaviour tree\'s plugins."""\n')
    return files


def _entry(leaf: Leaf, system: System) -> LeafEntry:
    by_plugin = bool(leaf.plugin) and not (leaf.tick and leaf.plugin in _STANDARD_PLUGINS)
    return LeafEntry(
        leaf.name,
        leaf.kind is LeafKind.CONDITION,
        None if by_plugin else _service(leaf.tick, leaf.tick_type, system),
        _service(leaf.halt, leaf.halt_type, system),
        leaf.plugin if by_plugin else "",
        dict(leaf.ports),
    )


def _service(channel: str, type_name: str, system: System) -> LeafService | None:
    if not channel or not type_name:
        return None
    service = system.library.service(type_name)
    return LeafService(channel, type_name, service.request, service.response)
