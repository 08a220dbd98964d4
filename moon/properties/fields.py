"""Which fields of messages properties read."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator

from m2c.language.expressions import Expression, Index, Member, Variable, children
from moon.properties.formula import predicates
from moon.properties.predicates import ANY_CHANNEL
from moon.properties.property import Port, Property
from moon.recording.cdr import FieldsRead, Paths
from moon.tap.action_parts import action_of


def fields_read(properties: Iterable[Property], whole: Container[str] = ()) -> FieldsRead:
    """What says which fields of the messages of a channel are read; None: all.

    Args:
        properties: who reads them.
        whole: the channels of which others read everything; an action stands for all its parts.
    """
    by_channel = _by_channel(properties)
    anywhere = by_channel.get(ANY_CHANNEL, frozenset())

    def read(channel: str) -> Paths | None:
        if channel in whole or action_of(channel) in whole:
            return None
        return by_channel.get(channel, frozenset()) | anywhere

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
        if isinstance(here, Member):
            names.insert(0, here.name)
        else:
            yield from _paths(here.index)
        here = here.object
    if isinstance(here, Variable):
        yield here.name, tuple(names)
    else:
        for child in children(here):
            yield from _paths(child)
