"""Requests that others sent to a machine: whether its node received them."""

from __future__ import annotations

from moon.oracle.expected import Expected, Place
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
        expected: by channel, client and number of the call.
    """

    __slots__ = ("_deadline", "_received", "expected")

    def __init__(self, deadline: int) -> None:
        self._deadline = deadline
        self.expected = Expected(deadline, KEPT_REQUESTS)
        self._received: dict[Place, int] = {}

    def ask(self, fact: TraceEvent) -> None:
        """A request was sent."""
        channel, (client, call) = fact.observation.channel, fact.call
        place = (channel, client, call)
        if place not in self._received and (channel, "", call) not in self._received:
            self.expected.add(place, fact)

    def take(self, fact: TraceEvent, finished: int) -> None:
        """A request was received; who sent it may be heard before or after.

        A client calls one after the other: its earlier requests have had an answer, or it gave them up.

        Args:
            fact: the request.
            finished: nothing older is to come (ns).
        """
        channel, (client, call) = fact.observation.channel, fact.call
        if client.startswith(NAMELESS):  # who sent it may say its name
            client = ""
        for place in tuple(self.expected.events):
            if place[0] == channel and (
                place[2] <= call if place[1] == client else not client and place[2] == call
            ):
                self.expected.remove(place)
        received = self._received
        received[channel, client, call] = fact.stamp
        if len(received) > KEPT_CALLS:
            oldest = next(iter(received))
            if received[oldest] < finished - self._deadline:
                del received[oldest]
