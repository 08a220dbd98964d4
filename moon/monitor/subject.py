"""What is to be monitored, as a command line names it, and read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

import msgspec

from m2c.changes import UNCHANGED, Changes
from m2c.diagnostics import DiagnosticLog, Severity
from m2c.model.machine import Machine
from m2c.model.system import System
from m2c.suggestions import nearest
from moon.judge import Judge
from moon.monitor.compiled import CompiledSystem
from moon.monitor.departures import Departures
from moon.monitor.properties import PropertyWatch
from moon.monitor.reading import (
    SelectionError,
    has_policy_node,
    interfaces_of,
    judgeable,
    no_system,
    policy_unmonitored,
    read_checked,
    select,
)
from moon.monitor.status import POLICY
from moon.oracle.bounds import Bounds
from moon.properties.fields import fields_read
from moon.properties.files import load_properties
from moon.properties.property import Property
from moon.wording import Wording
from transports.fields_read import FieldsRead
from transports.interface import Observation


class Subject(msgspec.Struct, frozen=True):
    """Names of what is to be monitored.

    Attributes:
        models: models, folders of them, or one system file; empty: none.
        properties: property files.
        interfaces: folders of interface packages.
        only: monitor these nodes; empty: all.
        without: do not monitor these.
        bounds: what is assumed of the middleware.
        changes: how the models are changed.
        property_ids: monitor these properties only; empty: all.
    """

    models: tuple[Path, ...]
    properties: tuple[Path, ...]
    interfaces: tuple[Path, ...]
    only: tuple[str, ...]
    without: tuple[str, ...]
    bounds: Bounds
    changes: Changes = UNCHANGED
    property_ids: tuple[str, ...] = ()


class Monitored(msgspec.Struct, frozen=True, dict=True):
    """What was read.

    Attributes:
        system: all models.
        machines: those to be monitored.
        properties: to be monitored.
        bounds: what is assumed of the middleware.
        notes: what a person should know, one sentence each.
        unmonitored: those of ``notes`` that say what is not monitored, and why.
        policy: whether the policy is monitored, if the system has one.
        judges: what makes further judges of a run.
    """

    system: System
    machines: tuple[Machine, ...]
    properties: tuple[Property, ...]
    bounds: Bounds
    notes: tuple[str, ...] = ()
    unmonitored: tuple[str, ...] = ()
    policy: bool = True
    judges: tuple[Callable[[], Judge[Observation]], ...] = ()

    def property_watch(self) -> PropertyWatch:
        """A fresh monitor of the properties."""
        nodes = [node.name for node in self.system.nodes]
        awaited = [*nodes, POLICY] if has_policy_node(self.system) else nodes
        departures = Departures(self.properties, self.system.nodes, awaited)
        wording = Wording(self.system.library)
        return PropertyWatch(self.properties, self.bounds.latency, departures, wording)

    @cached_property
    def fields_read(self) -> FieldsRead | None:
        """Which fields of messages are read by what judges them; None: all."""
        if self.judges:
            return None
        return fields_read(self.properties, (*self.system.nodes, *self.system.plugins))

    @cached_property
    def compiled(self) -> CompiledSystem:
        """The models ready to be stepped: once, for all runs of them."""
        return CompiledSystem(self.system, self.machines)


class NothingLeftError(ValueError):
    """Models were named, and none of them can be judged."""


def read_subject(subject: Subject) -> Monitored:
    """Read what ``subject`` names.

    Raises:
        ModelError: there are errors in a file.
        SelectionError: a node that is not there was chosen, or none is left.
        NothingLeftError: no node is left that can be judged.
    """
    system = no_system(subject.interfaces)
    if subject.models:
        system = read_checked(subject.models, subject.interfaces, changes=subject.changes)
    log = DiagnosticLog()
    interfaces = interfaces_of(system, subject.interfaces)
    properties = tuple(load_properties(*subject.properties, interfaces=interfaces, log=log))
    properties = chosen(properties, subject.property_ids)
    notes = [str(item) for item in log.diagnostics if item.severity is Severity.WARNING]
    if not subject.models:
        return Monitored(system, (), properties, subject.bounds, tuple(notes))
    return monitored_of(
        system, properties, subject.bounds, subject.only, subject.without, tuple(notes)
    )


def chosen(properties: tuple[Property, ...], ids: Sequence[str]) -> tuple[Property, ...]:
    """Those of ``properties`` that ``ids`` name; all, if it is empty. SelectionError if one is not there."""
    known = [item.name for item in properties]
    for name in ids:
        if name not in known:
            raise SelectionError(f"there is no property {name}; {nearest(name, known)}")
    return tuple(item for item in properties if not ids or item.name in ids)


def monitored_of(
    system: System,
    properties: tuple[Property, ...],
    bounds: Bounds,
    only: Sequence[str] = (),
    without: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> Monitored:
    """What is monitored of ``system``, which has no errors.

    Args:
        system: all models.
        properties: what else is monitored.
        bounds: what is assumed of the middleware.
        only: monitor these nodes; empty: all.
        without: do not monitor these.
        notes: what a person should know of what was read, one sentence each.

    Raises:
        SelectionError: a node that is not there was chosen, or none is left.
        NothingLeftError: no node is left that can be judged.
    """
    machines, unjudged = judgeable(select(system, only, without))
    why_no_policy = policy_unmonitored(system, machines, without)
    unmonitored = (*unjudged, *filter(None, [why_no_policy]))
    if not machines and (system.nodes or why_no_policy is not None):
        why = f"{system.name}: no node is left to be judged"
        raise NothingLeftError("\n".join([*unmonitored, why]))
    return Monitored(
        system,
        machines,
        properties,
        bounds,
        (*unmonitored, *notes),
        unmonitored,
        why_no_policy is None,
    )
