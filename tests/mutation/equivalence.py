"""Mutants that are no faults: what they change cannot be told from outside.

A machine is brought into a normal form by steps that each keep everything it can be observed to do.
A mutant with the original's normal form is equivalent to it, and the steps are the argument. Mutants
that are equivalent for deeper reasons are not found: a survivor still has to be looked at. Machines with
compound states are compared as they run.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import msgspec
from msgspec.structs import replace

from m2c.diagnostics import Position
from m2c.language.expressions import Expression, Index, Variable, children
from m2c.model.machine import (
    Assign,
    Event,
    EventKind,
    Machine,
    State,
    Statement,
    Transition,
)
from m2c.model.walk import root_of
from tests.mutation import places
from tests.mutation.constants import constants
from tests.mutation.places import Block
from tests.mutation.shape import Shapes

Step = Callable[[Machine], Machine]


FEWER = "of the outcomes that are drawn by probability, some never come; all that it does, the original may do"
"""The argument for a mutant whose runs are all runs of the original: only their frequency could tell."""


def equivalence(original: Machine, mutant: Machine) -> str:
    """Why ``mutant`` cannot be told from ``original``: one sentence; "" if that is not known."""
    original, mutant = places.flat(original), places.flat(mutant)
    widened = _with_outcomes_of(original, mutant)
    if widened != mutant and _equal(original, widened, tuple(STEPS)):
        return FEWER
    needed = tuple(STEPS)
    if not _equal(original, mutant, needed):
        return ""
    for reason in STEPS:
        fewer = tuple(item for item in needed if item != reason)
        if _equal(original, mutant, fewer):
            needed = fewer
    return f"the same machine: {'; '.join(needed)}"


def _equal(one: Machine, other: Machine, reasons: tuple[str, ...]) -> bool:
    return bool(_shape_of_normal(one, reasons) == Shapes().of(_normal(other, reasons)))


@functools.lru_cache(maxsize=32)
def _shape_of_normal(original: Machine, reasons: tuple[str, ...]) -> Any:
    """Kept, as an original is compared with all of its mutants."""
    return Shapes().of(_normal(original, reasons))


def _normal(machine: Machine, reasons: tuple[str, ...]) -> Machine:
    for reason in reasons:
        machine = _everywhere(machine, STEPS[reason])
    return machine


def _everywhere(machine: Machine, step: Step) -> Machine:
    """``step`` on the machine and on its action threads."""
    threads = tuple(replace(item, machine=step(item.machine)) for item in machine.threads)
    return step(replace(machine, threads=threads))


def _with_outcomes_of(original: Machine, mutant: Machine) -> Machine:
    """``mutant``; where it draws from some of the outcomes of a draw in ``original``, from all of them."""
    drawn = {
        (state.name, transition.position): transition.targets
        for machine in (original, *(item.machine for item in original.threads))
        for state in machine.states
        for transition in state.transitions
        if len(transition.targets) > 1
    }

    def widened(state: State, transition: Transition) -> Transition:
        targets = drawn.get((state.name, transition.position), ())
        outcomes = {(target.state, target.body) for target in targets}
        kept = {(target.state, target.body) for target in transition.targets}
        return replace(transition, targets=targets) if kept and kept <= outcomes else transition

    return _everywhere(mutant, functools.partial(_with_transitions, widened))


def _with_transitions(
    change: Callable[[State, Transition], Transition], machine: Machine
) -> Machine:
    return replace(
        machine,
        states=tuple(
            replace(state, transitions=tuple(change(state, item) for item in state.transitions))
            for state in machine.states
        ),
    )


# -- steps ------------------------------------------------------------------------------------


def _without_unreachable_states(machine: Machine) -> Machine:
    states = {state.name: state for state in machine.states}
    reached: set[str] = set()
    pending = [machine.initial]
    while pending:
        name = pending.pop()
        if name not in reached:
            reached.add(name)
            for transition in states[name].transitions:
                pending += [target.state for target in transition.targets]
    return replace(machine, states=tuple(item for item in machine.states if item.name in reached))


def _without_shadowed_transitions(machine: Machine) -> Machine:
    def kept(state: State) -> State:
        certain: set[Event | None] = set()
        found = []
        for transition in state.transitions:
            if transition.event not in certain:
                found.append(transition)
            if transition.cond is None:
                certain.add(transition.event)
        return replace(state, transitions=tuple(found))

    return replace(machine, states=tuple(kept(state) for state in machine.states))


def _with_constants_in_place(machine: Machine) -> Machine:
    fixed = constants(machine)

    def inlined(node: Any) -> Any:
        if isinstance(node, Variable) and node.name in fixed:
            return replace(fixed[node.name], position=node.position)
        return node

    data = tuple(item for item in machine.data if item.name not in fixed)
    return replace(
        machine,
        on_start=_rewritten(machine.on_start, inlined),
        states=_rewritten(machine.states, inlined),
        data=_rewritten(data, inlined),
    )


def _rewritten(value: Any, change: Callable[[Any], Any]) -> Any:
    """``value`` with ``change`` applied to every structure in it, innermost first."""
    if isinstance(value, tuple):
        return tuple(_rewritten(item, change) for item in value)
    if isinstance(value, Position) or not isinstance(value, msgspec.Struct):
        return value
    parts = {name: _rewritten(getattr(value, name), change) for name in value.__struct_fields__}
    return change(replace(value, **parts))


def _without_unread_variables(machine: Machine) -> Machine:
    """Assignments whose value cannot fail, to variables that nothing reads."""
    while True:
        read = _read(machine.on_start) | _read(machine.states) | _read(machine.data)
        for place in places.blocks(machine):
            kept = tuple(item for item in place.part if not _is_unread(item, read))
            if kept != place.part:
                machine = place.put(kept)
                break
        else:
            data = tuple(item for item in machine.data if item.name in read | _assigned(machine))
            return replace(machine, data=data)


def _read(value: Any) -> set[str]:
    """The variables that are read in ``value``; a whole one that is assigned is not."""
    match value:
        case tuple():
            return set().union(*map(_read, value))
        case Variable():
            return {value.name}
        case Assign(location=Variable()):
            return _read(value.value)
        case msgspec.Struct():
            return set().union(*(_read(getattr(value, name)) for name in value.__struct_fields__))
        case _:
            return set()


def _is_unread(statement: Statement, read: set[str]) -> bool:
    return (
        isinstance(statement, Assign)
        and isinstance(statement.location, Variable)
        and statement.location.name not in read
        and not _may_fail(statement.value)
    )


def _may_fail(expression: Expression) -> bool:
    """Whether evaluating it can throw: reading a part of something that may be undefined."""
    return isinstance(expression, Index) or any(map(_may_fail, children(expression)))


def _assigned(machine: Machine) -> set[str]:
    return {
        root_of(item.location)
        for place in places.blocks(machine)
        for item in place.part
        if isinstance(item, Assign)
    }


def _with_independent_assignments_sorted(machine: Machine) -> Machine:
    for place in list(places.blocks(machine)):
        ordered = _sorted_runs(place.part)
        if ordered != place.part:
            return _with_independent_assignments_sorted(place.put(ordered))
    return machine


def _sorted_runs(block: Block) -> Block:
    items = list(block)
    for _ in items:
        for index in range(len(items) - 1):
            first, second = items[index], items[index + 1]
            if (
                isinstance(first, Assign)
                and isinstance(second, Assign)
                and _independent(first, second)
                and root_of(second.location) < root_of(first.location)
            ):
                items[index], items[index + 1] = second, first
    return tuple(items)


def _independent(first: Assign, second: Assign) -> bool:
    one, other = root_of(first.location), root_of(second.location)
    whole = isinstance(first.location, Variable) and isinstance(second.location, Variable)
    return (
        one != other
        and whole
        and not _may_fail(first.value)
        and not _may_fail(second.value)
        and one not in _read(second.value)
        and other not in _read(first.value)
    )


def _without_returns_to_where_it_is(machine: Machine) -> Machine:
    """A transition back to its own state only runs its body, where nothing happens on the way."""

    def stays(state: State, transition: Transition) -> bool:
        plain = not state.on_entry and not state.on_exit and not state.final
        timed = any(item.after_s is not None for item in state.transitions)
        targets = transition.targets
        return plain and not timed and len(targets) == 1 and targets[0].state == state.name

    def changed(state: State, transition: Transition) -> Transition:
        if not stays(state, transition):
            return transition
        body = (*transition.body, *transition.targets[0].body)
        return replace(transition, targets=(), body=body)

    return _with_transitions(changed, machine)


_WAITED_FOR = (EventKind.REQUEST, EventKind.GOAL, EventKind.CALL_ERROR)
"""Discarding these is not the same as taking them and doing nothing: somebody waits."""


def _without_transitions_that_do_nothing(machine: Machine) -> Machine:
    def idle(transition: Transition) -> bool:
        event = transition.event
        return (
            event is not None
            and event.kind not in _WAITED_FOR
            and not transition.targets
            and not transition.body
            and (transition.cond is None or not _may_fail(transition.cond))
        )

    def kept(state: State) -> State:
        found = list(state.transitions)
        for transition in reversed(state.transitions):
            index = found.index(transition)
            later = any(item.event == transition.event for item in found[index + 1 :])
            eventless = any(item.event is None for item in found)
            if idle(transition) and not later and not eventless:
                del found[index]
        return replace(state, transitions=tuple(found))

    return replace(machine, states=tuple(kept(state) for state in machine.states))


STEPS: dict[str, Step] = {
    "a state that is never reached does nothing": _without_unreachable_states,
    "a transition after an unconditional one on the same event is never taken": (
        _without_shadowed_transitions
    ),
    "a variable that is never assigned is its value": _with_constants_in_place,
    "a variable that nothing reads does not matter": _without_unread_variables,
    "assignments that do not concern each other may come in either order": (
        _with_independent_assignments_sorted
    ),
    "returning to a state without entry, exit or delay is staying in it": (
        _without_returns_to_where_it_is
    ),
    "an input that is taken and changes nothing may as well be discarded": (
        _without_transitions_that_do_nothing
    ),
    "what is not reached then does nothing either": _without_unreachable_states,
}
"""The steps to the normal form, each with what it rests on."""
