"""Entries of the blackboard that have two types: BehaviorTree.CPP ends the run where the second one is met.

An entry has the type of the first port that names it. What a ``Switch`` looks at is text for it, and an
entry of text takes no number and no truth value from an output port. One that holds a structure or an array
holds no other type; it may be text to others, its JSON.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import describe
from m2c.policy.bound import BoundLeaf
from m2c.policy.plugins import PortValue, referenced_entry
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
    """Report ``leaf-port``: an output port writes a number to an entry that a node declares as text, or two
    ports have an entry in common and not their types, one of which is a structure or an array.

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
                if port.kind in ("string", "json") or not port.entry:
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
    _check_structures(policy, bound, entries, log)


def _check_structures(
    policy: PolicyFile, bound: Mapping[Position, BoundLeaf], entries: _Entries, log: DiagnosticLog
) -> None:
    met: dict[Entry, list[tuple[LeafNode, PortValue]]] = {}
    for tree in policy.trees:
        for node in nodes_of(tree.root):
            leaf = bound.get(node.position) if isinstance(node, LeafNode) else None
            for port in (*leaf.inputs, *leaf.outputs) if leaf is not None else ():
                if not port.entry or port.kind == "string" or not isinstance(node, LeafNode):
                    continue
                named = list(entries.of(tree.id, port.entry))
                known = [one for entry in named for one in met.get(entry, ())]
                other = next((one for one in known if one[1].type != port.type), None)
                for entry in named:
                    met.setdefault(entry, []).append((node, port))
                if other is not None:
                    theirs, at = other[1], other[0].position
                    what = (
                        f"the port `{port.key}` has type {_type_of(port)}, but the entry `{port.entry}` is "
                        f"{_type_of(theirs)} to the port `{theirs.key}` at {at.line}:{at.column}"
                    )
                    hint = "an entry has one type"
                    log.error("leaf-port", node.position, node.element, what, hint)


def _type_of(port: PortValue) -> str:
    return port.kind if port.type is None else describe(port.type)


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
