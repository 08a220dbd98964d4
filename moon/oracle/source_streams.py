"""Source streams: what one source sends on one channel, as one machine's oracle reads it, and its numbers."""

from __future__ import annotations

from collections.abc import Iterable

from moon.oracle.channels import AT_THE_SERVER, Channels
from moon.oracle.trace_events import Reader
from moon.ordering.numbers import Count, Numbers, Place
from transports.interface import Observation, ObservationKind

KEPT_STREAMS = 4096
"""SourceStreams that are remembered; their names come from the wire."""


class SourceStream:
    """Observations of one source, channel and kind.

    Attributes:
        read: what makes facts of them; None if nothing does.
        more: what makes further facts of them, where they are part of several interfaces.
        own: whether the machine's own node is their source.
        other_end: whether they are what a server tells of the machine's calls.
        count: their numbers; None for what is told by others of their calls, which only adds to what
            is known.
    """

    __slots__ = ("count", "more", "other_end", "own", "read")

    def __init__(
        self, readers: tuple[Reader, ...], own: bool, other_end: bool, count: Count | None
    ) -> None:
        self.read = readers[0] if readers else None
        self.more = readers[1:]
        self.own = own
        self.other_end = other_end
        self.count = count


class SourceStreams:
    """The streams of one machine.

    Args:
        channels: the machine's.
        node: the node that runs it.
        numbers: those of all sources, if somebody else follows them; else it has its own.
    """

    def __init__(self, channels: Channels, node: str, numbers: Numbers | None = None) -> None:
        self._are_followed = numbers is not None
        self._numbers = numbers or Numbers(most=KEPT_STREAMS)
        self._channels = channels
        self._node = node
        self.opened: dict[tuple[str, str, ObservationKind], SourceStream] = {}
        """By source, channel and kind."""
        self.counts: dict[Place, Count] = {}
        self.heard_since: int | None = None
        """From when on (ns) silence means that the machine did nothing, once it is heard at all; FOREVER: its
        node is not known to be there."""

    def of(self, observation: Observation) -> SourceStream:
        """The stream that ``observation`` is in."""
        key = (observation.source, observation.channel, observation.kind)
        return self.opened.get(key) or self._open(*key)

    def _open(self, source: str, channel: str, kind: ObservationKind) -> SourceStream:
        if len(self.opened) >= KEPT_STREAMS:
            # those that are in use come back; a first number says nothing about losses
            self.opened.clear()
            self.counts.clear()
        message = kind is ObservationKind.MESSAGE
        own = source == self._node
        readers = self._channels.readers(channel, source, kind)
        count = None
        if own or (message and readers):
            place = (source, channel, message)
            count = self.counts[place] = self._numbers.add(place)
        stream = self.opened[source, channel, kind] = SourceStream(
            readers, own, not own and kind in AT_THE_SERVER, count
        )
        return stream

    def is_heard(self, channel: str) -> bool:
        """Whether the machine's node was heard on ``channel``, or on one that is part of that action."""
        part = f"{channel}/_action/"
        return any(
            source == self._node and (heard == channel or heard.startswith(part))
            for source, heard, _ in self.opened
        )

    def may_be_unheard(self, channels: Iterable[str], by_ns: int) -> bool:
        """Whether the node was found after ``by_ns``, and was not heard on all of ``channels`` yet."""
        if self.heard_since is None or by_ns >= self.heard_since:
            return False
        return not all(self.is_heard(channel) for channel in channels)

    def restart(self) -> None:
        """The machine's node numbers anew, and was not heard yet."""
        self.heard_since = None
        for key in [key for key in self.opened if key[0] == self._node]:
            del self.opened[key]
        if not self._are_followed:
            self._numbers.forget(self._node)
