"""How a system is wired: its nodes, the channels that each offers, and who uses which."""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum

import msgspec

from m2c.draw import svg
from m2c.draw.layers import Link
from m2c.draw.layout import Layout, lay_out, path
from m2c.draw.wording import short_names
from m2c.model.machine import Interface, InterfaceKind, Machine
from m2c.model.system import System

POLICY = "policy"
OUTSIDE = "outside the system"

_PADDING = 12.0
_MARGIN = 16.0
_HEAD = 28.0
_ROW = 22.0
_COLUMNS = 48
"""Characters of a name; longer ones are shortened."""
_PER_SKILL = 54.0
"""Side of the policy for each of its links, and from one skill to the next: the links are straight."""
_PER_LINK = 12.0
"""Side of a box for each link that leaves it."""


class Sort(StrEnum):
    """What a channel is; also the class of its lines in a picture."""

    TOPIC = "topic"
    SERVICE = "service"
    ACTION = "action"


_OFFERS = {
    InterfaceKind.PUBLISHER: Sort.TOPIC,
    InterfaceKind.SERVER: Sort.SERVICE,
    InterfaceKind.ACTION_SERVER: Sort.ACTION,
}
_USES = {
    InterfaceKind.SUBSCRIBER: Sort.TOPIC,
    InterfaceKind.CLIENT: Sort.SERVICE,
    InterfaceKind.ACTION_CLIENT: Sort.ACTION,
}


class Offer(msgspec.Struct, frozen=True):
    """A channel that a node publishes, or serves."""

    channel: str
    sort: Sort


class Place(msgspec.Struct, frozen=True):
    """A node, the policy, or what is outside the system.

    Attributes:
        name: of the node.
        role: ``policy``, ``skill`` (the policy calls it), ``plugin`` (the policy runs it), ``node`` or
            ``outside``.
        offers: what others use, or nobody; in the order of the model.
        served: what only the policy calls.
    """

    name: str
    role: str
    offers: tuple[Offer, ...] = ()
    served: tuple[Offer, ...] = ()


class Wire(msgspec.Struct, frozen=True):
    """``places[user]`` uses ``offer`` of ``places[provider]``; None: its served channels."""

    user: int
    provider: int
    offer: Offer | None


class Wiring(msgspec.Struct, frozen=True):
    """Everything that is drawn."""

    name: str
    places: tuple[Place, ...]
    wires: tuple[Wire, ...]


def wiring_of(system: System, policy_calls: Collection[str] = ()) -> Wiring:
    """The wiring of ``system``.

    Args:
        system: the nodes, the policy's plugins and what they declare; plugins without channels are left out.
        policy_calls: channels that the policy's leaves use; without any there is no policy in it.
    """
    called = [Offer(channel, Sort.SERVICE) for channel in policy_calls]
    plugins = [one for one in system.plugins if _offers(one) or _used(one)]
    machines = [*system.nodes, *plugins]
    used = {offer for machine in machines for offer in _used(machine)}
    places = [Place(POLICY, "policy")] if called else []
    first = len(places)
    providers: dict[Offer, list[int]] = {}
    for machine in machines:
        offers = _offers(machine)
        served = tuple(offer for offer in offers if offer in called and offer not in used)
        rest = tuple(offer for offer in offers if offer not in served)
        for offer in rest:
            providers.setdefault(offer, []).append(len(places))
        role = "plugin" if machine in plugins else "skill" if served else "node"
        places.append(Place(machine.name, role, rest, served))
    wires = [
        Wire(0, index, None)
        for index, place in enumerate(places)
        if index >= first and place.served
    ]
    only_served = {offer for place in places for offer in place.served}
    calls = [(0, offer) for offer in called if offer not in only_served]
    for index, machine in enumerate(machines, first):
        calls += [(index, offer) for offer in _used(machine)]
    outside = dict.fromkeys(offer for _, offer in calls if offer not in providers)
    if outside:
        providers.update((offer, [len(places)]) for offer in outside)
        places.append(Place(OUTSIDE, "outside", tuple(outside)))
    wires += [
        Wire(user, provider, offer)
        for user, offer in calls
        for provider in providers[offer]
        if provider != user
    ]
    return Wiring(system.name, tuple(places), tuple(wires))


def _named(interface: Interface) -> str:
    """A channel that a port gives is called by the port."""
    return interface.channel if interface.channel is not None else f"{{{interface.port}}}"


def _offers(node: Machine) -> list[Offer]:
    found = [
        Offer(_named(one), _OFFERS[one.kind]) for one in node.interfaces if one.kind in _OFFERS
    ]
    return list(dict.fromkeys(found))


def _used(node: Machine) -> list[Offer]:
    found = [Offer(_named(one), _USES[one.kind]) for one in node.interfaces if one.kind in _USES]
    return list(dict.fromkeys(found))


def offer_names(wiring: Wiring) -> dict[str, str]:
    """How each channel is called inside its box: by its last parts, which name no other there."""
    found: dict[str, str] = {}
    for place in wiring.places:
        names = [offer.channel for offer in (*place.offers, *place.served)]
        found.update(zip(names, names, strict=True) if place.role == "outside" else ())
        if place.role != "outside":
            found.update(short_names(names))
    return found


