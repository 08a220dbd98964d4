"""The ``m2c convert`` command."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from m2c.inputs import Inputs, input_options
from m2c.terminal import fail, show


@click.command()
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the converted files; made if it does not exist.",
)
@click.option(
    "--to",
    "dialect",
    type=click.Choice(["ascxml", "hl-scxml"]),
    default="ascxml",
    show_default=True,
    help="The dialect to write.",
)
@click.option("--force", is_flag=True, help="Overwrite files that exist.")
@input_options
def convert(inputs: Inputs, output: Path, dialect: str, force: bool) -> None:
    """Write models in one dialect, with today's names.

    PATHS are models (.scxml, .ascxml), folders of them, or one system file, which is converted with
    its models; its policy and interfaces stay where they are. Comments are kept. What is written is
    read back first: unless it means the same, nothing is written.

    \b
    Example:
      m2c convert examples/lab_tour/system.xml -o converted
    """
    from m2c.check.report import print_findings
    from m2c.codegen.writer import counted
    from m2c.convert.conversion import ExistingFilesError, convert_files
    from m2c.model import DiagnosticLog
    from m2c.model.machine import Dialect

    log = DiagnosticLog()
    folders = [path for path in inputs.interfaces if path.is_dir()]
    try:
        made = convert_files(inputs.paths, folders, output, Dialect(dialect), log, force=force)
    except ExistingFilesError as error:
        fail(*error.lines)
    print_findings(log.diagnostics)
    if made is None:
        sys.exit(2)
    models = f"{counted(made.models, 'model')} in {output}"
    system = f"{output / made.system}, with " if made.system is not None else ""
    show(
        f"{system}{models}: read back as the same "
        f"({counted(made.written, 'file')} written, {made.unchanged} unchanged)"
    )
