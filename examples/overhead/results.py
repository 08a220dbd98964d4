"""Everything that one run of the comparison has measured, as a file."""

from __future__ import annotations

import csv
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from examples.overhead import growth_points, node_cost, table3
from examples.overhead.machine import Machine, described
from examples.overhead.tables import (
    Table,
    as_markdown,
    beside_the_paper,
    cost_table,
    details,
    growth_tables,
    targets,
)

FILE = "results.json"
BUSY = 1.0
"""A load average before the run from which on its figures are marked."""


class Results(msgspec.Struct, frozen=True, dict=True):
    """Every single tick, so that all tables and figures can be made again from it.

    Attributes:
        command: how to repeat it.
        began: when, as ``YYYY-MM-DD HH:MM`` UTC.
        minutes: how long it took.
        problems: what could not be measured, one sentence each.
    """

    machine: Machine
    command: str
    began: str
    minutes: float
    table3: table3.Measured
    growth: tuple[growth_points.Run, ...] = ()
    windows: tuple[node_cost.Window, ...] = ()
    problems: tuple[str, ...] = ()

    @functools.cached_property
    def cells(self) -> list[table3.Cell]:
        """The figures of table III."""
        return table3.cells(self.table3)

    @functools.cached_property
    def points(self) -> list[growth_points.Point]:
        """How it grows."""
        return growth_points.points(self.growth)


def sections(results: Results) -> dict[str, str]:
    """Markdown by the name of its section."""
    found = results.cells
    parts: dict[str, str] = {
        "machine": f"`{results.command}`, {results.began} UTC, {results.minutes:.0f} minutes, on "
        f"{described(results.machine)}.",
        "targets": _markdown([targets(found)]),
        "table3": _markdown(beside_the_paper(found)),
        "details": _markdown(details(results.table3, found)),
        "growth": _markdown(growth_tables(results.points)),
        "cost": _markdown([cost_table(results.windows)]) if results.windows else "Not measured.",
    }
    if results.machine.load > BUSY:
        parts["machine"] += (
            "\n\n**Others were at work on the machine: these figures say how it is measured, not what it "
            "costs.** How far *no monitor, again* is from 1 says how little they say."
        )
    if results.problems:
        parts["machine"] += "\n\n" + "\n".join(
            f"- not measured: {text}" for text in results.problems
        )
    return parts


def _markdown(tables: Sequence[Table]) -> str:
    return "\n\n".join(map(as_markdown, tables)) or "Not measured."


def summary(results: Results) -> dict[str, Any]:
    """For machines: every figure, without the single ticks."""
    found, own = results.cells, results.points
    shown = {
        "machine": results.machine,
        "command": results.command,
        "began": results.began,
        "minutes": results.minutes,
        "problems": results.problems,
        "paper": table3.PAPER,
        "targets": [
            {**msgspec.to_builtins(item), "met": item.is_met} for item in table3.targets(found)
        ],
        "table3": found,
        "attachments": results.table3.attachments,
        "growth": own,
        "knees": [growth_points.knee(line) for line in growth_points.series(own)],
        "cost": node_cost.costs(results.windows),
    }
    builtins: dict[str, Any] = msgspec.to_builtins(shown)
    return builtins


def save(results: Results, folder: Path) -> None:
    """Write results, CSV and Markdown into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FILE).write_bytes(msgspec.json.encode(results))
    short = summary(results)
    for name in ("table3", "growth", "cost"):
        if short[name]:
            _write_csv(folder / f"{name}.csv", [_flat(item) for item in short[name]])
    text = "\n\n".join(f"## {name}\n\n{text}" for name, text in sections(results).items())
    (folder / "overhead.md").write_text(f"# Overhead\n\n{text}\n", encoding="utf-8")


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
    """The rounds of several runs, as if one run had made all of them.

    A ratio is of the same round in it, too, so that what differs between runs is no more than what
    differs between rounds.

    Args:
        runs: one or more.

    Raises:
        ResultsError: their machines differ in more than their load, or one run is there twice.
    """
    first = runs[0]
    seen: set[tuple[str, str]] = set()
    blocks: list[table3.Block] = []
    attachments: list[table3.Attachment] = []
    growth: list[growth_points.Run] = []
    windows: list[node_cost.Window] = []
    for run in runs:
        here = msgspec.structs.replace(run.machine, load=first.machine.load)
        if here != first.machine:
            raise ResultsError(
                f"the run of {run.began} UTC is of another machine: {described(run.machine)}; "
                f"that of {first.began}: {described(first.machine)}"
            )
        if (run.began, run.command) in seen:
            raise ResultsError(f"the run of {run.began} UTC is there twice")
        seen.add((run.began, run.command))
        before = _rounds(attachments)
        attachments += _later(run.table3.attachments, before)
        blocks += _later(run.table3.blocks, before)
        growth += _later(run.growth, _rounds(growth))
        windows += _later(run.windows, _rounds(windows))
    return Results(
        msgspec.structs.replace(first.machine, load=max(run.machine.load for run in runs)),
        "; ".join(run.command for run in runs),
        ", ".join(run.began for run in runs),
        sum(run.minutes for run in runs),
        table3.Measured(tuple(blocks), tuple(attachments)),
        tuple(growth),
        tuple(windows),
        tuple(problem for run in runs for problem in run.problems),
    )


Numbered = TypeVar("Numbered", table3.Block, table3.Attachment, growth_points.Run, node_cost.Window)


def _rounds(found: Sequence[Numbered]) -> int:
    """How many rounds ``found`` is of."""
    return max((item.round for item in found), default=-1) + 1


def _later(found: Sequence[Numbered], before: int) -> list[Numbered]:
    """``found``, with its rounds behind ``before`` others."""
    return [msgspec.structs.replace(item, round=item.round + before) for item in found]


def _flat(item: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested fields as ``outer_inner``."""
    found: dict[str, Any] = {}
    for key, value in item.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{key}_")
        else:
            found[prefix + key] = value
    return found


def _write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def rewrite(page: Path, results: Results) -> None:
    """Put every section between its markers in ``page``; the rest of the page stays as it is.

    Raises:
        ValueError: a marker is missing.
    """
    text = page.read_text(encoding="utf-8")
    for name, content in sections(results).items():
        text = replaced(text, name, content)
    page.write_text(text, encoding="utf-8")


def replaced(text: str, name: str, content: str) -> str:
    """``text`` with ``content`` between the markers of ``name``."""
    first, last = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    head, found, rest = text.partition(first)
    _, closed, tail = rest.partition(last)
    if not found or not closed:
        raise ValueError(f"no {first} … {last}")
    return f"{head}{first}\n{content}\n{last}{tail}"
