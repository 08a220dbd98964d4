"""In transit: what others sent to a machine, until its node has it, or should have had it.

Of requests the node reports that it received them. Of messages on topics it may report which it took
(``ObservationKind.MESSAGE_TAKEN``). A node that does orders all that its machine does: a message is an input
at the moment at which it was taken, as a request is. Its contents come from its publisher. Until the node's
first such report, and for publishers that do not number their messages, a message was taken at some time
within the latency bound.
"""

from __future__ import annotations

from moon.oracle.bounds import FOREVER, LINKED_NS
from moon.oracle.calls import Call, KnownCalls, is_nameless, may_be_same
from moon.oracle.trace_events import Role, TraceEvent
from transports.bounded import BoundedDict

KEPT_CALLS = 256
"""Requests received of which nobody has reported yet that they were sent."""
KEPT_REQUESTS = 1024
"""Requests sent that were not received yet. Of more, the oldest are not missed."""
KEPT_MESSAGES = 1024
"""Messages that were not taken yet, and others that are remembered."""
SEVERAL = 2
"""So many messages in a row that were not taken were not lost by chance."""

_RECEIVED = "received"
Reference = tuple[str, Call]
"""What was sent: on which channel, by whom, with which number, and in which life of its sender."""


class Links:
    """Between the node of one machine and those that send to it: each takes some time to find the other.

    Attributes:
        started_ns: when the machine's node started, or was found (ns); 0 where it is there for long.
    """

    __slots__ = ("_came", "started_ns")

    def __init__(self) -> None:
        self.started_ns = 0
        self._came: BoundedDict[str, tuple[int, int]] = BoundedDict(KEPT_CALLS)
        """When each sender came last (ns), and in which life of it; 0 where that is not known yet."""

    def came(self, sender: str, stamp_ns: int) -> None:
        """``sender`` came or went at ``stamp_ns``."""
        self._came.pop(sender, None)
        self._came[sender] = stamp_ns, 0

    def surely_ns(self, sender: str, life: int, stamp_ns: int) -> int:
        """From when on (ns) ``sender`` and the node surely are linked.

        Args:
            sender: who sent something.
            life: in which life; 0 where that is not known.
            stamp_ns: when; if nobody told that it has come, it may have come just then.
        """
        came_ns, known = self._came.get(sender, (stamp_ns, life))
        if life and known and life != known:
            came_ns = stamp_ns
        self._came[sender] = came_ns, life or known
        return max(came_ns, self.started_ns) + LINKED_NS


class Expected:
    """What is on its way to one machine.

    Args:
        deadline: its node has it so soon after it was sent, and could reach it (ns).
        most: so much is kept; of more, the oldest is not missed.

    Attributes:
        deadline: as given.
        events: as who sent them reports them, oldest first.
        due: when the first of them will be overdue (ns), or earlier.
    """

    __slots__ = ("_since", "deadline", "due", "events")

    def __init__(self, deadline: int, most: int) -> None:
        self.deadline = deadline
        self.events: BoundedDict[Reference, TraceEvent] = BoundedDict(most)
        self._since: BoundedDict[Reference, int] = BoundedDict(most)
        """From when on (ns) those are under way that were sent before both ends surely were linked."""
        self.due = FOREVER

    def add(self, reference: Reference, event: TraceEvent, since_ns: int = 0) -> None:
        """``event`` was sent; it is under way since then, or since ``since_ns`` where that is later."""
        self.events[reference] = event
        if since_ns > event.stamp:
            self._since[reference] = since_ns
        self.due = min(self.due, max(event.stamp, since_ns) + self.deadline)

    def since_ns(self, reference: Reference) -> int:
        """From when on (ns) what is expected there is under way for sure."""
        return self._since.get(reference, self.events[reference].stamp)

    def remove(self, reference: Reference) -> None:
        """It has arrived, or is not waited for any more; nothing happens if it was not expected."""
        self._since.pop(reference, None)
        if self.events.pop(reference, None) is not None and not self.events:
            self.due = FOREVER

    def overdue(self, watermark: int) -> list[tuple[Reference, TraceEvent, int]]:
        """What should have arrived by ``watermark`` (ns), and since when it was under way (ns).

        It is expected no more.
        """
        limit = watermark - self.deadline
        since = (
            (reference, event, self.since_ns(reference)) for reference, event in self.events.items()
        )
        found = [item for item in since if item[2] <= limit]
        for reference, _, _ in found:
            del self.events[reference]
            self._since.pop(reference, None)
        left = map(self.since_ns, self.events)
        self.due = min(left, default=FOREVER - self.deadline) + self.deadline
        return found

    def wait_on(self, reference: Reference, event: TraceEvent, since_ns: int, until: int) -> None:
        """``event`` is overdue, but may be under way: it is looked at again at ``until`` (ns)."""
        self.add(reference, event, since_ns)
        self.due = min(self.due, until)

    def remove_of(self, sender: str) -> None:
        """Nothing of ``sender`` is expected any more."""
        for reference in [reference for reference in self.events if reference[1][0] == sender]:
            self.remove(reference)

    def clear(self) -> None:
        """Nothing is expected."""
        self.events.clear()
        self._since.clear()
        self.due = FOREVER


