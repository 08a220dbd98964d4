"""The policy's package: the tree, its leaves, and the program that runs them."""

from __future__ import annotations

import msgspec

from m2c.codegen.names import camel, snake
from m2c.codegen.writer import sealed
from m2c.model.diagnostics import DiagnosticLog, ModelError
from m2c.model.system import System
from m2c.policy.program import read_policy


def policy_package(system: System, package: str) -> dict[str, str]:
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
    main = (
        f'"""Runs the policy of ``{system.name}`` as a process."""\n\n'
        "from pathlib import Path\n\n"
        f"{imports}\n"
        f'{plugins}if __name__ == "__main__":\n'
        f"    main(Path(__file__).parent, {'PLUGINS' if used else '{}'})\n"
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
        f"{package}/policy.xml": policy.xml,
        f"{package}/policy.json": msgspec.json.format(msgspec.json.encode(policy)).decode() + "\n",
        "pyproject.toml": sealed(project),
    }
    if system.plugins:
        files[f"{package}/plugins/__init__.py"] = sealed('"""The behaviour tree\'s plugins."""\n')
    return files
