"""What was measured as tables: the same on a terminal and on the page of the documentation."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from benchmarks.sampling import Estimate
from examples.overhead import blocks
from examples.overhead.blocks import COST, NOBODY, PAPER, SERIES, TABLE3, Cell
from examples.overhead.load import ROOT
from examples.overhead.node_cost import NODE
from examples.overhead.observers import CONFIGURATIONS


class Table(msgspec.Struct, frozen=True):
    """A table of text; ``note`` stands below it."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


# -- figures in words -------------------------------------------------------------------------------


def place(cell: Cell | blocks.Target) -> str:
    """A transport and a rate of ticks, as people write them."""
    return f"{_NAMES[cell.transport]}, {_rate(cell.rate_hz)}"


_NAMES = {"zenoh": "Zenoh", "ros2": "ROS 2"}


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:g} tick{'' if rate_hz == 1 else 's'}/s" if rate_hz else "saturated"


def _ratio(found: Estimate | None) -> str:
    return "–" if found is None else f"{found.value:.2f} ({found.low:.2f}–{found.high:.2f})"


def _spread(found: Estimate) -> str:
    return f"{found.value:,.0f} ({found.low:,.0f}–{found.high:,.0f})"


def _lag(p50: float | None, p99: float | None) -> str:
    if p50 is None:
        return "–"
    return f"{p50:.1f}" if p99 is None else f"{p50:.1f} / {p99:.1f}"


def _amount(cell: Cell) -> str:
    """The place of a point in its growth, with its unit."""
    if cell.experiment == "rate":
        return _rate(cell.rate_hz)
    if cell.experiment == "payload":
        for size, unit in ((1 << 20, "MB"), (1 << 10, "KB")):
            if cell.x >= size:
                return f"{cell.x / size:g} {unit}"
        return f"{cell.x:g} B"
    return f"{cell.x:g}"


# -- tables -----------------------------------------------------------------------------------------


def targets(found: Sequence[Cell]) -> Table:
    """What passive monitoring of everything may cost, and costs."""
    rows = tuple(
        (
            place(target),
            _ratio(target.found),
            f"≤ {target.most:.2f}",
            "yes" if target.is_met else "**no**",
        )
        for target in blocks.targets(found)
    )
    title = "Targets: everything monitored passively, ROOT"
    return Table(title, ("", "ratio", "target", "met"), rows)


def paper() -> Table:
    """The paper's own figures."""
    labels = {"none": "no monitor", "properties": "properties", "models": "models", "both": "both"}
    rows = tuple(
        (label, *(f"{PAPER[s][name]:,} ({PAPER[s][name] / PAPER[s]['none']:.2f})" for s in SERIES))
        for name, label in labels.items()
    )
    return Table("The paper's table III: averages in µs (ratio)", ("", *SERIES), rows)


def table3(found: Sequence[Cell]) -> list[Table]:
    """Table III by transport and rate, a row for each way to monitor."""
    own = [cell for cell in found if cell.experiment == TABLE3]
    made = []
    for where in dict.fromkeys(map(place, own)):
        by_name = {(c.configuration, c.series): c for c in own if place(c) == where}
        rows = tuple(
            _row(item.label, [by_name[item.name, series] for series in SERIES])
            for item in CONFIGURATIONS
            if (item.name, ROOT) in by_name
        )
        header = ("", *SERIES, "p99 / worst", "ticks", "failed", "monitors [cores]", "lag [ms]")
        deaf = [f"{c.configuration}: {c.deaf} of {c.rounds}" for c in by_name.values() if c.deaf]
        note = f"Blocks not monitored: {', '.join(dict.fromkeys(deaf))}." if deaf else ""
        made.append(Table(where, header, rows, note))
    return made


def _row(label: str, own: Sequence[Cell]) -> tuple[str, ...]:
    *_, root = own
    name = root.configuration
    # what chance does is told by the whole tick
    shown = [_cell(cell) if name != "control" or cell is root else "" for cell in own]
    return (
        label,
        *shown,
        f"{root.found.p99:,.0f} / {root.found.worst:,.0f}",
        f"{root.found.count:,}",
        str(root.failures),
        f"{root.processor:.2f}",
        _lag(root.lag_ms, None),
    )


