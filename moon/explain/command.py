"""The ``moon explain`` command."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.changes import Changes
from m2c.inputs import change_options, interface_folders
from m2c.terminal import fail, folded, show
from moon.offline.view_options import time_option

if TYPE_CHECKING:
    from m2c.model import System
    from moon.sources.time_choice import TimeChoice


@click.command()
@click.argument(
    "models", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="MODEL...|SYSTEM"
)
@interface_folders
@change_options
@click.option("--only", multiple=True, metavar="NODE", help="Explain only this node (repeatable).")
@click.option(
    "--recording",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="Say what can be concluded from this recording instead.",
)
@time_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object a machine and line.")
def explain(
    models: tuple[Path, ...],
    interfaces: tuple[Path, ...],
    changes: Changes,
    only: tuple[str, ...],
    recording: Path | None,
    time: TimeChoice | None,
    as_json: bool,
) -> None:
    """Say what a monitor would observe of models, and what it cannot check, and why.

    MODEL...|SYSTEM are models (.scxml, .ascxml), folders of them, or one system file.

    Exit code 0, or 2 for models in which `m2c check` finds errors.

    \b
    Example:
      moon explain examples/lab_tour/skills/GoToPoiSkill.scxml
      moon explain examples/lab_tour/system.xml --recording bag/ --time log
    """
    if time is not None and recording is None:
        raise click.UsageError("--time is one of a recording, and there is none (--recording RUN)")
    from m2c.json_lines import versioned_line
    from m2c.model import ModelError
    from m2c.suggestions import nearest
    from moon.explain.observables import observables
    from moon.explain.policy import policy_observables
    from moon.explain.report import ASSUMED, policy_report, report
    from moon.monitor.reading import read_checked, say_why
    from moon.monitor.status import POLICY

    try:
        system = read_checked(models, interfaces, changes=changes)
    except ModelError as error:
        say_why(error)
        sys.exit(2)
    known = [machine.name for machine in (*system.nodes, *system.plugins)]
    known += [POLICY] if system.policy is not None else []
    for name in only:
        if name not in known:
            fail(f"{system.name} has no machine {name}; {nearest(name, known)}")
    if recording is not None:
        _explain_recording(recording, system, only, time, as_json)
        return
    found = [
        observables(machine, plugin=machine in system.plugins)
        for machine in (*system.nodes, *system.plugins)
        if not only or machine.name in only
    ]
    policy = policy_observables(system) if not only or POLICY in only else None
    if as_json:
        for item in (*found, *filter(None, [policy])):
            show(versioned_line(item).decode())
        return
    for item in found:
        _show(*report(item), "")
    if policy is not None:
        _show(*policy_report(policy), "")
    _show(ASSUMED)


def _show(*lines: str) -> None:
    """Show ``lines``, folded where the terminal is not as wide."""
    show(*(part for line in lines for part in folded(line)))


def _explain_recording(
    path: Path, system: System, only: tuple[str, ...], time: TimeChoice | None, as_json: bool
) -> None:
    """What can be concluded of the nodes of ``system`` from the recording at ``path``."""
    import msgspec

    from m2c.json_lines import versioned_line
    from moon.explain.recorded import concluded, lines_of, lines_of_overview, overview
    from moon.offline.survey import read_through
    from moon.oracle.bounds import Bounds
    from moon.recording.reader import RecordingError, open_recording

    chosen = [machine for machine in system.nodes if not only or machine.name in only]
    try:
        recording = open_recording(path, system.library)
        base, attribution = read_through(recording, time, system, chosen, Bounds())
    except RecordingError as error:
        fail(str(error))
    whole, judged = overview(recording, base), None
    if attribution is not None:
        judged = frozenset(machine.name for machine in attribution.machines)
        more = [*filter(None, [attribution.assumption()]), *attribution.unjudged]
        whole = msgspec.structs.replace(whole, limits=(*whole.limits, *more))
    found = [concluded(machine, recording.contents, judged) for machine in chosen]
    if as_json:
        for item in (whole, *found):
            show(versioned_line(item).decode())
        return
    show(*lines_of_overview(whole), "")
    for conclusion in found:
        show(*lines_of(conclusion))
