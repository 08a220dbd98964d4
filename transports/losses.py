"""What a tap missed or could not decode, told from sequence numbers and payloads."""

from __future__ import annotations


class Losses:
    """Counts of what a tap missed or could not decode, per channel and source."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], int] = {}
        self._missed: dict[tuple[str, str], int] = {}
        self._undecodable: dict[tuple[str, str], tuple[int, str]] = {}

    def number(self, channel: str, source: str, sequence: int) -> None:
        """Take the sequence number of something heard into account.

        A number that does not go up is a restarted node, whose numbers start again.
        """
        place = (channel, source)
        last = self._last.get(place)
        self._last[place] = sequence
        if last is not None and sequence > last + 1:
            self._missed[place] = self._missed.get(place, 0) + sequence - last - 1

    def undecodable(self, channel: str, source: str, error: Exception) -> None:
        """Count a payload that could not be decoded."""
        count, first = self._undecodable.get((channel, source), (0, str(error)))
        self._undecodable[channel, source] = (count + 1, first)

    def sentences(self) -> list[str]:
        """What went wrong, one sentence for each channel and source."""
        missed = [
            f"missed {count} message{'s' * (count != 1)} on {channel} from {source or 'unknown'}"
            for (channel, source), count in sorted(self._missed.copy().items())
        ]
        undecodable = [
            f"could not decode {count} message{'s' * (count != 1)} on {channel} "
            f"from {source or 'unknown'}: {first}"
            for (channel, source), (count, first) in sorted(self._undecodable.copy().items())
        ]
        return missed + undecodable
