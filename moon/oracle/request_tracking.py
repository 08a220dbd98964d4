"""Requests that others sent to a machine: whether its node received them."""

from __future__ import annotations

from moon.oracle.bounds import FOREVER
from moon.oracle.trace_events import TraceEvent
from transports.interface import NAMELESS

KEPT_CALLS = 256
"""Requests received whose sending was not heard yet."""
KEPT_REQUESTS = 1024
"""Requests sent that were not received yet. Of more, nothing is said of the oldest."""


class RequestTracking:
    """Requests on their way to one machine.

    Args:
        deadline: a request is received within this time (ns).

    Attributes:
        due: when one that is known will be overdue (ns), or earlier.
    """

    __slots__ = ("_asked", "_deadline", "_taken", "due")

    def __init__(self, deadline: int) -> None:
        self._deadline = deadline
        self._asked: dict[tuple[str, str, int], TraceEvent] = {}
        self._taken: dict[tuple[str, str, int], int] = {}
        self.due = FOREVER

    def ask(self, fact: TraceEvent) -> None:
        """A request was sent."""
        channel, (client, call) = fact.observation.channel, fact.call
        place = (channel, client, call)
        if place not in self._taken and (channel, "", call) not in self._taken:
            self._asked[place] = fact
            if len(self._asked) > KEPT_REQUESTS:
                del self._asked[next(iter(self._asked))]
            self.due = min(self.due, fact.stamp + self._deadline)

    def take(self, fact: TraceEvent, finished: int) -> None:
        """A request was received; who sent it may be heard before or after.

        Args:
            fact: the request.
            finished: nothing older is to come (ns).
        """
        channel, (client, call) = fact.observation.channel, fact.call
        if client.startswith(NAMELESS):  # who sent it may say its name
            for other in [p for p in self._asked if p[0] == channel and p[2] == call]:
                del self._asked[other]
            client = ""
        place = (channel, client, call)
        # a client calls one after the other: its earlier requests have had an answer, or it gave them up
        before = [p for p in self._asked if p[0] == channel and p[1] == client and p[2] <= call]
        for other in before:
            del self._asked[other]
        if before and not self._asked:
            self.due = FOREVER
        taken = self._taken
        taken[place] = fact.stamp
        if len(taken) > KEPT_CALLS:
            oldest = next(iter(taken))
            if taken[oldest] < finished - self._deadline:
                del taken[oldest]

    def overdue(self, settled: int) -> list[TraceEvent]:
        """Those that should have been received by ``settled`` (ns); they are forgotten."""
        limit = settled - self._deadline
        found = {place: fact for place, fact in self._asked.items() if fact.stamp <= limit}
        for place in found:
            del self._asked[place]
        stamps = (fact.stamp for fact in self._asked.values())
        self.due = min(stamps, default=FOREVER - self._deadline) + self._deadline
        return list(found.values())

    def clear(self) -> None:
        """Forget what is on its way."""
        self._asked.clear()
        self.due = FOREVER
