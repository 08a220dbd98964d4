"""Two numbers in the 32 bits that an MCAP record has for one.

An observation has a number among those of its source and channel, and on some transports one among all
that its source tells. Both go up by one or a little more, so 16 bits of each tell the rest, as long as
no more than 32 767 in a row are missing. The writer does what a reader will do, and what would be read
wrongly (a node that has started again) is kept whole.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

from transports.interface import Observation, ObservationKind

MAX_PLACES = 65_536
"""Sources and channels whose numbers are kept; names come from the wire, and never end."""
_BITS = 16
_RANGE = 1 << _BITS
_MASK = _RANGE - 1
_HALF = _RANGE >> 1


class Numbering(StrEnum):
    """What the number in an MCAP record is."""

    NONE = "none"
    """Nothing: there is none."""
    SEQUENCE = "sequence"
    """The observation's ``sequence``, and one more: 0 is no number in MCAP."""
    BOTH = "order,sequence"
    """The lower 16 bits of its ``order``, then those of its ``sequence``."""


def numbering_of(seen: Observation) -> Numbering | None:
    """How the numbers of ``seen`` are kept; None if they cannot be."""
    if seen.order < 0:
        return Numbering.SEQUENCE if seen.sequence >= 0 else Numbering.NONE
    return Numbering.BOTH if seen.sequence >= 0 else None


class Numbers:
    """The last numbers of each source: the same for who writes a recording and who reads it."""

    def __init__(self) -> None:
        self._sequences: dict[tuple[str, str, bool], int] = {}
        self._orders: dict[str, int] = {}

    def pack(self, seen: Observation) -> int:
        """Both numbers of ``seen`` in 32 bits; -1 if a reader would not find them again."""
        bits = (seen.order & _MASK) << _BITS | seen.sequence & _MASK
        place = (seen.source, seen.channel, seen.kind is ObservationKind.MESSAGE)
        if self._unpacked(place, bits) != (seen.sequence, seen.order):
            return -1
        self._keep(place, seen.sequence, seen.order)
        return bits

    def unpacker(
        self, source: str, channel: str, is_message: bool
    ) -> Callable[[int], tuple[int, int]]:
        """From the bits of the next observation of this place to its ``(sequence, order)``."""
        place = (source, channel, is_message)
        sequences, orders = self._sequences, self._orders

        def unpack(bits: int) -> tuple[int, int]:
            last, before = sequences.get(place), orders.get(source)
            if last is None or before is None:
                sequence, order = self._unpacked(place, bits)
                self._keep(place, sequence, order)
            else:  # the same, where both are kept: nearly always
                sequence = sequences[place] = last + ((bits & _MASK) - last & _MASK)
                order = before + ((bits >> _BITS) - before + _HALF & _MASK) - _HALF
                orders[source] = order
            return sequence, order

        return unpack

    def note(self, seen: Observation) -> None:
        """``seen`` is kept whole."""
        if seen.order >= 0 and seen.sequence >= 0:
            place = (seen.source, seen.channel, seen.kind is ObservationKind.MESSAGE)
            self._keep(place, seen.sequence, seen.order)

    def _unpacked(self, place: tuple[str, str, bool], bits: int) -> tuple[int, int]:
        sequence, order = bits & _MASK, bits >> _BITS
        last = self._sequences.get(place)
        if last is not None:
            sequence = last + (sequence - last & _MASK)
        last = self._orders.get(place[0])
        if last is not None:
            order = last + (order - last + _HALF & _MASK) - _HALF
        return sequence, order

    def _keep(self, place: tuple[str, str, bool], sequence: int, order: int) -> None:
        if place in self._sequences or len(self._sequences) < MAX_PLACES:
            self._sequences[place] = sequence
        if place[0] in self._orders or len(self._orders) < MAX_PLACES:
            self._orders[place[0]] = order
