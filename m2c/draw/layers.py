"""The first half of a layered layout: which layer each box is in, and in which order there.

After K. Sugiyama, S. Tagawa and M. Toda, "Methods for visual understanding of hierarchical system
structures", IEEE Trans. SMC 11(2), 1981. Where links have labels, boxes stand in even layers, and
the labels are boxes themselves, in odd layers, as in E. R. Gansner, E. Koutsofios, S. C. North and
K.-P. Vo, "A technique for drawing directed graphs", IEEE TSE 19(3), 1993: so no label can lie on
anything. A link that passes a layer has an item without extent there.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections.abc import Mapping, Sequence
from enum import IntEnum
from itertools import pairwise

import msgspec

from m2c.draw.bounds import ALL_EFFORT, MAX_ITEMS, TooLargeError

_SWEEPS, _FEWER_SWEEPS = 24, 8
_TRANSPOSED_UP_TO = 1_500
"""Larger drawings are left as the sweeps have them: exchanging neighbours is quadratic there."""


class Link(msgspec.Struct, frozen=True, kw_only=True):
    """A line between two boxes.

    Attributes:
        source, target: indices of boxes, which differ.
        label: width and height of its label; None if it has none.
        source_at, target_at: where it ends on the box's side, from its first corner; None: anywhere.
    """

    source: int
    target: int
    label: tuple[float, float] | None = None
    source_at: float | None = None
    target_at: float | None = None


class Kind(IntEnum):
    """What stands in a layer."""

    BOX = 0
    LABEL = 1
    PASSAGE = 2


class Item(msgspec.Struct):
    """Something in a layer.

    Attributes:
        kind: what it is.
        layer: where.
        along, across: its extent in the direction of the layers' sequence, and within the layer.
        line: where the link passes it, from its first corner (labels, passages).
        before, after: items of the neighbouring layers that links join it with.
    """

    kind: Kind
    layer: int
    along: float
    across: float
    line: float = 0.0
    before: list[int] = msgspec.field(default_factory=list)
    after: list[int] = msgspec.field(default_factory=list)


class Layers(msgspec.Struct):
    """Items, the items of each layer in order, the items of each link from its first layer on.

    ``reversed`` says of each link whether its chain begins at its target.
    """

    items: list[Item]
    order: list[list[int]]
    chains: list[list[int]]
    reversed: list[bool]


class Edge(IntEnum):
    """A side of a drawing, and of each box, at which links end: where the layers begin, or end."""

    FIRST = 0
    LAST = 1


def arrange(
    sizes: Sequence[tuple[float, float]],
    links: Sequence[Link],
    sideways: bool,
    edges: Mapping[int, Edge] | None = None,
) -> Layers:
    """Layers of boxes of ``sizes`` (width, height).

    Args:
        sizes: of the boxes; the first box comes first.
        links: the lines between them.
        sideways: the layers are columns, from left to right; else rows, from top to bottom.
        edges: boxes that stand in the first or the last layer, the last ones of ``sizes``; each has one
            link at most, and no two are linked.

    Raises:
        TooLargeError: the links pass too many layers.
    """
    edges = edges or {}
    turned = against(len(sizes), links, edges)
    arcs = [
        (link.target, link.source) if back else (link.source, link.target)
        for link, back in zip(links, turned, strict=True)
    ]
    ranks = _ranks(len(sizes), arcs)
    for box, edge in edges.items():
        ranks[box] = 0 if edge is Edge.FIRST else max(ranks)
    step = 2 if any(link.label is not None for link in links) else 1
    if len(sizes) + sum(step * (ranks[high] - ranks[low]) for low, high in arcs) > MAX_ITEMS:
        what = f"{len(sizes):,} boxes with {len(links):,} links make no readable picture"
        raise TooLargeError(f"{what}; draw them as .dot or .mmd, or draw a part")
    items = [
        Item(
            Kind.PASSAGE if box in edges else Kind.BOX,
            step * rank,
            *(size if sideways else size[::-1]),
        )
        for box, (rank, size) in enumerate(zip(ranks, sizes, strict=True))
    ]
    layers = Layers(items, [], [], turned)
    load = [0.0] * (step * max(ranks, default=0) + 1)
    for link, (low, high), back in zip(links, arcs, turned, strict=True):
        layers.chains.append(_chain(items, low, high, link.label, back, sideways, load))
    for chain in layers.chains:
        for one, next_one in pairwise(chain):
            items[one].after.append(next_one)
            items[next_one].before.append(one)
    layers.order = _first_order(layers)
    _uncross(layers)
    return layers


def against(count: int, links: Sequence[Link], edges: Mapping[int, Edge]) -> list[bool]:
    """Which links run against the layers: to the first of them, from the last, or closing a cycle.

    Cycles are found depth first from the first box on. The arguments are those of :func:`arrange`.
    """
    cyclic = _cyclic(count, links)
    return [
        back or edges.get(link.source) is Edge.LAST or edges.get(link.target) is Edge.FIRST
        for link, back in zip(links, cyclic, strict=True)
    ]


def _cyclic(count: int, links: Sequence[Link]) -> list[bool]:
    leaving: list[list[int]] = [[] for _ in range(count)]
    for index, link in enumerate(links):
        leaving[link.source].append(index)
    against = [False] * len(links)
    open_, done = [False] * count, [False] * count
    for root in range(count):
        if done[root]:
            continue
        stack = [(root, iter(leaving[root]))]
        open_[root] = True
        while stack:
            box, rest = stack[-1]
            index = next(rest, -1)
            if index < 0:
                stack.pop()
                open_[box], done[box] = False, True
                continue
            target = links[index].target
            if open_[target]:
                against[index] = True
            elif not done[target]:
                open_[target] = True
                stack.append((target, iter(leaving[target])))
    return against


def _ranks(count: int, arcs: Sequence[tuple[int, int]]) -> list[int]:
    """Ranks that every arc ascends, with short arcs."""
    after: list[list[int]] = [[] for _ in range(count)]
    before: list[list[int]] = [[] for _ in range(count)]
    for low, high in arcs:
        after[low].append(high)
        before[high].append(low)
    waiting = [len(found) for found in before]
    ready = [box for box in range(count) if not waiting[box]]
    sequence: list[int] = []
    ranks = [0] * count
    while ready:
        box = ready.pop(0)
        sequence.append(box)
        for high in after[box]:
            ranks[high] = max(ranks[high], ranks[box] + 1)
            waiting[high] -= 1
            if not waiting[high]:
                ready.append(high)
    for _ in range(4):  # a box moves towards where more of its links lead
        for box in reversed(sequence):
            if len(after[box]) > len(before[box]):
                ranks[box] = min(ranks[high] for high in after[box]) - 1
        for box in sequence:
            if len(before[box]) > len(after[box]):
                ranks[box] = max(ranks[low] for low in before[box]) + 1
    lowest = min(ranks, default=0)
    return [rank - lowest for rank in ranks]


def _chain(
    items: list[Item],
    low: int,
    high: int,
    label: tuple[float, float] | None,
    back: bool,
    sideways: bool,
    load: list[float],
) -> list[int]:
    """The items of a link; its label stands where there is least, else near where it comes from."""
    first, last = items[low].layer, items[high].layer
    odd = list(range(first + 1, last, 2))
    if back:
        odd.reverse()
    chosen = min(odd, key=lambda layer: load[layer], default=-1)
    chain = [low]
    for layer in range(first + 1, last):
        item = Item(Kind.PASSAGE, layer, 0, 0)
        if layer == chosen and label is not None:
            width, height = label
            if sideways:  # the text stands on its line
                item = Item(Kind.LABEL, layer, width, height, height)
            else:  # the text stands to the right of its line
                item = Item(Kind.LABEL, layer, height, width, 0)
            load[layer] += item.across
        chain.append(len(items))
        items.append(item)
    return [*chain, high]


def _first_order(layers: Layers) -> list[list[int]]:
    """Each layer in the order in which a search in depth meets its items."""
    items = layers.items
    order: list[list[int]] = [[] for _ in range(max((i.layer for i in items), default=0) + 1)]
    seen = [False] * len(items)
    for root in range(len(items)):
        stack = [root]
        while stack:
            here = stack.pop()
            if seen[here]:
                continue
            seen[here] = True
            order[items[here].layer].append(here)
            stack += reversed(items[here].after)
    return order


def _uncross(layers: Layers) -> None:
    """Reorder the layers so that fewer links cross."""
    order, items = layers.order, layers.items
    place = [0] * len(items)

    def number(layer: Sequence[int]) -> None:
        for index, item in enumerate(layer):
            place[item] = index

    for layer in order:
        number(layer)
    best, fewest = [list(layer) for layer in order], _crossings(order, items, place)
    for sweep in range(_SWEEPS if len(items) <= ALL_EFFORT else _FEWER_SWEEPS):
        if not fewest:
            break
        downwards = sweep % 2 == 0
        for layer in order[1:] if downwards else order[-2::-1]:
            keys = {
                item: _middle(
                    [place[n] for n in (items[item].before if downwards else items[item].after)],
                    place[item],
                )
                for item in layer
            }
            layer.sort(key=lambda item: keys[item])
            number(layer)
        if len(items) <= _TRANSPOSED_UP_TO:
            _transpose(order, items, place)
        crossings = _crossings(order, items, place)
        if crossings < fewest:
            best, fewest = [list(layer) for layer in order], crossings
    layers.order = best


def _middle(places: list[int], own: int) -> float:
    """Where an item with such neighbours belongs: the weighted median of Gansner et al."""
    if not places:
        return own
    places.sort()
    middle = len(places) // 2
    if len(places) % 2:
        return places[middle]
    if len(places) == 2:
        return sum(places) / 2
    left, right = places[middle - 1] - places[0], places[-1] - places[middle]
    if left + right == 0:
        return sum(places[middle - 1 : middle + 1]) / 2
    return (places[middle - 1] * right + places[middle] * left) / (left + right)


def _crossings(order: list[list[int]], items: list[Item], place: list[int]) -> int:
    total = 0
    for layer in order[:-1]:
        seen: list[int] = []
        for item in layer:
            ends = [place[target] for target in items[item].after]
            total += sum(len(seen) - bisect_right(seen, end) for end in ends)
            for end in ends:
                insort(seen, end)
    return total


def _transpose(order: list[list[int]], items: list[Item], place: list[int]) -> None:
    """Exchange neighbours for as long as that saves crossings."""
    for _ in range(4):
        improved = False
        for layer in order:
            for index in range(len(layer) - 1):
                one, other = layer[index], layer[index + 1]
                saved = 0
                for ours, theirs in (
                    (items[one].before, items[other].before),
                    (items[one].after, items[other].after),
                ):
                    for mine in ours:
                        for its in theirs:
                            saved += (place[mine] > place[its]) - (place[mine] < place[its])
                if saved > 0:
                    layer[index], layer[index + 1] = other, one
                    place[one], place[other] = index + 1, index
                    improved = True
        if not improved:
            return
