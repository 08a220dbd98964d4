"""Which fields of messages are read, where models and properties are monitored."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from m2c.language.expressions import Expression, Index, Member, Variable, children
from m2c.model.machine import Machine
from m2c.policy.ticks import TICKS_CHANNEL
from moon.properties.formula import predicates
from moon.properties.predicates import ANY_CHANNEL
from moon.properties.property import Port, Property
from moon.tap.action_parts import action_of
from transports.fields_read import FieldsRead, Paths


def fields_read(properties: Iterable[Property], machines: Iterable[Machine] = ()) -> FieldsRead:
    """What says which fields of the messages of a channel are read; None: all.

    What a machine sends is compared as a whole, and of what it gets all must be of its type: its node takes
    nothing else. What a policy reports of its ticks is read as a whole, too.

    Args:
        properties: who reads them.
        machines: the models of who sends and receives them.
    """
    by_channel = _by_channel(properties)
    anywhere = by_channel.get(ANY_CHANNEL, frozenset())
    whole = {TICKS_CHANNEL, *(end.channel for machine in machines for end in machine.interfaces)}
    """An action stands for all its parts."""

    def read(channel: str) -> Paths | None:
        if channel in whole or action_of(channel) in whole:
            return None
        found = by_channel.get(channel, frozenset()) | anywhere
        return None if () in found else found

    return read


def _by_channel(properties: Iterable[Property]) -> dict[str, Paths]:
    found: dict[str, set[tuple[str, ...]]] = {}
    for item in properties:
        ports = {port.name: port for port in item.ports}
        for predicate in predicates(item.formula).values():
            for name, path in _paths(predicate.expression):
                port = ports.get(name) or Port(name, ANY_CHANNEL, (), (name,))
                read = found.setdefault(port.channel, set())
                if not port.event:
                    read.add((*port.path, *path))
                elif port.condition is not None:
                    read.update(path for _, path in _paths(port.condition))
    return {channel: frozenset(paths) for channel, paths in found.items()}


def _paths(expression: Expression) -> Iterator[tuple[str, tuple[str, ...]]]:
    """The variables of ``expression``, and what is read of each."""
    names: list[str] = []
    here = expression
    while isinstance(here, Member | Index):
        if isinstance(here, Index):
            yield from _paths(here.index)
        elif (
            here.name == "length"
        ):  # of the only array in a structure, perhaps (datatypes.only_array)
            names.clear()
        else:
            names.insert(0, here.name)
        here = here.object
    if isinstance(here, Variable):
        yield here.name, tuple(names)
    else:
        for child in children(here):
            yield from _paths(child)
