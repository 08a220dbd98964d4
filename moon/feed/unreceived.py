"""What nodes may have done that was not received: while it may undo a violation, that is not certain.

What is missing shows in numbers (decision 26). Up to when all is known that a node did on a channel:

* a node that numbers all that it reports, and answers: up to where it has reported. One that does not
  answer is judged by the latency bound;
* where links are made channel by channel, nodes number each channel: up to the newest on that channel; of
  what they do in calls, so from when on something numbered was missing in this run. A node that has started
  is linked for sure some time later: until then what it does in calls is unknown, and what it sends up to
  number 0. Who is not found by then was not there;
* what is not numbered at all is taken for whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import msgspec

from moon.feed.nodes import LEASE_NS, Node, Nodes
from moon.oracle.bounds import FOREVER
from transports.interface import Observation, ObservationKind

MOST_PLACES = 10_000
"""Nodes that are remembered, and channels of them; their names come from the wire, and never end."""


class Place(msgspec.Struct, frozen=True):
    """What a node reports on a channel: its messages, or what it does in calls."""

    node: str
    channel: str
    is_message: bool


class Stretch(msgspec.Struct, frozen=True):
    """Something that was not received may have been reported at ``place``.

    Attributes:
        place: where.
        from_ns, until_ns: stamped in ``[from_ns, until_ns)``.
        ends_ns: from then on (ns) that is not so, if nothing is received.
        can_answer: whether the node can be asked.
    """

    place: Place
    from_ns: int
    until_ns: int = FOREVER
    ends_ns: int = FOREVER
    can_answer: bool = False


class Unreceived:
    """What may be missing of the nodes that send on the channels of some judge.

    Args:
        sources: how far all nodes have reported; kept up to date by whoever makes this.

    Attributes:
        linked_ns: a node is linked on all its channels so long after it started (ns); 0: at once.
        is_lossy: whether something numbered is known to be missing.
        channels: on which each node may report something; none: on any.
    """

    def __init__(self, sources: Nodes) -> None:
        self.linked_ns = 0
        self.is_lossy = False
        self.channels: dict[str, set[str]] = {}
        self._sources = sources
        self._places: dict[str, dict[Place, int]] = {}
        """Of each node, the newest stamp received there; 0: nothing was, FOREVER: it is not numbered."""
        self._first: dict[Place, int] = {}
        """When the first message was sent that was received of a place, and was not the first of all (ns)."""
        self._lives: dict[str, tuple[int, int]] = {}
        """Since when each node is up, and since when all is received, as it was last told of (ns)."""

    def expect(self, node: str, channel: str = "", is_message: bool = True) -> None:
        """``node`` may report something there, by its model; on any channel, if none is given."""
        if node not in self.channels and len(self.channels) >= MOST_PLACES:
            return
        channels = self.channels.setdefault(node, set())
        if channel:
            channels.add(channel)
            self._places.setdefault(node, {}).setdefault(Place(node, channel, is_message), 0)

    def received(self, seen: Observation) -> None:
        """``seen`` was received: who sent it may send there."""
        place = Place(seen.source, seen.channel, seen.kind is ObservationKind.MESSAGE)
        places = self._places.get(seen.source, {})
        if place not in places and len(places) < MOST_PLACES:
            self.expect(seen.source, seen.channel, place.is_message)
            places = self._places.get(seen.source, {})
        if place in places:
            if not places[place] and place.is_message and seen.sequence > 0:
                self._first[place] = seen.stamp_ns
            places[place] = max(places[place], seen.stamp_ns if seen.sequence >= 0 else FOREVER)

    def started(self, node: str, since_ns: int) -> Iterator[tuple[str, int, int]]:
        """``node`` is up, having begun to connect at ``since_ns``: what cannot be known of it.

        The first message of a node has number 0; reports on calls are numbered while somebody listens. Of a
        node that comes back in reach, numbers show what was missed.

        Returns:
            Channels, each with the first and last time at which something of it may be missing (ns); none
            if it was told of this life before.
        """
        places = self._places.get(node, {})
        life = since_ns, self._sources.listening_ns
        if not places or self._lives.get(node) == life:
            return
        self._lives[node] = life
        for place, last_ns in places.items():
            if last_ns < since_ns:
                places[place] = 0
        listening_ns = self._sources.listening_ns
        from_ns = max(since_ns, listening_ns)
        for place in places if self.linked_ns else ():
            if not place.is_message or since_ns < listening_ns:
                yield place.channel, from_ns, from_ns + self.linked_ns
            elif self._first.get(place, 0) > from_ns:
                yield place.channel, from_ns, self._first[place]

    def all_have_started(self) -> bool:
        """Whether all that may send are there, and each has started since all is received."""
        listening_ns = self._sources.listening_ns
        started = (self._sources.up_since(name) for name in self.channels)
        return 0 < listening_ns < min(started, default=0)

    def restart(self) -> None:
        """Stamps begin elsewhere: nothing is known any more of what was received."""
        for node, places in self._places.items():
            self._places[node] = dict.fromkeys(places, 0)

    def windows(
        self, concerns: Callable[[str], bool], until_ns: int, now_ns: int
    ) -> Iterator[Stretch]:
        """What may be missing of all that happened until ``until_ns``, on the channels that concern."""
        for node, channels in self.channels.items():
            if channels and not any(map(concerns, channels)):
                continue
            source = self._sources.known.get(node)
            if source is not None and self._can_answer(node, source):
                window = self._of_answering(node, source, until_ns, now_ns)
                if window is not None:
                    yield window
                continue
            for place in tuple(self._places.get(node, ())):
                if concerns(place.channel):
                    window = self.window(place, until_ns, now_ns)
                    if window is not None:
                        yield window

    def window(self, place: Place, until_ns: int, now_ns: int) -> Stretch | None:
        """What may be missing at ``place`` of what happened until ``until_ns``; None: nothing."""
        source = self._sources.known.get(place.node)
        if source is not None and self._can_answer(place.node, source):
            return self._of_answering(place.node, source, until_ns, now_ns)
        if source is None or not source.is_up:
            return self._of_unknown(place, source, until_ns, now_ns)
        if source.progress.next or not self.linked_ns:
            return None  # it says nothing of its silence
        last_ns = self._places.get(place.node, {}).get(place, 0)
        if last_ns > until_ns or source.since_ns > until_ns:
            return None
        if last_ns:
            is_open = place.is_message or self.is_lossy
            return Stretch(place, last_ns + 1) if is_open else None
        has_started = source.since_ns >= self._sources.listening_ns
        return Stretch(place, source.since_ns) if place.is_message and has_started else None

    def _can_answer(self, node: str, source: Node) -> bool:
        """Whether it says how far it has reported. Who is expected, is up and was never heard may be out of
        reach, where others have answered.
        """
        if self._sources.is_answering(source):
            return True
        is_unheard = source.is_up is True and source.is_numbered and not source.progress.reported_ns
        return is_unheard and self._sources.are_asked and bool(self.channels.get(node))

    def _of_answering(self, node: str, source: Node, until_ns: int, now_ns: int) -> Stretch | None:
        place, reported_ns = Place(node, "", True), source.progress.reported_ns
        if self._sources.is_over(source, now_ns) or reported_ns >= until_ns:
            return None
        if source.answers:
            return Stretch(place, reported_ns + 1, can_answer=True)
        from_ns = max(source.since_ns, self._sources.listening_ns)
        if now_ns >= from_ns + LEASE_NS:
            return None
        return Stretch(place, from_ns, ends_ns=from_ns + LEASE_NS)

    def _of_unknown(
        self, place: Place, source: Node | None, until_ns: int, now_ns: int
    ) -> Stretch | None:
        """Who is not known to be there may be there, and not be found yet, or be out of reach."""
        sources = self._sources
        ends_ns, from_ns = until_ns + self.linked_ns, sources.listening_ns
        if source is None:
            missed_ns = from_ns if sources.are_found else None
            from_ns = 0  # it may have been there before
        else:
            missed_ns = sources.missed_ns(place.node, source) if self.linked_ns else None
            heard_ns = sources.reachability.heard_ns(place.node) + 1
            from_ns = max(from_ns, source.since_ns if missed_ns is None else heard_ns)
        if missed_ns is not None:
            ends_ns = max(ends_ns, missed_ns + LEASE_NS)
        if ends_ns <= until_ns or now_ns >= ends_ns:
            return None
        return Stretch(place, from_ns, ends_ns=ends_ns)
