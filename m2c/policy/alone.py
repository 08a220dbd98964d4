"""A policy without its system: what can be said of it."""

from __future__ import annotations

import os
from pathlib import Path

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.naming import ANYWHERE, Naming, absolute, check_channel
from m2c.model.system import MODEL_SUFFIXES, POLICY_ROOT
from m2c.model.xml import read_xml
from m2c.policy.tree import CONTROLS, TIMED, LeafKind, PolicyFile

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
    from m2c.policy.entries import check_entries
    from m2c.policy.own_nodes import bind_own
    from m2c.policy.reader import read_policy_file

    policy = read_policy_file(path, log, None)
    if policy is not None:
        check_entries(policy, log)
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
