"""A policy's main tree as a picture, its sub-trees in place, with every port and attribute of its nodes."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from m2c.draw import svg
from m2c.draw.bounds import MAX_NODES, TooLargeError
from m2c.policy.tree import BuiltinNode, LeafKind, LeafNode, PolicyFile, SubTreeNode, TreeNode

_MARGIN = 16.0
_TOP = 48.0
_LEAF, _CONTROL = 32.0, 38.0
"""Heights of boxes without ports."""
_PORT = 13.0
"""A line more."""
_BELOW_LEAF, _BELOW_CONTROL = 10.0, 4.0
_GAP = 44.0
"""Between the columns: room for the lines' bends."""
_NOT = 42.0
"""And for the sign of an inverter."""
_COLUMNS = 44
"""Characters of a line; longer ones are shortened, and shown in full when one points at the box."""
_PORT_COLUMNS = 54
"""The same for a port, which is set smaller."""

LEGEND = (
    "→ Sequence: one after the other, until one fails · ? Fallback: until one succeeds · "
    "Reactive: from the first at every tick"
)
_SIGNS = {
    "Sequence": "→",
    "Fallback": "?",
    "Parallel": "⇉",
    "ParallelAll": "⇉",
}


class Node(msgspec.Struct):
    """A node of the tree as it is ticked.

    Attributes:
        kind: the node's type; ``condition`` or ``action`` for leaves that skills answer.
        name: what the policy calls it.
        negated: an inverter stands before it.
        children: in the order in which they are ticked.
        place: ``file:line:column`` in the policy.
        ports: what its ports and attributes are given, as it is written.
        y: its middle, once it has a place.
    """

    kind: str
    name: str
    negated: bool
    children: list[Node]
    place: str = ""
    ports: tuple[tuple[str, str], ...] = ()
    y: float = 0

    @property
    def is_leaf(self) -> bool:
        """Whether a skill, or a built-in leaf, answers it."""
        return not self.children

    @property
    def told(self) -> tuple[str, ...]:
        """Its ports, a line each: ``num_cycles=3``."""
        return tuple(f"{key}={value}" for key, value in self.ports)


def tree_of(policy: PolicyFile) -> Node:
    """The main tree of ``policy``, with every sub-tree in its place.

    Raises:
        TooLargeError: it has too many nodes.
    """
    trees = {tree.id: tree.root for tree in policy.trees}
    count = 0

    def read(node: TreeNode, name: str, negated: bool) -> Node:
        nonlocal count
        count += 1
        if count > MAX_NODES:
            what = (
                f"the tree has more than {MAX_NODES:,} nodes, sub-trees counted wherever they stand"
            )
            raise TooLargeError(f"{what}; draw its sub-trees instead")
        match node:
            case SubTreeNode(id=called, attributes=()):
                return read(trees[called], called, negated)
            case SubTreeNode(id=called):
                sort, label = "SubTree", node.name or called
                children = [read(trees[called], called if node.name else "", False)]
            case BuiltinNode(tag="Inverter", children=(inner,), attributes=()):
                return read(inner, name, not negated)
            case LeafNode(kind=kind) if kind is not None and not node.children:
                sort, label, children = _leaf_kind(node, kind), node.name, []
            case _:
                sort = node.id if isinstance(node, LeafNode) else node.tag
                label = name or node.name
                children = [read(child, "", False) for child in node.children]
        return Node(sort, label, negated, children, str(node.position), node.attributes)

    return read(trees[policy.main], policy.main, False)


def _leaf_kind(node: LeafNode, kind: LeafKind) -> str:
    return (
        str(kind) if node.id == node.element or node.element in ("Action", "Condition") else node.id
    )


def leaf_keys(root: Node) -> dict[str, str]:
    """``file:line:column`` of each leaf → its keys in the picture, joined by blanks."""
    found: dict[str, list[str]] = {}
    for index, leaf in enumerate(_leaves(root)):
        found.setdefault(leaf.place, []).append(f"l{index}")
    return {place: " ".join(keys) for place, keys in found.items()}


def _leaves(node: Node) -> Iterator[Node]:
    if node.is_leaf:
        yield node
    for child in node.children:
        yield from _leaves(child)


