"""The second half of a layered layout: where everything is, and how the links run.

Within a layer, items are put where their links are straightest, as far as the order and the room that
each one needs allow: a least-squares fit, solved exactly by pooling neighbours that are in each other's
way (isotonic regression). Links run straight through layers and bend between them only, so that
none touches a box or a label.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import msgspec

from m2c.draw.bounds import ALL_EFFORT
from m2c.draw.layers import Edge, Item, Kind, Layers, Link, arrange

_ROOM = {
    (Kind.BOX, Kind.BOX): 26.0,
    (Kind.LABEL, Kind.LABEL): 12.0,
    (Kind.PASSAGE, Kind.PASSAGE): 12.0,
}
_ROOM_BETWEEN_KINDS = 16.0
_STIFFNESS = {0: 1.0, 1: 3.0, 2: 9.0}
"""How much a piece of a link wants to be straight, by how many of its ends are no boxes."""
_SWEEPS, _FEWER_SWEEPS = 24, 9
_ANYWHERE = (-1e9, 1e9)
_PORT_ROOM = 11.0
_PORT_MARGIN = 12.0
"""Links end so far from a box's corners, which are round."""
ARROW = 12.0
"""Links arrive straight for so long."""

Point = tuple[float, float]


class Route(msgspec.Struct, frozen=True):
    """A link: ``points`` in pairs, straight within each and bent from one to the next.

    ``label`` is the upper left corner of its label.
    """

    points: tuple[Point, ...]
    label: Point | None


class Layout(msgspec.Struct, frozen=True):
    """A drawing's size, the upper left corner of each box, and a route for each link.

    It is made of ``items``, boxes, labels and passages.
    """

    width: float
    height: float
    corners: tuple[Point, ...]
    routes: tuple[Route, ...]
    sideways: bool
    items: int

    @property
    def large(self) -> bool:
        """Whether it took long, and little effort was made for it."""
        return self.items > ALL_EFFORT

    def moved(self, x: float, y: float) -> Layout:
        """The same, further right and down."""
        routes = tuple(
            msgspec.structs.replace(
                route,
                points=tuple((a + x, b + y) for a, b in route.points),
                label=None if route.label is None else (route.label[0] + x, route.label[1] + y),
            )
            for route in self.routes
        )
        corners = tuple((a + x, b + y) for a, b in self.corners)
        return msgspec.structs.replace(self, corners=corners, routes=routes)


def lay_out(
    sizes: Sequence[tuple[float, float]],
    links: Sequence[Link],
    sideways: bool,
    edges: Mapping[int, Edge] | None = None,
) -> Layout:
    """Place boxes of ``sizes`` (width, height) and the ``links`` between them.

    Args:
        sizes: of the boxes; the drawing begins with the first.
        links: without any from a box to itself.
        sideways: from left to right; else from top to bottom.
        edges: boxes that stand in the first or the last layer (:func:`m2c.draw.layers.arrange`).

    Raises:
        TooLargeError: there is too much of it.
    """
    layers = arrange(sizes, links, sideways, edges)
    return _Placement(layers, links, sideways).layout(len(sizes))


def path(layout: Layout, route: Route) -> str:
    """A route as the ``d`` of an SVG path."""
    (x, y), *others = route.points
    parts = [f"M{_short(x)},{_short(y)}"]
    for index, (to_x, to_y) in enumerate(others):
        if index % 2 and (x, y) != (to_x, to_y):
            if layout.sideways:
                middle = (x + to_x) / 2
                turns = (middle, y, middle, to_y)
                straight = abs(y - to_y) < 0.1
            else:
                middle = (y + to_y) / 2
                turns = (x, middle, to_x, middle)
                straight = abs(x - to_x) < 0.1
            if not straight:
                a, b, c, d = map(_short, turns)
                parts.append(f"C{a},{b} {c},{d} {_short(to_x)},{_short(to_y)}")
                x, y = to_x, to_y
                continue
        if (x, y) != (to_x, to_y):
            parts.append(f"L{_short(to_x)},{_short(to_y)}")
        x, y = to_x, to_y
    return " ".join(parts)


