"""What a tap does not know, as it is recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from moon.recording.entries import Missed
from moon.tap.notices import Standing
from transports.interface import BlindSpot


class Misses:
    """Records what a tap says of itself, each sentence once.

    Args:
        record: takes the entries.

    Attributes:
        blind_spots: what was not known at the last look.
    """

    def __init__(self, record: Callable[[Missed], None]) -> None:
        self._record = record
        self.blind_spots: Mapping[BlindSpot, str] = {}
        self._standing = Standing()
        self._noted: frozenset[str] = frozenset()

    def look_at_blind_spots(self, blind_spots: Mapping[BlindSpot, str], now_ns: int) -> None:
        """``blind_spots`` is so at ``now_ns``."""
        before, self.blind_spots = self.blind_spots, dict(blind_spots)
        for spot in sorted({*before, *blind_spots}):
            if before.get(spot) != (why := blind_spots.get(spot, "")):
                self._record(Missed(now_ns, why, spot.channel, spot.node, spot.kind))

    def look_at_problems(self, problems: Sequence[str], now_ns: int) -> None:
        """``problems`` is what ``Tap.problems`` says at ``now_ns``; it has what is not received, too."""
        standing = self._standing.look(problems)
        for text in standing:
            if text not in self._noted and text not in self.blind_spots.values():
                self._record(Missed(now_ns, text))
        self._noted = frozenset(standing)
