"""Reading a system as every command does that must not go on with a wrong one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m2c.check.system import check_system
from m2c.model import DiagnosticLog, System, load
from m2c.model.naming import ANYWHERE, Naming


def read_and_check(
    paths: Sequence[Path],
    interfaces: Sequence[Path],
    log: DiagnosticLog,
    with_policy: bool = True,
    naming: Naming = ANYWHERE,
) -> System | None:
    """The system in ``paths``, or None if there is none; with errors in ``log``, it is no good.

    Args:
        paths: models, folders of them, or one system file.
        interfaces: folders of interface packages, and the earlier tool's lists of channels
            (``INTERFACES.xml``), with which the models are compared.
        log: where findings go.
        with_policy: check the policy against its machines too.
        naming: the transports that must take the names of nodes and channels.
    """
    system = load(paths, log, [path for path in interfaces if path.is_dir()])
    if system is None:
        return None
    whole = not log.has_errors
    lists = [path for path in interfaces if not path.is_dir()]
    if lists:
        from m2c.model.full_model import cross_check, read_interface_list

        for path in lists:
            cross_check(system, read_interface_list(path, log), log)
    check_system(system, log, naming)
    # leaves are bound to machines and types: where some are missing, the tree is not to blame
    blamed = ("unknown-type", "tick-contract")
    whole = whole and all(found.rule not in blamed for found in log.diagnostics)
    if with_policy and system.policy is not None and whole:
        from m2c.policy.program import read_policy

        read_policy(system.policy, system, log, naming)
    return system
