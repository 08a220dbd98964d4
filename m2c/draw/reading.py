"""What a path names: a machine, a system or a policy, free of errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from m2c.draw.wiring import Wiring, wiring_of
from m2c.model.diagnostics import DiagnosticLog
from m2c.model.machine import Machine
from m2c.model.system import MODEL_SUFFIXES, load
from m2c.model.xml import read_xml
from m2c.policy.tree import PolicyFile


class Drawable(msgspec.Struct, frozen=True):
    """What is drawn, and what it is called."""

    name: str
    content: Machine | PolicyFile | Wiring


def read(path: Path, interfaces: Sequence[Path], log: DiagnosticLog) -> Drawable | None:
    """Read what ``path`` names; None after errors, which go to ``log``.

    Args:
        path: a model, a policy (root ``<root>``), a system file, or a folder of models.
        interfaces: folders of interface packages, besides those near the models.
        log: gets what ``m2c check`` finds in it.
    """
    if not path.is_dir() and path.suffix not in MODEL_SUFFIXES and _is_policy(path):
        from m2c.policy.reader import read_policy_file

        policy = read_policy_file(path, log)
        return None if policy is None or log.has_errors else Drawable(path.stem, policy)
    system = load([path], log, interfaces)
    if system is None or log.has_errors:
        return None
    from m2c.check import check_system

    check_system(system, log)
    calls: tuple[str, ...] = ()
    if system.policy is not None and not log.has_errors:
        from m2c.policy.program import read_policy

        program = read_policy(system.policy, system, log)
        if program is not None:
            found = (name for leaf in program.leaves for name in (leaf.tick, leaf.halt) if name)
            calls = tuple(dict.fromkeys(found))
    if log.has_errors:
        return None
    if path.suffix in MODEL_SUFFIXES and len(system.nodes) == 1:
        return Drawable(system.nodes[0].name, system.nodes[0])
    return Drawable(system.name, wiring_of(system, calls))


def _is_policy(path: Path) -> bool:
    """Whether the file is XML whose root is that of a policy; what is wrong with it is said later."""
    root = read_xml(path, DiagnosticLog())
    return root is not None and root.tag == "root"