def draw_policy(root: Node, prefix: str = "") -> svg.Picture:
    """The tree from left to right; what is ticked first stands at the top. Leaves are in one column.

    Args:
        root: of the tree.
        prefix: of every id. A leaf's group has the class ``leaf`` and the id ``<prefix><key>``, as
            :func:`leaf_keys` has it.
    """
    leaves = 0
    widths: dict[int, float] = {}
    negated: dict[int, bool] = {}
    leaf_width, any_negated_leaf = 120.0, False
    spans: dict[int, float] = {}

    def measure(node: Node) -> float:
        inner = sum(measure(child) for child in node.children)
        below = _BELOW_LEAF if node.is_leaf else _BELOW_CONTROL
        spans[id(node)] = max(inner, _height(node) + below)
        return spans[id(node)]

    def place(node: Node, depth: int, top: float) -> None:
        nonlocal leaf_width, any_negated_leaf
        span = spans[id(node)]
        ports = max((svg.name_width(line, 11, bold=False) for line in _lines(node)), default=0)
        if node.is_leaf:
            own = svg.name_width(_leaf_words(node), bold=False)
            leaf_width = max(leaf_width, own + 28, ports + 28)
            node.y = top + span / 2
            any_negated_leaf = any_negated_leaf or node.negated
            return
        below = top + (span - sum(spans[id(child)] for child in node.children)) / 2
        for child in node.children:
            place(child, depth + 1, below)
            below += spans[id(child)]
        half = _height(node) / 2
        middle = (node.children[0].y + node.children[-1].y) / 2
        node.y = min(max(middle, top + half), top + span - half)
        name, kind = _control_words(node)
        width = max(svg.name_width(name), svg.name_width(kind, 11, bold=False), ports) + 24
        widths[depth] = max(widths.get(depth, 120.0), width)
        negated[depth] = negated.get(depth, False) or node.negated

    measure(root)
    top = _TOP - (_LEAF + _BELOW_LEAF) / 2
    place(root, 0, top)
    columns: list[float] = []
    x = _MARGIN
    for depth in range(len(widths)):
        x += _NOT if negated[depth] else 0
        columns.append(x)
        x += widths[depth] + _GAP
    leaves_at = x + (_NOT if any_negated_leaf else 0)
    if root.is_leaf:
        leaves_at = _MARGIN + (_NOT if root.negated else 0)
    parts: list[str] = [svg.text(_MARGIN, 18, LEGEND, "small")]

    def draw(node: Node, depth: int) -> None:
        nonlocal leaves
        if node.is_leaf:
            rounded = node.kind == LeafKind.CONDITION
            kind, corner = ("box", 16) if rounded else ("tool", 4)
            height = _height(node)
            begin = node.y - height / 2
            shapes = [
                svg.box(leaves_at, begin, leaf_width, height, kind, corner),
                svg.text(leaves_at + 14, begin + 21, _leaf_words(node)),
                *_port_texts(node, leaves_at + 14, begin + 21),
            ]
            parts.append(svg.group(shapes, "leaf", f"{prefix}l{leaves}", _in_full(node)))
            leaves += 1
            return
        x, width = columns[depth], widths[depth]
        name, kind = _control_words(node)
        height = _height(node)
        begin = node.y - height / 2
        shapes = [
            svg.box(x, begin, width, height),
            svg.text(x + 10, begin + 16, name, "head"),
            svg.text(x + 10, begin + 31, kind, "small"),
            *_port_texts(node, x + 10, begin + 31),
        ]
        full = _in_full(node)
        parts.extend([svg.group(shapes, title=full)] if full else shapes)
        middle = x + width + 22
        for child in node.children:
            end = leaves_at if child.is_leaf else columns[depth + 1]
            start = x + width
            parts.append(
                svg.line(
                    f"M{svg.number(start)},{svg.number(node.y)} H{svg.number(middle)} "
                    f"V{svg.number(child.y)} H{svg.number(end)}"
                )
            )
            if child.negated:
                _sign(end - 38, child.y)
            draw(child, depth + 1)

    def _sign(x: float, y: float) -> None:
        parts.append(svg.box(x, y - 10, 30, 20, "box", 10))
        parts.append(svg.text(x + 15, y + 4, "not", "small", "middle"))

    if root.negated:
        _sign(_MARGIN, root.y)
    draw(root, 0)
    bottom = top + spans[id(root)] + (_LEAF + _BELOW_LEAF) / 2
    parts.append(svg.text(leaves_at, bottom - 4, "rounded: condition · square: action", "small"))
    width = max(
        leaves_at + leaf_width,
        leaves_at + svg.name_width("rounded: condition · square: action", 11, bold=False),
        svg.name_width(LEGEND, 11, bold=False),
    )
    return svg.Picture(width + _MARGIN, bottom + 6, tuple(parts))


def _height(node: Node) -> float:
    return (_LEAF if node.is_leaf else _CONTROL) + _PORT * len(node.ports)


def _lines(node: Node) -> list[str]:
    return [svg.shortened(" ".join(line.split()), _PORT_COLUMNS) for line in node.told]


def _port_texts(node: Node, x: float, y: float) -> list[str]:
    return [
        svg.text(x, y + _PORT * number, line, "small")
        for number, line in enumerate(_lines(node), 1)
    ]


def _in_full(node: Node) -> str:
    """Name and ports, where the box has not room for all of them."""
    texts = (node.name, *node.told)
    cut = len(node.name) > _COLUMNS or any(len(line) > _PORT_COLUMNS for line in node.told)
    return " · ".join(texts) if cut else ""


def _leaf_words(node: Node) -> str:
    name = svg.shortened(node.name or node.kind, _COLUMNS)
    match node.kind:
        case LeafKind.CONDITION:
            return f"{name}?"
        case LeafKind.ACTION:
            return name
        case kind:
            return kind if name in ("", kind) else f"{name} ({kind})"


def _control_words(node: Node) -> tuple[str, str]:
    sign = next((s for ending, s in _SIGNS.items() if node.kind.endswith(ending)), "◇")
    if node.kind == "SequenceWithMemory":
        sign = "→"
    name = svg.shortened(node.name or node.kind, _COLUMNS)
    return name, f"{sign} {svg.shortened(node.kind, _COLUMNS)}"
