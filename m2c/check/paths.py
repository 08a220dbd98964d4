"""What a machine can do at all: settled conditions, transitions that can be taken, states reached."""

from __future__ import annotations

from collections.abc import Iterator

from m2c.language.ecmascript import ExecutionError, truthy
from m2c.language.evaluate import evaluate
from m2c.language.expressions import (
    Conditional,
    Expression,
    Index,
    Logical,
    Member,
    Unary,
    children,
    is_settled,
)
from m2c.language.macrostep import prefix_of
from m2c.model.machine import Event, EventKind, If, Machine, State, Statement, Target, Transition


def truth(cond: Expression | None) -> bool | None:
    """Whether a condition holds whatever the data are.

    Args:
        cond: the condition; None is no condition.

    Returns:
        True if it always holds, False if it never does (a condition that cannot be evaluated does
        not hold, W3C SCXML section 5.9.1), None if that depends on the data.
    """
    if cond is None:
        return True
    if is_settled(cond):
        try:
            return truthy(evaluate(cond, {}, {}))
        except ExecutionError:
            return False
    match cond:
        case Logical(operator="&&", left=left, right=right):
            both = (truth(left), truth(right))
            return False if False in both else True if both == (True, True) else None
        case Logical(left=left, right=right):
            first, second = truth(left), truth(right)
            if first or (second and not _may_fail(left)):
                return True
            return False if (first, second) == (False, False) else None
        case Unary(operator="!", operand=operand):
            inner = truth(operand)
            if inner is False:
                return None if _may_fail(operand) else True
            return False if inner else None
        case Conditional(test=test, then=then, otherwise=otherwise):
            chosen = truth(test)
            if chosen:
                return truth(then)
            ends = truth(then), truth(otherwise)
            if chosen is False and not _may_fail(test):
                return ends[1]
            if ends == (True, True) and _may_fail(test):
                return None
            return ends[0] if ends[0] == ends[1] else None
        case _:
            return None


def takable(state: State) -> tuple[Transition, ...]:
    """The transitions of ``state`` that are taken in some run."""
    hidden = shadows(state)
    return tuple(
        transition
        for index, transition in enumerate(state.transitions)
        if index not in hidden and truth(transition.cond) is not False
    )


def shadows(state: State) -> dict[int, Transition]:
    """Which transitions (by index) never get their turn, and the one that always is before them.

    An eventless transition that always holds comes before everything that waits for an event, in
    whatever order they are written (W3C SCXML, appendix D); otherwise the first that matches is
    taken. Transitions whose own condition never holds are left out.
    """
    leaving = leaving_at_once(state)
    certain: dict[Event | None, Transition] = {}  # by what they take
    hidden: dict[int, Transition] = {}
    for index, transition in enumerate(state.transitions):
        holds = truth(transition.cond)
        if holds is False:
            continue
        event = transition.event
        earlier = next((certain[wide] for wide in _covering(event) if wide in certain), None)
        if event is not None and leaving is not None:
            hidden[index] = leaving
        elif earlier is not None:
            hidden[index] = earlier
        elif holds:
            certain[_plain(event)] = transition
    return hidden


def leaving_at_once(state: State) -> Transition | None:
    """The eventless transition that always holds, if there is one: nothing waits in ``state``."""
    return next(
        (item for item in state.transitions if item.event is None and truth(item.cond)), None
    )


def reachable(machine: Machine) -> set[str]:
    """The names of the states that some run enters."""
    states = {state.name: state for state in machine.states}
    found: set[str] = set()
    pending = [machine.initial]
    while pending:
        name = pending.pop()
        if name in found or name not in states:
            continue
        found.add(name)
        for transition in takable(states[name]):
            pending += [target.state for target in possible_targets(transition)]
    return found


def possible_targets(transition: Transition) -> tuple[Target, ...]:
    """Where ``transition`` can lead; nowhere if it stays."""
    return tuple(target for target in transition.targets if target.probability != 0)


def open_branches(statement: If) -> Iterator[tuple[Statement, ...]]:
    """The bodies of ``statement`` that can run."""
    for cond, body in statement.branches:
        holds = truth(cond)
        if holds is not False:
            yield body
        if holds:
            return


def _plain(event: Event | None) -> Event | None:
    """``event`` with its descriptor in the shortest spelling: ``e.*`` and ``e.`` are ``e``."""
    if event is None or event.kind is not EventKind.INTERNAL:
        return event
    return Event(EventKind.INTERNAL, prefix_of(event.name))


def _covering(event: Event | None) -> Iterator[Event | None]:
    """Every descriptor that matches whatever ``event`` does (W3C SCXML section 3.12.1)."""
    plain = _plain(event)
    yield plain
    if plain is not None and plain.kind is EventKind.INTERNAL and plain.name:
        tokens = plain.name.split(".")
        for count in range(len(tokens) - 1, 0, -1):
            yield Event(EventKind.INTERNAL, ".".join(tokens[:count]))
        yield Event(EventKind.INTERNAL, "")


def _may_fail(expression: Expression) -> bool:
    """Whether evaluation may throw: only access to members and elements does."""
    return isinstance(expression, Member | Index) or any(
        _may_fail(child) for child in children(expression)
    )
