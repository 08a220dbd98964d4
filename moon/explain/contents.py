"""What stands in a machine: its statements, flat, and where choices are left open."""

from __future__ import annotations

from collections.abc import Iterator

from m2c.language.expressions import Expression, Index, nodes
from m2c.model.machine import (
    Assign,
    Emit,
    Foreach,
    If,
    Log,
    Machine,
    Raise,
    State,
    Statement,
    Transition,
)
from m2c.model.walk import flat, is_draw, statements_of, variables_of, with_threads


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
    match statement:
        case Assign(value=value):
            return [value]
        case Emit(fields=fields) | Raise(fields=fields):
            return [field.value for field in fields]
        case If(branches=branches):
            return [condition for condition, _ in branches if condition is not None]
        case Foreach(array=array):
            return [array]
        case Log(value=value):
            return [] if value is None else [value]
        case _:
            return []


def variables_read(machine: Machine) -> set[str]:
    """The variables on whose values something depends."""
    found: set[str] = set()
    todo: list[Expression] = []
    for statement in all_statements(machine):
        todo += expressions(statement)
        match statement:
            case Assign(location=Index(index=index)):
                todo.append(index)
            case Emit(goal_id=goal, thread_id=thread):
                todo += [inner for inner in (goal, thread) if inner is not None]
            case Raise(delay_s=delay) if delay is not None:
                todo.append(delay)
    for owner in with_threads(machine):
        for state in owner.states:
            todo += [t.cond for t in state.transitions if t.cond is not None]
    for expression in todo:
        found.update(variables_of(expression))
    return found
