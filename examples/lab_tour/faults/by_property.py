"""What the properties of the tour find of each fault, beside what the paper's table II says of its own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from catalogue import Fault
from rich.console import Console
from rich.table import Table

PROPERTIES = Path(__file__).resolve().parent.parent / "properties.yaml"

PAPERS = ("P1", "P2", "P3")
"""The properties of the paper's table I."""

BROKEN: dict[str, frozenset[str]] = {
    "T1": frozenset({"P1", "P2"}),
    "T2": frozenset({"P2", "P3", "A1"}),
    "T3": frozenset({"P1"}),
    "T4": frozenset({"A2"}),
    "T5": frozenset({"P2"}),
    "T6": frozenset({"A3"}),
}
"""What must be found broken of each fault, and nothing else. In T2 the tree stands still while it waits
for the answer, also when the battery is low."""


class Cell(msgspec.Struct, frozen=True):
    """One property in one run.

    Attributes:
        property: its id.
        paper: what the paper's monitor of it said; "" for those that are not the paper's.
        broken: whether it was found broken.
        latency_ms: from the first thing that was wrong to the verdict.
        delay_ms: from the instant at which it was broken (a deadline, say) to the verdict.
        witness: the last thing that broke it.
        problem: why it counts as failed; "" if all is well.
    """

    property: str
    paper: str = ""
    broken: bool = False
    latency_ms: float | None = None
    delay_ms: float | None = None
    witness: str = ""
    problem: str = ""


def cells(
    chosen: Fault | None,
    broken: Iterable[Any],
    onset_ns: int | None,
    standing: Mapping[str, str],
) -> tuple[Cell, ...]:
    """What was found of ``chosen`` (None: the tour as it is).

    Args:
        chosen: the fault.
        broken: the verdicts on properties that were found broken, with when they were said.
        onset_ns: when the fault first showed itself; None if it did not.
        standing: each property's verdict at the end.
    """
    first: dict[str, Any] = {}
    for said in broken:
        first.setdefault(said.verdict.machine, said)
    return tuple(
        _cell(chosen, name, first.get(name), onset_ns, standing[name]) for name in standing
    )


def _cell(chosen: Fault | None, name: str, said: Any, onset_ns: int | None, stands: str) -> Cell:
    papers = chosen.paper if chosen is not None else None
    cell = Cell(name, getattr(papers, name.lower()) if papers and name in PAPERS else "")
    owed = chosen is not None and name in BROKEN[chosen.id]
    if said is None:
        problem = ""
        if owed:
            problem = f"{name} is not found broken"
        elif stands != "conforming":
            problem = f"nothing is known of {name}: {stands}"
        return msgspec.structs.replace(cell, problem=problem)
    problem = "" if owed else f"{name} is found broken: {said.verdict.reason}"
    since_ns = onset_ns if onset_ns is not None else said.verdict.stamp_ns
    return msgspec.structs.replace(
        cell,
        broken=True,
        latency_ms=(said.at_ns - since_ns) / 1e6,
        delay_ms=(said.at_ns - said.verdict.stamp_ns) / 1e6,
        witness=said.verdict.explanation.observed,
        problem=problem,
    )


def show(
    console: Console, transport: str, rows: Sequence[tuple[str, str, str, tuple[Cell, ...]]]
) -> None:
    """A table: of each fault its id, what the model monitors said there and here, and the properties."""
    names = [cell.property for cell in rows[0][3]]
    table = Table(
        title="Table II: the paper's (above) and, in seconds since the fault showed, ours on "
        f"{transport} (below)",
        title_style="bold",
    )
    for heading in ("", "model", *names):
        table.add_column(heading)
    for identifier, paper, ours, found in rows:
        if identifier != "nominal":
            table.add_row(identifier, paper, *(_short(cell.paper) for cell in found))
        first = identifier if identifier == "nominal" else ""
        table.add_row(first, ours, *map(_found, found), end_section=True)
    console.print(table)
    for identifier, _, _, found in rows:
        for cell in found:
            if cell.broken:
                console.print(f"{identifier}: {cell.property}: {cell.witness}", markup=False)
            if cell.problem:
                console.print(f"{identifier}: FAILED: {cell.problem}", markup=False)


def _short(papers: str) -> str:
    if papers.startswith("detects when"):
        return "below 30 %"
    return {"no detection": "–", "not relevant": "n/a"}.get(papers, papers)


def _found(cell: Cell) -> str:
    if cell.latency_ms is None:
        return "FAILED" if cell.problem else "–"
    return f"{'WRONG: ' if cell.problem else ''}{cell.latency_ms / 1e3:.2f} s"
