"""Timers of an executor: a heap by due time, on whatever clock the executor runs by."""

from __future__ import annotations

import functools
import heapq
import itertools
from collections.abc import Callable

from transports.interface import TransportError

NS = 1_000_000_000
"""A second."""

_SWEEP = 64
"""So many timers are kept before cancelled ones are looked for."""


def period_ns(period_s: float) -> int:
    """The period of a timer in ns.

    Raises:
        TransportError: it is not positive: the timer would do nothing else.
    """
    period = round(period_s * NS)
    if period <= 0:
        raise TransportError(f"a timer's period must be positive, not {period_s} s")
    return period


class Timer:
    """A timer; ``period_ns`` 0 means once."""

    __slots__ = ("cancelled", "due_ns", "handler", "period_ns")

    def __init__(self, due_ns: int, period_ns: int, handler: Callable[[], None]) -> None:
        self.due_ns = due_ns
        self.period_ns = period_ns
        self.handler: Callable[[], None] | None = handler
        self.cancelled = False

    def cancel(self) -> None:
        """Stop it; idempotent, from any thread."""
        self.cancelled = True
        self.handler = None


class Timers:
    """The timers of one executor on one clock; only its thread touches the heap.

    Args:
        clock_ns: what time it is; only differences mean something.
        run: runs something on the executor's thread: at once on that thread, soon from another.
    """

    def __init__(
        self, clock_ns: Callable[[], int], run: Callable[[Callable[[], None]], None]
    ) -> None:
        self._clock_ns = clock_ns
        self._run = run
        self._heap: list[tuple[int, int, Timer]] = []
        self._sweep_at = _SWEEP
        self._count = itertools.count()

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once; from any thread."""
        return self._start(Timer(self._clock_ns() + round(delay_s * NS), 0, handler))

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` each ``period_s``, counted from now: lateness does not add up. From any thread.

        Times that are over before the executor begins to run are skipped.

        Raises:
            TransportError: the period is not positive.
        """
        period = period_ns(period_s)
        timer = Timer(self._clock_ns() + period, period, handler)
        self._run(functools.partial(self._push_ahead, timer))
        return timer

    def wait_ns(self) -> int | None:
        """How long until the next is due, on this clock; None if none runs."""
        heap = self._heap
        while heap and heap[0][2].cancelled:
            heapq.heappop(heap)
        return max(heap[0][0] - self._clock_ns(), 0) if heap else None

    def take_due(self, until_ns: int | None = None) -> Callable[[], None] | None:
        """The handler of a timer that is due (by ``until_ns``, or now), started again if it is periodic."""
        heap = self._heap
        while heap and heap[0][0] <= (self._clock_ns() if until_ns is None else until_ns):
            timer = heapq.heappop(heap)[2]
            handler = timer.handler
            if handler is None:
                continue
            if timer.period_ns:
                timer.due_ns += timer.period_ns
                self._push_ahead(timer)
            return handler
        return None

    def shift(self, by_ns: int) -> None:
        """Move every due time: the clock was set."""
        for _, _, timer in self._heap:
            timer.due_ns += by_ns
        self._heap = [(timer.due_ns, order, timer) for _, order, timer in self._heap]

    def _start(self, timer: Timer) -> Timer:
        self._run(functools.partial(self._push, timer))
        return timer

    def _push_ahead(self, timer: Timer) -> None:
        """Keep a periodic timer. Times that were slept through are skipped, the phase is kept.

        If the clock was set before the executor began to run, it is due within a period of now all the same.
        """
        behind_ns = self._clock_ns() - timer.due_ns
        if behind_ns > 0 or behind_ns < -timer.period_ns:
            timer.due_ns += (behind_ns // timer.period_ns + 1) * timer.period_ns
        self._push(timer)

    def _push(self, timer: Timer) -> None:
        if len(self._heap) >= self._sweep_at:  # answered calls leave their timers behind
            self._heap[:] = [entry for entry in self._heap if not entry[2].cancelled]
            heapq.heapify(self._heap)
            self._sweep_at = 2 * len(self._heap) + _SWEEP
        heapq.heappush(self._heap, (timer.due_ns, next(self._count), timer))
