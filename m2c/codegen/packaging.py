"""How generated code is packed: as a Python distribution, or as a package of a ROS 2 workspace.

The code is the same; what differs are the files around it and how ``__main__.py`` is started.
"""

from __future__ import annotations

from enum import StrEnum

import msgspec

from m2c.codegen.ament import ament_files
from m2c.codegen.writer import sealed


class Packaging(StrEnum):
    """What a generated package is installed with."""

    WHEEL = "wheel"
    """pip; nodes run on Zenoh unless told otherwise."""
    AMENT = "ament"
    """colcon (``ament_python``); nodes run on ROS 2 unless told otherwise."""


class Distribution(msgspec.Struct, frozen=True):
    """One installable package.

    Attributes:
        package: its name, and that of the Python package in it.
        description: one line.
        types: the ROS types that its code uses, e.g. ``std_msgs/msg/Int32``.
        is_nested: whether it has packages and data files within.
    """

    package: str
    description: str
    types: tuple[str, ...] = ()
    is_nested: bool = False


MARKS = {Packaging.WHEEL: "pyproject.toml", Packaging.AMENT: "package.xml"}
"""The file that each packaging has and the other does not. Both in one folder: setuptools would
take a part of what it installs from the one, and a part from the other."""


def packaging_of(transport: str) -> Packaging:
    """How nodes for ``transport`` are packed."""
    return Packaging.AMENT if transport == "ros2" else Packaging.WHEEL


def project_files(packaging: Packaging, distribution: Distribution) -> dict[str, str]:
    """The files that make ``distribution`` installable."""
    package, description = distribution.package, distribution.description
    if packaging is Packaging.AMENT:
        return ament_files(package, description, distribution.types, distribution.is_nested)
    found = (
        f'[tool.setuptools.packages.find]\ninclude = ["{package}*"]\n\n'
        '[tool.setuptools.package-data]\n"*" = ["*.xml", "*.json"]\n'
        if distribution.is_nested
        else f'[tool.setuptools]\npackages = ["{package}"]\n'
    )
    return {
        "pyproject.toml": sealed(
            '[build-system]\nrequires = ["setuptools>=77"]\n'
            'build-backend = "setuptools.build_meta"\n\n'
            f'[project]\nname = "{package.replace("_", "-")}"\nversion = "0.1.0"\n'
            f'description = "{description}"\n'
            'requires-python = ">=3.11"\ndependencies = ["m2c-moon"]\n\n'
            f"{found}"
        )
    }


def starter(packaging: Packaging, head: str, arguments: str) -> str:
    """``__main__.py``: ``head`` (docstring, imports, constants), then ``main(arguments)``."""
    if packaging is Packaging.WHEEL:
        return sealed(f'{head}if __name__ == "__main__":\n    main({arguments})\n')
    return sealed(
        f'{head.rstrip()}\n\n\ndef run() -> None:\n    """Runs it on ROS 2, as `ros2 run` does."""\n'
        f'    main({arguments}, transport="ros2")\n\n\n'
        'if __name__ == "__main__":\n    run()\n'
    )
