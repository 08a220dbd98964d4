"""What stands in a machine: its statements, flat, and where choices are left open."""

from __future__ import annotations

from collections.abc import Iterator

from m2c.language.expressions import Expression, Index, nodes
from m2c.model.machine import Assign, Machine, State, Statement, Transition
from m2c.model.walk import (
    expressions_among,
    flat,
    is_draw,
    statements_of,
    variables_of,
    with_threads,
)


def effects(machine: Machine, state: State, transition: Transition) -> list[Statement]:
    """All that taking ``transition`` out of ``state`` can run, in order (W3C SCXML 3.13)."""
    found = list(flat(state.on_exit)) if transition.targets else []
    found += flat(transition.body)
    for target in transition.targets:
        found += flat(target.body)
        found += flat(machine.state(target.state).on_entry)
    return found


def all_statements(machine: Machine) -> Iterator[Statement]:
    """Every statement of ``machine`` and its action threads."""
    for owner in with_threads(machine):
        yield from statements_of(owner)


def draws(expression: Expression) -> bool:
    """Whether the value of ``expression`` is random."""
    return any(map(is_draw, nodes(expression)))


def expressions(statement: Statement) -> list[Expression]:
    """The expressions whose values ``statement`` uses, without those of statements inside it."""
    if isinstance(statement, Assign):
        location = statement.location
        return [statement.value, *([location.index] if isinstance(location, Index) else [])]
    return list(expressions_among((statement,)))


def variables_read(machine: Machine) -> set[str]:
    """The variables on whose values something depends."""
    found: set[str] = set()
    todo: list[Expression] = []
    for statement in all_statements(machine):
        todo += expressions(statement)
    for owner in with_threads(machine):
        for state in owner.states:
            todo += [t.cond for t in state.transitions if t.cond is not None]
    for expression in todo:
        found.update(variables_of(expression))
    return found
