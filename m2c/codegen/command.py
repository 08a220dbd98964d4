"""The ``m2c generate`` command."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from m2c.changes import Changes
from m2c.inputs import ExistingPath, Inputs, TransportName, change_options, input_options
from m2c.terminal import fail, say, show


@click.command()
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the packages; made if it does not exist.",
)
@click.option(
    "--transport",
    type=TransportName(),
    default="zenoh",
    show_default=True,
    help="Middleware of the nodes.",
)
@click.option(
    "--templates",
    type=ExistingPath(path_type=Path, exists=True, file_okay=False),
    help="Folder of your own Jinja2 templates: they override or extend ours of the same name.",
)
@click.option("--force", is_flag=True, help="Overwrite files that were edited by hand.")
@change_options
@input_options
def generate(
    inputs: Inputs,
    output: Path,
    transport: str,
    templates: Path | None,
    force: bool,
    changes: Changes,
) -> None:
    """Generate running Python nodes from models.

    PATHS are models (.scxml, .ascxml), folders of them, or one system file. Every node becomes an
    installable package (for ros2 one of a ROS 2 workspace); a system also gets its policy and a
    launch description. The output is the same, byte for byte, each time; a file that somebody has
    edited is not overwritten.

    With --templates DIR, a template of yours takes the place of ours with its name, or extends it:
    DIR/header.j2 with one line of a comment is a header in every file (docs/templates.md).

    \b
    Example:
      m2c generate examples/lab_tour/system.xml -o generated
    """
    from m2c.check.reading import read_and_check
    from m2c.check.report import print_findings
    from m2c.codegen.generation import OtherPackagesError, write_system
    from m2c.codegen.rendering import TemplateFault
    from m2c.codegen.writer import EditedFilesError, counted
    from m2c.model import DiagnosticLog, ModelError
    from m2c.naming import naming_for

    naming = naming_for(transport)
    log = DiagnosticLog()
    system = read_and_check(*inputs, log, with_policy=False, naming=naming, changes=changes)
    print_findings(log.diagnostics)
    if system is None or log.has_errors:
        sys.exit(2)
    try:
        made = write_system(system, output, transport, templates, naming, force)
    except EditedFilesError as error:
        fail(*error.lines)
    except (OtherPackagesError, TemplateFault) as error:
        fail(str(error))
    except ModelError as error:
        print_findings(error.diagnostics)
        sys.exit(2)
    except OSError as error:
        fail(f"cannot write {error.filename}: {error.strerror}")
    for path in made.unused:
        say(f"warning: {path}: makes no file; ours are: {', '.join(made.templates)}")
    policy = ", 1 policy" if system.policy is not None else ""
    show(
        f"{system.name}: {counted(len(system.nodes), 'node')}{policy} in {output} "
        f"({counted(made.written, 'file')} written, {made.unchanged} unchanged)"
    )