def _short(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


class _Placement:
    """The steps from layers to coordinates; all of it in directions along and across."""

    def __init__(self, layers: Layers, links: Sequence[Link], sideways: bool) -> None:
        self._layers = layers
        self._items = layers.items
        self._links = links
        self._sideways = sideways
        self._at = [0.0] * len(layers.items)
        self._ends: list[list[float]] = []
        """For each link: where it leaves its first item and arrives at its last, from their corners."""
        self._sides: dict[tuple[int, int], list[int]] = {}
        """(box, 0 or 1) → the links whose chains begin or end there, in order."""

    def layout(self, boxes: int) -> Layout:
        self._ports()
        self._place()
        self._slide_ports()
        self._straighten()
        self._slide_ports()
        start, end = self._along()
        least = min(self._at, default=0.0)
        self._at = [value - least for value in self._at]
        across = max((self._at[i] + item.across for i, item in enumerate(self._items)), default=0.0)
        corners = [
            self._point(
                start[item.layer] + (end[item.layer] - start[item.layer] - item.along) / 2, at
            )
            for item, at in zip(self._items[:boxes], self._at, strict=False)
        ]
        routes = [self._route(index, start, end) for index in range(len(self._links))]
        along = end[-1] if end else 0.0
        size = (along, across) if self._sideways else (across, along)
        return Layout(*size, tuple(corners), tuple(routes), self._sideways, len(self._items))

    def _point(self, along: float, across: float) -> Point:
        return (along, across) if self._sideways else (across, along)

    # -- where links end on boxes ----------------------------------------------------------------

    def _ports(self) -> None:
        """Spread the ends of links over the sides of their boxes, in the order of their ways."""
        place = {item: n for layer in self._layers.order for n, item in enumerate(layer)}
        self._ends = [[0.0, 0.0] for _ in self._links]
        for index, chain in enumerate(self._layers.chains):
            for side, box in ((0, chain[0]), (1, chain[-1])):
                self._sides.setdefault((box, side), []).append(index)
        for (box, side), links in self._sides.items():
            next_to = 1 if side == 0 else -2
            links.sort(key=lambda index: place[self._layers.chains[index][next_to]])
            size = self._items[box].across
            room = min(_PORT_ROOM * 1.6, (size - 2 * _PORT_MARGIN) / max(len(links) - 1, 1))
            for number, index in enumerate(links):
                fixed = self._fixed(index, side)
                offset = size / 2 + (number - (len(links) - 1) / 2) * room
                self._ends[index][side] = offset if fixed is None else fixed

    def _fixed(self, index: int, side: int) -> float | None:
        link = self._links[index]
        at_source = (side == 0) != self._layers.reversed[index]
        return link.source_at if at_source else link.target_at

    def _slide_ports(self) -> None:
        """Move ends along the sides to where their links are straight."""
        for (box, side), links in self._sides.items():
            if any(self._fixed(index, side) is not None for index in links):
                continue
            size = self._items[box].across
            room = min(_PORT_ROOM, (size - 2 * _PORT_MARGIN) / max(len(links) - 1, 1))
            wanted = []
            for index in links:
                chain = self._layers.chains[index]
                near = chain[1 if side == 0 else -2]
                opposite = self._line(index, 1 if side == 0 else len(chain) - 2)
                wanted.append((self._at[near] + opposite - self._at[box], 1.0))
            lows = [room] * (len(links) - 1)
            margin = min(_PORT_MARGIN, size / 2)
            for index, offset in zip(links, _fit(wanted, lows, margin, size - margin), strict=True):
                self._ends[index][side] = offset

    def _line(self, index: int, step: int) -> float:
        """Where link ``index`` meets the item ``step`` of its chain, from the item's corner."""
        chain = self._layers.chains[index]
        if step == 0:
            return self._ends[index][0]
        if step == len(chain) - 1:
            return self._ends[index][1]
        return self._items[chain[step]].line

    # -- across ----------------------------------------------------------------------------------

    def _place(self) -> None:
        """Put every item where its links are straightest."""
        pulls: list[list[tuple[int, float, float]]] = [[] for _ in self._items]
        pushes: list[list[tuple[int, float, float]]] = [[] for _ in self._items]
        for index, chain in enumerate(self._layers.chains):
            for step in range(len(chain) - 1):
                one, other = chain[step], chain[step + 1]
                shift = self._line(index, step) - self._line(index, step + 1)
                free = sum(self._items[item].kind != Kind.BOX for item in (one, other))
                pulls[other].append((one, shift, _STIFFNESS[free]))
                pushes[one].append((other, -shift, _STIFFNESS[free]))
        for layer in self._layers.order:
            at = 0.0
            for number, item in enumerate(layer):
                at += self._room(layer[number - 1], item) if number else 0.0
                self._at[item] = at
                at += self._items[item].across
        sweeps = _SWEEPS if len(self._items) <= ALL_EFFORT else _FEWER_SWEEPS
        for sweep in range(sweeps):
            downwards = sweep % 2 == 0
            both = sweep >= sweeps // 3
            for layer in self._layers.order if downwards else reversed(self._layers.order):
                wanted = []
                for item in layer:
                    forces = pulls[item] if downwards else pushes[item]
                    if both or not forces:
                        forces = pulls[item] + pushes[item]
                    weight = sum(force for _, _, force in forces)
                    if not weight:
                        wanted.append((self._at[item], 0.01))
                        continue
                    middle = sum((self._at[n] + shift) * force for n, shift, force in forces)
                    wanted.append((middle / weight, weight))
                rooms = [
                    self._items[one].across + self._room(one, other)
                    for one, other in pairwise(layer)
                ]
                for item, at in zip(layer, _fit(wanted, rooms), strict=True):
                    self._at[item] = at

    def _room(self, one: int, other: int) -> float:
        kinds = (self._items[one].kind, self._items[other].kind)
        return _ROOM.get(kinds, _ROOM_BETWEEN_KINDS)

    def _straighten(self) -> None:
        """Give the passages and labels of a link one height where the others leave room for that."""
        slack: dict[int, tuple[int | None, int | None]] = {}
        for layer in self._layers.order:
            for number, item in enumerate(layer):
                above = layer[number - 1] if number else None
                below = layer[number + 1] if number + 1 < len(layer) else None
                slack[item] = (above, below)
        for _ in range(4):
            for chain in self._layers.chains:
                run: list[int] = []
                low, high = _ANYWHERE
                for item in chain[1:-1]:
                    least, most = self._free(item, *slack[item])
                    if run and max(low, least) > min(high, most):
                        self._level(run, low, high)
                        run, (low, high) = [], _ANYWHERE
                    run.append(item)
                    low, high = max(low, least), min(high, most)
                self._level(run, low, high)

    def _free(self, item: int, above: int | None, below: int | None) -> tuple[float, float]:
        """Between which heights the line of ``item`` may be, its neighbours staying where they are."""
        least, most = _ANYWHERE
        line = self._items[item].line
        if above is not None:
            edge = self._at[above] + self._items[above].across
            least = edge + self._room(above, item) + line
        if below is not None:
            rest = self._items[item].across - line
            most = self._at[below] - self._room(item, below) - rest
        return least, most

    def _level(self, run: list[int], low: float, high: float) -> None:
        if len(run) < 2 or low > high:
            return
        lines = sorted(self._at[item] + self._items[item].line for item in run)
        level = min(max(lines[len(lines) // 2], low), high)
        for item in run:
            self._at[item] = level - self._items[item].line

    # -- along -----------------------------------------------------------------------------------

    def _along(self) -> tuple[list[float], list[float]]:
        """Start and end of each layer; steep links get more room to bend."""
        order = self._layers.order
        steepest, bends = [0.0] * len(order), [0] * len(order)
        for index, chain in enumerate(self._layers.chains):
            for step in range(len(chain) - 1):
                one, other = chain[step], chain[step + 1]
                rise = abs(
                    self._at[one]
                    + self._line(index, step)
                    - self._at[other]
                    - self._line(index, step + 1)
                )
                layer = self._items[one].layer
                steepest[layer] = max(steepest[layer], rise)
                bends[layer] += rise > 1
        start: list[float] = []
        end: list[float] = []
        at = 0.0
        for number, items in enumerate(order):
            start.append(at)
            at += max((self._items[item].along for item in items), default=0.0)
            end.append(at)
            at += ARROW + 16 + min(60.0, 0.09 * steepest[number] + 1.5 * bends[number])
        return start, end

    def _route(self, index: int, start: list[float], end: list[float]) -> Route:
        chain = self._layers.chains[index]
        points: list[Point] = []
        label = None
        back = self._layers.reversed[index]
        for step, number in enumerate(chain):
            item = self._items[number]
            across = self._at[number] + self._line(index, step)
            first, last = start[item.layer], end[item.layer]
            inset = (last - first - item.along) / 2
            if step == 0:
                points += [(last - inset, across), (last + (ARROW if back else 0), across)]
            elif step == len(chain) - 1:
                points += [(first - (0 if back else ARROW), across), (first + inset, across)]
            else:
                points += [(first, across), (last, across)]
                if item.kind is Kind.LABEL:
                    label = self._label(item, number, first, last)
        if back:
            points.reverse()
        return Route(tuple(self._point(*point) for point in points), label)

    def _label(self, item: Item, number: int, first: float, last: float) -> Point:
        return self._point((first + last - item.along) / 2, self._at[number])


def _fit(
    wanted: Sequence[tuple[float, float]],
    rooms: Sequence[float],
    least: float | None = None,
    most: float | None = None,
) -> list[float]:
    """Places nearest to the wanted ones (place, weight), each ``rooms`` after the one before it."""
    shifts = [0.0]
    for room in rooms:
        shifts.append(shifts[-1] + room)
    pools: list[tuple[float, float, int]] = []
    for (place, weight), shift in zip(wanted, shifts, strict=True):
        mean, total, count = place - shift, weight, 1
        while pools and pools[-1][0] > mean:
            other, other_weight, other_count = pools.pop()
            mean = (mean * total + other * other_weight) / (total + other_weight)
            total += other_weight
            count += other_count
        pools.append((mean, total, count))
    fitted = [mean for mean, _, count in pools for _ in range(count)]
    if least is not None and most is not None:
        highest = most - shifts[-1]
        fitted = [max(min(value, highest), min(least, highest)) for value in fitted]
    return [value + shift for value, shift in zip(fitted, shifts, strict=True)]
