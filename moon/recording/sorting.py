"""Messages in the order in which they were received, where a file has them nearly so.

rosbag2 writes what it took from its caches, topic by topic: almost in order. What is further out of
it than the window is handed on late, and counted.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator

from moon.recording.stored import StoredMessage

WINDOW_NS = 1_000_000_000
MAX_HELD = 20_000
"""Messages held at once, whatever the window."""


class Sorting:
    """Sorts one stream of messages by when they were received.

    Attributes:
        late: how many messages came too late to be put in their place.
    """

    def __init__(self) -> None:
        self.late = 0

    def __call__(self, messages: Iterable[StoredMessage]) -> Iterator[StoredMessage]:
        """``messages`` in order; those of one moment in the order in which they come."""
        held: list[tuple[int, int, StoredMessage]] = []
        newest_ns = last_ns = 0
        for number, message in enumerate(messages):
            heapq.heappush(held, (message.received_ns, number, message))
            newest_ns = max(newest_ns, message.received_ns)
            while held and (held[0][0] <= newest_ns - WINDOW_NS or len(held) > MAX_HELD):
                received_ns, _, first = heapq.heappop(held)
                self.late += received_ns < last_ns
                last_ns = max(last_ns, received_ns)
                yield first
        while held:
            received_ns, _, first = heapq.heappop(held)
            self.late += received_ns < last_ns
            last_ns = max(last_ns, received_ns)
            yield first
