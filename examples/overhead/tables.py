"""What was measured as tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.page import markdown_table
from benchmarks.ticking import NAMES, WHOLE, at_rate
from examples.overhead import blocks
from examples.overhead.blocks import PAPER, SERIES, Cell
from examples.overhead.observers import CONFIGURATIONS, NOBODY


def place(cell: Cell) -> str:
    """A transport and a rate of ticks, as people write them."""
    return f"{NAMES[cell.transport]}, {at_rate(cell.rate_hz)}"


def targets(found: Sequence[Cell]) -> str:
    """What passive monitoring of everything may cost, and costs."""
    rows = [
        (
            place(cell),
            cell.ratio.shown(".2f"),
            f"≤ {most:.2f}",
            "yes" if cell.ratio.value <= most else "**no**",
        )
        for cell, most in blocks.targets(found)
    ]
    header = ("Targets: everything monitored passively, ROOT", "ratio", "target", "met")
    return markdown_table([header, *rows])


def paper() -> str:
    """The paper's own figures."""
    labels = {"none": "no monitor", "properties": "properties", "models": "models", "both": "both"}
    rows = [
        (label, *(f"{PAPER[s][name]:,} ({PAPER[s][name] / PAPER[s]['none']:.2f})" for s in SERIES))
        for name, label in labels.items()
    ]
    return markdown_table([("The paper's table III: averages in µs (ratio)", *SERIES), *rows])


_OF_ROOT = ("p99 / worst", "ticks", "failed", "monitors [cores]", "lag [ms]")


def table3(found: Sequence[Cell]) -> list[str]:
    """Table III by transport and rate, a row for each way to monitor."""
    made = []
    for where in dict.fromkeys(map(place, found)):
        by_name = {(c.configuration, c.series): c for c in found if place(c) == where}
        rows: list[tuple[str, ...]] = [(where, *SERIES, *_OF_ROOT)]
        deaf = []
        for item in CONFIGURATIONS:
            if root := by_name.get((item.name, WHOLE)):
                ticks = (_tick(by_name[item.name, series]) for series in SERIES)
                rows.append((item.label, *ticks, *_whole(root)))
                if root.deaf:
                    times = f"{len(root.deaf)} of {root.rounds}"
                    deaf.append(f"{item.name}: {times} ({root.deaf[0]})")
        note = f"\n\nBlocks not monitored: {', '.join(deaf)}." if deaf else ""
        made.append(markdown_table(rows) + note)
    return made


def _tick(cell: Cell) -> str:
    if cell.configuration == "control" and cell.series != WHOLE:
        return ""  # what chance does is told by the whole tick
    if cell.configuration == NOBODY:
        return cell.found.p50.shown(",.0f")
    return f"{cell.found.p50.value:,.0f} · {cell.ratio.shown('.2f')}"


def _whole(cell: Cell) -> tuple[str, ...]:
    """What ``_OF_ROOT`` heads."""
    return (
        f"{cell.found.p99:,.0f} / {cell.found.worst:,.0f}",
        f"{cell.found.count:,}",
        str(cell.failures),
        f"{cell.processor:.2f}",
        "–" if cell.lag_ms is None else f"{cell.lag_ms:.1f}",
    )
