"""Constants and variables of a machine, and what could stand in their place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec.structs import replace

from m2c.language.expressions import (
    EventData,
    Expression,
    Index,
    Literal,
    Location,
    Member,
    Unary,
    Variable,
)
from m2c.model.machine import Assign, Machine
from m2c.model.walk import root_of, with_inner
from tests.mutation import places

_LARGEST = frozenset(2**bits - 1 for bits in (7, 8, 15, 16, 31, 32, 53, 63, 64))
"""One more than these may not fit the type any more."""


def constants(machine: Machine) -> dict[str, Literal]:
    """Variables that have a literal value and are never assigned, as models write constants."""
    assigned = {
        root_of(statement.location)
        for place in places.blocks(machine)
        for statement in place.part
        if isinstance(statement, Assign)
    }
    found: dict[str, Literal] = {}
    for data in machine.data:
        match data.initial:
            case Literal() as literal:
                value = literal
            case Unary(operator="-", operand=Literal(value=int() | float() as number) as literal):
                value = replace(literal, value=-number)
            case _:
                continue
        if data.name not in assigned:
            found[data.name] = value
    return found


def same_typed(variable: Variable, machine: Machine) -> Iterator[Variable]:
    """The other variables of ``variable``'s type, in the order of the datamodel; no model names a history's."""
    histories = {item.variable for state in with_inner(machine.written) for item in state.histories}
    kind = next((data.type for data in machine.data if data.name == variable.name), None)
    for data in machine.data:
        if data.type == kind and data.name != variable.name and data.name not in histories:
            yield replace(variable, name=data.name)


def altered(
    node: Expression, machine: Machine, fixed: Mapping[str, Literal]
) -> Iterator[Expression]:
    """What else could be sent: another constant, or another variable of the same type."""
    match node:
        case Literal():
            yield from _other_literals(node)
        case Variable(name=name):
            others = list(same_typed(node, machine))
            yield from others
            if not others and name in fixed:
                yield from _other_literals(replace(fixed[name], position=node.position))


def _other_literals(literal: Literal) -> Iterator[Literal]:
    match literal.value:
        case bool(value):
            yield replace(literal, value=not value)
        case int(value):
            yield replace(literal, value=value - 1 if value in _LARGEST else value + 1)
        case float(value):
            yield replace(literal, value=value + 1.0)
        case str(value):
            yield replace(literal, value=f"{value}x")


def shifted_literals(node: Expression, fixed: Mapping[str, Literal]) -> Iterator[Literal]:
    """The constant ``node`` in a condition, one more and one less; a text with a letter more."""
    literal = fixed.get(node.name) if isinstance(node, Variable) else node
    if not isinstance(literal, Literal):
        return
    match literal.value:
        case bool() | None:
            return  # `== false` became `== true` is the negated condition
        case int(value) | float(value):
            for new in (value + 1, value - 1):
                yield Literal(value=new, position=node.position)
        case str(value):
            yield Literal(value=f"{value}x", position=node.position)


def name_of(expression: Expression | Location) -> str:
    """``expression`` for a message: short where it is, else by its kind."""
    match expression:
        case Literal(value=bool(value)):
            return "true" if value else "false"
        case Literal(value=value):
            return repr(value)
        case Variable(name=name):
            return name
        case Member(object=inner, name=name):
            return f"{name_of(inner)}.{name}"
        case Index(object=inner, index=index):
            return f"{name_of(inner)}[{name_of(index)}]"
        case EventData(spelling=spelling):
            return spelling
        case _:
            return "…"
