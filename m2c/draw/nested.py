"""A layered layout of boxes in boxes: the inside of each is laid out, and is a box of the one around it.

A link that crosses a side of a box leads to that side in the layout inside, and ends at the same place of
it in the layout around.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import msgspec

from m2c.draw.bounds import MAX_ITEMS, TooLargeError
from m2c.draw.layers import Edge, Link, against
from m2c.draw.layout import Layout, Point, Route, lay_out

_PADDING = 14.0
"""Between the sides of a box and what is inside."""


class _Piece(msgspec.Struct, frozen=True):
    """A link as far as it runs in one layout, between boxes; None: a side of the box around them."""

    source: int | None
    target: int | None


class _Inside(msgspec.Struct, frozen=True):
    """What is inside a box.

    Attributes:
        layout: its first boxes are those inside, its routes those of the links that run there.
        ports: where links end at the box's sides, along these.
        size: of the box.
    """

    layout: Layout
    ports: dict[int, float]
    size: Point


def lay_out_nested(
    parents: Sequence[int | None],
    sizes: Sequence[Point],
    links: Sequence[Link],
    sideways: bool,
) -> tuple[Layout, list[Point]]:
    """Place boxes, some in others, and the ``links`` between them; with the sizes that the boxes have then.

    Args:
        parents: in which box each one stands; None: in none.
        sizes: of the boxes; of one with others inside, of its head: above these where the drawing is
            ``sideways``, else left of them.
        links: without any from a box to itself.
        sideways: from left to right; else from top to bottom.

    Raises:
        TooLargeError: there is too much of it.
    """
    return _Nested(parents, sizes, links, sideways).layout()


class _Nested:
    def __init__(
        self,
        parents: Sequence[int | None],
        sizes: Sequence[Point],
        links: Sequence[Link],
        sideways: bool,
    ) -> None:
        self._parents = parents
        self._sizes = sizes
        self._links = links
        self._sideways = sideways
        self._boxes: dict[int | None, list[int]] = {}
        for box, parent in enumerate(parents):
            self._boxes.setdefault(parent, []).append(box)
        self._pieces: dict[int | None, dict[int, _Piece]] = {}
        self._insides: dict[int | None, _Inside] = {}
        self._ways = [self._way(number) for number in range(len(links))]
        """For each link: in which boxes it runs, in order, and the outermost of them."""
        self._items = 0

    # -- which links run where --------------------------------------------------------------------

    def _way(self, number: int) -> tuple[list[int | None], int | None]:
        link = self._links[number]
        ends = [[None, *reversed([*self._chain(box)])] for box in (link.source, link.target)]
        shared = sum(one == other for one, other in zip(*ends, strict=False))
        around = ends[0][shared - 1]
        out, into = (end[shared:] for end in ends)
        pieces: dict[int | None, _Piece] = {
            parent: _Piece(box, None) for parent, box in zip(out[-2::-1], out[:0:-1], strict=True)
        }
        pieces[around] = _Piece(out[0] if out else None, into[0] if into else None)
        pieces |= {parent: _Piece(None, box) for parent, box in pairwise(into)}
        for parent, piece in pieces.items():
            self._pieces.setdefault(parent, {})[number] = piece
        return list(pieces), around

    def _chain(self, box: int | None) -> Iterator[int]:
        """A box and those that it stands in."""
        while box is not None:
            yield box
            box = self._parents[box]

    # -- from the inside out ----------------------------------------------------------------------

    def _lay_out(self, around: int | None, edges: Mapping[int, Edge]) -> None:
        """Lay out what is in ``around``, of which links end at the sides ``edges``."""
        boxes, pieces = self._boxes[around], self._pieces.get(around, {})
        places: dict[int, int] = {box: place for place, box in enumerate(boxes)}
        own = {
            number: Edge.FIRST if piece.source is None else Edge.LAST
            for number, piece in pieces.items()
            if piece.source is None or piece.target is None
        }
        sides = {**own, **edges}
        ports = {number: len(boxes) + place for place, number in enumerate(sides)}
        at = {ports[number]: edge for number, edge in sides.items()}
        links = [
            Link(
                source=ports[number] if piece.source is None else places[piece.source],
                target=ports[number] if piece.target is None else places[piece.target],
                label=self._links[number].label if self._ways[number][1] == around else None,
            )
            for number, piece in pieces.items()
        ]
        ends: dict[int | None, dict[int, Edge]] = {}
        turned = against(len(boxes) + len(ports), links, at)
        for (number, piece), back in zip(pieces.items(), turned, strict=True):
            ends.setdefault(piece.source, {})[number] = Edge.FIRST if back else Edge.LAST
            ends.setdefault(piece.target, {})[number] = Edge.LAST if back else Edge.FIRST
        for box in boxes:
            if box in self._boxes:
                self._lay_out(box, ends.get(box, {}))
        links = [
            msgspec.structs.replace(
                link,
                source_at=self._port(piece.source, number),
                target_at=self._port(piece.target, number),
            )
            for (number, piece), link in zip(pieces.items(), links, strict=True)
        ]
        sizes = [*map(self._size, boxes), *[(0.0, 0.0)] * len(ports)]
        layout = lay_out(sizes, links, self._sideways, at)
        self._add(layout.items)
        self._insides[around] = _Inside(
            layout,
            {number: self._across(layout.corners[port]) for number, port in ports.items()},
            self._around(layout, (0.0, 0.0) if around is None else self._sizes[around]),
        )

    def _add(self, items: int) -> None:
        self._items += items
        if self._items > MAX_ITEMS:
            boxes, links = len(self._sizes), len(self._links)
            what = f"{boxes:,} boxes with {links:,} links make no readable picture"
            raise TooLargeError(f"{what}; draw them as .dot or .mmd, or draw a part")

    def _around(self, layout: Layout, head: Point) -> Point:
        """The size of a box with a head, and ``layout`` inside."""
        width, height = layout.width + 2 * _PADDING, layout.height + 2 * _PADDING
        if self._sideways:
            return max(head[0], width), head[1] + height
        return head[0] + width, max(head[1], height)

    def _begin(self, box: int) -> Point:
        """Where the inside of ``box`` begins, from its corner."""
        width, height = self._sizes[box]
        return (_PADDING, height + _PADDING) if self._sideways else (width + _PADDING, _PADDING)

    def _across(self, point: Point) -> float:
        return point[1] if self._sideways else point[0]

    def _size(self, box: int) -> Point:
        return self._insides[box].size if box in self._insides else self._sizes[box]

    def _port(self, box: int | None, number: int) -> float | None:
        """Where the link ends at a side of ``box``; None: anywhere."""
        if box is None or box not in self._insides:
            return None
        return self._across(self._begin(box)) + self._insides[box].ports[number]

    # -- from the outside in ----------------------------------------------------------------------

    def layout(self) -> tuple[Layout, list[Point]]:
        self._add(sum(map(len, self._pieces.values())))  # each is an item at least
        self._items = 0
        self._lay_out(None, {})
        corners: list[Point] = [(0.0, 0.0)] * len(self._sizes)
        routes: dict[tuple[int | None, int], Route] = {}
        todo: list[tuple[int | None, Point]] = [(None, (0.0, 0.0))]
        while todo:
            around, begin = todo.pop()
            moved = self._insides[around].layout.moved(*begin)
            for number, route in zip(self._pieces.get(around, {}), moved.routes, strict=True):
                routes[around, number] = route
            for box, (x, y) in zip(self._boxes[around], moved.corners, strict=False):
                corners[box] = (x, y)
                if box in self._boxes:
                    right, down = self._begin(box)
                    todo.append((box, (x + right, y + down)))
        layout = msgspec.structs.replace(
            self._insides[None].layout,
            corners=tuple(corners),
            routes=tuple(
                self._route(number, routes, corners) for number in range(len(self._links))
            ),
            items=self._items,
        )
        return layout, [*map(self._size, range(len(self._sizes)))]

    def _route(
        self,
        number: int,
        routes: Mapping[tuple[int | None, int], Route],
        corners: Sequence[Point],
    ) -> Route:
        """A link as a whole."""
        link, (way, around) = self._links[number], self._ways[number]
        points = [point for part in way for point in routes[part, number].points]
        if around == link.source:
            points[:0] = [self._at_side(corners[around], points[0]), points[0]]
        elif around == link.target:
            (x, y), (width, height) = corners[around], self._size(around)
            points += [points[-1], self._at_side((x + width, y + height), points[-1])]
        return Route(tuple(points), routes[around, number].label)

    def _at_side(self, corner: Point, point: Point) -> Point:
        """Beside ``point``, at the side of a box that goes through ``corner``."""
        return (corner[0], point[1]) if self._sideways else (point[0], corner[1])
