"""Entries of the blackboard that a leaf reads and nothing in the policy could have set."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from m2c.diagnostics import DiagnosticLog, Position
from m2c.policy.bound import BoundLeaf
from m2c.policy.tree import LeafNode, PolicyFile, SubTreeNode, TreeNode, nodes_of
from m2c.suggestions import nearest

_WORD = re.compile(r"[A-Za-z_]\w*")


def check_leaf_entries(
    policy: PolicyFile, bound: Mapping[Position, BoundLeaf], log: DiagnosticLog
) -> None:
    """Warn of ports whose entry is named nowhere else in the policy (`X.

    Whatever names an entry may set it (a script, an output port, a sub-tree's port), in whatever tree:
    so that every warning is a certainty.

    Args:
        policy: with its trees.
        bound: its leaves, by the position of their elements.
        log: where the findings go.
    """
    named = {
        word
        for tree in policy.trees
        for node in nodes_of(tree.root)
        for text in _texts(node, bound)
        for word in _WORD.findall(text)
    }
    for node in policy.leaves():
        leaf = bound.get(node.position)
        for port in leaf.inputs if leaf is not None else ():
            entry = port.entry.removeprefix("@")
            if entry and not named.intersection(_WORD.findall(entry)):
                outputs = {out.entry for other in bound.values() for out in other.outputs}
                hint = nearest(entry, outputs)
                if not hint.startswith("did you mean"):
                    hint = "write a value, or set it: <SetBlackboard>, <Script> or an output port"
                what = f"the port `{port.key}` reads the entry `{port.entry}`, which nothing sets"
                log.warning("unset-port", node.position, node.element, what, hint)


def _texts(node: TreeNode, bound: Mapping[Position, BoundLeaf]) -> Iterator[str]:
    """What ``node`` has written that may name an entry to be set."""
    leaf = bound.get(node.position) if isinstance(node, LeafNode) else None
    read = {port.key for port in leaf.inputs} if leaf is not None else set()
    for key, value in node.attributes:
        if key not in read:
            yield value
        if isinstance(node, SubTreeNode):
            yield key
    for port in leaf.outputs if leaf is not None else ():
        yield port.entry
