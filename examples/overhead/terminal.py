"""What was measured, on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.table import Table

from examples.overhead import growth, table3
from examples.overhead.observers import CONFIGURATIONS
from examples.overhead.wording import amount, lag, micros, rate, ratio


def console() -> Console:
    """Wide enough for the table where the width is not a terminal's."""
    return Console(width=None if sys.stdout.isatty() else 150)


def show(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """One table; all columns but the first are numbers."""
    table = Table(title=title, title_style="bold", title_justify="left")
    for place, name in enumerate(header):
        table.add_column(name, justify="right" if place else "left")
    for row in rows:
        table.add_row(*row)
    console().print(table)


def print_table3(measured: table3.Measured) -> None:
    """Table III by transport and rate, and what failed."""
    found = table3.cells(measured)
    for transport, rate_hz in dict.fromkeys((c.transport, c.rate_hz) for c in found):
        title = f"Tick times [µs] on {transport}, {rate(rate_hz)}: median / p99, and ratio to no monitor"
        rows = []
        for configuration in CONFIGURATIONS:
            own = [
                cell
                for cell in found
                if (cell.transport, cell.rate_hz, cell.configuration)
                == (transport, rate_hz, configuration.name)
            ]
            if own:
                values = [
                    f"{micros(c.micros.p50.value)} / {micros(c.micros.p99)}\n{ratio(c.ratio)}"
                    for c in own
                ]
                failed = sum(c.failures for c in own)
                rows.append([configuration.label, *values, f"{failed}"])
        show(title, ["", *table3.SERIES, "failed"], rows)
    for attachment in measured.attachments:
        if attachment.deaf:
            print(f"round {attachment.round + 1}, {attachment.configuration}: {attachment.deaf}")


GROWTH_HEADER = (
    "taps / skills / rate / bytes",
    "alone p50 [µs]",
    "watched p50 / p99 [µs]",
    "ratio",
    "lag p50 / p99 [ms]",
    "watchers [cores]",
    "machine busy",
    "ticks/s",
    "failed",
)


def growth_row(point: growth.Point) -> list[str]:
    """One point as a row."""
    return [
        amount(point.experiment, point.x),
        micros(point.alone.p50.value),
        f"{micros(point.watched.p50.value)} / {micros(point.watched.p99)}",
        ratio(point.ratio),
        lag(point.lag_ms, point.lag_p99_ms),
        f"{point.processor:.2f}",
        f"{point.busy:.0%}",
        f"{point.ticks_per_s:,.0f}",
        str(point.failures),
    ]


def growth_title(first: growth.Point) -> str:
    """What a series of points is about."""
    names = {
        "taps": "Taps",
        "skills": "Monitored skills",
        "rate": "Ticks a second, everything monitored",
        "payload": "Payload, tapped",
    }
    where = "" if first.experiment == "rate" else f", {rate(first.rate_hz)}"
    return f"{names[first.experiment]} on {first.transport}{where}"


def print_growth(runs: Sequence[growth.Run]) -> None:
    """A table by experiment, transport and rate, and where its knee is."""
    for own in growth.series(growth.points(runs)):
        show(growth_title(own[0]), GROWTH_HEADER, map(growth_row, own))
        found = growth.knee(own)
        where = "" if found.x is None else f" at {amount(found.experiment, found.x)}"
        print(f"knee{where}: {found.why}\n")
