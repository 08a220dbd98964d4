"""Reading a system as every command does that must not go on with a wrong one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m2c.changes import UNCHANGED, Changes
from m2c.check.system import check_system
from m2c.model import Diagnostic, DiagnosticLog, System, load
from m2c.model.naming import ANYWHERE, Naming
from m2c.model.overrides import with_changes

_NOT_THE_TREES = ("unknown-type", "tick-contract")
"""Leaves are bound to machines and types: where one of these is broken, the tree is not to blame."""


def read_and_check(
    paths: Sequence[Path],
    interfaces: Sequence[Path],
    log: DiagnosticLog,
    with_policy: bool = True,
    naming: Naming = ANYWHERE,
    changes: Changes = UNCHANGED,
) -> System | None:
    """The system in ``paths``, or None if there is none; with errors in ``log``, it is no good.

    Args:
        paths: models, folders of them, or one system file.
        interfaces: folders of interface packages, and the earlier tool's lists of channels
            (``INTERFACES.xml``), with which the models are compared.
        log: where findings go.
        with_policy: check the policy against its machines too.
        naming: the transports that must take the names of nodes and channels.
        changes: how the models are changed.
    """
    system = load(paths, log, [path for path in interfaces if path.is_dir()])
    if system is None:
        return None
    system = with_changes(system, changes, log)
    lists = [path for path in interfaces if not path.is_dir()]
    _check(system, lists, log, with_policy, naming)
    return system


def findings_of(system: System, naming: Naming = ANYWHERE) -> list[Diagnostic]:
    """What is to be said of ``system``: its reader's findings and those of all checks, by place."""
    log = DiagnosticLog()
    log.diagnostics += system.findings
    _check(system, (), log, True, naming)
    return sorted(log.diagnostics, key=lambda found: (found.position, found.rule))


def raise_if_errors(system: System, naming: Naming = ANYWHERE) -> None:
    """Raise ModelError with all findings if there is an error among those of ``system``."""
    log = DiagnosticLog()
    log.diagnostics += findings_of(system, naming)
    log.raise_if_errors()


def _check(
    system: System,
    lists: Sequence[Path],
    log: DiagnosticLog,
    with_policy: bool,
    naming: Naming,
) -> None:
    whole = not log.has_errors
    if lists:
        from m2c.model.full_model import cross_check, read_interface_list

        for path in lists:
            cross_check(system, read_interface_list(path, log), log)
    check_system(system, log, naming)
    whole = whole and all(found.rule not in _NOT_THE_TREES for found in log.diagnostics)
    if with_policy and system.policy is not None and whole:
        from m2c.policy.program import read_policy

        read_policy(system.policy, system, log, naming)