class RequestTracking:
    """Requests on their way to one machine.

    Args:
        deadline: a request is received within this time (ns).
        links: the node's; None: all are linked from the beginning.

    Attributes:
        expected: by channel, client and number of the call.
        passed: those that were overdue when a later one of their client was received.
    """

    __slots__ = ("_deadline", "_linked", "_links", "_received", "expected", "passed")

    def __init__(self, deadline: int, links: Links | None) -> None:
        self._deadline = deadline
        self._links = links
        self._linked: BoundedDict[tuple[str, str], int] = BoundedDict(KEPT_CALLS)
        """Of each client and channel, in which life a request of it was received last."""
        self.expected = Expected(deadline, KEPT_REQUESTS)
        self.passed: list[TraceEvent] = []
        self._received = KnownCalls()

    def ask(self, request: TraceEvent) -> None:
        """A request was sent; it waits at its client until that has found the server."""
        channel, call = request.observation.channel, request.call
        if not self._received.has((_RECEIVED, channel), call):
            self.expected.add((channel, call), request, self._surely_ns(request))

    def _surely_ns(self, request: TraceEvent) -> int:
        """From when on (ns) its client has found the server for sure."""
        client, _, life = request.call
        place = client, request.observation.channel
        if self._links is None or self._linked.get(place, -1) == life:
            return 0
        return self._links.surely_ns(client, life, request.stamp)

    def give_up(self, call: Call, channel: str, stamp_ns: int) -> None:
        """Its client gave up at ``stamp_ns``: a request that may have waited there until then never left."""
        reference = channel, call
        if reference in self.expected.events and self.expected.since_ns(reference) > stamp_ns:
            self.expected.remove(reference)

    def take(self, request: TraceEvent, watermark: int) -> None:
        """A request was received, or answered; its sender's report may come before or after.

        A client calls one after the other: its earlier requests have had an answer, or it gave them up.

        Args:
            request: the request, or its answer as its client reports it.
            watermark: nothing older is to come (ns).
        """
        channel, call = request.observation.channel, request.call
        overdue_ns = watermark - self._deadline
        place = call[0], channel
        if self._linked.get(place, -1) != call[2]:
            self._linked[place] = call[2]
        for reference, sent in tuple(self.expected.events.items()):
            if reference[0] == channel and _answers(call, reference[1]):
                since_ns = self.expected.since_ns(reference)
                is_passed = since_ns <= overdue_ns and not may_be_same(call, reference[1])
                if is_passed and request.role is Role.ANSWERED:
                    continue  # its client reports that: what the node reports of it may be on its way
                self.expected.remove(reference)
                if reference[1] == call:
                    request.sent = sent.stamp
                if is_passed:
                    self.passed.append(sent)  # a link keeps its order: it has arrived
        received = self._received
        received.add((_RECEIVED, channel), call, request.stamp)
        if received.count > KEPT_CALLS and received.oldest_ns() < watermark - self._deadline:
            received.drop_oldest()

    def sender_ended(self, name: str) -> None:
        """``name`` is gone: what it sent may never have left."""
        self.expected.remove_of(name)
        for place in [place for place in self._linked if place[0] == name]:
            del self._linked[place]

    def unlink(self) -> None:
        """The node came or went: clients have to find it once more."""
        self._linked.clear()


def _answers(received: Call, sent: Call) -> bool:
    """Whether a client whose call is received had to send the other one before, or it is that."""
    client, number, life = received
    earlier = (
        client == sent[0] and life == sent[2] and not is_nameless(client) and sent[1] <= number
    )
    return earlier or may_be_same(received, sent)


class _Link:
    """From one publisher of a topic to the machine's node.

    Attributes:
        life: which life of the publisher it is; 0 where that is not known.
        last: number of the newest message.
        taken: number of the newest of that life that the node has taken; -1: it has taken none.
        missed: those that were not taken in time since it took one.
    """

    __slots__ = ("last", "life", "missed", "taken")

    def __init__(self, life: int) -> None:
        self.life = life
        self.last = -1
        self.taken = -1
        self.missed: list[TraceEvent] = []


