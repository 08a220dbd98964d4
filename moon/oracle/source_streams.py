"""The observations of one machine by source, channel and kind, with the numbers of what was received."""

from __future__ import annotations

from collections.abc import Iterable

from m2c.model.machine import EventKind
from moon.feed.nodes import Nodes
from moon.feed.numbers import Numbers, Place
from moon.oracle.bounds import FOREVER
from moon.oracle.channels import Channels
from moon.oracle.readers import Reader
from transports.channel_filter import whole_of
from transports.interface import SERVER_END, Observation, ObservationKind
from transports.sequences import Sequence

KEPT_STREAMS = 4096
"""Source streams that are remembered; their names come from the wire."""


class SourceStream:
    """Observations of one source, channel and kind.

    Attributes:
        read: what makes trace events of them; None if nothing does.
        more: what makes further events of them, where they are part of several interfaces.
        taken_as: as which input the machine takes them, where they are another node's messages.
        own: whether the machine's own node is their source.
        other_end: whether they are what a server reports of the machine's calls.
        count: their numbers; None for what others report of their calls, which only adds to what is
            known.
    """

    __slots__ = ("count", "more", "other_end", "own", "read", "taken_as")

    def __init__(
        self,
        readers: tuple[Reader, ...],
        own: bool,
        other_end: bool,
        count: Sequence | None,
        taken_as: EventKind | None,
    ) -> None:
        self.read = readers[0] if readers else None
        self.more = readers[1:]
        self.taken_as = taken_as
        self.own = own
        self.other_end = other_end
        self.count = count


class SourceStreams:
    """The streams of one machine.

    Args:
        channels: the machine's.
        node: the node that runs it.
        nodes: which of them are there.
        numbers: those of all sources, if somebody else follows them; else it has its own.
    """

    def __init__(
        self, channels: Channels, node: str, nodes: Nodes, numbers: Numbers | None = None
    ) -> None:
        self._nodes = nodes
        self._are_followed = numbers is not None
        self._numbers = numbers or Numbers(most=KEPT_STREAMS)
        self._channels = channels
        self.node = node
        self.opened: dict[tuple[str, str, ObservationKind], SourceStream] = {}
        """By source, channel and kind."""
        self.counts: dict[Place, Sequence] = {}
        self._first_ns: dict[str, int] = {}
        """Of each channel, when the first that was received from the machine's node happened (ns)."""
        self.received_since: int | None = None
        """From when on (ns) silence means that the machine did nothing, once something is received from it;
        FOREVER: its node is not known to be there."""

    @property
    def is_there(self) -> bool:
        """Whether the machine's node is there; where nobody says which nodes are, all are taken to be."""
        return not self._nodes.are_found or self.received_since not in (None, FOREVER)

    def of(self, observation: Observation) -> SourceStream:
        """The stream that ``observation`` is in."""
        key = (observation.source, observation.channel, observation.kind)
        found = self.opened.get(key)
        if found is None:
            found = self._open(*key)
            if found.own:
                first_ns = self._first_ns.get(observation.channel, FOREVER)
                self._first_ns[observation.channel] = min(first_ns, observation.stamp_ns)
        return found

    def _open(self, source: str, channel: str, kind: ObservationKind) -> SourceStream:
        if len(self.opened) >= KEPT_STREAMS:
            # those that are in use come back; a first number says nothing about losses
            self.opened.clear()
            self.counts.clear()
        message = kind is ObservationKind.MESSAGE
        own = source == self.node
        readers = self._channels.readers(channel, source, kind)
        count = None
        if own or (message and readers):
            place = (source, channel, message)
            count = self.counts[place] = self._numbers.add(place)
        stream = self.opened[source, channel, kind] = SourceStream(
            readers,
            own,
            not own and kind in SERVER_END,
            count,
            None if own or not message else self._channels.taken_as(channel),
        )
        return stream

    def was_received(self, channel: str, by_ns: int) -> bool:
        """Whether the machine's node was heard on ``channel``, or on a part of that action, by then (ns)."""
        return any(
            first_ns <= by_ns and channel in (received, whole_of(received))
            for received, first_ns in self._first_ns.items()
        )

    def may_have_missed(self, channels: Iterable[str], by_ns: int, silent_ns: int) -> bool:
        """Whether the node may have done something by then (ns) on one of ``channels`` that was missed.

        It may if nothing of before was received there and the node was found later than ``silent_ns`` before.
        """
        if self.received_since is None or by_ns - silent_ns >= self.received_since:
            return False
        return not all(self.was_received(channel, by_ns) for channel in channels)

    def restart(self) -> None:
        """The machine's node numbers anew, and nothing was received from it yet."""
        self.received_since = None
        self._first_ns.clear()
        for key in [key for key in self.opened if key[0] == self.node]:
            del self.opened[key]
        if not self._are_followed:
            self._numbers.forget(self.node)
