"""What a path names: a machine, a system or a policy, free of errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from m2c.changes import UNCHANGED, Changes
from m2c.diagnostics import DiagnosticLog, Position
from m2c.draw.wiring import Wiring, wiring_of
from m2c.model.machine import Machine
from m2c.model.system import System, is_model
from m2c.policy.alone import is_policy
from m2c.policy.tree import PolicyFile
from m2c.suggestions import nearest


class Drawable(msgspec.Struct, frozen=True):
    """What is drawn, and what it is called."""

    name: str
    content: Machine | PolicyFile | Wiring


def read(
    path: Path,
    interfaces: Sequence[Path],
    log: DiagnosticLog,
    node: str | None = None,
    changes: Changes = UNCHANGED,
) -> Drawable | None:
    """Read what ``path`` names; None after errors, which go to ``log``.

    Args:
        path: a model, a policy (root ``<root>``), a system file, or a folder of models.
        interfaces: folders of interface packages, besides those near the models.
        log: gets what ``m2c check`` finds in it.
        node: the machine of a system that is to be drawn, instead of the wiring.
        changes: how the models are changed.
    """
    if node is None and is_policy(path):
        from m2c.policy.reader import read_policy_file

        policy = read_policy_file(path, log, None)
        return None if policy is None else Drawable(path.stem, policy)
    from m2c.check.reading import read_and_check

    system = read_and_check([path], interfaces, log, changes=changes)
    if system is None or log.has_errors:
        return None
    if node is not None:
        return _one_of(system, node, log)
    if is_model(path) and len(system.nodes) == 1:
        return Drawable(system.nodes[0].name, system.nodes[0])
    return Drawable(system.name, wiring_of(system, _calls(system)))


def _one_of(system: System, node: str, log: DiagnosticLog) -> Drawable | None:
    machines = {machine.name: machine for machine in (*system.plugins, *system.nodes)}
    if node not in machines:
        what = f"{system.name} has no machine {node}"
        log.error("unknown-node", Position(str(system.path)), "", what, nearest(node, machines))
        return None
    return Drawable(node, machines[node])


def _calls(system: System) -> tuple[str, ...]:
    """The channels that the policy's leaves call; none without a policy."""
    if system.policy is None:
        return ()
    from m2c.policy.program import read_policy

    policy = read_policy(system.policy, system, DiagnosticLog())
    leaves = policy.leaves if policy is not None else ()
    found = (name for leaf in leaves for name in (leaf.tick, leaf.halt) if name)
    return tuple(dict.fromkeys(found))
