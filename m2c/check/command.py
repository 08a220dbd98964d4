"""The ``m2c check`` command."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, NoReturn

import click

from m2c.changes import Changes
from m2c.inputs import Inputs, TransportName, change_options, input_options

if TYPE_CHECKING:
    from m2c.model.system import System


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
@click.option(
    "--watch",
    "watched",
    is_flag=True,
    help="Check again whenever a file has changed, until Ctrl-C.",
)
@change_options
@input_options
def check(
    inputs: Inputs,
    strict: bool,
    each: bool,
    form: str,
    transport: str | None,
    watched: bool,
    changes: Changes,
) -> None:
    """Check models before anything is generated from them.

    PATHS are models (.scxml, .ascxml), folders of them, one system file, or one policy; without any,
    the system.xml of the current folder.
    Every finding names file, line and column, what is wrong and what would be right.

    Exit code 0: no errors; 2: errors (with --strict, warnings too). With --watch, those of the last check.

    \b
    Example:
      m2c check examples/lab_tour/system.xml
    """

    def once() -> tuple[System | None, int]:
        return _check_once(inputs, strict, each, form, transport, changes)

    if watched:
        _check_again_and_again(inputs, once)
    sys.exit(once()[1])


def _check_again_and_again(
    inputs: Inputs, once: Callable[[], tuple[System | None, int]]
) -> NoReturn:
    """Check, and check again when a file has changed; ends the process at Ctrl-C, however early."""
    import signal
    import threading

    from m2c.terminal import say
    from m2c.watched import PERIOD_S, WatchedFiles, named

    is_asked = False

    def interrupt(*_: object) -> NoReturn:
        nonlocal is_asked
        is_asked = True
        raise KeyboardInterrupt

    code = 2
    never = threading.Event()
    try:
        signal.signal(signal.SIGINT, interrupt)
        files = WatchedFiles((*inputs.paths, *inputs.interfaces))
        system, code = once()
        files.follow(system)
        say("watching; Ctrl-C ends it")
        # what is raised where Python can only print it (a weak reference's callback) interrupts nothing
        while not is_asked and not never.wait(PERIOD_S):
            if changed := files.changed():
                say(f"{named(changed)}:")
                system, code = once()
                files.follow(system)
    except KeyboardInterrupt:
        pass
    sys.exit(code)


def _check_once(
    inputs: Inputs,
    strict: bool,
    each: bool,
    form: str,
    transport: str | None,
    changes: Changes,
) -> tuple[System | None, int]:
    """Check and print what is found: the system, if it could be read, and the exit code."""
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
    system = None
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
    return system, 2 if failed else 0
