"""Who did what in a bag, where the models leave only one: rosbag2 stores no names.

A node is judged by what it did itself. In a bag that is known only if the models have one node that can
have done it: one that serves a service, one that calls it, one that publishes a topic. A machine of which
anything is left open is not judged: what is missing would look like something that it did not do.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable

from msgspec.structs import replace

from m2c.model.deployment import POLICY
from m2c.model.machine import Interface, InterfaceKind, Machine, OutputKind
from m2c.model.system import System
from m2c.model.walk import emits_of, with_threads
from moon.recording.contents import Contents, is_made_up
from transports.actions.parts import SERVICES, TOPICS, channel_of_part
from transports.interface import Observation, ObservationKind
from transports.service_events import EVENT_SUFFIX

_CLIENT_END = frozenset({ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_RECEIVED})
_SERVER_END = frozenset({ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT})
_PUBLISHES, _RECEIVES, _SERVES, _CALLS = "publishes", "receives", "serves", "calls"
_WHICH_NEEDS = {
    "send_goal": OutputKind.SEND_GOAL,
    "cancel_goal": OutputKind.SEND_CANCEL,
    "get_result": OutputKind.SEND_GOAL,
}
"""What a client of an action has to send before it calls each of its services."""
_Role = tuple[str, str]
"""What a node does, and on which channel."""


def only_node(system: System) -> Callable[[Observation], str]:
    """Who did what is observed, where only one node of ``system`` can have done it; else ""."""
    names = {role: players[0] for role, players in _players(system).items() if len(players) == 1}

    def named(seen: Observation) -> str:
        return names.get((_role_in(seen), seen.channel), "")

    return named


def shared_topics(system: System) -> frozenset[str]:
    """The topics on which several nodes of ``system`` publish."""
    return frozenset(
        channel
        for (what, channel), players in _players(system).items()
        if what == _PUBLISHES and len(players) > 1
    )


def _players(system: System) -> dict[_Role, list[str]]:
    """The names of the nodes that play each role; the policy plays those of its plugins."""
    found: defaultdict[_Role, dict[str, None]] = defaultdict(dict)
    for name, machine in (
        *((node.name, node) for node in system.nodes),
        *((POLICY, plugin) for plugin in system.plugins),
    ):
        for role in _roles(machine):
            found[role][name] = None
    return {role: list(names) for role, names in found.items()}


def _role_in(seen: Observation) -> str:
    """As what somebody did what is observed."""
    if seen.kind is ObservationKind.MESSAGE:
        return _PUBLISHES
    return _CALLS if seen.kind in _CLIENT_END else _SERVES


class Attribution:
    """Names for what a bag does not name.

    Args:
        contents: what was found in the bag, read to its end.
        topics: the topics that the bag declares, whether there are messages on them or not.
        system: all that runs.
        machines: those of it that are to be judged.
        on_arrival: whether messages are stamped when they were recorded, not when they were published.
        is_ordered: whether stamps tell in which order a node did what it did.

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
    ) -> None:
        self._contents = contents
        self._topics = frozenset(topics)
        self._on_arrival = on_arrival
        self._who = _players(system)
        self.machines: tuple[Machine, ...] = ()
        self.unjudged: list[str] = []
        self.unrecorded: list[str] = []
        for machine in machines:
            why = next(filter(None, map(self._what_is_open, _roles(machine))), "")
            if not why and not is_ordered:
                why = "in which order its node did what it did is known to the latency bound only"
            if why:
                self.unjudged.append(f"{machine.name} is not judged: {why}")
            else:
                self.machines += (machine,)
        judged = {machine.name for machine in self.machines}
        self._names = {
            role: names[0]
            for role, names in self._who.items()
            if len(names) == 1 and names[0] in judged
        }

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
            source = names.get((_PUBLISHES, channel), "")
            return replace(seen, source=source) if source else seen
        client = names.get((_CALLS, channel), seen.client)
        source = client if seen.kind in _CLIENT_END else names.get((_SERVES, channel), "")
        return replace(seen, source=source or seen.source, client=client)

    def _what_is_open(self, role: _Role) -> str:
        """Why it is not known who played ``role``; "" if it is."""
        what, channel = role
        topic = channel if what in (_PUBLISHES, _RECEIVES) else channel + EVENT_SUFFIX
        if topic not in self._topics:
            self.unrecorded.append(topic)
            return f"{topic} was not recorded"
        if what == _RECEIVES:
            return ""
        names = self._who[role]
        if len(names) > 1:
            return f"{' and '.join(sorted(names))} each {_verb(what)} {channel}, and who did is not known"
        found = self._contents.channels.get(channel)
        if what == _PUBLISHES:
            late = self._on_arrival
            return (
                f"when it published on {channel} is known to the latency bound only" if late else ""
            )
        if found is None:
            return ""  # nobody called it
        if not found.kinds & (_SERVER_END if what == _SERVES else _CLIENT_END):
            return f"only the other end of the calls of {channel} was recorded"
        callers = {source for kind, source in found.sources if kind in _CLIENT_END}
        if what == _CALLS and len(callers) > 1:
            return f"several nodes call {channel}, and which of them is {names[0]} is not known"
        return ""


def _verb(what: str) -> str:
    return what.removesuffix("s")


def _roles(machine: Machine) -> list[_Role]:
    """What its model has it do; what it declares and never sends is somebody else's."""
    sent: dict[str, set[OutputKind]] = {}
    for owner in with_threads(machine):
        for kind, name in emits_of(owner):
            sent.setdefault(name, set()).add(kind)
    found: list[_Role] = []
    for interface in machine.interfaces:
        if interface.channel is not None:
            found += _roles_of(interface, interface.channel, sent.get(interface.name, set()))
    return found


def _roles_of(interface: Interface, channel: str, sent: set[OutputKind]) -> list[_Role]:
    match interface.kind:
        case InterfaceKind.PUBLISHER:
            return [(_PUBLISHES, channel)] if OutputKind.PUBLISH in sent else []
        case InterfaceKind.SUBSCRIBER:
            return [(_RECEIVES, channel)]
        case InterfaceKind.SERVER:
            return [(_SERVES, channel)]
        case InterfaceKind.CLIENT:
            return [(_CALLS, channel)] if OutputKind.REQUEST in sent else []
        case InterfaceKind.ACTION_SERVER | InterfaceKind.ACTION_CLIENT:
            serves = interface.kind is InterfaceKind.ACTION_SERVER
            parts = [
                channel_of_part(channel, part)
                for part in SERVICES
                if serves or _WHICH_NEEDS[part] in sent
            ]
            topics = [channel_of_part(channel, part) for part in TOPICS]
            return [(_SERVES if serves else _CALLS, part) for part in parts] + [
                (_PUBLISHES if serves else _RECEIVES, topic) for topic in topics
            ]
    return []
