"""Reading what is to be monitored: the models, checked as ``m2c check`` checks them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m2c.changes import UNCHANGED, Changes
from m2c.check.reading import read_and_check
from m2c.check.report import print_findings
from m2c.model import DiagnosticLog, ModelError, Position, System
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import InterfaceKind, Machine
from m2c.model.system import library_for
from m2c.suggestions import nearest
from moon.monitor.status import POLICY
from moon.properties.files.interfaces import Interfaces


def read_checked(
    paths: Sequence[Path],
    interfaces: Sequence[Path] = (),
    changes: Changes = UNCHANGED,
) -> System:
    """The system in ``paths``.

    Args:
        paths: models, folders of them, or one system file.
        interfaces: folders of interface packages.
        changes: how the models are changed.

    Raises:
        ModelError: ``m2c check`` would find errors, which the exception has.
    """
    log = DiagnosticLog()
    system = read_and_check(paths, interfaces, log, changes=changes)
    log.raise_if_errors()
    if system is None or not (system.nodes or system.plugins):
        log.error("no-models", Position(str(paths[0])), "", "no model in it")
        raise ModelError(log.diagnostics)
    return system


def no_system(interfaces: Sequence[Path] = ()) -> System:
    """A system without models, for who monitors properties only; the types in ``interfaces`` are known.

    Raises:
        ModelError: a folder of ``interfaces`` cannot be read.
    """
    log = DiagnosticLog()
    library = library_for((), interfaces, log) if interfaces else InterfaceLibrary()
    log.raise_if_errors()
    return System(name="", path=Path(), nodes=(), library=library)


def interfaces_of(system: System, folders: Sequence[Path]) -> Interfaces | None:
    """What properties are held against: the channels of ``system``, if it has models, and their types.

    None if there are neither models nor ``folders`` of interface packages.
    """
    if system.nodes or system.plugins:
        return Interfaces(system.library, system)
    return Interfaces(system.library) if folders else None


def say_why(error: ModelError) -> None:
    """Print on standard error what ``m2c check`` says of the models."""
    print_findings(error.diagnostics)


MOST_NAMED = 5
"""So many nodes are named in a sentence."""


class SelectionError(ValueError):
    """A node to be monitored that the system does not have."""


def judgeable(machines: Sequence[Machine]) -> tuple[tuple[Machine, ...], tuple[str, ...]]:
    """Those of ``machines`` whose inputs can be known, and for each of the others why it is not one.

    That a best-effort message was received here does not mean that a node got it, and when a node gets a
    transient_local one depends on when it finds its publisher: no bound on latency holds.
    """
    kept: list[Machine] = []
    reasons: list[str] = []
    for machine in machines:
        unsure = [
            f"{interface.channel} ({'best effort' if interface.best_effort else 'transient local'})"
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.SUBSCRIBER
            and not interface.own
            and (interface.best_effort or interface.transient_local)
        ]
        if unsure:
            what = "what it received cannot be known"
            reasons.append(
                f"{machine.name} is not judged: it subscribes to {', '.join(unsure)}; {what}"
            )
        else:
            kept.append(machine)
    return tuple(kept), tuple(reasons)


def has_policy_node(system: System) -> bool:
    """Whether ``system`` has a policy, which runs as the node :data:`POLICY`."""
    return system.policy is not None and all(node.name != POLICY for node in system.nodes)


def policy_unmonitored(
    system: System, machines: Sequence[Machine], without: Sequence[str]
) -> str | None:
    """Why the policy of ``system`` is not monitored, a sentence; None if it is, or there is none.

    Args:
        system: the models.
        machines: those that are monitored.
        without: the nodes that are left out by name.
    """
    if system.policy is None:
        return None
    if POLICY in without and has_policy_node(system):
        return f"the policy is not monitored: --without {POLICY}"
    monitored = {machine.name for machine in machines}
    missing = [node.name for node in system.nodes if node.name not in monitored]
    if not missing:
        return None
    shown = ", ".join(missing[:MOST_NAMED])
    more = f" and {len(missing) - MOST_NAMED} more" if len(missing) > MOST_NAMED else ""
    are = "is" if len(missing) == 1 else "are"
    return f"the policy is not monitored: that needs all of its nodes, and {shown}{more} {are} not monitored"


def select(system: System, only: Sequence[str], without: Sequence[str]) -> tuple[Machine, ...]:
    """The nodes of ``system`` in ``only`` (empty: all) that are not in ``without``.

    The policy is a node, too, if it has one: it may be left out (:func:`policy_unmonitored`).

    Raises:
        SelectionError: there is no such node, or none is left.
    """
    known = [machine.name for machine in system.nodes]
    policy = [POLICY] if has_policy_node(system) else []
    if POLICY in policy and POLICY in only:
        raise SelectionError(
            f"--only {POLICY}: the policy is monitored together with all of its nodes; leave --only away"
        )
    for name in (*only, *without):
        if name not in known and name not in policy:
            close = nearest(name, [*known, *policy])
            raise SelectionError(f"{system.name} has no node {name}; {close}")
    kept = tuple(
        machine
        for machine in system.nodes
        if (not only or machine.name in only) and machine.name not in without
    )
    if not kept and (known or POLICY not in policy or POLICY in without):
        why = "all are left out" if known or policy else "it has no nodes"
        raise SelectionError(f"{system.name}: no node to monitor: {why}")
    return kept
