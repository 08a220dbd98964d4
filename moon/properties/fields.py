"""Which fields of messages models and properties read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from m2c.language.expressions import EventData, Expression, Index, Member, Variable, children
from m2c.model.machine import InterfaceKind, Machine
from m2c.model.walk import expressions_of
from m2c.policy.ticks import TICKS_CHANNEL
from moon.properties.formula import predicates
from moon.properties.predicates import ANY_CHANNEL
from moon.properties.property import Port, Property
from moon.tap.action_parts import action_of
from transports.fields_read import FieldsRead, Paths


def fields_read(properties: Iterable[Property], machines: Iterable[Machine] = ()) -> FieldsRead:
    """What says which fields of the messages of a channel are read; None: all.

    Of what a machine sends all is compared. So is what it gets in calls; of the messages of topics that it
    subscribes to it reads what its expressions name. What a policy reports of its ticks is read as a whole.

    Args:
        properties: who reads them.
        machines: the models of who sends and receives them.
    """
    found: dict[str, set[tuple[str, ...]]] = {}
    whole = {TICKS_CHANNEL}
    """An action stands for all its parts."""
    _add_properties(properties, found)
    for machine in machines:
        parts = (machine, *(thread.machine for thread in machine.threads))
        paths = {
            path for part in parts for item in expressions_of(part) for path in _of_event(item)
        }
        for interface in machine.interfaces:
            if interface.channel is None:
                continue
            if interface.kind is InterfaceKind.SUBSCRIBER:
                found.setdefault(interface.channel, set()).update(paths)
            else:
                whole.add(interface.channel)
    by_channel = {channel: frozenset(paths) for channel, paths in found.items()}
    anywhere = by_channel.get(ANY_CHANNEL, frozenset())

    def read(channel: str) -> Paths | None:
        if channel in whole or action_of(channel) in whole:
            return None
        found = by_channel.get(channel, frozenset()) | anywhere
        return None if () in found else found

    return read


def _of_event(expression: Expression) -> Iterator[tuple[str, ...]]:
    """What is read of the event's data."""
    return (
        path
        for root, path in _paths(expression)
        if isinstance(root, EventData) and root.part == "data"
    )


def _add_properties(properties: Iterable[Property], found: dict[str, set[tuple[str, ...]]]) -> None:
    for item in properties:
        ports = {port.name: port for port in item.ports}
        for predicate in predicates(item.formula).values():
            for name, path in _of_variables(predicate.expression):
                port = ports.get(name) or Port(name, ANY_CHANNEL, (), (name,))
                read = found.setdefault(port.channel, set())
                if not port.event:
                    read.add((*port.path, *path))
                elif port.condition is not None:
                    read.update(path for _, path in _of_variables(port.condition))


def _of_variables(expression: Expression) -> Iterator[tuple[str, tuple[str, ...]]]:
    """The variables of ``expression``, and what is read of each."""
    return ((root.name, path) for root, path in _paths(expression) if isinstance(root, Variable))


def _paths(expression: Expression) -> Iterator[tuple[Expression, tuple[str, ...]]]:
    """The variables and event data in ``expression``, and what is read of each."""
    names: list[str] = []
    here = expression
    while isinstance(here, Member | Index):
        if isinstance(here, Member):
            if (
                here.name == "length"
            ):  # of the only array in a structure, perhaps (datatypes.only_array)
                names.clear()
            else:
                names.insert(0, here.name)
        else:
            yield from _paths(here.index)
        here = here.object
    if isinstance(here, Variable | EventData):
        yield here, tuple(names)
    else:
        for child in children(here):
            yield from _paths(child)
