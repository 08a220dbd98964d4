"""A policy's main tree as a picture, its sub-trees in place."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from m2c.draw import svg
from m2c.draw.bounds import MAX_NODES, TooLargeError
from m2c.policy.tree import BuiltinNode, LeafKind, LeafNode, PolicyFile, SubTreeNode, TreeNode

_MARGIN = 16.0
_TOP = 48.0
_ROW = 42.0
_GAP = 44.0
"""Between the columns: room for the lines' bends."""
_NOT = 42.0
"""And for the sign of an inverter."""
_COLUMNS = 44
"""Characters of a name; longer ones are shortened."""

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
        y: its middle, once it has a place.
    """

    kind: str
    name: str
    negated: bool
    children: list[Node]
    place: str = ""
    y: float = 0

    @property
    def is_leaf(self) -> bool:
        """Whether a skill, or a built-in leaf, answers it."""
        return not self.children


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
            case SubTreeNode(id=called):
                return read(trees[called], called, negated)
            case BuiltinNode(tag="Inverter", children=(inner,)):
                return read(inner, name, not negated)
            case LeafNode(kind=kind) if kind is not None and not node.children:
                return Node(_leaf_kind(node, kind), node.name, negated, [], str(node.position))
            case LeafNode():
                children = [read(child, "", False) for child in node.children]
                return Node(node.id, name or node.name, negated, children, str(node.position))
        children = [read(child, "", False) for child in node.children]
        sort = node.tag + _ports(node)
        return Node(sort, name or node.name, negated, children, str(node.position))

    return read(trees[policy.main], policy.main, False)


def _leaf_kind(node: LeafNode, kind: LeafKind) -> str:
    return (
        str(kind) if node.id == node.element or node.element in ("Action", "Condition") else node.id
    )


def _ports(node: BuiltinNode) -> str:
    """What a decorator is told: ``Repeat num_cycles=3``."""
    told = [f" {key}={value}" for key, value in node.attributes]
    return svg.shortened("".join(told), _COLUMNS)


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
    leaf_width, rows, any_negated_leaf = 120.0, 0, False

    def place(node: Node, depth: int) -> None:
        nonlocal leaf_width, rows, any_negated_leaf
        for child in node.children:
            place(child, depth + 1)
        if node.is_leaf:
            leaf_width = max(leaf_width, svg.name_width(_leaf_words(node), bold=False) + 28)
            node.y = _TOP + rows * _ROW
            any_negated_leaf = any_negated_leaf or node.negated
            rows += 1
            return
        node.y = (node.children[0].y + node.children[-1].y) / 2
        name, kind = _control_words(node)
        width = max(svg.name_width(name), svg.name_width(kind, 11, bold=False)) + 24
        widths[depth] = max(widths.get(depth, 120.0), width)
        negated[depth] = negated.get(depth, False) or node.negated

    place(root, 0)
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
            shapes = [
                svg.box(leaves_at, node.y - 16, leaf_width, 32, kind, corner),
                svg.text(leaves_at + 14, node.y + 5, _leaf_words(node)),
            ]
            parts.append(svg.group(shapes, "leaf", f"{prefix}l{leaves}"))
            leaves += 1
            return
        x, width = columns[depth], widths[depth]
        name, kind = _control_words(node)
        parts.append(svg.box(x, node.y - 19, width, 38))
        parts.append(svg.text(x + 10, node.y - 3, name, "head"))
        parts.append(svg.text(x + 10, node.y + 12, kind, "small"))
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
    bottom = _TOP + rows * _ROW
    parts.append(svg.text(leaves_at, bottom - 4, "rounded: condition · square: action", "small"))
    width = max(
        leaves_at + leaf_width,
        leaves_at + svg.name_width("rounded: condition · square: action", 11, bold=False),
        svg.name_width(LEGEND, 11, bold=False),
    )
    return svg.Picture(width + _MARGIN, bottom + 6, tuple(parts))


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
    base = node.kind.split(" ")[0]
    sign = next((s for ending, s in _SIGNS.items() if base.endswith(ending)), "◇")
    if base.startswith("SequenceWithMemory"):
        sign = "→"
    return svg.shortened(
        node.name or base, _COLUMNS
    ), f"{sign} {svg.shortened(node.kind, _COLUMNS)}"
