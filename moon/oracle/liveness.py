"""Which data of a machine can make a difference to what is seen of it.

A variable that no condition, output or delay depends on, not even through others, only multiplies
hypotheses: the oracle leaves its assignments out (live variable analysis over the whole machine).
"""

from __future__ import annotations

from m2c.model.datatypes import is_integer
from m2c.model.expressions import (
    Binary,
    Conditional,
    EventData,
    Expression,
    Literal,
    Member,
    Unary,
    Variable,
    children,
)
from m2c.model.machine import Assign, Emit, If, Machine, Raise
from m2c.model.typing import Scope, type_of
from m2c.model.walk import root_of, statements_of, variables_of


def live_variables(machine: Machine) -> frozenset[str]:
    """Variables on which conditions, outputs, events and delays depend, directly or not."""
    live = {
        name
        for state in machine.states
        for transition in state.transitions
        for name in variables_of(transition.cond)
    }
    assigns: list[Assign] = []
    for statement in statements_of(machine):
        match statement:
            case Assign():
                assigns.append(statement)
            case Emit(fields=fields, goal_id=goal, thread_id=thread):
                live.update(v for field in fields for v in variables_of(field.value))
                live.update((*variables_of(goal), *variables_of(thread)))
                if not statement.interface.isdigit():
                    live.add(statement.interface)  # a child that a variable names
            case Raise(fields=fields, delay_s=delay):
                live.update(v for field in fields for v in variables_of(field.value))
                live.update(variables_of(delay))
            case If(branches=branches):
                live.update(v for test, _ in branches for v in variables_of(test))
            case _:
                pass
    scope = Scope({data.name: data.type for data in machine.data})
    for assign in assigns:
        if not _cannot_fail(assign, scope):  # what fails ends its block, which is seen
            live.add(root_of(assign.location))
    while True:
        grown = set(live)
        for assign in assigns:
            if root_of(assign.location) in live:
                grown.update((*variables_of(assign.value), *variables_of(assign.location)))
        if grown == live:
            return frozenset(live)
        live = grown


def _cannot_fail(assign: Assign, scope: Scope) -> bool:
    if not isinstance(assign.location, Variable):
        return False
    target = scope.variables.get(assign.location.name)
    if target is None or not _is_simple(assign.value, scope):
        return False
    return not is_integer(target) or _is_whole(assign.value, scope)


def _is_simple(expression: Expression, scope: Scope) -> bool:
    """Whether evaluating ``expression`` cannot throw."""
    match expression:
        case Literal():
            return True
        case Variable(name=name):
            return name in scope.variables
        case Member(object=EventData(part="data")):
            return True
        case Unary() | Binary() | Conditional():
            return all(_is_simple(child, scope) for child in children(expression))
        case _:
            return False


def _is_whole(expression: Expression, scope: Scope) -> bool:
    """Whether an integer location takes ``expression`` for sure."""
    match expression:
        case Member(object=EventData(part="data")):
            return True  # an integer field, or ``m2c check`` would have said so
        case Binary(operator="/"):
            return False
        case Binary(left=left, right=right):
            return _is_whole(left, scope) and _is_whole(right, scope)
        case Conditional(then=then, otherwise=otherwise):
            return _is_whole(then, scope) and _is_whole(otherwise, scope)
        case _:
            return is_integer(type_of(expression, scope))
