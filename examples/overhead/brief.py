"""Three lines for the end of the demo: a fast part of the comparison, with what a plain install has."""

from __future__ import annotations

from examples.overhead import table3
from examples.overhead.load import ROOT
from examples.overhead.observers import CONFIGURATIONS

PLAN = table3.Plan(rounds=1, ticks={20.0: 25}, settle=20, warm_up=5, run_in=50)
NAMES = ("none", "both", "models-in-process")
"""Without the WebSocket, whose libraries a plain install does not have."""


def three_lines() -> list[str]:
    """Measure on Zenoh (12 s) and say it."""
    chosen = [item for item in CONFIGURATIONS if item.name in NAMES]
    measured = table3.measure("zenoh", PLAN, lambda _: None, chosen)
    return lines(measured)


def lines(measured: table3.Measured) -> list[str]:
    """What the demo says of ``measured``; what could not be measured is said as well."""
    found = {cell.configuration: cell for cell in table3.cells(measured) if cell.series == ROOT}
    none, both, middle = (found[name] for name in NAMES)
    paper = table3.PAPER[ROOT]
    failed = sum(cell.failures for cell in found.values())
    doubts = [f"{failed} ticks failed"] if failed else []
    doubts += [f"{item.configuration}: {item.deaf}" for item in measured.attachments if item.deaf]
    doubt = f" ({'; '.join(doubts)})" if doubts else ""
    return [
        f"a tick of four skills: {none.micros.p50.value:,.0f} µs, with all of it monitored passively "
        f"{both.micros.p50.value:,.0f} µs ({both.ratio.value:.2f} times){doubt}",
        f"by a monitor in the middle of each call, the best we could write: "
        f"{middle.micros.p50.value:,.0f} µs ({middle.ratio.value:.2f} times)",
        f"by the paper's, on its machine: {paper['none']:,} µs without, {paper['both']:,} µs with "
        f"({paper['both'] / paper['none']:.1f} times)",
    ]
