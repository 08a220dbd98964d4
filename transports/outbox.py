"""When a node reports to its taps what it did: all of it in one burst, between ticks (decision 15).

Each burst wakes the sender's threads, the kernel and the tap's threads; what is published right behind other
things costs a fraction of what it costs alone. On few processors that time is taken from whoever is at work:
events that leave while a tree is being ticked delay the tick. Hence a node publishes one burst for all its
services, not before the tick that the events are of is likely to be over, and not while it is at work itself.
Who ticks the tree knows when the tick is over. Where it can say so (``Transport.tick_complete``), all nodes
report then.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from transports.interface import Timer

Item = TypeVar("Item")

DELAY_S = 0.0025
"""How long the first item of a burst waits at least, unless the end of a round is waited for: a monitor
should not be more than 5 ms behind, and needs half of that itself."""
QUIET_S = 0.002
"""For how long a node must have kept nothing new: longer than between two calls of a policy."""
AT_MOST_S = 0.012
"""How long anything waits where a node is seldom at work, and how long it is at least from one burst to the
next."""
IN_A_ROW = 3
"""A node that so often had something to report again within ``AT_MOST_S`` of a burst is at work all the time,
not only in the middle of a tick."""
GROWTH = 1.5
"""By how much its bursts get rarer each time."""
SELDOM_S = 0.05
"""How rare they get: a quarter of the latency that is allowed for by default."""

NEAR_S = 0.0055
"""A node that usually begins to work at most so long before the end of a round waits for the end of the next,
at most for ``AT_MOST_S``: what it reports does not hold up the tick then. The others do not wait, as what
they did would be judged too late (decision 15)."""
NEAR_PART = 0.025
"""The same as a part of the time from one round to the next, at most ``AT_MOST_S``; the longer of the two
counts. A system that ticks seldom has longer ticks, as caches are cold, and can wait a fortieth of a period
for its verdicts."""
SHARE = 0.25
"""What the last round counts for in how long before the end a node usually begins: one that is longer than
the others is not to change everything."""
ROUND_S = 0.1
"""What the node did longer ago was not of this round."""
ROUNDS_S = 5.0
"""For how long a node that received the end of a round expects to receive that of the next."""

CALLER_S = AT_MOST_S - QUIET_S
"""How long events wait of a thread that calls one service after the other. To look earlier whether it is done
would only hold it up, as the executor's thread takes turns with it."""


class Clockwork(Protocol):
    """What an outbox needs of an executor."""

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.after``."""
        ...


class Outbox(Generic[Item]):
    """What a node has yet to publish, in order.

    Args:
        executor: the node's, which flushes.
        publish: publishes one item; called by one thread at a time, in the order of ``add``.
        clock: monotonic, in seconds.
        delay_s: how long the first item of a burst waits at least.
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
        """Keep an item; from any thread. ``flush_later`` or ``flush`` has it published."""
        self.publishing = threading.Lock()
        """Held while items are published: they leave in order, whoever flushes. Who ends what publishes
        some of them, and is not alone, holds it, too."""
        self._scheduled = False
        self._timer: Timer | None = None
        self._closed = False
        self._first_s = self._last_s = 0.0
        self._burst_s = -AT_MOST_S
        self._apart_s = AT_MOST_S
        """How long it is from one burst to the next at present."""
        self._in_a_row = 0
        self._began_s = -math.inf
        """When the node began to work in the round that goes on, if it has."""
        self._over_s = math.inf
        """When the last round was over, if there was one."""
        self._usual_s: float | None = None
        """How long before the end of a round the node usually begins to work."""
        self._expected_until_s = 0.0
        """How long the end of a round is waited for."""

    def flush_later(self, delay_s: float = 0.0) -> None:
        """Publish what is kept when the node is quiet; from any thread.

        Args:
            delay_s: how long the first item of a burst waits at least, if longer than usual.
        """
        self._last_s = now_s = self._clock()
        if now_s - self._began_s > ROUND_S:
            self._began_s = now_s
        if not self._scheduled:
            self._scheduled = True
            self._first_s = now_s
            self._set_apart(now_s)
            least_s = AT_MOST_S if now_s < self._expected_until_s else self._delay_s
            wait_s = max(least_s, delay_s, self._burst_s + self._apart_s - now_s)
            self._timer = self._executor.after(wait_s, self._look)

    def _set_apart(self, now_s: float) -> None:
        if now_s >= self._burst_s + AT_MOST_S:
            self._in_a_row, self._apart_s = 0, AT_MOST_S
        elif self._in_a_row < IN_A_ROW:
            self._in_a_row += 1
        else:
            self._apart_s = min(GROWTH * self._apart_s, SELDOM_S)

    def _look(self) -> None:
        wait_s = min(self._last_s + QUIET_S, self._first_s + AT_MOST_S) - self._clock()
        if wait_s > 0 and self._pending:
            self._timer = self._executor.after(wait_s, self._look)
        else:
            self._burst()

    def _burst(self) -> None:
        self._burst_s = self._clock()
        self._scheduled = False  # before looking: what is kept from now on schedules again
        self.flush()

    def note_round(self) -> bool:
        """A round of calls is over; whether ``tick_complete`` has something to publish. From any thread."""
        now_s = self._clock()
        before_s, apart_s = now_s - self._began_s, now_s - self._over_s
        self._began_s, self._over_s = -math.inf, now_s
        if before_s <= ROUND_S:
            if self._usual_s is None:
                self._usual_s = before_s
            self._usual_s += SHARE * (before_s - self._usual_s)
            is_near = self._usual_s <= max(NEAR_S, min(NEAR_PART * apart_s, AT_MOST_S))
            self._expected_until_s = now_s + ROUNDS_S if is_near else 0.0
        return self._scheduled and now_s >= self._burst_s + AT_MOST_S

    def tick_complete(self) -> None:
        """Publish what is kept, as nobody waits now; from any thread."""
        if not self._scheduled:
            return
        if self._timer is not None:
            self._timer.cancel()
        self._burst()

    def flush(self) -> None:
        """Publish what is kept, now; from any thread."""
        pending, publish = self._pending, self._publish
        with self.publishing:
            while pending and not self._closed:
                publish(pending.popleft())

    def close(self) -> None:
        """Publish what is kept, and nothing after it; idempotent."""
        self.flush()
        with self.publishing:
            self._closed = True
            self._pending.clear()
