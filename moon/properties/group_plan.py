"""What all monitors of the same properties share: everything that does not change while they run.

A monitor of a system makes several sets of the same properties, a fleet one for each robot, and what is found
here takes longer than most sets are used.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from functools import cached_property

import msgspec

from m2c.diagnostics import Position
from m2c.model.walk import variables_of
from moon.properties.compiler import network_code
from moon.properties.formula import predicates, reduced
from moon.properties.network import (
    Network,
    NetworkBuilder,
    build_network,
    obligations,
    stays_false,
)
from moon.properties.predicates import ANY_CHANNEL, bind, handler_source
from moon.properties.property import Port, Property
from moon.properties.three_valued import SplitNetwork

_KEPT = 16
"""Plans of so many tuples of properties are kept, those that were used last."""


class GroupPlan:
    """Properties that share a network, and that network.

    Args:
        properties: they wait for the same states.
        ports: the names that their predicates use.

    Attributes:
        names: of the properties.
        formulas: theirs.
        binding: how the names get their values.
        network: of the formulas.
        remembers: whether it matters what was before the beginning.
        counts_time: whether it matters how long ago that was: bounds of the start count from when time began.
        index: the network's node of each predicate's text.
        users: per port, the predicates that use it.
        texts: the predicates of each formula.
        final: of each formula, whether it stays false.
        used: the predicates that are in the network.
        code: the network with the channels' handlers.
    """

    def __init__(self, properties: Sequence[Property], ports: Sequence[Port]) -> None:
        self.names = tuple(item.name for item in properties)
        self.formulas = [item.formula for item in properties]
        self.binding = binding = bind(self.formulas, ports)
        self.network = build_network(self.formulas)
        nodes = tuple(enumerate(self.network.nodes))
        remembering = {i for i, n in nodes if n.kind in ("once", "since")}
        self.remembers = not remembering <= set(obligations(self.network))
        constant = {i for i, n in nodes if n.kind == "constant"}
        self.counts_time = any(
            n.interval.lower and constant.issuperset(n.inputs) for i, n in nodes if i in remembering
        )
        self.index = {node.text: number for number, node in nodes if node.kind == "atom"}
        self.users: dict[str, list[str]] = {name: [] for name in binding.ports}
        for text in self.index:
            for name in variables_of(binding.atoms[text].expression):
                self.users[name].append(text)
        self.texts = [frozenset(predicates(formula)) for formula in self.formulas]
        self.final = [stays_false(self.network, root) for root in self.network.roots]
        self.used = [text for text in binding.atoms if text in self.index]
        groups = [
            msgspec.structs.replace(group, atoms=tuple(t for t in group.atoms if t in self.index))
            for group in binding.groups
        ]
        self.code = network_code(
            self.network,
            [self.index[text] for text in self.used if text in binding.events],
            {f"{group.name}_cone": [self.index[t] for t in group.atoms] for group in groups},
            "\n".join(handler_source(group, binding, self.index) for group in groups),
            [f"X{place}" for place in range(len(binding.ports))],
        )

    @cached_property
    def split(self) -> SplitNetwork:
        """The network split by polarity, made when something is unknown for the first time."""
        return SplitNetwork(self.formulas, self.binding.events, self.network)


def plans_of(properties: Sequence[Property]) -> tuple[GroupPlan, ...]:
    """What each group of ``properties`` that share a network needs; of the same ones it is the same.

    Raises:
        PredicateError: a predicate that cannot be evaluated.
    """
    return _plans_of(_Same(properties))


class _Same:
    """Properties that are equal to themselves alone: a formula is a tree that is long to compare."""

    __slots__ = ("properties",)

    def __init__(self, properties: Sequence[Property]) -> None:
        self.properties = tuple(properties)

    def __hash__(self) -> int:
        return hash(tuple(map(id, self.properties)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Same) or len(self.properties) != len(other.properties):
            return False
        pairs = zip(self.properties, other.properties, strict=True)
        return all(one is another for one, another in pairs)


@functools.lru_cache(maxsize=_KEPT)
def _plans_of(same: _Same) -> tuple[GroupPlan, ...]:
    return tuple(
        GroupPlan(group.properties, list(group.ports.values()))
        for group in _together(same.properties)
    )


class _Members:
    """Properties that share a network: they wait for the same states."""

    def __init__(self, waits: frozenset[tuple[str, str]]) -> None:
        self._waits = waits
        self.properties: list[Property] = []
        self.ports: dict[str, Port] = {}
        self._forgotten: set[int] = set()
        self._remembered: set[int] = set()

    def take(self, item: Property, waits: frozenset[tuple[str, str]], own: Network) -> bool:
        """Take a property whose formula is ``own`` in, unless it is to have a network of its own.

        Args:
            item: the property.
            waits: the states it waits for.
            own: the network of its formula; of equal parts of others', the nodes have the same indices.
        """
        ports = {port.name: _placeless(port) for port in item.ports}
        forgotten = set(obligations(own))
        remembered = own.reached() - forgotten
        if (
            waits != self._waits
            or any(self.ports.get(name, port) != port for name, port in ports.items())
            or not forgotten.isdisjoint(self._remembered)
            or not remembered.isdisjoint(self._forgotten)
        ):
            return False
        self.properties.append(item)
        self.ports.update(ports)
        self._forgotten |= forgotten
        self._remembered |= remembered
        return True


def _together(properties: Sequence[Property]) -> list[_Members]:
    """The properties that can share a network.

    They wait for the same states; a name means the same to all of them (two files may use one name for
    two things); and what one forgets as it begins (:func:`obligations`) no other one remembers.
    """
    groups: list[_Members] = []
    builder = NetworkBuilder()
    for item in properties:
        waits = _waits_for(item)
        root = builder.node(reduced(item.formula))
        own = Network(tuple(builder.nodes), (root,))
        if not any(group.take(item, waits, own) for group in groups):
            groups.append(group := _Members(waits))
            group.take(item, waits, own)
    return groups


def _placeless(port: Port) -> Port:
    return msgspec.structs.replace(port, position=Position(""))


def _waits_for(item: Property) -> frozenset[tuple[str, str]]:
    """The states that must be known before ``item`` can begin."""
    ports = {port.name: port for port in item.ports}
    waits = set()
    for atom in predicates(item.formula).values():
        for name in variables_of(atom.expression):
            port = ports.get(name) or Port(name, ANY_CHANNEL, (), (name,))
            if not port.event and port.initial is msgspec.UNSET:
                waits.add((port.channel, name))
    return frozenset(waits)
