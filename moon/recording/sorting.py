"""Messages in the order in which they were received, where a file has them nearly so.

rosbag2 writes what it took from its caches, topic by topic: almost in order. What is further out of it
than the window is handed on late, and counted. On one topic messages are in order: where one is clearly
not, the recorder's clock was set back, and nothing after that is mixed with what was before.
"""

from __future__ import annotations

import heapq
from collections.abc import Hashable, Iterable, Iterator
from typing import Protocol, TypeVar

from moon.recording.entries import makes_sense

WINDOW_NS = 1_000_000_000
MAX_HELD = 20_000
"""Messages held at once, whatever the window."""
MAX_CHANNELS = 100_000
"""Of so many it is known when their last message was received."""
JITTER_NS = 200_000_000
"""Two messages of one topic may be written the other way round if they are as close as the latency bound."""


class Received(Protocol):
    """What was received on a channel, at some time."""

    @property
    def channel(self) -> Hashable:
        """Where."""
        ...

    @property
    def received_ns(self) -> int:
        """When."""
        ...


T = TypeVar("T", bound=Received)


class Sorting:
    """Sorts one stream of messages by when they were received.

    Attributes:
        late: how many messages came too late to be put in their place.
        set_back: how often time goes back within one channel.
    """

    def __init__(self) -> None:
        self.late = 0
        self.set_back = 0

    def __call__(self, messages: Iterable[T]) -> Iterator[T]:
        """``messages`` in order; those of one moment in the order in which they come."""
        held: list[tuple[int, int, T]] = []
        newest_ns = last_ns = 0
        last_of: dict[Hashable, int] = {}
        for number, message in enumerate(messages):
            received_ns = message.received_ns
            if not makes_sense(received_ns):
                received_ns = newest_ns  # it stays where it stands
            elif received_ns < last_of.get(message.channel, 0) - JITTER_NS:
                self.set_back += 1
                while held:
                    yield heapq.heappop(held)[2]
                newest_ns = last_ns = 0
                last_of.clear()
            if len(last_of) < MAX_CHANNELS:
                last_of[message.channel] = received_ns
            heapq.heappush(held, (received_ns, number, message))
            newest_ns = max(newest_ns, received_ns)
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
