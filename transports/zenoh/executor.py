"""One thread that runs everything: handlers of messages, requests, results and timers.

Zenoh's threads only put ``(function, argument)`` pairs into a queue (``Executor.put``); ``spin``
takes them out, one at a time. While nothing happens, it sleeps in ``queue.get`` until the next
timer is due: an idle node uses no processor time.

Requests, responses and timers wait in the queue however many they are: each of them is owed an
answer. Messages of topics wait in an ``Inbox`` per subscription, which a flood cannot fill without
end: the oldest go first.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from transports.interface import TransportError

Work = tuple[Callable[[Any], None], Any]

_NS = 1_000_000_000

_SWEEP = 64
"""So many timers are kept before cancelled ones are looked for."""

INBOX_MESSAGES = 10_000
INBOX_BYTES = 64 * 1024 * 1024
"""What may wait in one subscription: seconds of a fast topic, some of a large one."""
REPORT_PERIOD_NS = 10 * _NS
"""A flood that does not end is reported so often."""

_LOG = logging.getLogger("transports.zenoh")


class Timer:
    """A timer of the executor; ``period_ns`` 0 means once."""

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


def _call(handler: Callable[[], None]) -> None:
    handler()


def _nothing(_: object) -> None:
    """Wakes the executor."""


class Inbox:
    """The messages of one subscription that wait for the executor.

    Args:
        channel: the topic, for the report.
        receive: called with each message, on the executor.
        put: the executor's queue.
    """

    def __init__(
        self, channel: str, receive: Callable[[Any], None], put: Callable[[Work], None]
    ) -> None:
        self._channel = channel
        self._receive = receive
        self._put = put
        self._lock = threading.Lock()
        self._waiting: deque[tuple[Any, int]] = deque()
        self._bytes = 0
        self._turns = 0  # how often `_take` stands in the queue: at least once for each message
        self._dropped = 0
        self._report_ns = 0
        self.dropped = 0
        """Messages that were dropped so far."""

    def offer(self, message: Any, size: int) -> None:
        """Have ``message``, of ``size`` bytes, received; from any thread.

        Those that have waited longest are dropped for it if there is no room.
        """
        with self._lock:
            waiting = self._waiting
            while waiting and (len(waiting) >= INBOX_MESSAGES or self._bytes + size > INBOX_BYTES):
                self._bytes -= waiting.popleft()[1]
                self._dropped += 1
            waiting.append((message, size))
            self._bytes += size
            if self._turns >= len(waiting):
                return
            self._turns += 1
        self._put((self._take, None))

    def _take(self, _: object) -> None:
        with self._lock:
            self._turns -= 1
            if not self._waiting:
                return
            message, size = self._waiting.popleft()
            self._bytes -= size
            dropped = self._to_report() if self._dropped else 0
        if dropped:
            _LOG.warning(
                "%s: dropped %d message%s, the oldest: they arrive faster than they are handled",
                self._channel,
                dropped,
                "" if dropped == 1 else "s",
            )
        self._receive(message)

    def _to_report(self) -> int:
        """What was dropped: once when the burst is over, and now and then while it is not."""
        now_ns = time.monotonic_ns()
        self._report_ns = self._report_ns or now_ns + REPORT_PERIOD_NS
        if self._waiting and now_ns < self._report_ns:
            return 0
        dropped, self._dropped, self._report_ns = self._dropped, 0, 0
        self.dropped += dropped
        return dropped


class Executor:
    """A work queue and a heap of timers, served by the thread that spins."""

    def __init__(self) -> None:
        self._queue: SimpleQueue[Work] = SimpleQueue()
        self.put: Callable[[Work], None] = self._queue.put
        """Run ``function(argument)`` on the executor's thread; callable from any thread."""
        self._heap: list[tuple[int, int, Timer]] = []
        self._sweep_at = _SWEEP
        self._count = itertools.count()
        self._spinner = threading.Lock()
        self._thread = 0
        self._closed = False

    def is_current(self) -> bool:
        """Whether the calling thread is the one that spins."""
        return threading.get_ident() == self._thread

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` on the executor's thread; callable from any thread."""
        self.put((_call, handler))

    def inbox(self, channel: str, receive: Callable[[Any], None]) -> Inbox:
        """Where a subscription of ``channel`` puts its messages, for ``receive``."""
        return Inbox(channel, receive, self.put)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once."""
        return self._start(Timer(time.monotonic_ns() + int(delay_s * _NS), 0, handler))

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` each ``period_s``, counted from now: lateness does not add up."""
        period_ns = int(period_s * _NS)
        if period_ns <= 0:
            raise TransportError(f"a timer's period must be positive, not {period_s} s")
        return self._start(Timer(time.monotonic_ns() + period_ns, period_ns, handler))

    def close(self) -> None:
        """End ``spin``; idempotent, from any thread."""
        self._closed = True
        self.put((_nothing, None))

    def spin(self, until: Callable[[], bool] | None = None) -> None:
        """Run work and timers until ``close()`` or until ``until()`` holds.

        ``until`` is asked before each piece of work; ``post`` something to have it asked.
        """
        if not self._spinner.acquire(blocking=False):
            raise TransportError("this transport is already spinning on another thread")
        self._thread = threading.get_ident()
        try:
            self._run(until)
        finally:
            self._thread = 0
            self._spinner.release()

    def _run(self, until: Callable[[], bool] | None) -> None:
        get, heap = self._queue.get, self._heap
        while not self._closed:
            if until is not None and until():
                return
            if not heap:
                function, argument = get()
                function(argument)
                continue
            wait_ns = heap[0][0] - time.monotonic_ns()
            if wait_ns <= 0:
                self._fire()
                continue
            try:
                function, argument = get(timeout=wait_ns / _NS)
            except Empty:
                continue
            function(argument)

    def _start(self, timer: Timer) -> Timer:
        if self.is_current():
            self._push(timer)
        else:
            self.put((self._push, timer))
        return timer

    def _push(self, timer: Timer) -> None:
        if len(self._heap) >= self._sweep_at:  # answered calls leave their timers behind
            self._heap[:] = [entry for entry in self._heap if not entry[2].cancelled]
            heapq.heapify(self._heap)
            self._sweep_at = 2 * len(self._heap) + _SWEEP
        heapq.heappush(self._heap, (timer.due_ns, next(self._count), timer))

    def _fire(self) -> None:
        timer = heapq.heappop(self._heap)[2]
        handler = timer.handler
        if handler is None:
            return
        if timer.period_ns:
            timer.due_ns += timer.period_ns
            behind_ns = time.monotonic_ns() - timer.due_ns
            if behind_ns > 0:  # ticks that were slept through are skipped, the phase is kept
                timer.due_ns += (behind_ns // timer.period_ns + 1) * timer.period_ns
            self._push(timer)
        handler()


class Completion:
    """A value that one thread waits for and another delivers."""

    def __init__(self) -> None:
        self._ready = threading.Event()
        self._lock = threading.Lock()
        self._value: Any = None

    def set(self, value: Any) -> None:
        """Deliver ``value``; only the first delivery counts."""
        with self._lock:
            if not self._ready.is_set():
                self._value = value
                self._ready.set()

    def wait(self, timeout_s: float) -> Any:
        """The value, or None after ``timeout_s`` seconds."""
        self._ready.wait(timeout_s)
        return self._value