def draw_wiring(wiring: Wiring) -> svg.Picture:
    """Who uses stands left of who offers; arrows point where messages or requests arrive."""
    return _Drawing(wiring).picture()


class _Drawing:
    def __init__(self, wiring: Wiring) -> None:
        self._wiring = wiring
        self._names = offer_names(wiring)

    def picture(self) -> svg.Picture:
        layout, sizes = self._layout()
        parts: list[str] = []
        top = _MARGIN
        for wire, route in zip(self._wiring.wires, layout.routes, strict=True):
            sort = "service" if wire.offer is None else str(wire.offer.sort)
            points = tuple((x + _MARGIN, y + top) for x, y in route.points)
            if sort == Sort.TOPIC:
                points = points[::-1]
            moved = msgspec.structs.replace(route, points=points)
            parts.append(svg.line(path(layout, moved), f"line {sort}", tip="tip"))
        for place, size, (x, y) in zip(self._wiring.places, sizes, layout.corners, strict=True):
            parts += self._place(place, size, x + _MARGIN, y + top)
        bottom = layout.height + top + 26
        legend, reach = _legend(_MARGIN, bottom)
        return svg.Picture(max(layout.width + 2 * _MARGIN, reach), bottom + 14, (*parts, *legend))

    def _layout(self) -> tuple[Layout, list[tuple[float, float]]]:
        leaving = [0] * len(self._wiring.places)
        for wire in self._wiring.wires:
            leaving[wire.user] += 1
        sizes = [
            self._size(place, leaving[index]) for index, place in enumerate(self._wiring.places)
        ]
        widest: dict[str, float] = {}
        for place, (width, _) in zip(self._wiring.places, sizes, strict=True):
            widest[place.role] = max(widest.get(place.role, 0.0), width)
        sizes = [
            (widest[place.role], height)
            for place, (_, height) in zip(self._wiring.places, sizes, strict=True)
        ]
        links = [
            Link(source=wire.user, target=wire.provider, target_at=self._row_of(wire))
            for wire in self._wiring.wires
        ]
        return lay_out(sizes, links, sideways=True), sizes

    def _row_of(self, wire: Wire) -> float:
        if wire.offer is None:
            return _HEAD / 2
        offers = self._wiring.places[wire.provider].offers
        return _HEAD + (offers.index(wire.offer) + 0.5) * _ROW

    def _size(self, place: Place, leaving: int) -> tuple[float, float]:
        served = self._served(place)
        head = svg.name_width(svg.shortened(place.name, _COLUMNS))
        if served:
            head += svg.name_width(served, 11, bold=False) + 22
        rows = [svg.name_width(self._row(offer), bold=False) for offer in place.offers]
        width = max([head, *rows]) + 2 * _PADDING
        height = _HEAD + _ROW * len(place.offers) + (4 if place.offers else 0)
        if place.role == "policy":
            return max(width, 64.0), max(height, _PER_SKILL * leaving)
        return width, max(height, _PER_LINK * (leaving + 1))

    def _served(self, place: Place) -> str:
        if place.role == "plugin":
            return "plugin"
        names = " · ".join(self._names[offer.channel] for offer in place.served)
        return svg.shortened(names, _COLUMNS)

    def _row(self, offer: Offer) -> str:
        return svg.shortened(f"{offer.sort} {self._names[offer.channel]}", _COLUMNS)

    def _place(self, place: Place, size: tuple[float, float], x: float, y: float) -> list[str]:
        width, height = size
        kind = {"skill": "tool", "plugin": "tool", "outside": "outside"}.get(place.role, "box")
        parts = [svg.box(x, y, width, height, kind)]
        name = svg.shortened(place.name, _COLUMNS)
        if place.role == "policy":
            middle = y + height / 2
            parts.append(svg.text(x + width / 2, middle - 6, name, "head", "middle"))
            parts.append(svg.text(x + width / 2, middle + 12, "ticks,", "small", "middle"))
            parts.append(svg.text(x + width / 2, middle + 26, "halts", "small", "middle"))
            return parts
        base = y + (19 if place.offers else height / 2 + 5)
        parts.append(svg.text(x + _PADDING, base, name, "head"))
        if served := self._served(place):
            parts.append(svg.text(x + width - _PADDING, base, served, "small", "end"))
        for row, offer in enumerate(place.offers):
            at = y + _HEAD + (row + 0.5) * _ROW + 4
            parts.append(svg.text(x + _PADDING, at, self._row(offer)))
        return parts


def _legend(x: float, y: float) -> tuple[list[str], float]:
    """What the lines mean, and where that ends."""
    parts: list[str] = []
    for kind, words in (
        (Sort.TOPIC, "topic"),
        (Sort.SERVICE, "service call"),
        (Sort.ACTION, "action: goal, feedback, result, cancel"),
    ):
        parts.append(
            svg.line(f"M{svg.number(x)},{svg.number(y)} H{svg.number(x + 36)}", f"line {kind}")
        )
        parts.append(svg.text(x + 44, y + 4, words, "small"))
        x += 44 + svg.name_width(words, 11, bold=False) + 28
    return parts, x
