"""What others sent to a machine, and its node is to have within a deadline."""

from __future__ import annotations

from moon.oracle.bounds import FOREVER
from moon.oracle.trace_events import TraceEvent

Place = tuple[str, str, int]
"""What was sent: two names, and the number that it has between them."""


class Expected:
    """What is on its way to one machine.

    Args:
        deadline: its node has it within this time of its stamp (ns).
        most: so much is kept; of more, nothing is said of the oldest.

    Attributes:
        events: as who sent them reports them, oldest first.
        due: when the first of them will be overdue (ns), or earlier.
    """

    __slots__ = ("_deadline", "_most", "due", "events")

    def __init__(self, deadline: int, most: int) -> None:
        self._deadline = deadline
        self._most = most
        self.events: dict[Place, TraceEvent] = {}
        self.due = FOREVER

    def add(self, place: Place, event: TraceEvent) -> None:
        """``event`` was sent."""
        self.events[place] = event
        if len(self.events) > self._most:
            del self.events[next(iter(self.events))]
        self.due = min(self.due, event.stamp + self._deadline)

    def remove(self, place: Place) -> None:
        """It has arrived, or is not waited for any more; nothing happens if it was not expected."""
        if self.events.pop(place, None) is not None and not self.events:
            self.due = FOREVER

    def overdue(self, settled: int) -> list[TraceEvent]:
        """What should have arrived by ``settled`` (ns); it is expected no more."""
        limit = settled - self._deadline
        found = {place: event for place, event in self.events.items() if event.stamp <= limit}
        for place in found:
            del self.events[place]
        stamps = (event.stamp for event in self.events.values())
        self.due = min(stamps, default=FOREVER - self._deadline) + self._deadline
        return list(found.values())

    def clear(self) -> None:
        """Nothing is expected."""
        self.events.clear()
        self.due = FOREVER
