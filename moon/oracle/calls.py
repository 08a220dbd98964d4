"""Calls, as their two ends know them: one end may know less of who calls than the other."""

from __future__ import annotations

from collections.abc import Iterator

from transports.interface import NAMELESS

Call = tuple[str, int, int]
"""Who calls, the number of the call, and in which life of who calls (0 where that is not known)."""

Where = tuple[str, str]
"""What happened to a call, and on which channel."""


def is_nameless(client: str) -> bool:
    """Whether who made a call is known by its endpoint only, or not at all."""
    return not client or client.startswith(NAMELESS)


def may_be_same(one: Call, other: Call) -> bool:
    """Whether the two ends of a call may speak of the same one, as far as each knows who calls."""
    client, number, life = one
    if number != other[1] or (life != other[2] and life and other[2]):
        return False
    return client == other[0] or is_nameless(client) or is_nameless(other[0])


class KnownCalls:
    """Calls to which something happened, each with the time of that.

    Attributes:
        count: how many.
    """

    def __init__(self) -> None:
        self.count = 0
        self._calls: dict[tuple[Where, int], list[tuple[Call, int]]] = {}

    def add(self, where: Where, call: Call, stamp: int) -> None:
        """It happened to ``call`` at ``stamp`` (ns)."""
        self._calls.setdefault((where, call[1]), []).append((call, stamp))
        self.count += 1

    def has(self, where: Where, call: Call) -> bool:
        """Whether it may be ``call`` to which it happened."""
        return any(may_be_same(other, call) for other, _ in self._calls.get((where, call[1]), ()))

    def remove(self, where: Where, call: Call) -> bool:
        """Forget each that may be ``call``; whether there was one."""
        known = self._calls.get((where, call[1]))
        if known is None:
            return False
        left = [item for item in known if not may_be_same(item[0], call)]
        self.count -= len(known) - len(left)
        if left:
            self._calls[where, call[1]] = left
        else:
            del self._calls[where, call[1]]
        return len(left) < len(known)

    def oldest_ns(self) -> int:
        """When it happened to the one that was added first, about."""
        return next(iter(self._calls.values()))[0][1]

    def drop_oldest(self) -> int:
        """Forget it; when it happened (ns)."""
        key = next(iter(self._calls))
        known = self._calls[key]
        _, stamp = known.pop(0)
        if not known:
            del self._calls[key]
        self.count -= 1
        return stamp

    def items(self) -> Iterator[tuple[Where, Call, int]]:
        """What happened, to which call, and when (ns)."""
        return (
            (where, call, stamp)
            for (where, _), known in self._calls.items()
            for call, stamp in known
        )

    def clear(self) -> None:
        """Forget all."""
        self._calls.clear()
        self.count = 0
