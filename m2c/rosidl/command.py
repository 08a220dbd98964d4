"""The ``m2c interfaces`` command."""

from __future__ import annotations

import os
from pathlib import Path

import click


@click.group()
def interfaces() -> None:
    """Work with ROS interface packages (.msg, .srv, .action).

    Example: m2c interfaces build examples/lab_tour/interfaces
    """


@interfaces.command()
@click.argument(
    "directories", nargs=-1, required=True, type=click.Path(path_type=Path, file_okay=False)
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("build/interfaces"),
    show_default=True,
    help="Where colcon's build, install and log folders go.",
)
def build(directories: tuple[Path, ...], output: Path) -> None:
    """Build the interface packages in DIRECTORIES with colcon, for ROS 2.

    Needs the ROS 2 wheels (pip install 'm2c-moon[ros2]'), cmake and a C++ compiler. A build of
    unchanged packages is taken from the output folder.

    Example: m2c interfaces build examples/lab_tour/interfaces
    """
    from m2c.rosidl.build import SETUP_SCRIPT, InterfaceBuildError, build_interfaces
    from m2c.terminal import fail, show

    try:
        built = build_interfaces(
            [Path(os.path.realpath(path)) for path in directories], output.resolve()
        )
    except InterfaceBuildError as error:
        fail(*error.lines)
    how = "unchanged, taken from" if built.cached else "built into"
    show(f"{len(built.packages)} packages {how} {output}: {', '.join(built.packages)}")
    show(f"to use them in a shell: . {output / SETUP_SCRIPT}")
