"""A policy as the XML that BehaviorTree.CPP 4 loads, each leaf under its own name."""

from __future__ import annotations

from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

from m2c.model.diagnostics import Position
from m2c.policy.leaves import BoundLeaf
from m2c.policy.tree import CONDITIONS, LeafNode, PolicyFile, SubTreeNode, TreeNode


def child_tree(leaf: str, number: int) -> str:
    """The name of the tree that child ``number`` of the plugin ``leaf`` becomes."""
    return f"{leaf}#{number}"


def normalised(policy: PolicyFile, leaves: Mapping[Position, BoundLeaf]) -> str:
    """The text of ``policy`` in format 4; a leaf is an element called ``leaf.name``.

    Nodes registered from Python cannot declare ports, so a leaf's ports stay out of the XML: they
    are in ``leaves``, which must have one for every leaf of the policy. Nor can they have children:
    a plugin with children is a leaf, and each of its children a tree of its own (``child_tree``).
    """
    lines = [f'<root BTCPP_format="4" main_tree_to_execute={quoteattr(policy.main)}>']
    pending = [(tree.id, tree.root) for tree in policy.trees]
    while pending:
        name, root = pending.pop(0)
        lines.append(f"  <BehaviorTree ID={quoteattr(name)}>")
        _write(root, leaves, 2, lines, pending)
        lines.append("  </BehaviorTree>")
    lines.append("</root>")
    return "\n".join(lines) + "\n"


def _write(
    node: TreeNode,
    leaves: Mapping[Position, BoundLeaf],
    depth: int,
    lines: list[str],
    pending: list[tuple[str, TreeNode]],
) -> None:
    margin = "  " * depth
    match node:
        case LeafNode():
            leaf = leaves[node.position]
            scripts = [(key, value) for key, value in node.attributes if key in CONDITIONS]
            attributes = _attributes([("name", leaf.name), *scripts])
            lines.append(f"{margin}<{leaf.name}{attributes}/>")
            pending += [
                (child_tree(leaf.name, number), child) for number, child in enumerate(node.children)
            ]
        case SubTreeNode():
            attributes = _attributes([("ID", node.id), ("name", node.name), *node.attributes])
            lines.append(f"{margin}<SubTree{attributes}/>")
        case _:
            attributes = _attributes([("name", node.name), *node.attributes])
            if not node.children:
                lines.append(f"{margin}<{node.tag}{attributes}/>")
                return
            lines.append(f"{margin}<{node.tag}{attributes}>")
            for child in node.children:
                _write(child, leaves, depth + 1, lines, pending)
            lines.append(f"{margin}</{node.tag}>")


def _attributes(pairs: list[tuple[str, str]]) -> str:
    return "".join(f" {key}={quoteattr(value)}" for key, value in pairs if value or key != "name")
