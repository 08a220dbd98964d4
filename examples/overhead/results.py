"""Everything that one run of the comparison has measured, as a file, and its place on the page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
from msgspec.structs import replace

from benchmarks.page import put
from examples.overhead import tables
from examples.overhead.blocks import Block, cells

FILE = "results.json"
BUSY = 1.0
"""A load average before the run from which on its figures are marked."""


class Results(msgspec.Struct, frozen=True):
    """Every single tick, so that all tables can be made again from it.

    Attributes:
        machine: where it was measured, in words.
        load: the average number of processes that wanted to run, of the minute before it began: more than a
            few tenths means that others were at work.
        command: how to repeat it.
        began: when, as ``YYYY-MM-DD HH:MM`` UTC.
        minutes: how long it took.
        problems: what could not be measured, one sentence each.
    """

    machine: str
    load: float
    command: str
    began: str
    minutes: float
    blocks: tuple[Block, ...]
    problems: tuple[str, ...] = ()


def sections(results: Results) -> dict[str, str]:
    """Markdown by the name of its section."""
    found = cells(results.blocks)
    said = [
        f"`{results.command}`, {results.began} UTC, {results.minutes:.0f} minutes, on "
        f"{results.machine}; load average before it began {results.load:.2f}."
    ]
    if results.load > BUSY:
        said.append(
            "**Others were at work on the machine: these figures say how it is measured, not what it "
            "costs.** How far *no monitor, again* is from 1 says how little they say."
        )
    said += [f"- not measured: {text}" for text in results.problems]
    return {
        "machine": "\n\n".join(said),
        "targets": tables.targets(found),
        "table3": "\n\n".join([tables.paper(), *tables.table3(found)]),
    }


def document(results: Results) -> str:
    """All sections."""
    parts = [f"## {name}\n\n{text}" for name, text in sections(results).items()]
    return "\n\n".join(["# Overhead", *parts]) + "\n"


def save(results: Results, folder: Path) -> None:
    """Write results and their tables in Markdown into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FILE).write_bytes(msgspec.json.encode(results))
    (folder / "overhead.md").write_text(document(results), encoding="utf-8")


class ResultsError(ValueError):
    """A file that is no run's results, or runs whose rounds are not those of one."""


def read(path: Path) -> Results:
    """What :func:`save` wrote.

    Raises:
        OSError: it cannot be read.
        ResultsError: somebody else wrote it, or it was cut off.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=Results)
    except msgspec.MsgspecError as error:
        raise ResultsError(f"{path}: not the results of a run: {error}") from error


def joined(runs: Sequence[Results]) -> Results:
    """The rounds of one or more runs, as if one run had made all of them.

    A ratio is of the same round in it, too, so that what differs between runs is no more than what
    differs between rounds.

    Raises:
        ResultsError: their machines differ in more than their load, or one run is there twice.
    """
    first = runs[0]
    together: list[Block] = []
    for number, run in enumerate(runs):
        if run.machine != first.machine:
            raise ResultsError(
                f"the run of {run.began} UTC is of another machine: {run.machine}; "
                f"that of {first.began}: {first.machine}"
            )
        if (run.began, run.command) in [(other.began, other.command) for other in runs[:number]]:
            raise ResultsError(f"the run of {run.began} UTC is there twice")
        before = max((item.round for item in together), default=-1) + 1
        together += [replace(item, round=item.round + before) for item in run.blocks]
    return Results(
        first.machine,
        max(run.load for run in runs),
        "; ".join(run.command for run in runs),
        ", ".join(run.began for run in runs),
        sum(run.minutes for run in runs),
        tuple(together),
        tuple(problem for run in runs for problem in run.problems),
    )


def rewrite(page: Path, results: Results) -> None:
    """Put every section between its markers; the rest of the page stays as it is.

    Raises:
        ValueError: it does not have the markers of a section; it was not changed then.
    """
    text = page.read_text(encoding="utf-8")
    for name, content in sections(results).items():
        text = put(text, name, content)
    page.write_text(text, encoding="utf-8")
