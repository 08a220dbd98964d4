"""The ``moon check`` command."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from m2c.inputs import IntegerRange, options_as
from m2c.output_file import write_whole
from m2c.terminal import folded, has_colour, say, show_painted, write_to_nobody
from moon.monitor.subject_options import Choice, read_or_fail, subject_options
from moon.monitor.verdict_options import json_option, log_option
from moon.offline.view_options import view_options

if TYPE_CHECKING:
    from moon.offline.result import CheckResult
    from moon.offline.view import View

_MODEL_SUFFIXES = (".scxml", ".ascxml", ".xml")
_BAG_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_BAG_METADATA = "metadata.yaml"


class CheckOptions(NamedTuple):  # msgspec's would cost each --help its import
    """The command line of ``moon check``; what was not given is None, empty or False.

    Attributes:
        paths: recordings and models.
        choice: what of the system is judged, and by which bounds.
        as_json: whether verdicts are shown as JSON.
        log_file: to which they are appended.
        junit_file: to which they are written as JUnit XML.
        report_file: to which they are written as a page.
        strict: whether what is inconclusive counts.
        jobs: how many recordings are checked at once.
        view: which part of a recording is judged, and by which of its times.
        property_ids: which properties; all if empty.
    """

    paths: tuple[Path, ...]
    choice: Choice
    as_json: bool
    log_file: Path | None
    junit_file: Path | None
    report_file: Path | None
    strict: bool
    jobs: int | None
    view: View
    property_ids: tuple[str, ...]


@click.command()
@click.argument(
    "paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN... [MODEL...]"
)
@subject_options
@json_option
@log_option
@click.option(
    "--junit",
    "junit_file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write JUnit XML, for continuous integration.",
)
@click.option(
    "--report",
    "report_file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE.html",
    help="Write a page with timelines and diagrams.",
)
@click.option(
    "--strict",
    is_flag=True,
    help="Exit code 1 also if a machine or a property is inconclusive, or unseen, in the end, or a channel "
    "that is needed was not recorded.",
)
@view_options
@click.option(
    "--property",
    "property_ids",
    multiple=True,
    metavar="ID",
    help="Check only this property (repeatable).",
)
@click.option(
    "--jobs",
    type=IntegerRange(min=1),
    help="Recordings checked at once; by default as many as there are processors.",
)
@options_as(CheckOptions)
def check(options: CheckOptions) -> None:
    """Check recorded runs against models, or properties, or both, as `moon monitor` does live.

    RUN is what `moon record` or `ros2 bag record` wrote (a file or a folder), or a log of JSON lines;
    MODEL is a model (.scxml, .ascxml), a folder of them, or one system file. Verdicts and explanations
    are those of a monitor that ran live.

    A bag has several times of each message; --time chooses another than evidence does. What happened before
    the last entry is judged; what was due later is not violated.

    Exit code 0: no violation; 1: a violation, or with --strict something inconclusive or not recorded; 2: a
    recording or a model could not be read, or a recording not be judged.

    \b
    Example:
      moon check run.mcap examples/lab_tour/system.xml --report run.html
      moon check bag/ --properties p.yaml --time header:header --from 10 --to 60
    """
    from moon.offline.batch import check_all
    from moon.offline.result import CheckResult

    runs, models = _runs_and_models(options.paths)
    choice, property_ids = options.choice, options.property_ids
    if not runs:
        raise click.UsageError("Missing argument 'RUN': all that is named are models")
    if property_ids and not choice.property_files:
        raise click.UsageError(
            "--property chooses properties, and there are none (--properties FILE)"
        )
    subject = choice.subject(models, property_ids)
    monitored = read_or_fail(subject)
    results: list[CheckResult] = []
    failures: list[tuple[str, str]] = []
    try:
        jobs = options.jobs or os.cpu_count() or 1
        with_report = options.report_file is not None
        outcomes = check_all(runs, subject, monitored, jobs, with_report, options.view)
        for path, outcome in outcomes:
            if isinstance(outcome, CheckResult):
                results.append(outcome)
                _show(outcome, options.as_json)
            else:
                failures.append((str(path), outcome))
                say(f"error: {outcome}")
        _write_files(results, failures, options)
    except BrokenPipeError:
        write_to_nobody()
    except OSError as error:
        what = f"cannot write {error.filename}" if error.filename else "cannot check"
        say(f"error: {what}: {error.strerror or error}")
        write_to_nobody()
        sys.exit(2)
    if failures:
        sys.exit(2)
    if options.strict:
        for result in results:
            _say_undecided(result)
    wrong = any(result.violations or (options.strict and result.is_open) for result in results)
    sys.exit(1 if wrong else 0)


def _say_undecided(result: CheckResult) -> None:
    """What makes the exit code 1 with ``--strict``, though nothing was violated."""
    if result.undecided:
        named = ", ".join(f"{item.machine} ({item.verdict})" for item in result.undecided)
        say(f"strict: {result.recording.path}: not known to conform: {named}")
    if result.recording.unrecorded:
        channels = ", ".join(result.recording.unrecorded)
        say(f"strict: {result.recording.path}: not recorded: {channels}")


def _runs_and_models(paths: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """The recordings among ``paths``, and the models."""
    models = tuple(path for path in paths if _is_model(path))
    return tuple(path for path in paths if path not in models), models


def _is_model(path: Path) -> bool:
    if not os.path.isdir(path):
        return path.suffix.lower() in _MODEL_SUFFIXES
    return not any(
        found.name == _BAG_METADATA or found.name.endswith(_BAG_SUFFIXES)
        for found in path.iterdir()
    )


def _show(result: CheckResult, as_json: bool) -> None:
    from moon.offline.output import json_lines, lines_of

    if as_json:
        show_painted(*(line.decode() for line in json_lines(result)))
    else:
        lines = lines_of(result, has_colour())
        show_painted(*(part for line in lines for part in folded(line)))


def _write_files(
    results: Sequence[CheckResult],
    failures: Sequence[tuple[str, str]],
    options: CheckOptions,
) -> None:
    if options.log_file is not None:
        from moon.sinks.file import VerdictFile

        log = VerdictFile(options.log_file)
        for result in results:
            for reported in result.verdicts:
                log.take(reported.verdict)
        log.close()
    if options.junit_file is not None:
        from moon.offline.junit import junit

        write_whole(options.junit_file, junit(results, failures))
    if options.report_file is not None:
        from moon.report.page import write_report

        for number, result in enumerate(results, 1):
            path = options.report_file
            if len(results) > 1:
                path = path.with_name(f"{path.stem}-{number}{path.suffix}")
            write_report(result, path)
            say(f"wrote {path}")
