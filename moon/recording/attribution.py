"""Who did what in a bag, where the models leave only one: rosbag2 stores no names.

A node is judged by what it did itself. In a bag that is known only if the models have one node that can
have done it: one that serves a service, one that calls it, one that publishes a topic. A machine of which
anything is left open is not judged: what is missing would look like something that it did not do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from msgspec.structs import replace

from m2c.model.machine import Machine
from m2c.model.system import System
from m2c.model.walk import has_timers
from moon.feed.places import Place, nodes_at, places
from moon.recording.contents import Contents, is_made_up
from transports.interface import CLIENT_END, SERVER_END, Observation, ObservationKind
from transports.service_events import EVENT_SUFFIX

_VERBS = {
    ObservationKind.MESSAGE: "publish",
    ObservationKind.RESPONSE_SENT: "serve",
    ObservationKind.REQUEST_SENT: "call",
}
"""What a node does; who receives requests serves, and who receives responses calls."""


def only_node(system: System) -> Callable[[Observation], str]:
    """Who did what is observed, where only one node of ``system`` can have done it; else ""."""
    names = _only(_who(system))

    def named(seen: Observation) -> str:
        return names.get((seen.channel, seen.kind), "")

    return named


def shared_topics(system: System) -> frozenset[str]:
    """The topics on which several nodes of ``system`` publish."""
    return frozenset(
        channel
        for (channel, kind), names in _who(system).items()
        if kind is ObservationKind.MESSAGE and len(names) > 1
    )


def _who(system: System) -> dict[Place, set[str]]:
    """Who does what by the models; what they declare and never send is somebody else's."""
    return nodes_at(system.nodes, system.plugins, only_sent=True)


def _only(who: Mapping[Place, set[str]]) -> dict[Place, str]:
    """The one who does it, where there is only one."""
    return {place: name for place, names in who.items() if len(names) == 1 for name in names}


class Attribution:
    """Names for what a bag does not name.

    Args:
        contents: what was found in the bag, read to its end.
        topics: the topics that the bag declares, whether there are messages on them or not.
        system: all that runs.
        machines: those of it that are to be judged.
        on_arrival: whether messages are stamped when they were recorded, not when they were published.
        is_ordered: whether stamps tell in which order a node did what it did.
        other_time: why timers may follow another clock than stamps do.

    Attributes:
        machines: those of them that can be.
        unjudged: why each of the others cannot be, one sentence each.
        unrecorded: the topics that were not recorded, where that is why.
    """

    def __init__(
        self,
        contents: Contents,
        topics: Iterable[str],
        system: System,
        machines: Iterable[Machine],
        on_arrival: bool,
        is_ordered: bool = True,
        other_time: str = "",
    ) -> None:
        self._contents = contents
        self._topics = frozenset(topics)
        self._on_arrival = on_arrival
        self._who = _who(system)
        self.machines: tuple[Machine, ...] = ()
        self.unjudged: list[str] = []
        self.unrecorded: list[str] = []
        for machine in machines:
            why = next(filter(None, map(self._what_is_open, places(machine, only_sent=True))), "")
            if not why and other_time and has_timers(machine):
                why = f"it has timers, and {other_time}"
            if not why and not is_ordered:
                why = "in which order its node did what it did is known to the latency bound only"
            if why:
                self.unjudged.append(f"{machine.name} is not judged: {why}")
            else:
                self.machines += (machine,)
        judged = {machine.name for machine in self.machines}
        self._names = {place: name for place, name in _only(self._who).items() if name in judged}

    def assumption(self) -> str:
        """What is taken for granted of the machines that are judged; "" if none are."""
        if not self.machines:
            return ""
        names = ", ".join(machine.name for machine in self.machines)
        return (
            f"{names}: the recording names no senders; what only one node of the models can have sent is "
            "attributed to it"
        )

    def __call__(self, seen: Observation) -> Observation:
        """``seen`` with the names that it should have."""
        if seen.source and not is_made_up(seen.source):
            return seen
        names, channel = self._names, seen.channel
        if seen.kind is ObservationKind.MESSAGE:
            source = names.get((channel, seen.kind), "")
            return replace(seen, source=source) if source else seen
        client = names.get((channel, ObservationKind.REQUEST_SENT), seen.client)
        source = client if seen.kind in CLIENT_END else names.get((channel, seen.kind), "")
        return replace(seen, source=source or seen.source, client=client)

    def _what_is_open(self, place: Place) -> str:
        """Why it is not known who did what is observed at ``place``; "" if it is."""
        channel, kind = place
        is_message = kind in (ObservationKind.MESSAGE, ObservationKind.MESSAGE_TAKEN)
        topic = channel if is_message else channel + EVENT_SUFFIX
        if topic not in self._topics:
            self.unrecorded.append(topic)
            return f"{topic} was not recorded"
        if kind not in _VERBS:
            return ""
        names = sorted(self._who[place])
        if len(names) > 1:
            return f"{' and '.join(names)} each {_VERBS[kind]} {channel}, and who did is not known"
        found = self._contents.channels.get(channel)
        if is_message:
            late = self._on_arrival
            return (
                f"when it published on {channel} is known to the latency bound only" if late else ""
            )
        if found is None:
            return ""  # nobody called it
        is_client = kind in CLIENT_END
        if found.kinds.isdisjoint(CLIENT_END if is_client else SERVER_END):
            return f"only the other end of the calls of {channel} was recorded"
        callers = {source for kind, source in found.sources if kind in CLIENT_END}
        if is_client and len(callers) > 1:
            return f"several nodes call {channel}, and which of them is {names[0]} is not known"
        return ""
