"""Why BehaviorTree.CPP does not load a policy, and which of its nodes it is."""

from __future__ import annotations

from typing import Any

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.xml_writing import below, element, serialised
from m2c.policy.tree import (
    CONDITIONS,
    BuiltinNode,
    LeafNode,
    PolicyFile,
    SubTreeNode,
    TreeNode,
    nodes_of,
)


def check_loading(file: PolicyFile, xml: str, leaves: tuple[str, ...], log: DiagnosticLog) -> None:
    """Report ``refused-policy`` if BehaviorTree.CPP does not load ``xml``.

    Args:
        file: the policy as it is written.
        xml: the same in format 4.
        leaves: the names that its leaves have there.
        log: where it is reported, at the first node that is refused alone, if one is.
    """
    why = _why_refused(xml, file.main, leaves)
    if not why:
        return
    at, tag = Position(str(file.path)), ""
    for node in (node for tree in file.trees for node in nodes_of(tree.root)):
        alone = _why_refused(_alone(node), "Main")
        if alone:
            why, at = alone, node.position
            tag = node.tag if isinstance(node, BuiltinNode) else "SubTree"
            tag = node.element if isinstance(node, LeafNode) else tag
            break
    log.error("refused-policy", at, tag, f"BehaviorTree.CPP refuses the policy: {why}")


def _alone(node: TreeNode) -> str:
    """A policy of this node only: what is below it always succeeds."""
    root = element("root", {"BTCPP_format": "4"})
    tree = below(root, "BehaviorTree", {"ID": "Main"})
    match node:
        case SubTreeNode():
            below(tree, "SubTree", {"ID": "Below", **dict(node.attributes)})
            below(below(root, "BehaviorTree", {"ID": "Below"}), "AlwaysSuccess", {})
        case LeafNode():
            kept = {key: value for key, value in node.attributes if key in CONDITIONS}
            below(tree, "AlwaysSuccess", kept)
        case BuiltinNode():
            made = below(tree, node.tag, dict(node.attributes))
            for _ in node.children:
                below(made, "AlwaysSuccess", {})
    return serialised(root)


def _why_refused(xml: str, main: str, leaves: tuple[str, ...] = ()) -> str:
    import behaviortreepy

    factory: Any = behaviortreepy.BehaviorTreeFactory()
    for leaf in leaves:
        factory.register_simple_condition(leaf, bool)
    try:
        factory.register_behavior_tree_from_text(xml)
        factory.create_tree(main)
    except RuntimeError as error:
        return " ".join(str(error).split())
    return ""
