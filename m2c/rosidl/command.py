"""The ``m2c interfaces`` command."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click

from m2c.lazy_group import LazyGroup

_COMMANDS = {
    "build": ("m2c.rosidl.command:build", "Build interface packages with colcon, for ROS 2."),
    "python": (
        "m2c.codegen.message_command:python",
        "Write message classes for nodes that are written by hand.",
    ),
}


@click.group(cls=LazyGroup, lazy_commands=_COMMANDS)
def interfaces() -> None:
    """Work with ROS interface packages (.msg, .srv, .action).

    \b
    Example:
      m2c interfaces build examples/lab_tour/interfaces
    """


@click.command()
@click.argument("directories", nargs=-1, type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("build/interfaces"),
    show_default=True,
    help="Where colcon's build, install and log folders go.",
)
def build(directories: tuple[Path, ...], output: Path) -> None:
    """Build the interface packages in DIRECTORIES with colcon, for ROS 2, and bt_interfaces.

    A package is a folder with definitions in msg, srv or action; package.xml and CMakeLists.txt are
    made where they are missing. Without DIRECTORIES only bt_interfaces is built, the types of a
    behaviour tree's ticks. Needs the ROS 2 wheels (pip install 'm2c-moon[ros2]'), cmake and a C++
    compiler. A build of unchanged packages is taken from the output folder.

    Exit code 0, or 1 if a package was not built.

    \b
    Example:
      m2c interfaces build examples/lab_tour/interfaces
    """
    from m2c.rosidl.build import SETUP_SCRIPT, InterfaceBuildError, build_packages
    from m2c.terminal import fail, say, show

    try:
        built = build_packages(
            [Path(os.path.realpath(path)) for path in directories], output.resolve(), say
        )
    except InterfaceBuildError as error:
        fail(*error.lines)
    width = max((len(name) for name in built.packages), default=0)
    for name, types in zip(built.packages, built.types, strict=True):
        show(f"  {name:{width}}  {_counted(types)}")
    for item in built.unbuilt:
        say(f"error: {item.name} is not built: {item.reason}", *item.written)
    how = "unchanged, taken from" if built.cached else "built into"
    packages = "1 package" if len(built.packages) == 1 else f"{len(built.packages)} packages"
    show(f"{packages} {how} {output}" + ("" if built.cached else ", and imported"))
    if built.packages:
        show(f"to use them in a shell: . {output / SETUP_SCRIPT}")
    sys.exit(1 if built.unbuilt else 0)


def _counted(types: tuple[str, ...]) -> str:
    """``2 messages, 1 service``."""
    counts = []
    for kind, word in (("msg", "message"), ("srv", "service"), ("action", "action")):
        count = sum(name.startswith(f"{kind}/") for name in types)
        if count:
            counts.append(f"{count} {word}{'' if count == 1 else 's'}")
    return ", ".join(counts) or "no types of its own"
