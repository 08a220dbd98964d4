"""What a tap has taken and its executor has not handled yet."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Collection
from typing import NamedTuple

from transports.refusals import shown
from transports.zenoh.wire import Sent

MOST_WAITING_BYTES = 64 * 1024 * 1024
"""What waits for a slow reader, as much as in a node's own subscription (``executor.INBOX_BYTES``)."""
_OVERHEAD_BYTES = 512
"""What a message takes beside its payload, in Python: so at most twice ``RING_CAPACITY`` wait."""


class Arrived(NamedTuple):
    """A message as it came, none of it Zenoh's any more (which would keep the 64 KB that it came in)."""

    channel: str
    suffix: str
    sent: Sent
    encoding: str
    payload: bytes
    stamp_ns: int
    received_ns: int
    life: int = 0


class Waiting:
    """Batches of messages that wait for the executor, bounded in bytes; from any thread.

    When there is no room the oldest go. But one channel has half of the room at most, and what comes on it
    beyond that is dropped: a flood on it costs what is on it, and not what the others have said.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._batches: deque[list[Arrived]] = deque()
        self._bytes: Counter[str] = Counter()
        """What waits, by channel; only those of which something does."""
        self._total = 0
        self._is_taking = False
        self.offered = 0
        """Batches that were kept so far."""
        self.gone = 0
        """Those that were taken or dropped."""
        self._dropped: Counter[str] = Counter()
        self._dropped_bytes = 0
        self._to_report: set[tuple[str, str]] = set()

    def offer(self, batch: list[Arrived]) -> bool:
        """Keep ``batch``; whether somebody must be woken to take it."""
        kept: list[Arrived] = []
        with self._lock:
            for arrived in batch:
                size = size_of(arrived)
                if self._bytes[arrived.channel] + size > MOST_WAITING_BYTES // 2 and self._total:
                    self._count(arrived, size)
                    continue
                while self._batches and self._total + size > MOST_WAITING_BYTES:
                    self.gone += 1
                    for oldest in self._batches.popleft():
                        self._count(oldest, self._release(oldest))
                self._bytes[arrived.channel] += size
                self._total += size
                kept.append(arrived)
            if not kept:
                return False
            self._batches.append(kept)
            self.offered += 1
            is_new, self._is_taking = not self._is_taking, True
            return is_new

    def take(self) -> tuple[list[Arrived], bool]:
        """The oldest batch, and whether there are more."""
        with self._lock:
            batch = self._batches.popleft()
            self.gone += 1
            for arrived in batch:
                self._release(arrived)
            self._is_taking = bool(self._batches)
            return batch, self._is_taking

    def _release(self, arrived: Arrived) -> int:
        size = size_of(arrived)
        self._total -= size
        left = self._bytes[arrived.channel] - size
        if left:
            self._bytes[arrived.channel] = left
        else:
            del self._bytes[arrived.channel]
        return size

    def _count(self, arrived: Arrived, size: int) -> None:
        self._dropped[arrived.channel] += 1
        self._dropped_bytes += size
        self._to_report.add((arrived.channel, arrived.sent.node))

    def take_dropped(self) -> Collection[tuple[str, str]]:
        """Channel and source of what was dropped since this was last asked."""
        if not self._to_report:
            return ()
        with self._lock:
            dropped, self._to_report = self._to_report, set()
        return dropped

    def sentences(self) -> list[str]:
        """What was dropped."""
        with self._lock:
            if not self._dropped:
                return []
            channel, most = self._dropped.most_common(1)[0]
            total = sum(self._dropped.values())
            return [
                f"dropped {total} message{'s' * (total != 1)} ({self._dropped_bytes / 1e6:.1f} MB): they "
                f"come faster than they are handled, {most} of them on {shown(channel)}"
            ]


def size_of(arrived: Arrived) -> int:
    """How much of the room it takes, in bytes."""
    return len(arrived.payload) + _OVERHEAD_BYTES
