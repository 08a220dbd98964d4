"""The ``m2c check`` command."""

from __future__ import annotations

import sys

import click

from m2c.changes import Changes
from m2c.inputs import Inputs, TransportName, change_options, input_options


@click.command()
@click.option("--strict", is_flag=True, help="Treat warnings as errors.")
@click.option(
    "--all",
    "each",
    is_flag=True,
    help="Show each finding of a mistake that is repeated.  [default: the first of more than three]",
)
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "json", "sarif"]),
    default="text",
    show_default=True,
    help="How findings are printed.",
)
@click.option(
    "--transport",
    type=TransportName(),
    help="Where the nodes will run: a name that it does not take is an error.  "
    "[default: any; a name that one does not take is a warning]",
)
@change_options
@input_options
def check(
    inputs: Inputs,
    strict: bool,
    each: bool,
    form: str,
    transport: str | None,
    changes: Changes,
) -> None:
    """Check models before anything is generated from them.

    PATHS are models (.scxml, .ascxml), folders of them, one system file, or one policy.
    Every finding names file, line and column, what is wrong and what would be right.

    Exit code 0: no errors; 2: errors (with --strict, warnings too).

    \b
    Example:
      m2c check examples/lab_tour/system.xml
    """
    from m2c.check.reading import read_and_check
    from m2c.check.report import as_json, as_sarif, count, print_findings, summary
    from m2c.model import DiagnosticLog, Severity
    from m2c.naming import naming_for
    from m2c.policy.alone import check_policy, is_policy
    from m2c.terminal import show

    log = DiagnosticLog()
    naming = naming_for(transport)
    alone = len(inputs.paths) == 1 and is_policy(inputs.paths[0])
    models = 0
    if alone:
        check_policy(inputs.paths[0], log, naming)
    elif (system := read_and_check(*inputs, log, naming=naming, changes=changes)) is not None:
        models = len(system.nodes) + len(system.plugins)
    found = sorted(log.diagnostics, key=lambda item: (item.position, item.rule))
    if form == "json":
        show(*as_json(found).splitlines())
    elif form == "sarif":
        show(*as_sarif(found).splitlines())
    else:
        print_findings(found, sys.stdout, notes=True, each=each, option="--all")
        show(*(summary(1, found, "policy") if alone else summary(models, found)))
    failed = count(found, Severity.ERROR) or (strict and count(found, Severity.WARNING))
    sys.exit(2 if failed else 0)
