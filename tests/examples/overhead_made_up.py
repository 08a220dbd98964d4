"""A run of the overhead comparison that nobody made: few rounds, and figures that one can foresee."""

from __future__ import annotations

import functools

from examples.overhead import results
from examples.overhead.blocks import SERIES, Block
from examples.overhead.machine import described


@functools.cache
def made_up() -> results.Results:
    """Two rounds of no monitor, its control, and two ways to monitor."""
    cost = {"none": 100.0, "control": 101.0, "both": 104.0, "both-websocket": 300.0}
    blocks = tuple(
        Block(
            "zenoh",
            rate_hz,
            name,
            number,
            {series: [micros, micros * 1.02, micros * 0.98] for series in SERIES},
            {series: int(name == "both-websocket") for series in SERIES},
            processor=0.1,
            lag_ms=2.5,
        )
        for rate_hz in (10.0, 0.0)
        for number in range(2)
        for name, micros in cost.items()
    )
    command = "python -m examples.overhead --quick"
    return results.Results(described(is_awake=True), 0.5, command, "2026-01-01 12:00", 1.0, blocks)
