"""The ``m2c interfaces python`` command."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from m2c.inputs import ExistingPath


@click.command()
@click.argument(
    "directories", nargs=-1, type=ExistingPath(path_type=Path, exists=True, file_okay=False)
)
@click.option(
    "--type",
    "types",
    multiple=True,
    metavar="TYPE",
    help="A standard type (sensor_msgs/LaserScan), or all of a package (std_srvs) (repeatable).",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("messages.py"),
    show_default=True,
    help="The module that is written.",
)
def python(directories: tuple[Path, ...], types: tuple[str, ...], output: Path) -> None:
    """Write the message classes of the interface packages in DIRECTORIES as one typed Python module.

    Nodes that are written by hand import it (docs/hand-written-nodes.md). It has no part of ROS 2, and
    serves every transport. bt_interfaces, the types of a behaviour tree's ticks, is always in it.

    Exit code 0, or 2 if a definition has a fault, or a type is not known.

    \b
    Example:
      m2c interfaces python examples/lab_tour/interfaces --type sensor_msgs/LaserScan
    """
    from m2c.codegen.message_module import UnknownTypeError, message_module, named_types
    from m2c.diagnostics import DiagnosticLog
    from m2c.model.interfaces import InterfaceLibrary
    from m2c.output_file import write_whole
    from m2c.terminal import fail, say, show

    log = DiagnosticLog()
    library = InterfaceLibrary.load(directories, log)
    try:
        found = named_types(library, types)
        text = message_module(library, found, output.name)
    except UnknownTypeError as error:
        fail(str(error))
    except (
        KeyError
    ) as error:  # of a type that a definition contains; its file and line are in the log
        say(*map(str, log.diagnostics))
        fail(str(error.args[0]))
    say(*map(str, log.diagnostics))
    if log.has_errors:
        sys.exit(2)
    try:
        write_whole(output, text)
    except OSError as error:
        fail(f"{output}: {error.strerror}")
    show(f"{output}: {len(found)} types")
