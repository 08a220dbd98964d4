"""How machines and properties stood in the course of a recording, as bands of time."""

from __future__ import annotations

from moon.offline.result import Band, Timeline
from moon.recording.entries import Entry
from moon.run import Run
from moon.sources.played import Player
from transports.interface import Observation

MAX_BANDS = 20_000
"""Bands of one machine; when there are more, neighbours are joined, the shortest first half of them."""
_SHORTEST_NS = 1_000
"""A page counts microseconds: a shorter band has no length there."""
_LOOK_NS = 100_000_000
"""How often machines are looked at when nothing is received."""


class _Growing:
    """The timeline of one machine as it grows."""

    __slots__ = ("bands", "kind", "merged", "since_ns", "states", "verdict")

    def __init__(self, kind: str, since_ns: int, states: tuple[str, ...], verdict: str) -> None:
        self.kind = kind
        self.since_ns = since_ns
        self.states = states
        self.verdict = verdict
        self.bands: list[Band] = []
        self.merged = 0

    def change(self, now_ns: int, states: tuple[str, ...], verdict: str) -> None:
        self.end(now_ns)
        self.since_ns, self.states, self.verdict = now_ns, states, verdict

    def end(self, now_ns: int) -> None:
        if now_ns > self.since_ns:
            self.bands.append(Band(self.since_ns, now_ns, self.states, self.verdict))
            if len(self.bands) > MAX_BANDS:
                self._thin()

    def _thin(self) -> None:
        """Join neighbours two by two, so that half as many are left."""
        joined = [
            _joined(one, other)
            for one, other in zip(self.bands[::2], self.bands[1::2], strict=False)
        ]
        self.merged += len(joined)
        self.bands = joined + self.bands[2 * len(joined) :]


_GRAVITY = ("violated", "inconclusive", "conforming")


def _joined(one: Band, other: Band) -> Band:
    """One band for two: the states of both, and the graver verdict."""
    states = one.states + tuple(state for state in other.states if state not in one.states)
    verdicts = (one.verdict, other.verdict)
    verdict = next((word for word in _GRAVITY if word in verdicts), one.verdict)
    return Band(one.start_ns, other.end_ns, states, verdict)


class Timelines:
    """Looks at a watch as it is handed what was recorded.

    Args:
        watch: whose machines are looked at.
        player: what hands it on, for the time.
    """

    def __init__(self, watch: Run, player: Player) -> None:
        self._watch = watch
        self._player = player
        self._growing: dict[tuple[str, str], _Growing] = {}
        self._looked_ns = 0

    def look(self, entry: Entry) -> None:
        """``entry`` was handed to the watch."""
        now_ns = self._player.now_ns()
        if isinstance(entry, Observation) or now_ns - self._looked_ns >= _LOOK_NS:
            self._look(now_ns)

    def _look(self, now_ns: int) -> None:
        self._looked_ns = now_ns
        for name, kind, verdict, states in self._watch.standings():
            known = self._growing.get((name, kind))
            if known is None:
                self._growing[name, kind] = _Growing(kind, now_ns, states, verdict)
            elif known.verdict != verdict or known.states != states:
                known.change(now_ns, states, verdict)

    def finished(self, end_ns: int) -> tuple[Timeline, ...]:
        """All timelines; the recording ends at ``end_ns``.

        They go on for as long as the watch did: what is false at a deadline after the last message is
        false in the last band, if only for :data:`_SHORTEST_NS`.
        """
        end_ns = max(end_ns, self._player.now_ns())
        self._look(end_ns)
        for growing in self._growing.values():
            growing.end(max(end_ns, growing.since_ns + _SHORTEST_NS))
        return tuple(
            Timeline(name, growing.kind, tuple(growing.bands), growing.merged)
            for (name, _), growing in self._growing.items()
        )
