"""What a recording was found to hold, and what can therefore not be concluded from it."""

from __future__ import annotations

from collections.abc import Container, Iterable

import msgspec

from moon.recording.stored import plural
from transports.interface import CLIENT_END, CLOCK_TYPE, SERVER_END, Observation, ObservationKind
from transports.service_events import EVENT_SUFFIX

_MAX_CHANNELS = 10_000
MADE_UP = "client-"
"""How clients in a bag are called, with a number."""
_MAX_SOURCES = 1_000
_NAMED = 6
"""So many channels are named in a sentence; of more, how many."""


class ChannelContents(msgspec.Struct):
    """What was found of one channel.

    Attributes:
        type_name: of its messages, as first seen.
        count: observations.
        kinds: their kinds.
        unnamed: how many do not say who published them.
        unnumbered: how many have no number.
        hollow: how many have no contents.
        sources: who published each kind, as far as is known.
    """

    type_name: str = ""
    count: int = 0
    kinds: set[ObservationKind] = msgspec.field(default_factory=set)
    unnamed: int = 0
    unnumbered: int = 0
    hollow: int = 0
    sources: set[tuple[ObservationKind, str]] = msgspec.field(default_factory=set)


class Contents:
    """Takes note of observations as they are read.

    Attributes:
        channels: what was found, by channel.
        first_ns: the stamp of the first observation; 0 before there is one.
        last_ns: the last one's.
        count: how many there were.
        on_arrival: whether every message was stamped when it was received.
    """

    def __init__(self) -> None:
        self.channels: dict[str, ChannelContents] = {}
        self.first_ns = 0
        self.last_ns = 0
        self.count = 0
        self.on_arrival = True
        self._known: set[tuple[str, ObservationKind, str]] = set()
        """Channels, kinds and sources that were found before."""

    def note(self, seen: Observation) -> None:
        """Take note of one."""
        self.count += 1
        self.first_ns = self.first_ns or seen.stamp_ns
        self.last_ns = seen.stamp_ns
        if seen.kind is ObservationKind.MESSAGE_TAKEN:
            return  # what it is about has been noted
        found = self.channels.get(seen.channel)
        if found is None:
            if len(self.channels) >= _MAX_CHANNELS:
                return
            found = self.channels[seen.channel] = ChannelContents(seen.type_name)
        found.count += 1
        if self.on_arrival and seen.stamp_ns != seen.received_ns:
            self.on_arrival = seen.kind is not ObservationKind.MESSAGE
        place = (seen.channel, seen.kind, seen.source)
        if place not in self._known:
            found.kinds.add(seen.kind)
            if len(found.sources) < _MAX_SOURCES:
                found.sources.add((seen.kind, seen.source))
                self._known.add(place)
        if not seen.source:
            found.unnamed += 1
        if seen.sequence < 0:
            found.unnumbered += 1
        if seen.data is None and not seen.error:
            found.hollow += 1

    def topics(self) -> list[str]:
        """Where that was in a bag: events of a service have a topic of their own."""
        return [
            name if ObservationKind.MESSAGE in found.kinds else name + EVENT_SUFFIX
            for name, found in self.channels.items()
        ]

    def limits(self) -> list[str]:
        """What cannot be concluded from what was found, one sentence each."""
        found = []
        topics = {n: c for n, c in self.channels.items() if ObservationKind.MESSAGE in c.kinds}
        calls = {n: c for n, c in self.channels.items() if n not in topics}
        if unnamed := [name for name, found in topics.items() if found.unnamed == found.count]:
            found.append(f"who published the messages on {named(unnamed)} is not recorded")
        for kinds, who in ((SERVER_END, "who served"), (CLIENT_END, "who called")):
            if unnamed := [name for name, found in calls.items() if _is_unnamed(found, kinds)]:
                found.append(f"{who} {named(unnamed)} is not recorded")
        if lost := [name for name, found in self.channels.items() if found.unnumbered]:
            found.append(
                f"events on {named(lost)} have no number: if any of them were lost cannot be known"
            )
        for kinds, end, other in (
            (CLIENT_END, "client", "server"),
            (SERVER_END, "server", "client"),
        ):
            half = [name for name, found in calls.items() if found.kinds.issubset(kinds)]
            if half:
                found.append(
                    f"calls of {named(half)} were recorded at the {end}'s end only: when its "
                    f"{other} had them is known to the latency bound"
                )
        if hollow := [name for name, found in self.channels.items() if found.hollow]:
            found.append(
                f"events of {named(hollow)} have no contents: nothing can be said of those"
            )
        return found


def _is_unnamed(found: ChannelContents, kinds: Container[ObservationKind]) -> bool:
    """Whether nothing of ``kinds`` says who did it."""
    names = {source for kind, source in found.sources if kind in kinds}
    return bool(names) and all(is_made_up(name) for name in names)


def is_made_up(name: str) -> bool:
    """Whether a node's name is none: that of a client in a bag, where they are only distinguished."""
    return not name or name.startswith(MADE_UP)


def is_clock(channel: str, type_name: str) -> bool:
    """Whether a simulation publishes its time there: by the type, or by the name in a log without types."""
    return type_name == CLOCK_TYPE if type_name else channel == "/clock"


def named(channels: Iterable[str]) -> str:
    """Channels in words: all of a few, some of many."""
    names = sorted(channels)
    if len(names) <= _NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:_NAMED])} and {plural(len(names) - _NAMED, 'more channel')}"
