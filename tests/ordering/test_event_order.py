"""When judging begins."""

from __future__ import annotations

from typing import Any

import pytest

from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from moon.ordering.counts import Counts
from moon.ordering.event_order import EventOrder
from moon.ordering.reception import Reception

MS = 1_000_000
LATENCY_NS = 200 * MS


class Clocks:
    """Two that go on together, and what the judges are told."""

    def __init__(self) -> None:
        self.passed_ns = 0
        self.anew: list[str] = []

    def now_ns(self) -> int:
        return 10**18 + self.passed_ns

    def monotonic_ns(self) -> int:
        return self.passed_ns

    def start_anew(self, from_ns: int, since_ns: int, was_set_back: bool, why: str) -> None:
        self.anew.append(why)

    def gap(self, gap: Any) -> None:
        raise AssertionError(gap)


class Tap:
    def take_dropped(self) -> tuple[()]:
        return ()


def made(clocks: Clocks) -> EventOrder:
    counts = Counts()
    library = InterfaceLibrary.load([], DiagnosticLog())
    reception = Reception((), library, LATENCY_NS, counts)
    return EventOrder(
        clocks.now_ns, clocks.monotonic_ns, LATENCY_NS, 0.0, reception, counts, clocks
    )


@pytest.mark.parametrize("later_ms", [1, 80, 150, 5000])
def test_judging_that_begins_later_than_it_was_made_sees_no_clock_that_was_set(
    later_ms: int,
) -> None:
    clocks = Clocks()
    order = made(clocks)
    clocks.passed_ns += later_ms * MS
    listener: Any = Tap()
    assert order.start(listener) == clocks.now_ns()
    for _ in range(20):
        clocks.passed_ns += 20 * MS
        order.look_at_clock(*order.read_clocks())
        order.tick(clocks.now_ns(), clocks.monotonic_ns())
    assert clocks.anew == []


def test_what_was_received_before_judging_begins_counts_if_all_was() -> None:
    clocks = Clocks()
    order = made(clocks)
    since_ns = clocks.now_ns()
    clocks.passed_ns += 5000 * MS
    listener: Any = Tap()
    assert order.start(listener, since_ns) == order.since_ns == since_ns
