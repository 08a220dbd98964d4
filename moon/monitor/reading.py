"""Reading what is to be monitored: the models, checked as ``m2c check`` checks them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m2c.check.reading import read_and_check
from m2c.check.report import print_findings
from m2c.model import DiagnosticLog, ModelError, Position, System
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import InterfaceKind, Machine
from m2c.model.typing import nearest


def read_checked(
    paths: Sequence[Path], interfaces: Sequence[Path] = (), log: DiagnosticLog | None = None
) -> System:
    """The system in ``paths``.

    Args:
        paths: models, folders of them, or one system file.
        interfaces: folders of interface packages.
        log: where findings go.

    Raises:
        ModelError: ``m2c check`` would find errors, which the exception has.
    """
    log = log or DiagnosticLog()
    system = read_and_check(paths, interfaces, log)
    log.raise_if_errors()
    if system is None or not (system.nodes or system.plugins):
        log.error("no-models", Position(str(paths[0])), "", "no model in it")
        raise ModelError(log.diagnostics)
    return system


def no_system() -> System:
    """A system without models, for who monitors properties only."""
    return System(name="", path=Path(), nodes=(), library=InterfaceLibrary())


def say_why(error: ModelError) -> None:
    """Print on standard error what ``m2c check`` says of the models."""
    print_findings(error.diagnostics)


class SelectionError(ValueError):
    """A node to be monitored that the system does not have."""


def judgeable(machines: Sequence[Machine]) -> tuple[tuple[Machine, ...], tuple[str, ...]]:
    """Those of ``machines`` whose inputs can be known, and for each of the others why it is not one.

    That a best-effort message was heard here does not mean that a node got it, and when a node gets a
    latched one depends on when it finds its publisher: no bound on latency holds.
    """
    kept: list[Machine] = []
    reasons: list[str] = []
    for machine in machines:
        unsure = [
            f"{interface.channel} ({'best effort' if interface.best_effort else 'latched'})"
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.SUBSCRIBER
            and (interface.best_effort or interface.latched)
        ]
        if unsure:
            what = "nobody can tell what it received"
            reasons.append(f"{machine.name} is not judged: it hears {', '.join(unsure)}; {what}")
        else:
            kept.append(machine)
    return tuple(kept), tuple(reasons)


def select(system: System, only: Sequence[str], without: Sequence[str]) -> tuple[Machine, ...]:
    """The nodes of ``system`` in ``only`` (empty: all) that are not in ``without``.

    Raises:
        SelectionError: there is no such node, or none is left.
    """
    known = [machine.name for machine in system.nodes]
    for name in (*only, *without):
        if name not in known:
            raise SelectionError(f"{system.name} has no node {name}; {nearest(name, known)}")
    kept = tuple(
        machine
        for machine in system.nodes
        if (not only or machine.name in only) and machine.name not in without
    )
    if not kept:
        why = "all are left out" if known else "it has only plugins, which run in the policy"
        raise SelectionError(f"{system.name}: no node to monitor: {why}")
    return kept
