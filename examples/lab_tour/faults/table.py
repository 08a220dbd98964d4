"""The table of a run: the paper's table II beside what was found here."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import by_property
from judging import Row
from rich.console import Console
from rich.table import Table

WIDTH = 130
"""Of a table that goes to a file."""


def show(rows: Sequence[Row]) -> None:
    """The table, a column for each transport, and below it what was said."""
    console = Console(width=None if sys.stdout.isatty() else WIDTH)
    transports = list(dict.fromkeys(row.transport for row in rows))
    table = Table(title="The paper's table II (monitor of models) beside ours", title_style="bold")
    for name in ("", "fault", "node", "the paper's monitor"):
        table.add_column(name)
    for transport in transports:
        table.add_column(f"this one, on {transport}")
        table.add_column("verdict after", justify="right")
    for name in dict.fromkeys(row.id for row in rows):
        of_fault = [row for row in rows if row.id == name]
        one = of_fault[0]
        ours = [text for row in of_fault for text in (found(row), latency(row))]
        table.add_row(one.id, one.type, one.node, one.paper, *ours)
    console.print(table)
    for row in rows:
        where = f"{row.id} on {row.transport}"
        if row.reason:
            console.print(f"{where}: {' and '.join(row.violated)}: {row.reason}", markup=False)
        if row.problem:
            console.print(f"{where}: FAILED: {row.problem}", markup=False)
    for transport in transports if rows[0].properties else ():
        lines = [
            (row.id, row.paper, f"{found(row)} {latency(row)}".strip(), row.properties)
            for row in rows
            if row.transport == transport
        ]
        by_property.show(console, transport, lines)


def brief(rows: Sequence[Row]) -> list[str]:
    """How many faults were found and who was accused without one; then a line for each fault."""
    faults = [row for row in rows if row.id != "nominal"]
    accused = {name: None for row in rows for name in row.violated if name != row.node}
    alarms = f"FALSE ALARM: {', '.join(accused)}" if accused else "no false alarm"
    return [
        f"The paper's faults: {sum(row.is_well for row in faults)} of {len(faults)} found, {alarms}",
        *(
            f"{row.id}  {row.node:<17}  {row.type:<19}  {found(row).removeprefix('detects ')}"
            f" ({latency(row) or 'never'})"
            for row in faults
        ),
    ]


def found(row: Row) -> str:
    """What the monitors of the models found, in words."""
    if row.id == "nominal":
        return f"FALSE ALARM: {', '.join(row.violated)}" if row.violated else "says nothing"
    if row.latency_ms is None:
        return "NOT DETECTED"
    if row.after_deadline_ms is not None:
        return "detects at the deadline" if row.detected else f"detects, but {row.problem}"
    if row.first is None:  # nothing wrong was sent
        return "detects at its next input" if row.detected else f"detects, but {row.problem}"
    return "detects at first occurrence" if row.detected else f"detects, but {row.problem}"


def latency(row: Row) -> str:
    """How long it took; "" if nothing was found."""
    if row.latency_ms is None:
        return ""
    text = f"{row.latency_ms:.0f} ms"
    if row.after_deadline_ms is not None:
        text = f"deadline + {row.after_deadline_ms:.0f} ms"
    if row.certain_ms is not None and row.certain_ms > row.latency_ms:
        text += f", certain after {row.certain_ms / 1e3:.2f} s"
    return text
