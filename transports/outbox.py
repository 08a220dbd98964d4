"""When a node tells its taps what it did: all at once, and when nobody waits for it.

What is published alone costs Zenoh 100 µs of processor time (DDS 60 to 300), what is published right behind
it 5 (DDS 15): each burst wakes the sender's threads and the tap's, and the kernel in between. On few
processors that time is taken from whoever is at work, so it is also a matter of when: events that leave
while a tree is being ticked delay the tick. Hence one burst for all services of a node, not before the tick
that the events are of is likely to be over, and not while the node itself is at work.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

Item = TypeVar("Item")

DELAY_S = 0.0035
"""How long what is told first waits at least: as long as a tick of a few skills, one after the other, takes
where nobody else is at work. (At 4 ms a monitor on a busy machine was 5.1 ms behind; it should not be 5.)"""
QUIET_S = 0.002
"""For how long a node must have told nothing: longer than between two calls of a policy."""
AT_MOST_S = 0.012
"""How long anything waits where a node is never quiet, and how long it is at least from one burst to the
next: half of the 25 ms that a monitor allows for at least (``moon.monitor.patience.LEAST_NS``)."""

CALLER_S = AT_MOST_S - QUIET_S
"""How long what a thread tells waits that calls one service after the other: looking earlier whether it has
done so would only hold it up, as the executor's thread takes turns with it."""


class Clockwork(Protocol):
    """What an outbox needs of an executor."""

    def after(self, delay_s: float, handler: Callable[[], None]) -> object:
        """See ``Transport.after``."""
        ...


class Outbox(Generic[Item]):
    """What a node has yet to tell, in order.

    Args:
        executor: the node's, which flushes.
        publish: tells one item; called by one thread at a time, in the order of ``add``.
        clock: monotonic, in seconds.
        delay_s: how long what is told first waits at least.
    """

    def __init__(
        self,
        executor: Clockwork,
        publish: Callable[[Item], None],
        clock: Callable[[], float] = time.monotonic,
        delay_s: float = DELAY_S,
    ) -> None:
        self._delay_s = delay_s
        self._executor = executor
        self._publish = publish
        self._clock = clock
        self._pending: deque[Item] = deque()
        self.add: Callable[[Item], None] = self._pending.append
        """Keep an item; from any thread. ``flush_later`` or ``flush`` has it told."""
        self._lock = threading.Lock()
        """Held while items are published: they leave in order, whoever flushes."""
        self._scheduled = False
        self._closed = False
        self._first_s = self._last_s = 0.0
        self._burst_s = -AT_MOST_S

    def flush_later(self, delay_s: float = 0.0) -> None:
        """Tell what is kept when the node is quiet; from any thread.

        Args:
            delay_s: how long what is told first waits at least, if longer than usual.
        """
        self._last_s = now_s = self._clock()
        if not self._scheduled:
            self._scheduled = True
            self._first_s = now_s
            wait_s = max(self._delay_s, delay_s, self._burst_s + AT_MOST_S - now_s)
            self._executor.after(wait_s, self._look)

    def _look(self) -> None:
        wait_s = min(self._last_s + QUIET_S, self._first_s + AT_MOST_S) - self._clock()
        if wait_s > 0 and self._pending:
            self._executor.after(wait_s, self._look)
        else:
            self._burst_s = self._clock()
            self._scheduled = False  # before looking: what is kept from now on schedules again
            self.flush()

    def flush(self) -> None:
        """Tell what is kept, now; from any thread."""
        pending, publish = self._pending, self._publish
        with self._lock:
            while pending and not self._closed:
                publish(pending.popleft())

    def close(self) -> None:
        """Tell what is kept, and nothing after it; idempotent."""
        self.flush()
        with self._lock:
            self._closed = True
            self._pending.clear()
