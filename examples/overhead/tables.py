"""What was measured as tables: the same on a terminal, in Markdown and on the page of the documentation."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

import msgspec

from examples.overhead import growth_points, node_cost, table3
from examples.overhead.load import ROOT
from examples.overhead.observers import CONFIGURATIONS
from examples.overhead.table3 import PAPER, SERIES, Cell
from examples.overhead.wording import amount, lag, micros, name_of, rate, ratio, spread


class Table(msgspec.Struct, frozen=True):
    """A table of text; ``note`` stands below it."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


WHAT = {
    "none": "1 no monitor",
    "properties": "2 properties",
    "models": "3 models",
    "both": "4 both",
}
"""The paper's configurations."""
WAYS = ("", "-websocket", "-in-process")
"""What the names of ours have behind the paper's: passive, and the two men in the middle."""


def beside_the_paper(found: Sequence[Cell]) -> list[Table]:
    """Table III with ours beside it, by transport and rate."""
    tables = []
    for transport, rate_hz in _places(found):
        by_name = {
            (c.configuration, c.series): c
            for c in found
            if (c.transport, c.rate_hz) == (transport, rate_hz)
        }
        rows = []
        for series in SERIES:
            for what, label in WHAT.items():
                paper = PAPER[series][what]
                times = paper / PAPER[series]["none"]
                cells = [
                    _cell(by_name.get((what + way, series)), is_base=what == "none") for way in WAYS
                ]
                if any(cells):
                    rows.append((series, label, f"{micros(paper)} ({times:.2f})", *cells))
        tables.append(
            Table(
                f"Table III on {name_of(transport)}, {rate(rate_hz)}",
                (
                    "skill",
                    "monitored",
                    "paper [µs] (ratio)",
                    "passive [µs]",
                    "in the middle, WebSocket [µs]",
                    "in the middle, in-process [µs]",
                ),
                tuple(rows),
                _note(by_name.get(("control", ROOT))),
            )
        )
    return tables


def _cell(cell: Cell | None, is_base: bool) -> str:
    if cell is None:
        return ""
    if is_base:
        p50 = cell.micros.p50
        return f"{micros(p50.value)} ({micros(p50.low)}–{micros(p50.high)})"
    return f"{micros(cell.micros.p50.value)} · {ratio(cell.ratio)}"


def _note(control: Cell | None) -> str:
    if control is None:
        return ""
    return (
        "Medians; after the dot, the ratio to no monitor with its interval of 95 %. No monitor against "
        f"no monitor again (what chance does): ROOT {ratio(control.ratio)}."
    )


def _places(found: Sequence[Cell]) -> list[tuple[str, float]]:
    return list(dict.fromkeys((cell.transport, cell.rate_hz) for cell in found))


def details(measured: table3.Measured, found: Sequence[Cell]) -> list[Table]:
    """Of each configuration: how much was measured, the tail, what the monitors did."""
    tables = []
    for transport, rate_hz in _places(found):
        rows = []
        for configuration in CONFIGURATIONS:
            own = [
                c
                for c in found
                if (c.transport, c.rate_hz, c.configuration)
                == (transport, rate_hz, configuration.name)
            ]
            if own:
                rows.append(_detail(measured, configuration.label, own))
        tables.append(
            Table(
                f"ROOT on {name_of(transport)}, {rate(rate_hz)}",
                (
                    "",
                    "ticks",
                    "failed",
                    "p50 [µs]",
                    "p99 [µs]",
                    "worst [µs]",
                    "ratio",
                    "monitors [cores]",
                    "lag [ms]",
                    "blocks not monitored",
                ),
                tuple(rows),
            )
        )
    return tables


def _detail(measured: table3.Measured, label: str, own: Sequence[Cell]) -> tuple[str, ...]:
    root = next(cell for cell in own if cell.series == ROOT)
    attached = [
        item
        for item in measured.attachments
        if (item.transport, item.configuration) == (root.transport, root.configuration)
    ]
    lags = [item.heard.lag_ms for item in attached if item.heard.lag_ms is not None]
    return (
        label,
        f"{root.micros.count:,}",
        str(root.failures),
        micros(root.micros.p50.value),
        micros(root.micros.p99),
        micros(root.micros.worst),
        ratio(root.ratio),
        f"{root.processor:.2f}",
        f"{statistics.median(lags):.1f}" if lags else "–",
        f"{sum(bool(item.deaf) for item in attached)} of {len(attached)}",
    )


