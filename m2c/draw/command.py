"""The ``m2c draw`` command."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.changes import Changes
from m2c.inputs import change_options, interface_folders

if TYPE_CHECKING:
    from m2c.draw.reading import Drawable

SUFFIXES = (".svg", ".mmd", ".dot")


@click.command()
@click.argument("path", metavar="MODEL|SYSTEM|POLICY", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Where the picture goes; it ends in .svg, .mmd (Mermaid) or .dot (Graphviz).",
)
@click.option("--node", metavar="NODE", help="Draw this machine of a system, not the wiring.")
@interface_folders
@change_options
def draw(
    path: Path, output: Path, node: str | None, interfaces: tuple[Path, ...], changes: Changes
) -> None:
    """Draw a state machine, a system's wiring or a policy.

    A model (.scxml, .ascxml) gives its states and transitions; a system file or a folder of models
    the nodes and the channels between them; a policy its tree.

    Exit code 0, or 2 for models in which `m2c check` finds errors.

    \b
    Example:
      m2c draw examples/lab_tour/skills/GoToPoiSkill.scxml -o go_to_poi.svg
    """
    from m2c.check.report import print_findings
    from m2c.draw.bounds import TooLargeError
    from m2c.draw.reading import read
    from m2c.model import DiagnosticLog
    from m2c.output_file import write_whole
    from m2c.terminal import fail

    if output.suffix not in SUFFIXES:
        raise click.UsageError(f"{output} names no format; it ends in {', '.join(SUFFIXES)}")
    log = DiagnosticLog()
    drawable = read(path, interfaces, log, node, changes)
    if drawable is None:
        print_findings(log.diagnostics)
        sys.exit(2)
    try:
        content = _drawn(drawable, output.suffix)
    except TooLargeError as error:
        fail(f"{path}: {error}")
    try:
        write_whole(output, content)
    except OSError as error:
        fail(f"{output} cannot be written: {error.strerror}")


def _drawn(drawable: Drawable, suffix: str) -> str:
    from m2c.draw import dot, mermaid
    from m2c.draw.machine import draw_machine
    from m2c.draw.policy import draw_policy, tree_of
    from m2c.draw.svg import document
    from m2c.draw.wiring import Wiring, draw_wiring
    from m2c.model.machine import Machine

    name, content = drawable.name, drawable.content
    if isinstance(content, Machine):
        match suffix:
            case ".svg":
                return document(draw_machine(content), name)
            case ".mmd":
                return mermaid.machine_as_mermaid(content)
            case _:
                return dot.machine_as_dot(content)
    if isinstance(content, Wiring):
        match suffix:
            case ".svg":
                return document(draw_wiring(content), name)
            case ".mmd":
                return mermaid.wiring_as_mermaid(content)
            case _:
                return dot.wiring_as_dot(content)
    tree = tree_of(content)
    match suffix:
        case ".svg":
            return document(draw_policy(tree), name)
        case ".mmd":
            return mermaid.policy_as_mermaid(name, tree)
        case _:
            return dot.policy_as_dot(name, tree)
