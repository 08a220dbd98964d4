"""A policy without its system: what can be said of it."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from pathlib import Path

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.naming import ANYWHERE, Naming, absolute, check_channel
from m2c.model.system import MODEL_SUFFIXES, POLICY_ROOT
from m2c.model.xml import Element, read_xml
from m2c.policy.tree import BUILTINS, CONTROLS, TIMED, LeafKind, PolicyFile

_TOP = ("root", "BehaviorTree", "TreeNodesModel", "include")
_ALIKE = 0.8
"""From here on a name is that of a control node misspelt (``difflib``'s measure, from 0 to 1)."""
_ADDRESSES = ("service_name", "service_name_tick", "service_name_halt")


def is_policy(path: Path) -> bool:
    """Whether the file is XML whose root is that of a policy; what is wrong with it is said later."""
    if path.suffix in MODEL_SUFFIXES or not os.path.isfile(path):
        return False
    root = read_xml(path, DiagnosticLog())
    return root is not None and root.tag == POLICY_ROOT


def check_policy(path: Path, log: DiagnosticLog, naming: Naming = ANYWHERE) -> None:
    """Check the trees of the policy in ``path``, and say what only its system could tell.

    Its leaves may be plugins, with any ports: those are not known here.

    Args:
        path: the XML file.
        log: gets what is found, and the note ``policy-alone``.
        naming: the transports that must take the channels that the policy names.
    """
    from m2c.policy.own_nodes import bind_own
    from m2c.policy.reader import read_policy_file

    root = read_xml(path, DiagnosticLog())
    policy = read_policy_file(path, log, _perhaps_plugins(root) if root is not None else {})
    if policy is not None:
        _check_loads(policy, log)
        for leaf in policy.leaves():
            if leaf.id in TIMED or leaf.id in CONTROLS:
                bind_own(leaf, log)
    for leaf in policy.leaves() if policy is not None else ():
        for key in _ADDRESSES:
            address = leaf.get(key)
            if address and not address.startswith("{"):
                check_channel(
                    "service", absolute(address), leaf.position, leaf.element, naming, log
                )
    what = (
        "checked without its system: not whether its leaves are served, their types and their ports"
    )
    log.note("policy-alone", Position(str(path)), "", what, "give the system file to check them")


def _check_loads(policy: PolicyFile, log: DiagnosticLog) -> None:
    """Report ``refused-policy`` for what BehaviorTree.CPP finds, whoever answers the leaves."""
    from m2c.policy.bound import BoundLeaf
    from m2c.policy.refusal import check_loading

    bound = {
        leaf.position: BoundLeaf(
            name=f"Leaf_{number}", kind=LeafKind.ACTION, position=leaf.position
        )
        for number, leaf in enumerate(policy.leaves())
    }
    check_loading(policy, bound, log)


def _perhaps_plugins(root: Element) -> dict[str, bool]:
    """The elements that may be plugins of the system, and whether they have children here.

    What is almost called as a control node is that node misspelt.
    """
    found: dict[str, bool] = {}
    for element in _trees(root):
        explicit = element.tag in ("Action", "Condition", "Control", "Decorator")
        tag = element.get("ID") if explicit else element.tag
        if explicit and not element.children:
            continue  # a leaf, whoever answers it
        near = difflib.get_close_matches(tag, (*BUILTINS, "SubTree"), 1, _ALIKE)
        if tag and tag not in _TOP and not near:
            found[tag] = found.get(tag, True) and bool(element.children)
    return found


def _trees(element: Element) -> Iterator[Element]:
    for child in element.children:
        if child.tag != "TreeNodesModel":
            yield child
            yield from _trees(child)
