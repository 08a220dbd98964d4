"""Numbers of what a node publishes, from those that DDS gives to each of its publishers."""

from __future__ import annotations

from transports.ros_forms import life_of

_NUMBERS = 2**63
"""Above it, an RMW says that it does not number publications."""


class Numbers:
    """Numbers per channel and source from the numbers that each publisher counts for itself."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, bytes], int] = {}
        self._next: dict[tuple[str, str, int], int] = {}

    def number(self, channel: str, source: str, gid: bytes, published: int) -> int:
        """The number of publication ``published`` (from 1) of publisher ``gid``; -1: not known.

        Two publishers of one node (a server and a client of one service) count together, and what
        either lost is a gap. Each life of a node counts anew.
        """
        if not 0 < published < _NUMBERS:
            return -1
        last = self._last.get((channel, gid))
        place = (channel, source, life_of(gid))
        number = self._next.get(place)
        if last is not None and number is not None and published <= last:
            return max(number - 1 - (last - published), 0)  # once more, or late
        self._last[channel, gid] = published
        if number is None:
            number = published - 1
        elif last is not None and published > last:
            number += published - last - 1
        self._next[place] = number + 1
        return number
