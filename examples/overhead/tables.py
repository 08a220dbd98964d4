"""What was measured as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from benchmarks.page import markdown_table
from benchmarks.sampling import Estimate
from benchmarks.ticking import NAMES, WHOLE, at_rate
from examples.overhead import blocks
from examples.overhead.blocks import COST, NOBODY, PAPER, SERIES, TABLE3, Cell
from examples.overhead.node_cost import NODE
from examples.overhead.observers import CONFIGURATIONS


class Table(msgspec.Struct, frozen=True):
    """A table of text; ``note`` stands below it."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def as_markdown(table: Table) -> str:
    """The table, with its title where its first column has no name, and its note."""
    first, *rest = table.header
    text = markdown_table([(first or table.title, *rest), *table.rows])
    return f"{text}\n\n{table.note}" if table.note else text


# -- figures in words -------------------------------------------------------------------------------


def place(cell: Cell | blocks.Target) -> str:
    """A transport and a rate of ticks, as people write them."""
    return f"{NAMES[cell.transport]}, {at_rate(cell.rate_hz)}"


def _ratio(found: Estimate | None) -> str:
    return "–" if found is None else f"{found.value:.2f} ({found.low:.2f}–{found.high:.2f})"


def _spread(cell: Cell) -> str:
    p50 = cell.found.p50
    return f"{p50.value:,.0f} ({p50.low:,.0f}–{p50.high:,.0f})"


def _lag(cell: Cell) -> str:
    lags = [f"{lag:.1f}" for lag in (cell.lag_ms, cell.lag_p99_ms) if lag is not None]
    return " / ".join(lags) or "–"


def _amount(cell: Cell) -> str:
    """The place of a point in its growth, with its unit."""
    if cell.experiment == "rate":
        return at_rate(cell.rate_hz)
    if cell.experiment == "payload":
        units = (("MB", 1 << 20), ("KB", 1 << 10), ("B", 1))
        unit, size = next(item for item in units if cell.x >= item[1])
        return f"{cell.x / size:g} {unit}"
    return f"{cell.x:g}"


# -- tables -----------------------------------------------------------------------------------------


def targets(found: Sequence[Cell]) -> Table:
    """What passive monitoring of everything may cost, and costs."""
    rows = tuple(
        (place(item), _ratio(item.found), f"≤ {item.most:.2f}", "yes" if item.is_met else "**no**")
        for item in blocks.targets(found)
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


Columns = dict[str, Callable[[Cell], str]]

_TABLE3: Columns = {
    "p99 / worst": lambda cell: f"{cell.found.p99:,.0f} / {cell.found.worst:,.0f}",
    "ticks": lambda cell: f"{cell.found.count:,}",
    "failed": lambda cell: str(cell.failures),
    "monitors [cores]": lambda cell: f"{cell.processor:.2f}",
    "lag [ms]": _lag,
}
"""Of the whole tick."""


def table3(found: Sequence[Cell]) -> list[Table]:
    """Table III by transport and rate, a row for each way to monitor."""
    own = [cell for cell in found if cell.experiment == TABLE3]
    made = []
    for where in dict.fromkeys(map(place, own)):
        by_name = {(c.configuration, c.series): c for c in own if place(c) == where}
        rows = []
        for item in CONFIGURATIONS:
            if root := by_name.get((item.name, WHOLE)):
                ticks = (_tick(by_name[item.name, series]) for series in SERIES)
                rows.append((item.label, *ticks, *(show(root) for show in _TABLE3.values())))
        deaf = [f"{c.configuration}: {c.deaf} of {c.rounds}" for c in by_name.values() if c.deaf]
        note = f"Blocks not monitored: {', '.join(dict.fromkeys(deaf))}." if deaf else ""
        made.append(Table(where, ("", *SERIES, *_TABLE3), tuple(rows), note))
    return made


def _tick(cell: Cell) -> str:
    if cell.configuration == "control" and cell.series != WHOLE:
        return ""  # what chance does is told by the whole tick
    if cell.configuration == NOBODY:
        return _spread(cell)
    return f"{cell.found.p50.value:,.0f} · {_ratio(cell.ratio)}"


_TITLES = {
    "taps": "taps",
    "skills": "monitored skills",
    "rate": "rate of the tree, all monitored",
    "payload": "bytes of an answer, one tap",
}

_GROWTH: Columns = {
    "to": _amount,
    "alone [µs]": lambda cell: f"{cell.alone:,.0f}",
    "watched [µs]": lambda cell: f"{cell.found.p50.value:,.0f}",
    "p99 [µs]": lambda cell: f"{cell.found.p99:,.0f}",
    "ratio": lambda cell: _ratio(cell.ratio),
    "lag p50 / p99 [ms]": _lag,
    "watchers [cores]": lambda cell: f"{cell.processor:.2f}",
    "machine busy": lambda cell: f"{cell.busy:.0%}",
    "ticks/s": lambda cell: f"{cell.ticks_per_s:,.0f}",
    "failed": lambda cell: str(cell.failures),
}


def growth(found: Sequence[Cell]) -> Table:
    """How the cost grows; below it where the knees are."""
    rows, knees = [], []
    for line in blocks.lines(found):
        first = line[0]
        where = NAMES[first.transport] if first.experiment == "rate" else place(first)
        title = f"{_TITLES[first.experiment]}; {where}"
        for point in line:
            shown = (show(point) for show in _GROWTH.values())
            rows.append((title if point is first else "", *shown))
        if bend := blocks.knee(line):
            knees.append(f"{title}, at {_amount(bend[0])}: {bend[1]}")
    header = ("what grows; where", *_GROWTH)
    return Table("Growth", header, tuple(rows), f"Knees: {'. '.join(knees) or 'none'}.")


_COST: dict[str, tuple[str, Callable[[Cell], str]]] = {
    "processor [µs/tick]": ("processor", _spread),
    "sent [bytes/tick]": ("sent", _spread),
    "packets/tick": ("packets", lambda cell: f"{cell.found.p50.value:.1f}"),
    "policy, processor [µs/tick]": ("policy", _spread),
    "idle [µs/s]": ("idle processor", lambda cell: f"{cell.found.p50.value:,.0f}"),
    "idle, sent [bytes/s]": ("idle sent", lambda cell: f"{cell.found.p50.value:,.0f}"),
    "rounds": ("processor", lambda cell: str(cell.rounds)),
    "failed": ("processor", lambda cell: str(cell.failures)),
}
"""By column: the account that it shows, and how."""


def cost(found: Sequence[Cell]) -> Table:
    """What a tap costs the node that is tapped."""
    own = [cell for cell in found if cell.experiment == COST]
    rows = []
    for where, name in dict.fromkeys((place(cell), cell.configuration) for cell in own):
        by = {c.series: c for c in own if (place(c), c.configuration) == (where, name)}
        shown = (show(by[account]) for account, show in _COST.values())
        rows.append((where, "untapped" if name == NOBODY else "tapped", *shown))
    return Table("Cost on the node itself", (NODE, "", *_COST), tuple(rows))
