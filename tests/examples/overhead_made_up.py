"""A run of the overhead comparison that nobody made: few rounds, and figures that one can foresee."""

from __future__ import annotations

import functools
from typing import Any

import msgspec

from benchmarks.ticking import WHOLE
from examples.overhead import results
from examples.overhead.blocks import SERIES, Block
from examples.overhead.machine import this_machine

ACCOUNTS = {
    "processor": 500.0,
    "sent": 300.0,
    "packets": 2.0,
    "policy": 900.0,
    "idle processor": 100.0,
    "idle sent": 90.0,
}


def run(x: float, micros: float, number: int = 0, **fields: Any) -> Block:
    """A block of growth against the number of taps."""
    who = "tap" if x else "none"
    made = Block("taps", "zenoh", 10.0, x, who, number, {WHOLE: [micros] * 20}, {WHOLE: 0})
    return msgspec.structs.replace(
        made, **{"processor": 0.1, "busy": 0.3, "ticks_per_s": 10.0, **fields}
    )


@functools.cache
def made_up() -> results.Results:
    """Two rounds of no monitor, its control, and two ways to monitor."""
    cost = {"none": 100.0, "control": 101.0, "both": 104.0, "both-websocket": 300.0}
    table = tuple(
        Block(
            "table3",
            "zenoh",
            rate_hz,
            0.0,
            name,
            number,
            {series: [micros, micros * 1.02, micros * 0.98] for series in SERIES},
            {series: int(name == "both-websocket") for series in SERIES},
            processor=0.1,
            busy=0.5,
            ticks_per_s=rate_hz or 200.0,
            lag_ms=2.5,
        )
        for rate_hz in (10.0, 0.0)
        for number in range(2)
        for name, micros in cost.items()
    )
    accounts = tuple(
        Block("cost", "zenoh", 10.0, 0.0, who, number, {k: [v] for k, v in ACCOUNTS.items()}, {})
        for who in ("none", "tap")
        for number in range(2)
    )
    return results.Results(
        this_machine(is_awake=True),
        "python -m examples.overhead --quick",
        "2026-01-01 12:00",
        1.0,
        (*table, run(0, 100.0), run(1, 120.0), *accounts),
    )
