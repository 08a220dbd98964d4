"""The policy's package: the tree, its leaves, and the program that runs them."""

from __future__ import annotations

import msgspec

from m2c.codegen.names import camel, snake
from m2c.codegen.packaging import Distribution, Packaging, project_files, starter
from m2c.codegen.writer import sealed
from m2c.model.diagnostics import DiagnosticLog, ModelError
from m2c.model.system import System
from m2c.policy.program import read_policy


def policy_package(
    system: System, package: str, packaging: Packaging = Packaging.WHEEL
) -> dict[str, str]:
    """The files of the policy package, without its plugins' modules.

    Raises:
        ModelError: the policy cannot be used.
    """
    assert system.policy is not None
    log = DiagnosticLog()
    policy = read_policy(system.policy, system, log)
    if policy is None:
        raise ModelError(log.diagnostics)
    used = sorted({leaf.plugin for leaf in policy.leaves if leaf.plugin})
    imports = "".join(
        f"{line}\n"
        for line in sorted(
            [
                "from m2c.policy.main import main",
                *(
                    f"from {package}.plugins.{snake(name)}.node import {camel(name)}Node"
                    for name in used
                ),
            ]
        )
    )
    entries = "".join(f'    "{name}": {camel(name)}Node,\n' for name in used)
    plugins = f"PLUGINS = {{\n{entries}}}\n\n" if used else ""
    head = (
        f'"""Runs the policy of ``{system.name}`` as a process."""\n\n'
        "from pathlib import Path\n\n"
        f"{imports}\n{plugins}"
    )
    arguments = f"Path(__file__).parent, {'PLUGINS' if used else '{}'}"
    types = {leaf.tick_type for leaf in policy.leaves} | {leaf.halt_type for leaf in policy.leaves}
    for plugin in system.plugins:
        types |= {interface.type_name for interface in plugin.interfaces}
    distribution = Distribution(
        package,
        f"The policy of {system.name}, generated from its behaviour tree",
        tuple(sorted(types - {""})),
        is_nested=True,
    )
    files = {
        f"{package}/__init__.py": sealed(f'"""The policy of ``{system.name}``."""\n'),
        f"{package}/__main__.py": starter(packaging, head, arguments),
        f"{package}/policy.xml": policy.xml,
        f"{package}/policy.json": msgspec.json.format(msgspec.json.encode(policy)).decode() + "\n",
        **project_files(packaging, distribution),
    }
    if system.plugins:
        files[f"{package}/plugins/__init__.py"] = sealed('"""The behaviour tree\'s plugins."""\n')
    return files
