"""Violations that wait for proof that no observation is missing (decision 11)."""

from __future__ import annotations

from collections.abc import Iterable

from moon.oracle.lanes import Count, Place
from moon.verdict import Verdict

KEPT_SUSPICIONS = 16
"""More of them are not kept; the oldest go."""


class Losses:
    """What the oracles of one tap know of it. ``happen``: observations have been lost."""

    def __init__(self, happen: bool = False) -> None:
        self.happen = happen


class Suspicions:
    """Verdicts that are true if nothing was lost."""

    def __init__(self) -> None:
        self.kept: list[tuple[Verdict, dict[Place, int]]] = []
        """Each with the number that has to come next at each place."""

    def add(self, verdict: Verdict, counts: Iterable[Count]) -> None:
        """``verdict`` holds if what comes next at each of ``counts`` has the number that follows."""
        self.kept.append((verdict, {c.place: c.next for c in counts if c.next >= 0}))
        del self.kept[:-KEPT_SUSPICIONS]

    def hear(self, place: Place, number: int, stamp: int) -> list[Verdict]:
        """An observation's number clears its place of having lost what a suspicion hangs on.

        What happened before the suspicion and is heard only now was missing: it was no violation.

        Returns:
            The verdicts that are proven by now.
        """
        proven = []
        for suspicion in tuple(self.kept):
            verdict, open_places = suspicion
            if place not in open_places:
                continue
            if number != open_places[place] or stamp <= verdict.stamp_ns:
                self.kept.remove(suspicion)
                continue
            del open_places[place]
            if not open_places:
                self.kept.remove(suspicion)
                proven.append(verdict)
        return proven
