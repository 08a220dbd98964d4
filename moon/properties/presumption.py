"""What is presumably false (RV-LTL): false, if nothing is on its way any more that was stamped earlier.

It is never reported. It tells when it is worth asking nodes how far they have reported: what they answer
makes it certain. A second set of monitors is given what was received so far, in order of stamps; when
something comes late, or was lost, it goes back to where the first set stands.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from moon.ordering.held import Held
from moon.properties.monitor import PropertySet
from moon.properties.network import NEVER
from moon.properties.property import Property, Status, Verdict
from transports.interface import Observation


class Presumption:
    """Monitors ahead of a set of monitors.

    Args:
        properties: those of the set.
    """

    def __init__(self, properties: Iterable[Property]) -> None:
        self._set = PropertySet(properties)
        self._waiting: Held[Observation] = Held()
        self._reached_ns = -1
        self._follows = False
        """Whether the monitors stand where the others will."""

    def observe(self, seen: Observation) -> None:
        """``seen`` was received."""
        if not self._follows:
            return
        if seen.stamp_ns <= self._reached_ns:
            self.stop()
        else:
            self._waiting.add(seen)

    def stop(self) -> None:
        """What was received is not all: look at the first set again before anything is presumed."""
        self._follows = False
        self._waiting.clear()

    @property
    def follows(self) -> bool:
        """Whether it runs ahead; else it begins when all that is behind is certain."""
        return self._follows

    @property
    def due_ns(self) -> int:
        """Before this instant :meth:`advance` finds nothing, if nothing is received; 0: not known."""
        if not self._follows:
            return 0
        own = self._set.next_deadline()
        due_ns = NEVER if own is None else own
        stamps = self._waiting.stamps
        return min(due_ns, stamps[0]) if stamps else due_ns

    def advance(
        self, until_ns: int, behind: PropertySet, held: Sequence[Observation]
    ) -> list[tuple[str, Verdict]]:
        """Take what was stamped up to ``until_ns`` for complete; what becomes false by that.

        Args:
            until_ns: the instant.
            behind: the monitors whose verdicts are certain; how far they are, is where to begin.
            held: what was received that they do not know yet.
        """
        if not self._follows:
            if not behind.is_certain:
                return []
            self._set.restore(behind.snapshot())
            self._set.listen_as(behind)
            self._reached_ns = behind.sealed_ns
            self._waiting = Held(held)
            self._follows = True
        if until_ns <= self._reached_ns:
            return []
        self._reached_ns = until_ns
        changes: list[tuple[str, Verdict]] = []
        for seen in self._waiting.take(self._waiting.count(until_ns)):
            changes += self._set.observe(seen)
        changes += self._set.advance(until_ns)
        return [change for change in changes if change[1].status is Status.FALSE]
