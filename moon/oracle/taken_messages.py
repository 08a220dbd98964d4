"""Messages of topics, where the machine's node reports which of them it took, and when.

A node that reports that (``ObservationKind.MESSAGE_TAKEN``) orders all that its machine does: a message is an
input at the moment at which it was taken, as a request is. Its contents come from its publisher. Until the
node's first such report, and for publishers that do not number their messages, a message was taken at some
time within the latency bound.
"""

from __future__ import annotations

from moon.oracle.bounds import FOREVER, LINKED_NS
from moon.oracle.expected import Expected, Place
from moon.oracle.trace_events import TraceEvent

KEPT_MESSAGES = 1024
"""Messages that were not taken yet, and others that are remembered."""


class _Link:
    """From one publisher of a topic to the machine's node.

    Attributes:
        since: the first message of the publisher's life was published then (ns).
        last: number of the newest message.
        is_used: whether the node has taken a message of that life.
    """

    __slots__ = ("is_used", "last", "since")

    def __init__(self, since: int) -> None:
        self.since = since
        self.last = -1
        self.is_used = False


class TakenMessages:
    """The messages on the topics of one machine.

    Args:
        deadline: a message is taken within this time of its stamp (ns).

    Attributes:
        reported: whether the machine's node reports what it takes.
        started_ns: when the node started (ns); 0 where it is linked for long.
        expected: by source and channel of a message, and its number there.
        awaited_ns: the first that was taken and whose contents were not received yet, was taken then (ns).
    """

    __slots__ = (
        "_awaited",
        "_contents",
        "_links",
        "awaited_ns",
        "expected",
        "reported",
        "started_ns",
    )

    def __init__(self, deadline: int) -> None:
        self.reported = False
        self.expected = Expected(deadline, KEPT_MESSAGES)
        self.awaited_ns = FOREVER
        self._contents: dict[Place, TraceEvent] = {}
        self._awaited: dict[Place, TraceEvent] = {}
        self._links: dict[tuple[str, str], _Link] = {}
        self.started_ns = 0

    def publish(self, message: TraceEvent, is_expected: bool) -> None:
        """A message was published; what was taken already, and awaited, has its contents now.

        Args:
            message: as its publisher reports it.
            is_expected: whether the node has to take it if it is linked to the publisher.
        """
        reference = reference_of(message)
        if is_expected:
            is_expected = self._is_linked(message)
        taken = self._awaited.pop(reference, None)
        if taken is not None:
            _fill(taken, message)
            stamps = (each.stamp for each in self._awaited.values())
            self.awaited_ns = min(stamps, default=FOREVER)
            return
        contents = self._contents
        contents[reference] = message
        if len(contents) > KEPT_MESSAGES:
            oldest = next(iter(contents))
            del contents[oldest]
            self.expected.remove(oldest)
        if is_expected:
            self.expected.add(reference, message)

    def _is_linked(self, message: TraceEvent) -> bool:
        """Whether what the publisher of ``message`` publishes reaches the node."""
        number = message.observation.sequence
        link = self._links.get(message.stream)
        if link is None or number < link.last:  # the publisher has started again
            link = self._links[message.stream] = _Link(message.stamp)
        link.last = number
        return link.is_used or message.stamp - LINKED_NS > max(link.since, self.started_ns)

    def take(self, taken: TraceEvent) -> None:
        """The node took a message: ``taken`` has its contents, now or once they are received."""
        client, number = taken.call
        reference = (client, taken.observation.channel, number)
        link = self._links.get(reference[:2])
        if link is not None and number <= link.last:
            link.is_used = True
        message = self._contents.pop(reference, None)
        if message is None:
            self._awaited[reference] = taken
            self.awaited_ns = min(self.awaited_ns, taken.stamp)
            return
        self.expected.remove(reference)
        _fill(taken, message)

    def forget(self) -> None:
        """It is not known any more what the node takes; what it will have taken may still come."""
        self.expected.clear()
        self._awaited.clear()
        self.awaited_ns = FOREVER

    def restart(self) -> None:
        """Another life of the node begins: whether it reports what it takes is not known yet."""
        self.forget()
        self._contents.clear()
        self._links.clear()
        self.reported = False


def reference_of(message: TraceEvent) -> Place:
    """By what a report of the node that took it names a message."""
    source, channel = message.stream
    return source, channel, message.observation.sequence


def _fill(taken: TraceEvent, message: TraceEvent) -> None:
    taken.data = message.data
    taken.observation = message.observation
    taken.stream = message.stream
