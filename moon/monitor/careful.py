"""Properties where links are made channel by channel: what nodes did before theirs were made is not known.

Two sets of monitors are handed the same. One takes what was received for all that there was. To the other
everything may have happened before a node was linked for sure: only what is false there as well is violated.
What only the first finds false is inconclusive; what it finds true is conforming.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from moon.oracle.confirmation import UNCONFIRMED
from moon.properties.ordering import Change, OrderedProperties
from moon.properties.property import Property, Status, Verdict
from transports.interface import Observation


class CarefulProperties:
    """Monitors properties over observations that arrive late (``moon.properties.ordering``).

    Args:
        properties: what to monitor.
        latency_ns: nothing arrives later than this after its stamp.
    """

    def __init__(self, properties: Iterable[Property], latency_ns: int) -> None:
        self._properties = tuple(properties)
        self._latency_ns = latency_ns
        self._texts = {item.name: item.text or item.meaning for item in self._properties}
        self.hopeful = OrderedProperties(self._properties, latency_ns)
        """Takes what was received for all that there was."""
        self._careful: OrderedProperties | None = None

    def be_careful(self) -> None:
        """From the beginning on, something may happen that cannot be received (:meth:`may_lose`)."""
        if self._careful is None:
            self._careful = OrderedProperties(self._properties, self._latency_ns)

    @property
    def _certain(self) -> OrderedProperties:
        """By whom something is violated."""
        return self.hopeful if self._careful is None else self._careful

    def observe(self, seen: Observation) -> None:
        """Take ``seen`` in (``OrderedProperties.observe``)."""
        self.hopeful.observe(seen)
        if self._careful is not None:
            self._careful.observe(seen)

    def seal(self, until_ns: int) -> Sequence[Change]:
        """All that is stamped up to ``until_ns`` was received, or is known to be lost. Changed verdicts."""
        careful = () if self._careful is None else self._careful.seal(until_ns)
        return self._both(self.hopeful.seal(until_ns), careful)

    def lose(self, channel: str, from_ns: int, until_ns: int) -> Sequence[Change]:
        """Messages of ``channel`` stamped in ``[from_ns, until_ns)`` were lost. Changed verdicts."""
        careful = () if self._careful is None else self._careful.lose(channel, from_ns, until_ns)
        return self._both(self.hopeful.lose(channel, from_ns, until_ns), careful)

    def may_lose(self, channel: str, from_ns: int, until_ns: int) -> Sequence[Change]:
        """The same may have been, and nothing shows it. Changed verdicts."""
        careful = () if self._careful is None else self._careful.lose(channel, from_ns, until_ns)
        return self._both((), careful)

    def conclude(self, until_ns: int) -> Sequence[Change]:
        """What is false by what was received up to ``until_ns`` (``OrderedProperties.conclude``)."""
        return self._certain.conclude(until_ns)

    def withstands(self, name: str, losses: Iterable[tuple[str, int, int]]) -> bool:
        """Whether a property that is false now would be so whatever had been lost."""
        return self._certain.withstands(name, losses)

    def verdicts(self) -> dict[str, Verdict]:
        """The verdict of every property."""
        careful = self._certain.verdicts()
        return {name: self._of(name, one, careful) for name, one in self.hopeful.verdicts().items()}

    def _both(self, hopeful: Sequence[Change], careful: Sequence[Change]) -> Sequence[Change]:
        if self._careful is None:
            return hopeful
        violated = [change for change in careful if change[1].status is Status.FALSE]
        standing = {**self._careful.verdicts(), **dict(violated)}
        found = [(name, self._of(name, one, standing)) for name, one in hopeful]
        return [change for change in found if change[1].status is not Status.FALSE] + violated

    def _of(self, name: str, hopeful: Verdict, careful: dict[str, Verdict]) -> Verdict:
        if hopeful.status is not Status.FALSE or self._careful is None:
            return hopeful
        if careful[name].status is Status.FALSE:
            return careful[name]
        reason = f"{UNCONFIRMED}{self._texts[name]}"
        return Verdict(Status.INCONCLUSIVE, hopeful.since_ns, reason=reason)

    @property
    def due_ns(self) -> int:
        """Before this instant (ns) :meth:`seal` changes nothing if nothing is received."""
        return min(self.hopeful.due_ns, self._certain.due_ns)
