"""One thread that runs everything: handlers of messages, requests, results and timers.

Zenoh's threads only put ``(function, argument)`` pairs into a queue (``Executor.put``); ``spin``
takes them out, one at a time. While nothing happens, it sleeps until the next
timer is due: an idle node uses no processor time.

Requests, responses and timers wait in the queue however many they are: each of them is owed an
answer. Messages of topics wait in an ``Inbox`` per subscription, which a flood cannot fill without
end: the oldest go first.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from queue import Empty
from typing import Any

from transports.interface import TransportError
from transports.timers import NS, Timer, Timers
from transports.woken import woken_by_signals
from transports.work_queue import WorkQueue

Work = tuple[Callable[[Any], None], Any]

INBOX_MESSAGES = 10_000
INBOX_BYTES = 64 * 1024 * 1024
"""What may wait in one subscription: seconds of a fast topic, some of a large one."""
REPORT_PERIOD_NS = 10 * NS
"""A flood that does not end is reported so often."""

_LOG = logging.getLogger("transports.zenoh")


def call(handler: Callable[[], None]) -> None:
    """A handler as a piece of work."""
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
        self._queue: WorkQueue[Work] = WorkQueue()
        self.put: Callable[[Work], None] = self._queue.put
        """Run ``function(argument)`` on the executor's thread; callable from any thread."""
        self._timers = Timers(time.monotonic_ns, self._run_here)
        self._spinner = threading.Lock()
        self._thread = 0
        self._closed = False

    def is_current(self) -> bool:
        """Whether the calling thread is the one that spins."""
        return threading.get_ident() == self._thread

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` on the executor's thread; callable from any thread."""
        self.put((call, handler))

    def inbox(self, channel: str, receive: Callable[[Any], None]) -> Inbox:
        """Where a subscription of ``channel`` puts its messages, for ``receive``."""
        return Inbox(channel, receive, self.put)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once."""
        return self._timers.after(delay_s, handler)

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` each ``period_s``, counted from now: lateness does not add up."""
        return self._timers.every(period_s, handler)

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
            with woken_by_signals(lambda: self.put((_nothing, None))):
                self._run(until)
        finally:
            self._thread = 0
            self._spinner.release()

    def _run(self, until: Callable[[], bool] | None) -> None:
        get, timers = self._queue.get, self._timers
        while not self._closed:
            if until is not None and until():
                return
            wait_ns = timers.wait_ns()
            if wait_ns == 0:
                due = timers.take_due()
                if due is not None:
                    due()
                continue
            try:
                function, argument = get(timeout=None if wait_ns is None else wait_ns / NS)
            except Empty:
                continue
            if wait_ns is not None:
                self._run_due(time.monotonic_ns())
            function(argument)

    def _run_due(self, until_ns: int) -> None:
        """Run what was due by ``until_ns``: who is held up does it before what came meanwhile."""
        while not self._closed and (due := self._timers.take_due(until_ns)) is not None:
            due()

    def _run_here(self, handler: Callable[[], None]) -> None:
        if self.is_current():
            handler()
        else:
            self.post(handler)
