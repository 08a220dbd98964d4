"""Trees within trees: every one that is named exists, none contains itself, and all stay finite."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.policy.tree import LeafNode, SubTreeNode, Tree, TreeNode
from m2c.suggestions import nearest

MAX_DEPTH = 256
"""Nodes nested in one another, sub-trees unfolded: every level is a few frames of the C++ stack."""
PLUGIN_LEVELS = 4
"""A plugin with children counts as so many levels: each is some ten frames of Python's stack too."""
MAX_NODES = 100_000
"""Nodes of the whole policy, sub-trees unfolded: a few trees that each use the next one twice
would otherwise fill the memory."""


class _Unfolded(msgspec.Struct, frozen=True):
    """How many nodes a tree has and how deep it is, its sub-trees included."""

    nodes: int
    depth: int


def check_nesting(trees: Mapping[str, Tree], log: DiagnosticLog) -> None:
    """Report ``missing-subtree``, ``recursive-subtree``, ``deep-tree`` and ``large-tree``."""
    places = {name: list(_nodes(tree.root)) for name, tree in trees.items()}
    for found in places.values():
        for place, _ in found:
            if isinstance(place, SubTreeNode) and place.id not in trees:
                what = f"the sub-tree `{place.id}` does not exist"
                hint = nearest(place.id, trees)
                log.error("missing-subtree", place.position, "SubTree", what, hint)
    if not log.has_errors:
        done: dict[str, _Unfolded] = {}
        for name in trees:
            if not _unfold(name, trees, places, done, log):
                return


def _unfold(
    first: str,
    trees: Mapping[str, Tree],
    places: Mapping[str, list[tuple[TreeNode, int]]],
    done: dict[str, _Unfolded],
    log: DiagnosticLog,
) -> bool:
    """Measure ``first`` and all below it; False after an error. No recursion: chains may be long."""
    chain = [first]
    while chain:
        name = chain[-1]
        waiting = None
        for place, _ in places[name]:
            if not isinstance(place, SubTreeNode) or place.id in done:
                continue
            if place.id in chain:
                loop = " → ".join((*chain[chain.index(place.id) :], place.id))
                what = f"a tree cannot contain itself: {loop}"
                log.error("recursive-subtree", place.position, "SubTree", what)
                return False
            waiting = place.id
            break
        if waiting is not None:
            chain.append(waiting)
            continue
        chain.pop()
        if name in done:
            continue
        measured = _measure(places[name], done)
        position = trees[name].position
        if measured.depth > MAX_DEPTH:
            what = f"with its sub-trees, `{name}` is more than {MAX_DEPTH} nodes deep"
            log.error("deep-tree", position, "BehaviorTree", what)
            return False
        if measured.nodes > MAX_NODES:
            what = f"with its sub-trees, `{name}` has more than {MAX_NODES:,} nodes"
            log.error("large-tree", position, "BehaviorTree", what)
            return False
        done[name] = measured
    return True


def _measure(places: list[tuple[TreeNode, int]], done: Mapping[str, _Unfolded]) -> _Unfolded:
    nodes = len(places)
    depth = max(level for _, level in places)
    for place, level in places:
        if isinstance(place, SubTreeNode):
            nodes += done[place.id].nodes
            depth = max(depth, level + done[place.id].depth)
    return _Unfolded(nodes, depth)


def _nodes(node: TreeNode, level: int = 1) -> Iterator[tuple[TreeNode, int]]:
    """Every node of one tree and its level; an XML file is read only so deep."""
    yield node, level
    if not isinstance(node, SubTreeNode):
        below = level + (PLUGIN_LEVELS if isinstance(node, LeafNode) else 1)
        for child in node.children:
            yield from _nodes(child, below)
