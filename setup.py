"""Compiles the monitors with mypyc where ``MOON_COMPILED=1`` asks for it; all else is in ``pyproject.toml``.

It needs a C compiler, mypy and the project's dependencies: ``make compiled`` in a clone, or

    MOON_COMPILED=1 pip wheel --no-build-isolation --no-deps .

Without it the same modules run as they are written; see docs/decisions/0016-monitors-may-be-compiled.md.
"""

import os
from pathlib import Path

from setuptools import Extension, setup

PACKAGES = ("moon/oracle",)
"""What runs for every observation."""


def extensions() -> list[Extension]:
    """The compiled modules, if they are asked for."""
    if os.environ.get("MOON_COMPILED") != "1":
        return []
    from mypyc.build import mypycify

    modules = [str(path) for package in PACKAGES for path in sorted(Path(package).glob("[!_]*.py"))]
    options = ["--config-file", "mypyc.ini"]
    made: list[Extension] = mypycify(
        [*options, *modules], opt_level="2", debug_level="0", group_name="moon.compiled"
    )
    return made


setup(ext_modules=extensions())