def targets(found: Sequence[Cell]) -> Table:
    """What passive monitoring of everything may cost, and costs."""
    rows = tuple(
        (
            f"{name_of(target.transport)}, {rate(target.rate_hz)}",
            ratio(target.found),
            f"≤ {target.most:.2f}",
            "yes" if target.is_met else "**no**",
        )
        for target in table3.targets(found)
    )
    return Table(
        "Targets: everything monitored passively, ROOT", ("", "ratio", "target", "met"), rows
    )


_NAMES = {"taps": "taps", "skills": "skills", "rate": "rate", "payload": "answer"}
_TITLES = {
    "taps": "Taps",
    "skills": "Monitored skills",
    "rate": "Rate of the tree, everything monitored passively",
    "payload": "Payload, one tap",
}


def growth_tables(points: Sequence[growth_points.Point]) -> list[Table]:
    """A table by experiment, transport and rate; below it where the knee is."""
    tables = []
    for own in growth_points.series(points):
        first = own[0]
        where = "" if first.experiment == "rate" else f", {rate(first.rate_hz)}"
        bend = growth_points.knee(own)
        place = "" if bend.x is None else f" at {amount(bend.experiment, bend.x)}"
        tables.append(
            Table(
                f"{_TITLES[first.experiment]} on {name_of(first.transport)}{where}",
                (
                    _NAMES[first.experiment],
                    "alone [µs]",
                    "watched [µs]",
                    "p99 [µs]",
                    "ratio",
                    "lag p50 / p99 [ms]",
                    "watchers [cores]",
                    "machine busy",
                    "ticks/s",
                    "failed",
                ),
                tuple(_growth_row(point) for point in own),
                f"Knee{place}: {bend.why}.",
            )
        )
    return tables


def _growth_row(point: growth_points.Point) -> tuple[str, ...]:
    return (
        amount(point.experiment, point.x),
        micros(point.alone.p50.value),
        micros(point.watched.p50.value),
        micros(point.watched.p99),
        ratio(point.ratio),
        lag(point.lag_ms, point.lag_p99_ms),
        f"{point.processor:.2f}",
        f"{point.busy:.0%}",
        f"{point.ticks_per_s:,.0f}",
        str(point.failures),
    )


def cost_table(windows: Sequence[node_cost.Window]) -> Table:
    """What a tap costs the node that is tapped."""
    rows = tuple(
        (
            f"{name_of(cost.transport)}, {rate(cost.rate_hz)}",
            "tapped" if cost.tapped else "untapped",
            spread(cost.processor_us),
            spread(cost.sent),
            f"{cost.packets:.1f}",
            spread(cost.policy_us),
            micros(cost.idle_processor_us),
            micros(cost.idle_sent),
            str(cost.rounds),
            str(cost.failures),
        )
        for cost in node_cost.costs(windows)
    )
    header = (
        node_cost.NODE,
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
    return Table("Cost on the node itself", header, rows)


def as_markdown(table: Table) -> str:
    """The table with its title as bold text, and its note."""
    lines = [
        f"**{table.title}**",
        "",
        _line(table.header),
        "|" + "---|" * len(table.header),
        *(_line(row) for row in table.rows),
    ]
    if table.note:
        lines += ["", table.note]
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def print_table(table: Table) -> None:
    """The table on a terminal."""
    import sys

    from rich.console import Console
    from rich.table import Table as Drawn

    drawn = Drawn(title=table.title, title_style="bold", title_justify="left")
    for place, name in enumerate(table.header):
        drawn.add_column(name, justify="right" if place else "left")
    before = ""
    for row in table.rows:
        if table.header[0] == "skill" and before not in ("", row[0]):
            drawn.add_section()
        before = row[0]
        drawn.add_row(*(cell.replace("**", "") for cell in row))
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(drawn)
    if table.note:
        console.print(table.note, markup=False, highlight=False)
