"""Sequence numbers of what sources send on channels: what was received twice, and what was not received.

What a number means is described in :mod:`transports.sequences`; here each is kept once for all judges.
"""

from __future__ import annotations

from collections.abc import Iterable

from transports.interface import Observation, ObservationKind
from transports.sequences import Sequence

KEPT_PLACES = 10_000
"""Places that are remembered; their names come from the wire, and never end."""

Place = tuple[str, str, bool]
"""Source, channel, and whether it is a message: what is numbered together."""

_MESSAGE = ObservationKind.MESSAGE


def goes_on(found: Iterable[int], following: int) -> int | None:
    """The number that follows ``found``, if these go on from ``following`` without a gap; else None.

    Those before ``following`` were received.
    """
    new = {number for number in found if number >= following}
    after = following + len(new)
    return after if not new or max(new) == after - 1 else None


class Numbers:
    """The newest number of each place.

    Args:
        known: sources whose places are kept when there are too many; the oldest of others go.
        most: so many places are kept.
    """

    def __init__(self, known: Iterable[str] = (), most: int = KEPT_PLACES) -> None:
        self._known = frozenset(known)
        self._most = most
        self.counts: dict[Place, Sequence] = {}

    def of(self, seen: Observation) -> Sequence:
        """The numbers among which that of ``seen`` is."""
        place = (seen.source, seen.channel, seen.kind is _MESSAGE)
        return self.counts.get(place) or self.add(place)

    def add(self, place: Place) -> Sequence:
        """The numbers of ``place``, perhaps new."""
        counts = self.counts
        count = counts.get(place)
        if count is not None:
            return count
        count = Sequence()
        if len(counts) >= self._most:
            oldest = next((other for other in counts if other[0] not in self._known), None)
            if oldest is None:
                return count  # each of its numbers is a first one
            del counts[oldest]
        counts[place] = count
        return count

    def are_next(self, seen: Iterable[Observation]) -> bool:
        """Whether the numbers of these observations follow those of before, and each other, without a gap.

        Of a place of which nothing was received, its source's own numbers tell, or the first is 0.
        """
        numbers: dict[Place, set[int]] = {}
        for one in seen:
            if one.sequence < 0:
                continue
            place = (one.source, one.channel, one.kind is _MESSAGE)
            count = self.counts.get(place)
            is_known = count is not None and count.next >= 0
            if is_known and count is not None and count.life != one.life:
                return False
            if is_known or one.order < 0:
                numbers.setdefault(place, set()).add(one.sequence)
        for place, found in numbers.items():
            count = self.counts.get(place)
            if goes_on(found, max(count.next, 0) if count is not None else 0) is None:
                return False
        return True

    def clear(self) -> None:
        """Something is not known to be received, of any source: each number is a first one again."""
        for sequence in self.counts.values():
            sequence.forget()

    def forget(self, source: str, before_ns: int | None = None) -> None:
        """``source`` numbers anew; what is stamped ``before_ns`` or later is of after that."""
        for place, sequence in self.counts.items():
            if place[0] == source and (before_ns is None or sequence.stamp < before_ns):
                sequence.end_life()
