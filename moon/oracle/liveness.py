"""Which data of a machine can make a difference to what is seen of it.

A variable that no condition, output or delay depends on, not even through others, only multiplies
hypotheses: the oracle leaves its assignments out (live variable analysis over the whole machine).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from m2c.model.certainty import Certainty, Fit
from m2c.model.datatypes import DataType
from m2c.model.expressions import Expression, Variable
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Assign, Emit, If, Log, Machine, Raise, Statement
from m2c.model.scopes import event_parts
from m2c.model.typing import Scope
from m2c.model.walk import flat, root_of, variables_of


def live_variables(
    machine: Machine, library: InterfaceLibrary, owner: Machine | None = None
) -> frozenset[str]:
    """Variables on which conditions, outputs, events and delays depend, directly or not.

    Args:
        machine: the model, or an action thread.
        library: its message types.
        owner: the machine that declares the interfaces (differs for an action thread).
    """
    live = {
        name
        for state in machine.states
        for transition in state.transitions
        for name in variables_of(transition.cond)
    }
    types = {data.name: data.type for data in machine.data}
    ports = {port.key: port.type for port in machine.ports if not port.output}
    assigns: list[Assign] = []
    for statement, parts in _statements(machine, library, owner or machine):
        certainty = Certainty(Scope(types, parts, ports))
        match statement:
            case Assign(location=location, value=value):
                assigns.append(statement)
                if not _cannot_fail(location, value, types, certainty):
                    live.add(root_of(location))  # what fails ends its block, which is seen
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
            case Log(value=value) if value is not None and certainty.may_throw(value):
                live.update(variables_of(value))
            case _:
                pass
    while True:
        grown = set(live)
        for assign in assigns:
            if root_of(assign.location) in live:
                grown.update((*variables_of(assign.value), *variables_of(assign.location)))
        if grown == live:
            return frozenset(live)
        live = grown


def _statements(
    machine: Machine, library: InterfaceLibrary, owner: Machine
) -> Iterator[tuple[Statement, Mapping[str, DataType]]]:
    """Every statement with the parts of the event that it can read."""
    for state in machine.states:
        for transition in state.transitions:
            parts = event_parts(transition.event, owner, library)
            for block in (transition.body, *(target.body for target in transition.targets)):
                yield from ((statement, parts) for statement in flat(block))
        for block in (state.on_entry, state.on_exit):
            yield from ((statement, {}) for statement in flat(block))


def _cannot_fail(
    location: Expression, value: Expression, types: Mapping[str, DataType], certainty: Certainty
) -> bool:
    if not isinstance(location, Variable):
        return False
    target = types.get(location.name)
    if target is None or certainty.may_throw(value):
        return False
    return certainty.fit(value, target) is not Fit.MAY_FAIL
