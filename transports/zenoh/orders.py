"""The order in which a node does things: a number for each, and up to where all of them have been reported.

What a node does is numbered when it happens, and leaves later: a message when Zenoh has it, an event when it
is kept in the outbox and that is flushed. Whoever asks how far a node has reported must not get
numbers that another thread has taken and not yet used; hence each is *open* until what it stands for has left
or is kept.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import zenoh

Moment = tuple[zenoh.Timestamp, int]
"""When something happened, on the session's hybrid logical clock, and its place in all that the node reports.

A plain tuple, as it is made while somebody waits for the node: at ten ticks a second nothing of what runs
then is in the processor's caches, and each Python call takes some µs.
"""


class Orders:
    """Numbers what one node does; from any thread.

    Args:
        now: the session's clock, each time later than before.
    """

    def __init__(self, now: Callable[[], zenoh.Timestamp]) -> None:
        self._now = now
        self._lock = threading.Lock()
        self._next = 0
        self._open: dict[int, zenoh.Timestamp] = {}

    def begin(self) -> Moment:
        """Something happens now. ``end`` must follow, whatever becomes of it."""
        with self._lock:
            order = self._next
            stamp = self._open[order] = self._now()
            self._next = order + 1
        return stamp, order

    def skip(self) -> None:
        """Something happened that nobody listens to: its number is left out of what is reported."""
        with self._lock:
            self._next += 1

    def end(self, order: int) -> None:
        """What has this number has left, is in the outbox, or will never leave."""
        with self._lock:
            del self._open[order]

    def reported(self) -> Moment:
        """All that happened before this moment has a lower number, and has left or is in the outbox."""
        with self._lock:
            for order, stamp in self._open.items():  # the first is the oldest
                return stamp, order
            return self._now(), self._next

    def clock_ns(self) -> int:
        """What the session's clock shows now (ns since the epoch)."""
        return int(self._now().get_time_as_ntp64().as_nanos())
