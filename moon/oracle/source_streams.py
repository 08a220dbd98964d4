"""Source streams: what one source sends on one channel, read by one machine's oracle, and its numbers.

What the numbers tell is said in :mod:`transports.sequences`; here it is kept with what only an oracle needs.
"""

from __future__ import annotations

from moon.oracle.channels import AT_THE_SERVER, Channels
from moon.oracle.trace_events import Reader
from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel, sequel_of

KEPT_STREAMS = 4096
"""SourceStreams that are remembered; their names come from the wire."""

NONE = -2
"""No number, and not one that is missing either (-1)."""

Place = tuple[str, str, bool]
"""Source, channel, and whether it is a message: what is numbered together."""


class Count:
    """The last number of a place.

    Attributes:
        place: which.
        next: the number that should follow; negative while none has come.
        stamp: of the last, ns.
        unknown_until: what came before this was not heard (ns), where the first number was not 0.
    """

    __slots__ = ("next", "place", "stamp", "unknown_until")

    def __init__(self, place: Place) -> None:
        self.place = place
        self.next = NONE
        self.stamp = 0
        self.unknown_until = 0

    def sequel(self, number: int, stamp: int) -> Sequel:
        """How ``number`` follows; it is the last one from now on, unless it came before."""
        sequel = sequel_of((self.next - 1, self.stamp) if self.next >= 0 else None, number, stamp)
        if sequel is Sequel.AGAIN:
            return sequel
        self.next = number + 1
        self.stamp = stamp
        if sequel is Sequel.FIRST:
            self.unknown_until = stamp if number > 0 else 0
        elif sequel is Sequel.ANEW:
            self.unknown_until = stamp  # its source's last ones may be missing
        return sequel


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
    """

    def __init__(self, channels: Channels, node: str) -> None:
        self._channels = channels
        self._node = node
        self.opened: dict[tuple[str, str, ObservationKind], SourceStream] = {}
        """By source, channel and kind."""
        self.counts: dict[Place, Count] = {}

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
            count = self.counts.setdefault(place, Count(place))
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

    def restart(self) -> None:
        """The machine's node numbers anew, and was not heard yet."""
        for key in [key for key in self.opened if key[0] == self._node]:
            del self.opened[key]
        for count in self.counts.values():
            if count.place[0] == self._node:
                count.next = NONE
