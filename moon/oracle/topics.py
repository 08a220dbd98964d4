"""Topics of one machine: whether a message is judged when it was published, or when its node took it."""

from __future__ import annotations

from m2c.model.machine import EventKind
from moon.oracle.confirmation import Publishers
from moon.oracle.in_transit import TakenMessages, reference_of
from moon.oracle.program import Program
from moon.oracle.trace_events import Channels, Role, SourceStreams, TraceEvent
from moon.ordering.held import Held

_MESSAGE, _TAKEN, _INPUT = Role.MESSAGE, Role.TAKEN, Role.INPUT
_MESSAGED = EventKind.MESSAGE


class Topics:
    """What is received of the messages on the topics of one machine.

    Args:
        program: the machine.
        channels: its channels.
        streams: what was received, and its numbers.
        publishers: whose word is taken for it that they published.
        takes: the messages, where the node reports which of them it takes.
        held: what is not judged yet.

    Attributes:
        is_ordered: all that the machine takes and sends is reported by its own node, in order: it is known
            how far that is.
    """

    def __init__(
        self,
        program: Program,
        channels: Channels,
        streams: SourceStreams,
        publishers: Publishers,
        takes: TakenMessages,
        held: Held[TraceEvent],
    ) -> None:
        self._program = program
        self._channels = channels
        self._streams = streams
        self._publishers = publishers
        self._takes = takes
        self._held = held
        self._takes_none = not program.taken_topics()
        self.is_ordered = self._takes_none

    def restart(self) -> None:
        """Another life of the node begins."""
        self._takes.restart()
        self.is_ordered = self._takes_none

    def receive(self, event: TraceEvent, since_ns: int) -> TraceEvent | None:
        """What is left to be judged of ``event``, which is about a message of a topic.

        Args:
            event: a message that was published and makes a difference to the machine, or was taken.
            since_ns: what is published from then on is to be taken, where its publisher is known.
        """
        if event.role is _TAKEN:
            return self._taken(event, since_ns)
        if not self._takes.reported or event.event is None or event.event[0] is not _MESSAGED:
            return event
        if event.observation.sequence < 0:  # of such a message it is not reported when it is taken
            self.is_ordered = False
            return event
        self._publish(event, since_ns)
        return None

    def follow(self, since_ns: int) -> None:
        """The node can report what it takes: from here on, messages are taken when it does."""
        if not self._takes.reported and self._channels.is_plain:
            self._follow(since_ns)

    def _publish(self, message: TraceEvent, since_ns: int) -> None:
        is_known = self._publishers.is_caller(message.stream[0])
        self._takes.publish(message, message.stamp >= since_ns and is_known)

    def _taken(self, event: TraceEvent, since_ns: int) -> TraceEvent | None:
        """The node took a message: an input, whose contents may still have to be received."""
        if not self._program.changes_something(event.event):
            return None
        if not self._takes.reported and not self._begin_to_follow(event, since_ns):
            return None
        event.role = _INPUT
        self._takes.take(event)
        return event

    def _begin_to_follow(self, event: TraceEvent, since_ns: int) -> bool:
        """The node's first report of what it takes: whether its reports are what counts from here on.

        They are not, while the message has been judged already by when it was published.
        """
        if not self._channels.is_plain:
            return False
        client, number = event.call
        channel = event.observation.channel
        if (client, channel, number) not in map(reference_of, self._messages()):
            count = self._streams.counts.get((client, channel, True))
            if count is not None and number < count.next:
                return False
        self._follow(since_ns)
        return True

    def _messages(self) -> list[TraceEvent]:
        """Those that are not judged yet, and that the node may still report to have taken."""
        return [event for event in self._held.observations if _is_numbered_message(event)]

    def _follow(self, since_ns: int) -> None:
        messages = self._messages()
        self._takes.reported = True
        self.is_ordered = not self._program.takes_feedback
        for message in messages:
            self._held.remove(message)
            self._publish(message, since_ns)


def _is_numbered_message(event: TraceEvent) -> bool:
    """Whether its node may report that it took ``event``."""
    is_message = event.event is not None and event.event[0] is _MESSAGED
    return event.role is _MESSAGE and is_message and event.observation.sequence >= 0
