"""Compiles the monitors and the simulated world with mypyc where ``MOON_COMPILED=1`` asks for it.

All else is in ``pyproject.toml``.

It needs a C compiler, mypy and the project's dependencies: ``make compiled`` in a clone, or

    MOON_COMPILED=1 pip wheel --no-build-isolation --no-deps .

Without it the same modules run as they are written; see docs/decisions/0016-monitors-may-be-compiled.md.
"""

import ast
import os
from pathlib import Path

from setuptools import Extension, setup

MODULES = {
    "moon": "run",
    "moon/feed": "clock held host_clocks intake lives nodes numbers progress reachability reception senders",
    "moon/monitor": "machines models nodes properties turns",
    "moon/offline": "engine",
    "moon/oracle": "*",
    "moon/policy": "calls follow judge oracle remembered reported",
    "moon/properties": "monitor_group three_valued monitor ordering",
    "moon/recording": "cdr conversion format mcap_file numbers own_entries reader",
    "moon/sources": "played",
    "transports": "cdr losses sequences",
    "transports/simulated": "network routes services topics waiting",
}
"""What runs for every observation, and for every message of a simulated world, by package."""

GROUPS = ("moon", "transports")
"""Each is one library of its own: transports load nothing of moon's."""


def is_fit(module: Path) -> bool:
    """Whether mypyc leaves nothing out: of ``class C(Struct, frozen=True)`` it would, the keyword."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    return not any(node.keywords for node in classes)


def modules() -> list[str]:
    """The files that are compiled."""
    found: list[str] = []
    for package, names in MODULES.items():
        for name in names.split():
            files = sorted(Path(package).glob(f"{name}.py"))
            if not files:
                raise FileNotFoundError(f"{package}/{name}.py")
            found += [str(file) for file in files if file.stem != "__init__" and is_fit(file)]
    return found


def extensions() -> list[Extension]:
    """The compiled modules, if they are asked for."""
    if os.environ.get("MOON_COMPILED") != "1":
        return []
    from mypyc.build import mypycify

    made: list[Extension] = []
    for group in GROUPS:
        files = [name for name in modules() if Path(name).parts[0] == group]
        made += mypycify(
            ["--config-file", "mypyc.ini", *files],
            opt_level="2",
            debug_level="0",
            group_name=f"{group}.compiled",
        )
    return made


setup(ext_modules=extensions())