class TakenMessages:
    """The messages on the topics of one machine.

    Args:
        deadline: a message is taken within this time of its stamp (ns).
        links: the node's.

    Attributes:
        reported: whether the machine's node reports what it takes.
        expected: by source and channel of a message, and its number there.
        awaited_ns: the first that was taken and whose contents were not received yet, was taken then (ns).
        lost: those that were lost on their way; who says so empties it.
        presumed: those that were judged by when they were published (ns), as nobody said what is taken.
    """

    __slots__ = (
        "_awaited",
        "_contents",
        "_links",
        "_streams",
        "awaited_ns",
        "expected",
        "lost",
        "presumed",
        "reported",
    )

    def __init__(self, deadline: int, links: Links) -> None:
        self.reported = False
        self.expected = Expected(deadline, KEPT_MESSAGES)
        self.awaited_ns = FOREVER
        self._contents: dict[Reference, TraceEvent] = {}
        self._awaited: dict[Reference, TraceEvent] = {}
        self._links = links
        self._streams: dict[tuple[str, str], _Link] = {}
        self.lost: list[TraceEvent] = []
        self.presumed: BoundedDict[Reference, int] = BoundedDict(KEPT_MESSAGES)

    def publish(self, message: TraceEvent, is_expected: bool) -> None:
        """A message was published; what was taken already, and awaited, has its contents now.

        Args:
            message: as its publisher reports it.
            is_expected: whether the node has to take it if it is linked to the publisher.
        """
        reference = reference_of(message)
        is_expected = self.is_linked(message) and is_expected
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

    def is_linked(self, message: TraceEvent) -> bool:
        """Whether the publisher of ``message``, which is new, certainly was linked to the node.

        It was if the node has taken an earlier message of it, or if both were there for long.
        """
        number = message.observation.sequence
        link = self._streams.get(message.stream)
        source, life = message.stream[0], message.observation.life
        if link is not None and not life and number < link.last:
            self._links.came(source, message.stamp)  # once more
            link = None
        if link is None or link.life != life:
            link = self._streams[message.stream] = _Link(life)
        link.last = max(link.last, number)
        return link.taken >= 0 or message.stamp > self._links.surely_ns(source, life, message.stamp)

    def is_missed(self, message: TraceEvent) -> bool:
        """Whether it is the node's fault that it has not taken ``message`` in time.

        One message may have been lost on its way; it was, where the node takes a later one. So it is not
        before the node has taken none of several in a row.
        """
        link = self._streams.get(message.stream)
        _, (_, number, life) = reference_of(message)
        if link is None or link.life != life:
            return False
        if number < link.taken:
            self.lost.append(message)
            return False
        if len(link.missed) < SEVERAL:
            link.missed.append(message)
        return len(link.missed) == SEVERAL

    def take(self, taken: TraceEvent) -> None:
        """The node took a message: ``taken`` has its contents, now or once they are received."""
        client, number, life = taken.call
        channel = taken.observation.channel
        reference = (channel, taken.call)
        link = self._streams.get((client, channel))
        if link is not None and number <= link.last and life == link.life:
            link.taken = max(link.taken, number)
            if len(link.missed) < SEVERAL:
                self.lost += link.missed
            link.missed.clear()
        message = self._contents.pop(reference, None)
        if message is None:
            self._awaited[reference] = taken
            self.awaited_ns = min(self.awaited_ns, taken.stamp)
            return
        self.expected.remove(reference)
        _fill(taken, message)

    def has_contents(self, reference: Reference) -> bool:
        """Whether the message of that name was received from its publisher, and was not taken yet."""
        return reference in self._contents

    def forget(self) -> None:
        """It is not known any more what the node takes; what it will have taken may still come."""
        self.expected.clear()
        for link in self._streams.values():
            link.missed.clear()
        self._awaited.clear()
        self.awaited_ns = FOREVER

    def unlink(self) -> None:
        """The node came or went: publishers have to be linked to it once more."""
        for link in self._streams.values():
            link.taken = -1
            link.missed.clear()

    def sender_changed(self, name: str) -> None:
        """``name`` came or went: what it published may never have left.

        Another life of it numbers anew, and it has to be linked to the node once more.
        """
        self.expected.remove_of(name)
        for stream in [stream for stream in self._streams if stream[0] == name]:
            del self._streams[stream]
        for reference in [p for p in self._contents if p[1][0] == name and not p[1][2]]:
            del self._contents[reference]

    def restart(self) -> None:
        """Another life of the node begins: whether it reports what it takes is not known yet.

        What was published may be received before it is known that the node is there: it is kept.
        """
        self.forget()
        self.unlink()
        self.reported = False


def reference_of(message: TraceEvent) -> Reference:
    """By what a report of the node that took it names a message."""
    seen = message.observation
    return seen.channel, (seen.source, seen.sequence, seen.life)


def _fill(taken: TraceEvent, message: TraceEvent) -> None:
    taken.data, taken.goal, taken.sent = message.data, message.goal, message.stamp
    taken.observation = message.observation
    taken.stream = message.stream
