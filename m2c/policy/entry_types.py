"""Entries of the blackboard that have two types: BehaviorTree.CPP ends the run where the second one is met.

An entry has the type of the first port that names it. What a ``Switch`` looks at is text for it, and an
entry of text takes no number and no truth value from an output port.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from m2c.diagnostics import DiagnosticLog, Position
from m2c.policy.bound import BoundLeaf
from m2c.policy.plugins import referenced_entry
from m2c.policy.tree import (
    AUTOREMAP,
    BuiltinNode,
    LeafNode,
    PolicyFile,
    SubTreeNode,
    TreeNode,
    nodes_of,
)

Entry = tuple[str, str]
"""The id of a tree, and the name that an entry has in it."""


def check_entry_types(
    policy: PolicyFile, bound: Mapping[Position, BoundLeaf], log: DiagnosticLog
) -> None:
    """Report ``leaf-port``: an output port writes a number to an entry that a node declares as text.

    Args:
        policy: with its trees.
        bound: its leaves, by the position of their elements.
        log: where the findings go.
    """
    entries = _Entries(policy)
    texts: dict[Entry, tuple[BuiltinNode, str]] = {}
    for tree in policy.trees:
        for node in nodes_of(tree.root):
            for name in _texts(node):
                for entry in entries.of(tree.id, name):
                    assert isinstance(node, BuiltinNode)
                    texts.setdefault(entry, (node, name))
    for tree in policy.trees:
        for node in nodes_of(tree.root):
            leaf = bound.get(node.position) if isinstance(node, LeafNode) else None
            for port in leaf.outputs if leaf is not None else ():
                if port.kind == "string" or not port.entry:
                    continue
                met = [texts[entry] for entry in entries.of(tree.id, port.entry) if entry in texts]
                if met and isinstance(node, LeafNode):
                    other, name = met[0]
                    what = (
                        f"the port `{port.key}` writes {port.kind} to the entry `{port.entry}`, which is "
                        f"text to the <{other.tag}> at {other.position.line}:{other.position.column}"
                    )
                    hint = f"another entry, or a port of type string; an entry like `{name}` has one type"
                    log.error("leaf-port", node.position, node.element, what, hint)


def _texts(node: TreeNode) -> Iterator[str]:
    """Entries that ``node`` declares as text."""
    if isinstance(node, BuiltinNode) and node.tag.startswith("Switch"):
        for key, value in node.attributes:
            if key == "variable" or key.startswith("case_"):
                yield from filter(None, (referenced_entry(value, key),))


class _Entries:
    """Which names in which trees are the same entry."""

    def __init__(self, policy: PolicyFile) -> None:
        self._main = policy.main
        self._uses: dict[str, list[tuple[str, SubTreeNode]]] = {}
        for tree in policy.trees:
            for node in nodes_of(tree.root):
                if isinstance(node, SubTreeNode):
                    self._uses.setdefault(node.id, []).append((tree.id, node))

    def of(self, tree: str, name: str) -> Iterator[Entry]:
        """``name`` in ``tree``, and whatever it is in the trees around it."""
        if name.startswith("@"):
            yield self._main, name[1:]
            return
        yield tree, name
        for above, use in self._uses.get(tree, ()):
            given = dict(use.attributes)
            if name in given:
                outer = referenced_entry(given[name], name)
            else:
                is_shared = given.get(AUTOREMAP, "").lower() in ("true", "1")
                outer = name if is_shared and not name.startswith("_") else ""
            if outer:
                yield from self.of(above, outer)
