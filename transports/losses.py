"""What a tap missed or could not decode, by sequence numbers and payloads."""

from __future__ import annotations

from collections.abc import Mapping

from transports.bounded import BoundedDict
from transports.sequences import Sequel, Sequence

KEPT_PLACES = 10_000
"""Channels and sources that are distinguished; their names come from the wire, and never end."""

_AFTER_A_GAP, _LATE = Sequel.AFTER_A_GAP, Sequel.LATE

_Place = tuple[str, str]
"""Channel and source."""


_Kept = Mapping[_Place, object]


class Losses:
    """Counts of what a tap missed or could not decode, per channel and source."""

    def __init__(self) -> None:
        self._sequences: BoundedDict[_Place, Sequence] = BoundedDict(KEPT_PLACES)
        self._missed: dict[_Place, int] = {}
        self._undecodable: dict[_Place, tuple[int, str]] = {}
        self._elsewhere = 0
        """What was missed or not decoded on channels or from sources of which no more can be kept."""

    def number(
        self, channel: str, source: str, sequence: int, stamp_ns: int, life: int = 0
    ) -> None:
        """Take the sequence number of something received into account."""
        place = (channel, source)
        numbers = self._sequences.get(place)
        if numbers is None:
            numbers = self._sequences[place] = Sequence()
        following = numbers.next
        sequel = numbers.follow(sequence, stamp_ns, life)
        if sequel is _LATE and (missed := self._missed.pop(place, 0)) > 1:
            self._missed[place] = missed - 1
        if sequel is _AFTER_A_GAP:
            missed = sequence - following
            if self._has_room(self._missed, place, missed):
                self._missed[place] = self._missed.get(place, 0) + missed

    def undecodable(self, channel: str, source: str, error: Exception) -> None:
        """Count a payload that could not be decoded."""
        if self._has_room(self._undecodable, (channel, source), 1):
            count, first = self._undecodable.get((channel, source), (0, str(error)))
            self._undecodable[channel, source] = (count + 1, first)

    def _has_room(self, kept: _Kept, place: _Place, count: int) -> bool:
        """Whether ``place`` is, or can be, one of ``kept``; else ``count`` is counted elsewhere."""
        if place in kept or len(kept) < KEPT_PLACES:
            return True
        self._elsewhere += count
        return False

    def sentences(self) -> list[str]:
        """What went wrong, one sentence for each channel and source."""
        missed = [
            f"missed {_messages(count)} on {channel} from {source or 'unknown'}"
            for (channel, source), count in sorted(self._missed.copy().items())
        ]
        undecodable = [
            f"could not decode {_messages(count)} on {channel} from {source or 'unknown'}: {first}"
            for (channel, source), (count, first) in sorted(self._undecodable.copy().items())
        ]
        elsewhere = [
            f"missed or could not decode {_messages(self._elsewhere)} of yet other sources"
        ]
        return missed + undecodable + elsewhere[: self._elsewhere]


def _messages(count: int) -> str:
    return f"{count} message{'s' * (count != 1)}"
