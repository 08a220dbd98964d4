"""Sequence numbers: they show what was received twice, and what was not received.

Whoever publishes or calls numbers what it sends on each channel, from 0. This is the one rule by which all
read such numbers; what follows from it is each reader's own.
"""

from __future__ import annotations

from collections.abc import Hashable
from enum import Enum


class Sequel(Enum):
    """How a number follows the one before it, of the same source on the same channel."""

    FIRST = 0
    """Nothing was received before; whether that is a loss, if it is not 0, the number does not tell."""
    NEXT = 1
    AGAIN = 2
    """It was received before, or comes late: it is nothing new."""
    AFTER_A_GAP = 3
    """The numbers in between were not received."""
    ANEW = 4
    """Its source has started again, and numbers anew: what it sent last, before that, may be missing."""


_NEXT = Sequel.NEXT
"""Looking up a member of an Enum takes as long as all else that is done for the next number."""

Last = tuple[int, int]
"""The newest number of a place, and its stamp in ns."""


def sequel_of(last: Last | None, number: int, stamp_ns: int) -> Sequel:
    """How ``number`` follows.

    A number that does not go up is one that was received before, or a late one, if its stamp is not newer;
    else it is a restarted node's.

    Args:
        last: what it follows; None: it is the first.
        number: the sequence number, from 0.
        stamp_ns: when it was sent, ns since the epoch.
    """
    if last is None:
        return Sequel.FIRST
    before, before_ns = last
    if number == before + 1:
        return Sequel.NEXT
    if number > before:
        return Sequel.AFTER_A_GAP
    return Sequel.AGAIN if stamp_ns <= before_ns else Sequel.ANEW


class Sequences:
    """The newest number of each place: of whatever is numbered together, as a source's messages on a channel.

    Args:
        most: places that are remembered; their names come from the wire, and never end. The one that was
            received first is forgotten first.

    Attributes:
        last: by place.
        complete: whether none was forgotten; if one was, it is FIRST once more.
    """

    __slots__ = ("complete", "last", "most")

    def __init__(self, most: int) -> None:
        self.most = most
        self.last: dict[Hashable, Last] = {}
        self.complete = True

    def follow(self, place: Hashable, number: int, stamp_ns: int) -> tuple[Sequel, Last | None]:
        """How ``number`` follows, and what; it is the newest of its place now, unless it came AGAIN.

        Args:
            place: what it counts.
            number: from 0.
            stamp_ns: when it was sent, ns since the epoch.
        """
        kept = self.last
        last = kept.get(place)
        if last is not None and number == last[0] + 1:  # nearly always; the rest is rare
            kept[place] = number, stamp_ns
            return _NEXT, last
        sequel = sequel_of(last, number, stamp_ns)
        if sequel is not Sequel.AGAIN:
            if last is None and len(kept) >= self.most:
                del kept[next(iter(kept))]
                self.complete = False
            kept[place] = number, stamp_ns
        return sequel, last
