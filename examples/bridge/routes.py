"""Which channels cross a bridge, told from the models and from which node is where."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from m2c.model import DiagnosticLog
from m2c.model.machine import Interface, InterfaceKind
from m2c.policy.program import read_policy
from m2c.runtime.messages import message_class
from transports.interface import Action, Reliability, Service, Topic

if TYPE_CHECKING:
    from m2c.model.interfaces import InterfaceLibrary
    from m2c.model.system import System

POLICY = "policy"

_SERVED = {
    InterfaceKind.SERVER: InterfaceKind.CLIENT,
    InterfaceKind.ACTION_SERVER: InterfaceKind.ACTION_CLIENT,
    InterfaceKind.PUBLISHER: InterfaceKind.SUBSCRIBER,
}
"""Who gives, and who takes."""


class PlacementError(Exception):
    """The nodes cannot be placed so; the text says why."""


class Placement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which node is on which side; the policy counts as a node called ``policy``.

    Attributes:
        sides: transport per name, e.g. ``{"zenoh": ["WaitSkill", "policy"], "ros2": [...]}``.
    """

    sides: dict[str, tuple[str, ...]]

    def side_of(self, node: str) -> str:
        """The transport that ``node`` is on."""
        return next(side for side, nodes in self.sides.items() if node in nodes)


class Route(msgspec.Struct, frozen=True):
    """A channel that crosses.

    Attributes:
        channel: what is handed on.
        given: the transport where its publisher or server is.
        taken: the other one.
    """

    channel: Topic | Service | Action
    given: str
    taken: str


def read_placement(path: Path, system: System) -> Placement:
    """Read which node of ``system`` is where.

    Raises:
        PlacementError: it cannot be read, or does not place every node, once, on two sides.
    """
    try:
        placement = msgspec.yaml.decode(path.read_bytes(), type=Placement)
    except OSError as error:
        raise PlacementError(f"{path}: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise PlacementError(f"{path}: {error}") from error
    names = {node.name for node in system.nodes} | ({POLICY} if system.policy else set())
    placed = [node for nodes in placement.sides.values() for node in nodes]
    if len(placement.sides) != 2:
        raise PlacementError(f"{path}: {len(placement.sides)} sides; a bridge has two")
    for fault, found in (
        ("not placed", names - set(placed)),
        ("not in the system", set(placed) - names),
        ("placed twice", {node for node in placed if placed.count(node) > 1}),
    ):
        if found:
            raise PlacementError(f"{path}: {fault}: {', '.join(sorted(found))}")
    return placement


def routes(system: System, placement: Placement) -> list[Route]:
    """What crosses: a channel that is given on one side and taken on the other.

    Raises:
        PlacementError: a channel is given on both sides and would be handed on in circles.
    """
    given: dict[tuple[InterfaceKind, str], Interface] = {}
    givers: dict[tuple[InterfaceKind, str], set[str]] = {}
    takers: dict[tuple[InterfaceKind, str], set[str]] = {}
    for node, interface in _ends(system):
        if interface.channel is None:
            continue
        side = placement.side_of(node)
        if interface.kind in _SERVED:
            place = (_SERVED[interface.kind], interface.channel)
            given[place] = interface
            givers.setdefault(place, set()).add(side)
        else:
            takers.setdefault((interface.kind, interface.channel), set()).add(side)
    for side, service in _called_by_policy(system, placement):
        takers.setdefault((InterfaceKind.CLIENT, service), set()).add(side)
    found = []
    for place, interface in given.items():
        sides = givers[place]
        for taken in sorted(takers.get(place, set()) - sides):
            (side,) = sides
            found.append(Route(_channel(interface, system.library), side, taken))
        if len(sides) > 1 and takers.get(place):
            raise PlacementError(
                f"{place[1]} is given on both sides: a bridge would hand it on in circles"
            )
    return found


def _ends(system: System) -> Iterable[tuple[str, Interface]]:
    for machine in system.nodes:
        for interface in machine.interfaces:
            yield machine.name, interface
    for machine in system.plugins:
        for interface in machine.interfaces:
            yield POLICY, interface


def _called_by_policy(system: System, placement: Placement) -> Iterable[tuple[str, str]]:
    if system.policy is None:
        return
    log = DiagnosticLog()
    policy = read_policy(system.policy, system, log)
    log.raise_if_errors()
    assert policy is not None
    for leaf in policy.leaves:
        for service in (leaf.tick, leaf.halt):
            if service:
                yield placement.side_of(POLICY), service


def _channel(interface: Interface, library: InterfaceLibrary) -> Topic | Service | Action:
    name, type_name = interface.channel or "", interface.type_name
    if interface.kind is InterfaceKind.PUBLISHER:
        reliability = Reliability.BEST_EFFORT if interface.best_effort else Reliability.RELIABLE
        message = message_class(library.message(type_name))
        return Topic(name, type_name, message, reliability, interface.transient_local)
    if interface.kind is InterfaceKind.SERVER:
        service = library.service(type_name)
        request, response = message_class(service.request), message_class(service.response)
        return Service(name, type_name, request, response)
    action = library.action(type_name)
    parts: Mapping[str, type[msgspec.Struct]] = {
        part: message_class(getattr(action, part)) for part in ("goal", "result", "feedback")
    }
    return Action(name, type_name, **parts)
