"""The ``m2c check`` command."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from m2c.model import DiagnosticLog


@click.command()
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path))
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
    type=click.Path(path_type=Path, exists=True),
    help="Folder of ROS interface packages, or the earlier tool's INTERFACES.xml (repeatable).",
)
@click.option(
    "--model",
    type=click.Path(path_type=Path),
    help="The earlier tool's FULL_MODEL.xml, instead of PATHS.",
)
def check(
    paths: tuple[Path, ...],
    strict: bool,
    form: str,
    interfaces: tuple[Path, ...],
    model: Path | None,
) -> None:
    """Check models before anything is generated from them.

    PATHS are models (.scxml, .ascxml), folders of them, or one system file. Every finding names
    file, line and column, what is wrong and what would be right. Exit code 0: no errors; 2: errors
    (with --strict, warnings too).

    Example: m2c check examples/lab_tour/system.xml
    """
    from m2c.check.report import as_json, as_sarif, count, print_findings, summary
    from m2c.model import DiagnosticLog, Severity

    inputs = [*paths, *([model] if model is not None else [])]
    if not inputs:
        raise click.UsageError("nothing to check; give a model, a folder or a system file")
    log = DiagnosticLog()
    models = _check(inputs, interfaces, log)
    found = sorted(log.diagnostics, key=lambda item: (item.position, item.rule))
    if form == "json":
        click.echo(as_json(found))
    elif form == "sarif":
        click.echo(as_sarif(found))
    else:
        print_findings(found, sys.stdout, notes=True)
        click.echo(summary(models, found))
    failed = count(found, Severity.ERROR) or (strict and count(found, Severity.WARNING))
    sys.exit(2 if failed else 0)


def _check(inputs: Sequence[Path], interfaces: Sequence[Path], log: DiagnosticLog) -> int:
    """Check everything that ``inputs`` name; returns how many models were read."""
    from m2c.check import check_system
    from m2c.model import load

    system = load(inputs, log, [path for path in interfaces if path.is_dir()])
    if system is None:
        return 0
    complete = not log.has_errors
    lists = [path for path in interfaces if not path.is_dir()]
    if lists:
        from m2c.model.full_model import cross_check, read_interface_list

        for path in lists:
            cross_check(system, read_interface_list(path, log), log)
    check_system(system, log)
    # leaves are bound to machines and types: where some are missing, the tree is not to blame
    complete = complete and all(found.rule != "unknown-type" for found in log.diagnostics)
    if system.policy is not None and complete:
        from m2c.policy.program import read_policy

        read_policy(system.policy, system, log)
    return len(system.nodes) + len(system.plugins)
