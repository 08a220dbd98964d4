"""The timers of an executor."""

from __future__ import annotations

from collections.abc import Callable

from transports.timers import NS, Timers


def test_a_period_is_counted_from_when_it_was_asked_for_and_what_was_over_before_is_skipped() -> (
    None
):
    posted: list[Callable[[], None]] = []
    now_ns = 0
    timers = Timers(lambda: now_ns, posted.append)
    fired: list[str] = []
    timers.every(1.0, lambda: fired.append("first"))
    now_ns = NS // 4
    timers.every(1.0, lambda: fired.append("second"))
    timers.after(1.0, lambda: fired.append("delay"))
    now_ns = 5 * NS + NS // 2  # the node waits for who observes it
    for work in posted:
        work()
    while due := timers.take_due():
        due()
    assert fired == ["delay"]
    assert timers.wait_ns() == NS // 2
    now_ns = 6 * NS + NS // 4 - 1
    while due := timers.take_due():
        due()
    assert fired == ["delay", "first"]  # timers of several nodes do not ring together for that
    assert timers.wait_ns() == 1


def test_a_period_that_is_not_over_as_the_executor_begins_is_kept() -> None:
    posted: list[Callable[[], None]] = []
    now_ns = 0
    timers = Timers(lambda: now_ns, posted.append)
    timers.every(1.0, lambda: None)
    now_ns = NS // 4
    for work in posted:
        work()
    assert timers.wait_ns() == 3 * NS // 4


def test_a_clock_that_is_set_back_before_the_executor_begins_delays_no_period() -> None:
    posted: list[Callable[[], None]] = []
    now_ns = 3600 * NS
    timers = Timers(lambda: now_ns, posted.append)
    timers.every(1.0, lambda: None)
    now_ns = NS // 4
    for work in posted:
        work()
    assert timers.wait_ns() == 3 * NS // 4