def _cell(cell: Cell) -> str:
    if cell.configuration == NOBODY:
        return _spread(cell.found.p50)
    return f"{cell.found.p50.value:,.0f} · {_ratio(cell.ratio)}"


_TITLES = {
    "taps": "taps",
    "skills": "monitored skills",
    "rate": "rate of the tree, all monitored",
    "payload": "bytes of an answer, one tap",
}


def growth(found: Sequence[Cell]) -> Table:
    """How the cost grows; below it where the knees are."""
    rows, knees = [], []
    for line in blocks.lines(found):
        first = line[0]
        where = _NAMES[first.transport] if first.experiment == "rate" else place(first)
        title = f"{_TITLES[first.experiment]}; {where}"
        rows += [(title if point is first else "", *_point(point)) for point in line]
        if bend := blocks.knee(line):
            knees.append(f"{title}, at {_amount(bend[0])}: {bend[1]}")
    header = (
        "what grows; where",
        "to",
        "alone [µs]",
        "watched [µs]",
        "p99 [µs]",
        "ratio",
        "lag p50 / p99 [ms]",
        "watchers [cores]",
        "machine busy",
        "ticks/s",
        "failed",
    )
    return Table("Growth", header, tuple(rows), f"Knees: {'. '.join(knees) or 'none'}.")


def _point(point: Cell) -> tuple[str, ...]:
    return (
        _amount(point),
        f"{point.alone:,.0f}",
        f"{point.found.p50.value:,.0f}",
        f"{point.found.p99:,.0f}",
        _ratio(point.ratio),
        _lag(point.lag_ms, point.lag_p99_ms),
        f"{point.processor:.2f}",
        f"{point.busy:.0%}",
        f"{point.ticks_per_s:,.0f}",
        str(point.failures),
    )


def cost(found: Sequence[Cell]) -> Table:
    """What a tap costs the node that is tapped."""
    own = [cell for cell in found if cell.experiment == COST]
    rows = []
    for where, name in dict.fromkeys((place(cell), cell.configuration) for cell in own):
        by = {c.series: c for c in own if (place(c), c.configuration) == (where, name)}
        processor = by["processor"]
        rows.append(
            (
                where,
                "untapped" if name == NOBODY else "tapped",
                _spread(processor.found.p50),
                _spread(by["sent"].found.p50),
                f"{by['packets'].found.p50.value:.1f}",
                _spread(by["policy"].found.p50),
                f"{by['idle processor'].found.p50.value:,.0f}",
                f"{by['idle sent'].found.p50.value:,.0f}",
                str(processor.rounds),
                str(processor.failures),
            )
        )
    header = (
        NODE,
        "",
        "processor [µs/tick]",
        "sent [bytes/tick]",
        "packets/tick",
        "policy, processor [µs/tick]",
        "idle [µs/s]",
        "idle, sent [bytes/s]",
        "rounds",
        "failed",
    )
    return Table("Cost on the node itself", header, tuple(rows))


def as_markdown(table: Table) -> str:
    """The table, with its title where its first column has no name, and its note."""
    first, *rest = table.header
    lines = [f"| {' | '.join(row)} |" for row in ((first or table.title, *rest), *table.rows)]
    lines.insert(1, "|" + "---|" * len(table.header))
    return "\n".join([*lines, "", table.note] if table.note else lines)


def print_table(table: Table) -> None:
    """The table on a terminal."""
    import sys

    from rich.console import Console
    from rich.table import Table as Drawn

    drawn = Drawn(title=table.title, title_style="bold", title_justify="left")
    for number, name in enumerate(table.header):
        drawn.add_column(name, justify="right" if number else "left")
    for row in table.rows:
        drawn.add_row(*(cell.replace("**", "") for cell in row))
    console = Console(width=None if sys.stdout.isatty() else 200)
    console.print(drawn)
    if table.note:
        console.print(table.note, markup=False, highlight=False)
