"""Sequence numbers of what sources send on channels: what was received twice, and what was not received.

What a number means is described in :mod:`transports.sequences`; here each is kept once for all judges.
"""

from __future__ import annotations

from collections.abc import Iterable

from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel, Sequence

KEPT_PLACES = 10_000
"""Places that are remembered; their names come from the wire, and never end."""

NONE = -2
"""No number, and not one that is missing either (-1)."""

Place = tuple[str, str, bool]
"""Source, channel, and whether it is a message: what is numbered together."""

_MESSAGE = ObservationKind.MESSAGE


class Count:
    """The last number of a place.

    Attributes:
        place: which.
        sequence: what has come.
        unknown_until: what came before this was not received (ns), where the first number was not 0.
        left_at: the number that should have followed when nothing more was known of any.
    """

    __slots__ = ("left_at", "place", "sequence", "unknown_until")

    def __init__(self, place: Place) -> None:
        self.place = place
        self.sequence = Sequence()
        self.unknown_until = 0
        self.left_at = NONE

    @property
    def next(self) -> int:
        """The number that should follow; negative while none has come."""
        return self.sequence.next

    @property
    def stamp(self) -> int:
        """Of the newest, ns."""
        return self.sequence.stamp

    def sequel(self, number: int, stamp: int, life: int = 0) -> Sequel:
        """How ``number`` follows; it is the newest from now on, unless it came before, or comes late."""
        sequel = self.sequence.follow(number, stamp, life)
        if sequel is Sequel.FIRST:
            self.unknown_until = stamp if number > 0 else 0
        elif sequel is Sequel.ANEW:
            self.unknown_until = stamp  # its source's last ones may be missing
        return sequel


class Numbers:
    """The newest number of each place.

    Args:
        known: sources whose places are kept when there are too many; the oldest of others go.
        most: so many places are kept.
    """

    def __init__(self, known: Iterable[str] = (), most: int = KEPT_PLACES) -> None:
        self._known = frozenset(known)
        self._most = most
        self.counts: dict[Place, Count] = {}

    def of(self, seen: Observation) -> Count:
        """The numbers among which that of ``seen`` is."""
        place = (seen.source, seen.channel, seen.kind is _MESSAGE)
        return self.counts.get(place) or self.add(place)

    def add(self, place: Place) -> Count:
        """The numbers of ``place``, perhaps new."""
        counts = self.counts
        count = counts.get(place)
        if count is not None:
            return count
        count = Count(place)
        if len(counts) >= self._most:
            oldest = next((other for other in counts if other[0] not in self._known), None)
            if oldest is None:
                return count  # each of its numbers is a first one
            del counts[oldest]
        counts[place] = count
        return count

    def clear(self) -> None:
        """Something is not known to be received, of any source: each number is a first one again."""
        for count in self.counts.values():
            count.left_at = count.next
            count.sequence.forget()
            count.unknown_until = 0

    def forget(self, source: str, before_ns: int | None = None) -> None:
        """``source`` numbers anew; what is stamped ``before_ns`` or later is of after that."""
        for count in self.counts.values():
            if count.place[0] == source and (before_ns is None or count.stamp < before_ns):
                count.left_at = NONE
                count.sequence.end_life()
                count.unknown_until = 0
