"""``<TreeNodesModel>``: what a policy's file declares of its leaves and sub-trees, and their ports."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.model.xml import Element
from m2c.policy.tree import AUTOREMAP, LeafKind

LEAF_KINDS = {"Action": LeafKind.ACTION, "Condition": LeafKind.CONDITION}
"""The elements that say of a leaf what it is."""
MODEL = "TreeNodesModel"
SUB_TREES = ("SubTree", "SubTreePlus")
"""Elements that put a tree in their place; the second is format 3's."""
_READ = ("input_port", "inout_port", "bidirectional_port")
_PORTS = (*_READ, "output_port")


class DeclaredLeaf(msgspec.Struct, frozen=True):
    """A leaf type.

    Attributes:
        kind: what it is.
        read: the defaults of the ports that it reads, as far as they have one.
        defaults: these, and those of its outputs.
    """

    kind: LeafKind
    read: dict[str, str]
    defaults: dict[str, str]


class DeclaredNodes(msgspec.Struct, frozen=True):
    """What is declared, by id; ``sub_trees``: the default of each of a tree's ports, "" if it has none."""

    leaves: dict[str, DeclaredLeaf]
    sub_trees: dict[str, dict[str, str]]


def declared_in(models: Iterable[Element]) -> DeclaredNodes:
    """What ``models``, elements ``<TreeNodesModel>``, declare; the last declaration of an id counts."""
    declared = DeclaredNodes({}, {})
    for element in (child for model in models for child in model.children):
        name = element.get("ID")
        if element.tag in LEAF_KINDS:
            read, all_of_them = _given(element, _READ), _given(element, _PORTS)
            declared.leaves[name] = DeclaredLeaf(LEAF_KINDS[element.tag], read, all_of_them)
        elif element.tag in SUB_TREES:
            ports = {port.get("name"): port.get("default") for port in element.all(*_PORTS)}
            declared.sub_trees[name] = ports
    return declared


def _given(element: Element, kinds: tuple[str, ...]) -> dict[str, str]:
    return {
        port.get("name"): port.get("default") for port in element.all(*kinds) if port.get("default")
    }


def add_defaults(
    element: Element, ports: dict[str, str], declared: dict[str, str], log: DiagnosticLog
) -> None:
    """Add to the ``ports`` that a sub-tree is given those which it is not, from their defaults.

    As in BehaviorTree.CPP, ``_autoremap`` takes the place of all defaults.

    Args:
        element: ``<SubTree>``.
        ports: what it gives, changed here.
        declared: the default of each of its tree's ports; "" for one that has to be given.
        log: gets ``missing-attribute`` for one that is not.
    """
    if ports.get(AUTOREMAP, "").strip().lower() in ("true", "1"):
        return
    for port, default in declared.items():
        if port in ports:
            continue
        if default:
            ports[port] = default
            continue
        what = f"the port `{port}` of the tree `{element.get('ID')}` is not given"
        hint = f'write {port}="…": it has no default in <TreeNodesModel>'
        log.error("missing-attribute", element.position, element.tag, what, hint)
