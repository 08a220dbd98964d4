"""A queue that one thread waits on, for no longer than it says.

``queue.SimpleQueue`` does not keep that: on CPython 3.11 and 3.12 ``get(timeout=…)`` waits for ever if its
deadline passes between two of its looks at the clock, as it then waits for a negative time. That takes a
timeout of some nanoseconds, or a thread that is taken off the processor at that moment. A lock's ``acquire``
does keep its timeout, so here a lock is the bell. Nothing else in this project waits on a queue.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from queue import Empty
from typing import Generic, TypeVar

T = TypeVar("T")


class WorkQueue(Generic[T]):
    """What any thread puts, and one thread takes, in order; a signal's handler may put, too."""

    __slots__ = ("_bell", "_items")

    def __init__(self) -> None:
        self._items: deque[T] = deque()
        self._bell = threading.Lock()
        """Free: it rings. Who waits takes it."""
        self._bell.acquire()

    def put(self, item: T) -> None:
        """Have ``item`` taken."""
        self._items.append(item)
        if self._bell.locked():
            try:
                self._bell.release()
            except RuntimeError:
                return  # somebody else has rung meanwhile

    def get(self, timeout: float | None = None) -> T:
        """Take the oldest item; wait for it, at most ``timeout`` seconds (None: for ever).

        Raises:
            Empty: there was none.
        """
        items, bell = self._items, self._bell
        if timeout is None:
            while not items:
                bell.acquire()
            return items.popleft()
        if items:
            return items.popleft()
        deadline_s = time.monotonic() + timeout
        while not items:
            left_s = min(max(deadline_s - time.monotonic(), 0.0), threading.TIMEOUT_MAX)
            if not bell.acquire(timeout=left_s) and not items:
                raise Empty
        return items.popleft()

    def empty(self) -> bool:
        """Whether nothing waits."""
        return not self._items
