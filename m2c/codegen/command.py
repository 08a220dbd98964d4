"""The ``m2c generate`` command."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import click

from m2c.inputs import ExistingPath, Inputs, input_options
from m2c.terminal import fail, say, show


@click.command()
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the packages; made if it does not exist.",
)
@click.option("--transport", default="zenoh", show_default=True, help="Middleware of the nodes.")
@click.option(
    "--templates",
    type=ExistingPath(path_type=Path, exists=True, file_okay=False),
    help="Folder of your own Jinja2 templates: they override or extend ours of the same name.",
)
@click.option("--force", is_flag=True, help="Overwrite files that were edited by hand.")
@input_options
def generate(
    inputs: Inputs,
    output: Path,
    transport: str,
    templates: Path | None,
    force: bool,
) -> None:
    """Generate running Python nodes from models.

    PATHS are models (.scxml, .ascxml), folders of them, or one system file. Every node becomes an
    installable package (for ros2 one of a ROS 2 workspace); a system also gets its policy and a
    launch description. The output is the same, byte for byte, each time; a file that somebody has
    edited is not overwritten.

    With --templates DIR, a template of yours takes the place of ours with its name, or extends it:
    DIR/header.j2 with one line of a comment is a header in every file (docs/templates.md).

    Example: m2c generate examples/lab_tour/system.xml -o generated
    """
    from m2c.check.reading import read_and_check
    from m2c.check.report import print_findings
    from m2c.codegen.package import system_files
    from m2c.codegen.packaging import MARKS, packaging_of
    from m2c.codegen.rendering import TemplateFault, Templates
    from m2c.codegen.writer import EditedFilesError, counted, write_files
    from m2c.model import DiagnosticLog, ModelError
    from m2c.naming import naming_for

    naming = naming_for(transport)
    log = DiagnosticLog()
    system = read_and_check(*inputs, log, with_policy=False, naming=naming)
    print_findings(log.diagnostics)
    if system is None or log.has_errors:
        sys.exit(2)
    packaging = packaging_of(transport)
    try:
        made_from = Templates(templates)
        files = system_files(system, packaging, made_from, naming)
        other = _packed_otherwise(files, output, MARKS[packaging], MARKS.values())
        if other is not None:
            fail(
                f"{other}: {output} has packages for another transport; "
                f"give those for {transport} a folder of their own"
            )
        written, unchanged = write_files(files, output, force)
    except EditedFilesError as error:
        fail(*error.lines)
    except TemplateFault as error:
        fail(str(error))
    except ModelError as error:
        print_findings(error.diagnostics)
        sys.exit(2)
    except OSError as error:
        fail(f"cannot write {error.filename}: {error.strerror}")
    for path in made_from.unused():
        say(f"warning: {path}: makes no file; ours are: {', '.join(made_from.names)}")
    policy = ", 1 policy" if system.policy is not None else ""
    show(
        f"{system.name}: {counted(len(system.nodes), 'node')}{policy} in {output} "
        f"({counted(written, 'file')} written, {unchanged} unchanged)"
    )


def _packed_otherwise(
    files: Iterable[str], output: Path, own: str, marks: Iterable[str]
) -> Path | None:
    """A file in ``output`` that one of the packages of ``files`` has only for another transport."""
    others = [mark for mark in marks if mark != own]
    for name in files:
        if name.endswith(f"/{own}"):
            for other in others:
                path = (output / name).with_name(other)
                if path.exists():
                    return path
    return None
