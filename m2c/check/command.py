"""The ``m2c check`` command."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--strict", is_flag=True, help="Treat warnings as errors.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "json", "sarif"]),
    default="text",
    show_default=True,
    help="How findings are printed.",
)
@click.option(
    "--interfaces",
    multiple=True,
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Folder of ROS interface packages (repeatable).",
)
def check(paths: tuple[Path, ...], strict: bool, form: str, interfaces: tuple[Path, ...]) -> None:
    """Check models before anything is generated from them.

    PATHS are models (.scxml, .ascxml), folders of them, or one system file. Every finding names
    file, line and column, what is wrong and what would be right. Exit code 0: no errors; 2: errors
    (with --strict, warnings too).

    Example: m2c check examples/lab_tour/system.xml
    """
    from m2c.check import check_system
    from m2c.check.report import as_json, as_sarif, count, print_findings
    from m2c.model import DiagnosticLog, Severity, load

    log = DiagnosticLog()
    system = load(paths, log, interfaces)
    if system is not None:
        check_system(system, log)
    found = sorted(log.diagnostics, key=lambda item: (item.position, item.rule))
    errors, warnings = count(found, Severity.ERROR), count(found, Severity.WARNING)
    if form == "json":
        click.echo(as_json(found))
    elif form == "sarif":
        click.echo(as_sarif(found))
    else:
        print_findings(found, sys.stdout, notes=True)
        models = len(system.nodes) + len(system.plugins) if system is not None else 0
        click.echo(f"{models} models, {errors} errors, {warnings} warnings")
    sys.exit(2 if errors or (strict and warnings) else 0)
