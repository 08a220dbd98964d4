"""The timers of an executor."""

from __future__ import annotations

from collections.abc import Callable

from transports.timers import NS, Timers


def test_a_period_is_counted_from_when_the_executor_runs_and_a_delay_from_when_it_was_asked_for() -> (
    None
):
    posted: list[Callable[[], None]] = []
    now_ns = 0
    timers = Timers(lambda: now_ns, posted.append)
    fired: list[str] = []
    timers.every(1.0, lambda: fired.append("period"))
    timers.after(1.0, lambda: fired.append("delay"))
    now_ns = 5 * NS  # the node waits for who observes it
    for work in posted:
        work()
    while due := timers.take_due():
        due()
    assert fired == ["delay"]
    assert timers.wait_ns() == NS
