"""A run of the overhead comparison that nobody made: few rounds, and figures that one can foresee."""

from __future__ import annotations

import functools

import msgspec

from examples.overhead import growth_points, node_cost, results, table3
from examples.overhead.machine import this_machine
from examples.overhead.observers import Heard


def run(
    x: float, watchers: int, micros: float, number: int = 0, **fields: float
) -> growth_points.Run:
    """A block of growth against the number of taps."""
    made = growth_points.Run(
        "taps", "zenoh", 10.0, x, number, watchers, [micros] * 20, 0, (), 10.0, 0.1, 0.3
    )
    return msgspec.structs.replace(made, **fields)


@functools.cache
def made_up() -> results.Results:
    """Two rounds of no monitor, its control, and two ways to monitor."""
    cost = {"none": 100.0, "control": 101.0, "both": 104.0, "both-websocket": 300.0}
    blocks = tuple(
        table3.Block(
            "zenoh",
            rate_hz,
            name,
            number,
            {series: [micros, micros * 1.02, micros * 0.98] for series in table3.SERIES},
            {series: int(name == "both-websocket") for series in table3.SERIES},
            (),
            0.1,
            0.5,
            rate_hz or 200.0,
        )
        for rate_hz in (10.0, 0.0)
        for number in range(2)
        for name, micros in cost.items()
    )
    attachments = tuple(
        table3.Attachment("zenoh", name, number, Heard(100, 0, 5, 2.5), "")
        for number in range(2)
        for name in cost
    )
    windows = tuple(
        node_cost.Window("zenoh", 10.0, tapped, number, 500.0, 300.0, 2.0, 900.0, 100.0, 90.0, 0)
        for tapped in (False, True)
        for number in range(2)
    )
    return results.Results(
        this_machine(is_awake=True),
        "python -m examples.overhead --quick",
        "2026-01-01 12:00",
        1.0,
        table3.Measured(blocks, attachments),
        (run(0, 0, 100.0), run(1, 1, 120.0)),
        windows,
    )
