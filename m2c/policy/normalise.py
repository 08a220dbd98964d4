"""A policy as the XML that BehaviorTree.CPP 4 loads, each leaf under its own name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lxml import etree

from m2c.diagnostics import Position
from m2c.model.xml_writing import below, element, serialised
from m2c.policy.bound import BoundLeaf, child_tree
from m2c.policy.plugins import marked
from m2c.policy.tree import CONDITIONS, LeafNode, PolicyFile, SubTreeNode, TreeNode


def normalised(policy: PolicyFile, leaves: Mapping[Position, BoundLeaf]) -> str:
    """The text of ``policy`` in format 4; a leaf is an element called ``leaf.name``.

    Nodes registered from Python cannot declare ports, so a leaf's ports stay out of the XML: they
    are in ``leaves``, which must have one for every leaf of the policy. Nor can they have children:
    a plugin with children is a leaf, and each of its children a tree of its own (``child_tree``).
    """
    root = element("root", {"BTCPP_format": "4", "main_tree_to_execute": policy.main})
    pending = [(tree.id, tree.root) for tree in policy.trees]
    while pending:
        name, node = pending.pop(0)
        _add(below(root, "BehaviorTree", {"ID": name}), node, leaves, pending)
    return serialised(root)


def _add(
    above: etree._Element,
    node: TreeNode,
    leaves: Mapping[Position, BoundLeaf],
    pending: list[tuple[str, TreeNode]],
) -> None:
    match node:
        case LeafNode():
            leaf = leaves[node.position]
            scripts = [(key, value) for key, value in node.attributes if key in CONDITIONS]
            below(above, leaf.name, _named(leaf.name, scripts))
            pending += [
                (child_tree(leaf.name, number), child) for number, child in enumerate(node.children)
            ]
        case SubTreeNode():
            ports = [(key, marked(value)) for key, value in node.attributes]
            below(above, "SubTree", {"ID": node.id, **_named(node.name, ports)})
        case _:
            is_value = node.tag == "SetBlackboard"
            ports = [(key, marked(value) if is_value else value) for key, value in node.attributes]
            inner = below(above, node.tag, _named(node.name, ports))
            for child in node.children:
                _add(inner, child, leaves, pending)


def _named(name: str, attributes: Iterable[tuple[str, str]]) -> dict[str, str]:
    return {**({"name": name} if name else {}), **dict(attributes)}
