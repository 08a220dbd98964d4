"""What each node does on which channels, as its model says: the one rule of how interfaces are channels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from m2c.model.deployment import POLICY
from m2c.model.machine import Interface, InterfaceKind, Machine, OutputKind
from m2c.model.walk import emits_of, with_threads
from transports.actions.parts import SERVICES, TOPICS, channel_of_part
from transports.interface import CLIENT_END, SERVER_END, ObservationKind

Place = tuple[str, ObservationKind]
"""Where a node does something: a channel, and the kind of its observations."""

_MESSAGE, _TAKEN = ObservationKind.MESSAGE, ObservationKind.MESSAGE_TAKEN


def places_of(interface: Interface, channel: str) -> Iterator[tuple[Place, OutputKind | None]]:
    """What a node does by ``interface``, whose channel is ``channel``.

    Each with what its machine has to send for that; None: it does it without that.
    """
    parts = [channel_of_part(channel, part) for part in SERVICES]
    match interface.kind:
        case InterfaceKind.PUBLISHER:
            yield (channel, _MESSAGE), OutputKind.PUBLISH
        case InterfaceKind.SUBSCRIBER if not interface.own:
            yield (channel, _TAKEN), None
        case InterfaceKind.SERVER:
            yield from (((channel, kind), None) for kind in SERVER_END)
        case InterfaceKind.CLIENT:
            yield from (((channel, kind), OutputKind.REQUEST) for kind in CLIENT_END)
        case InterfaceKind.ACTION_SERVER:
            yield from (((part, kind), None) for part in parts for kind in SERVER_END)
            yield from (((channel_of_part(channel, part), _MESSAGE), None) for part in TOPICS)
        case InterfaceKind.ACTION_CLIENT:
            goal, cancel = OutputKind.SEND_GOAL, OutputKind.SEND_CANCEL
            for part, output in zip(parts, (goal, cancel, goal), strict=True):
                yield from (((part, kind), output) for kind in CLIENT_END)
            yield (channel_of_part(channel, "feedback"), _TAKEN), None


def places(machine: Machine, only_sent: bool = False) -> Iterator[Place]:
    """What the node of ``machine`` does; ``only_sent``: not what its model declares, and never sends."""
    owners = with_threads(machine)
    sent = {(kind, name) for owner in owners for kind, name in emits_of(owner)}
    for interface in (item for owner in owners for item in owner.interfaces):
        for place, output in places_of(interface, interface.channel) if interface.channel else ():
            if not only_sent or output is None or (output, interface.name) in sent:
                yield place


def nodes_at(
    machines: Iterable[Machine], plugins: Iterable[Machine] = (), only_sent: bool = False
) -> dict[Place, set[str]]:
    """The nodes that do something at each place (see :func:`places`); what plugins do, the policy does."""
    found: dict[Place, set[str]] = {}
    for name, machine in (
        *((node.name, node) for node in machines),
        *((POLICY, plugin) for plugin in plugins),
    ):
        for place in places(machine, only_sent):
            found.setdefault(place, set()).add(name)
    return found


def by_channel(found: Mapping[tuple[str, Any], set[str]]) -> dict[str, set[str]]:
    """The nodes of all places of each channel; a topic and a service may be called alike."""
    nodes: dict[str, set[str]] = {}
    for (channel, _), names in found.items():
        nodes[channel] = nodes.get(channel, set()) | names
    return nodes
