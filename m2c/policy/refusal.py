"""Why BehaviorTree.CPP does not load a policy, and which of its nodes it is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import count

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.policy.bound import BoundLeaf, child_tree
from m2c.policy.library import ON_HALTED, PolicyError, TreeFactory
from m2c.policy.normalise import normalised
from m2c.policy.tree import (
    BuiltinNode,
    LeafNode,
    PolicyFile,
    SubTreeNode,
    Tree,
    TreeNode,
    nodes_of,
)

_SCRIPTS = "scripts#"
"""The name of a tree that no policy has."""


def check_loading(
    file: PolicyFile, leaves: Mapping[Position, BoundLeaf], log: DiagnosticLog
) -> None:
    """Report ``refused-policy`` if BehaviorTree.CPP does not load ``file``.

    Args:
        file: the policy.
        leaves: of each of its leaves, by the position of its element.
        log: where it is reported, at the first node with which the policy is refused.
    """
    nodes = [node for tree in file.trees for node in nodes_of(tree.root)]
    why = _why_refused(file, leaves, len(nodes))
    if not why:
        return
    accepted, refused = 0, len(nodes)
    while refused - accepted > 1:
        middle = (accepted + refused) // 2
        found = _why_refused(file, leaves, middle)
        accepted, refused = (accepted, middle) if found else (middle, refused)
        why = found or why
    log.error("refused-policy", nodes[refused - 1].position, _tag(nodes[refused - 1]), why)


def _tag(node: TreeNode) -> str:
    match node:
        case LeafNode():
            return node.element
        case BuiltinNode():
            return node.tag
        case _:
            return "SubTree"


def _why_refused(file: PolicyFile, leaves: Mapping[Position, BoundLeaf], most: int) -> str:
    """Why ``file`` is refused, of which the first ``most`` nodes are as they are written; "" if it is not."""
    factory = TreeFactory()
    for leaf in {leaf.name for leaf in leaves.values()}:
        factory.register(leaf, bool)
    begun = _Begun(most)
    trees = [Tree(tree.id, begun.node(tree.root), tree.position) for tree in file.trees]
    trees.append(Tree(_SCRIPTS, begun.scripts(), file.trees[0].position))
    apart = [
        child_tree(leaves[node.position].name, number)
        for node in file.leaves()
        for number in range(len(node.children))
    ]
    try:
        factory.load(normalised(PolicyFile(file.path, file.main, tuple(trees)), leaves))
        for name in (file.main, _SCRIPTS, *dict.fromkeys(apart)):
            factory.create_tree(name)
    except PolicyError as error:
        return str(error)
    return ""


class _Begun:
    """A policy's first nodes as they are written, and all others without what can be refused.

    A tree that is made only to see whether it can be is thrown away, so it has no script that is run then: of
    these only the grammar is looked at (:meth:`scripts`).
    """

    def __init__(self, most: int) -> None:
        self._number = count()
        self._most = most
        self._halts: list[BuiltinNode] = []

    def node(self, node: TreeNode) -> TreeNode:
        """``node`` and all below it."""
        is_written = next(self._number) < self._most
        kept = tuple(self._attributes(node)) if is_written else ()
        if isinstance(node, SubTreeNode):
            return msgspec.structs.replace(node, attributes=kept)
        children = tuple(self.node(child) for child in node.children)
        made = msgspec.structs.replace(node, attributes=kept, children=children)
        if is_written or isinstance(made, LeafNode):
            return made
        return msgspec.structs.replace(made, tag="Sequence" if children else "AlwaysSuccess")

    def _attributes(self, node: TreeNode) -> Iterator[tuple[str, str]]:
        for key, value in node.attributes:
            if key == ON_HALTED:
                self._halts.append(_always(node.position, ("_onSuccess", value)))
            else:
                yield key, value

    def scripts(self) -> BuiltinNode:
        """A node with the scripts of :meth:`node` that are run where a tree is thrown away."""
        at = Position("")
        children = (_always(at), *self._halts)
        return BuiltinNode(tag="Sequence", name="", position=at, children=children)


def _always(position: Position, *attributes: tuple[str, str]) -> BuiltinNode:
    return BuiltinNode(tag="AlwaysSuccess", name="", position=position, attributes=attributes)
