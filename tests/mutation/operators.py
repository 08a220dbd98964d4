"""First-order mutation operators over machines.

A mutant is the machine with one small fault of the kinds that people make: what a monitor does not
tell from the original, it would not tell from a real fault either. Pure functions over
:class:`~m2c.model.machine.Machine`; the same machine gives the same mutants in the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import combinations

import msgspec
from msgspec.structs import replace

from m2c.diagnostics import Position
from m2c.language.expressions import Binary, Expression, Literal, Logical, Unary, Variable
from m2c.model.machine import (
    Assign,
    Emit,
    Event,
    Interface,
    InterfaceKind,
    Machine,
    OutputKind,
    State,
    Statement,
    Target,
    Transition,
)
from m2c.model.nesting import with_written
from m2c.model.scopes import interface_kind_of
from m2c.model.walk import with_inner
from tests.mutation import places
from tests.mutation.constants import altered, constants, name_of, same_typed, shifted_literals
from tests.mutation.places import Block, Place, swapped, without
from tests.mutation.shape import Shapes


class Mutant(msgspec.Struct, frozen=True):
    """A machine with one fault in it.

    Attributes:
        operator: which of :data:`OPERATORS` made it.
        description: ``file:line: what was changed``.
        machine: the faulty machine; its positions are the original's.
    """

    operator: str
    description: str
    machine: Machine


class Change(msgspec.Struct, frozen=True):
    """One change of a machine, before it is known to make a difference."""

    position: Position
    what: str
    machine: Machine


Operator = Callable[[Machine, Machine], Iterator[Change]]
"""``(owner, whole)``: changes of ``owner``, which is ``whole`` or one of its action threads."""


def mutants(machine: Machine) -> Iterator[Mutant]:
    """Every first-order mutant of ``machine``, operator by operator, each in document order.

    What is structurally equal (positions aside) to the original or to an earlier mutant is left
    out. A mutant keeps every rule that makes a machine valid, but may have states that are not
    reached, interfaces that are not used, or requests that are never answered. One with compound
    states is changed as it was written, and lowered then: what such a state does is changed for all in it.
    """
    shapes = Shapes()
    seen = {shapes.of(places.flat(machine))}
    for name, operator in OPERATORS.items():
        for owner in places.machines(machine):
            for change in operator(owner.part, machine):
                mutated = owner.put(change.machine)
                shape = shapes.of(places.flat(mutated))
                if shape in seen:
                    continue
                seen.add(shape)
                at = change.position
                yield Mutant(name, f"{at.file}:{at.line}: {change.what}", mutated)


# -- transitions ------------------------------------------------------------------------------


def _dropped_transition(owner: Machine, _: Machine) -> Iterator[Change]:
    for place in places.states(owner):
        state = place.part
        for index, transition in enumerate(state.transitions):
            kept = without(state.transitions, index)
            what = f"{_transition(state, transition)} dropped"
            yield Change(transition.position, what, place.put(replace(state, transitions=kept)))


def _redirected_transition(owner: Machine, _: Machine) -> Iterator[Change]:
    names = list(_targets(owner.written))
    for state, place in places.transitions(owner):
        what = _transition(state, place.part)
        if not place.part.targets:
            for name in names:
                if name != state.name:
                    changed = replace(place.part, targets=(Target(name),))
                    text = f"{what} leads to `{name}` instead of staying"
                    yield Change(place.part.position, text, place.put(changed))
        yield from _redirected(place, what, names)
    for state, history, place in places.ways(owner):
        what, names = f"the initial transition of `{state.name}`", list(_targets((state,)))[1:]
        if history is not None:
            what = f"the default transition of `{history.name}`"
            names = [inner.name for inner in with_inner(state.states)]
        yield from _redirected(place, what, names)


def _redirected(place: Place[Transition], what: str, names: Sequence[str]) -> Iterator[Change]:
    transition = place.part
    for index, target in enumerate(transition.targets):
        for name in names:
            if name == target.state:
                continue
            moved = swapped(transition.targets, index, replace(target, state=name))
            text = f"{what} leads to `{name}` instead of `{target.state}`"
            yield Change(transition.position, text, place.put(replace(transition, targets=moved)))


def _targets(states: Iterable[State]) -> Iterator[str]:
    """What a transition can lead to: ``states``, those in them, and the histories that are kept."""
    for state in with_inner(states):
        yield state.name
        yield from (history.name for history in state.histories if history.variable)


def _ignored_input(owner: Machine, _: Machine) -> Iterator[Change]:
    """One state does not take an event, or no state does."""
    events: dict[Event, Transition] = {}
    for place in places.states(owner):
        state = place.part
        for event, first in _events(state).items():
            events.setdefault(event, first)
            what = f"state `{state.name}` ignores {_event(event)}"
            yield Change(first.position, what, place.put(_deaf(state, event)))
    for event, first in events.items():
        deaf = with_written(owner, partial(_deaf_inside, event))
        yield Change(first.position, f"{_event(event)} is ignored everywhere", deaf)


def _events(state: State) -> dict[Event, Transition]:
    found: dict[Event, Transition] = {}
    for transition in state.transitions:
        if transition.event is not None:
            found.setdefault(transition.event, transition)
    return found


def _deaf(state: State, event: Event) -> State:
    kept = tuple(item for item in state.transitions if item.event != event)
    return state if len(kept) == len(state.transitions) else replace(state, transitions=kept)


def _deaf_inside(event: Event, state: State) -> State:
    """``state``, and those in it, without transitions for ``event``."""
    states = tuple(_deaf_inside(event, inner) for inner in state.states)
    return replace(_deaf(state, event), states=states)


# -- conditions -------------------------------------------------------------------------------


def _negated_condition(owner: Machine, _: Machine) -> Iterator[Change]:
    for place in places.conditions(owner):
        yield Change(place.part.position, "condition negated", place.put(_negation(place.part)))


_OPPOSITE = {"==": "!=", "!=": "==", "===": "!==", "!==": "==="}


def _negation(condition: Expression) -> Expression:
    match condition:
        case Unary(operator="!"):
            return condition.operand
        case Binary(operator=operator) if operator in _OPPOSITE:
            return replace(condition, operator=_OPPOSITE[operator])
        case Literal(value=bool(value)):
            return replace(condition, value=not value)
        case _:
            return Unary(operator="!", operand=condition, position=condition.position)


_SHIFTED = {
    "<": ("<=", ">"),
    "<=": ("<", ">="),
    ">": (">=", "<"),
    ">=": (">", "<="),
    **{operator: (opposite,) for operator, opposite in _OPPOSITE.items()},
}
"""The boundary moved, and the relation swapped."""

_OTHER_LOGIC = {"&&": "||", "||": "&&"}


def _shifted_condition(owner: Machine, _: Machine) -> Iterator[Change]:
    fixed = constants(owner)
    for condition in places.conditions(owner):
        for place in places.parts_of(condition):
            node = place.part
            match node:
                case Binary(operator=operator):
                    for other in _SHIFTED.get(operator, ()):
                        what = f"`{operator}` became `{other}`"
                        yield Change(node.position, what, place.put(replace(node, operator=other)))
                case Logical(operator=operator):
                    other = _OTHER_LOGIC[operator]
                    what = f"`{operator}` became `{other}`"
                    yield Change(node.position, what, place.put(replace(node, operator=other)))
                case Literal() | Variable():
                    for new in shifted_literals(node, fixed):
                        what = f"`{name_of(node)}` became `{name_of(new)}` in a condition"
                        yield Change(node.position, what, place.put(new))


# -- outputs ----------------------------------------------------------------------------------


def _dropped_output(owner: Machine, _: Machine) -> Iterator[Change]:
    for place, index, emit in _emits(owner):
        yield Change(
            emit.position, f"{_output(emit)} dropped", place.put(without(place.part, index))
        )


def _duplicated_output(owner: Machine, _: Machine) -> Iterator[Change]:
    for place, index, emit in _emits(owner):
        doubled = (*place.part[:index], emit, *place.part[index:])
        yield Change(emit.position, f"{_output(emit)} sent twice", place.put(doubled))


_WITH_A_STATUS = (OutputKind.BT_RETURN_STATUS,)
_STATUSES = ("SUCCESS", "FAILURE", "RUNNING")


def _altered_output(owner: Machine, _: Machine) -> Iterator[Change]:
    """A constant or a variable in a field is another one; a field of neither is left out."""
    fixed = constants(owner)
    for place, index, emit in _emits(owner):
        for number, field in enumerate(emit.fields):
            said = f"{_output(emit)}: field `{field.name}`"
            put = _putter(place, index, emit, number)
            found = False
            if emit.kind in _WITH_A_STATUS and isinstance(field.value, Literal):
                for status in _STATUSES:
                    changed = replace(field.value, value=status)
                    yield Change(field.position, f"{said} became `{status}`", put(changed))
                continue
            for inner in places.parts_of(Place(field.value, put)):
                for new in altered(inner.part, owner, fixed):
                    found = True
                    what = f"{said}: `{name_of(inner.part)}` became `{name_of(new)}`"
                    yield Change(field.position, what, inner.put(new))
            if not found and emit.kind is not OutputKind.BT_SET_OUTPUT:
                fewer = replace(emit, fields=without(emit.fields, number))
                left_out = place.put(swapped(place.part, index, fewer))
                yield Change(field.position, f"{said} left out", left_out)
        for attribute in ("goal_id", "thread_id"):
            value = getattr(emit, attribute)
            if isinstance(value, Variable):
                for other in same_typed(value, owner):
                    changed_emit = replace(emit, **{attribute: other})
                    what = f"{_output(emit)}: {attribute} `{value.name}` became `{other.name}`"
                    changed_block = swapped(place.part, index, changed_emit)
                    yield Change(emit.position, what, place.put(changed_block))


def _putter(
    place: Place[Block], index: int, emit: Emit, number: int
) -> Callable[[Expression], Machine]:
    def put(new: Expression) -> Machine:
        fields = swapped(emit.fields, number, replace(emit.fields[number], value=new))
        return place.put(swapped(place.part, index, replace(emit, fields=fields)))

    return put


def _wrong_channel(owner: Machine, whole: Machine) -> Iterator[Change]:
    """An output leaves by another interface of its kind and type, or a channel is misspelt."""
    for place, index, emit in _emits(owner):
        kind = interface_kind_of(emit.kind)
        mine = None if kind is None else whole.interface(emit.interface, kind)
        if mine is None:
            continue
        for other in whole.interfaces:
            if (other.kind, other.type_name) == (mine.kind, mine.type_name) and other != mine:
                moved = swapped(place.part, index, replace(emit, interface=other.name))
                what = f"{_output(emit)} leaves by {other.channel or other.name} instead"
                yield Change(emit.position, what, place.put(moved))
    if owner is whole:  # interfaces belong to the machine, not to its threads
        for number, interface in enumerate(whole.interfaces):
            if interface.channel and interface.kind is not InterfaceKind.TIMER:
                misspelt = _misspelt(interface, whole)
                changed = swapped(whole.interfaces, number, replace(interface, channel=misspelt))
                what = f"{interface.kind} {interface.channel} misspelt as {misspelt}"
                yield Change(interface.position, what, replace(whole, interfaces=changed))


def _misspelt(interface: Interface, whole: Machine) -> str:
    """The channel with its last letter doubled, as often as needed to be nobody's name."""
    channel = interface.channel or ""
    taken = {other.channel for other in whole.interfaces}
    while channel in taken:
        channel += channel[-1]
    return channel


# -- assignments ------------------------------------------------------------------------------


def _swapped_assignments(owner: Machine, _: Machine) -> Iterator[Change]:
    for place in places.blocks(owner):
        found = [
            (index, statement)
            for index, statement in enumerate(place.part)
            if isinstance(statement, Assign)
        ]
        for (first, one), (second, other) in combinations(found, 2):
            block = swapped(swapped(place.part, first, other), second, one)
            what = f"the assignments to `{_target(one)}` and `{_target(other)}` swapped"
            yield Change(one.position, what, place.put(block))


def _dropped_assignment(owner: Machine, _: Machine) -> Iterator[Change]:
    for place in places.blocks(owner):
        for index, statement in enumerate(place.part):
            if isinstance(statement, Assign):
                what = f"the assignment to `{_target(statement)}` dropped"
                yield Change(statement.position, what, place.put(without(place.part, index)))


OPERATORS: dict[str, Operator] = {
    "dropped transition": _dropped_transition,
    "redirected transition": _redirected_transition,
    "negated condition": _negated_condition,
    "shifted condition": _shifted_condition,
    "dropped output": _dropped_output,
    "duplicated output": _duplicated_output,
    "altered output": _altered_output,
    "wrong channel": _wrong_channel,
    "ignored input": _ignored_input,
    "swapped assignments": _swapped_assignments,
    "dropped assignment": _dropped_assignment,
}
"""The operators by name, in the order in which their mutants come."""


def _emits(owner: Machine) -> Iterator[tuple[Place[Block], int, Emit]]:
    for place in places.blocks(owner):
        for index, statement in enumerate(place.part):
            if isinstance(statement, Emit):
                yield place, index, statement


def _transition(state: State, transition: Transition) -> str:
    event = "eventless" if transition.event is None else f"on {_event(transition.event)}"
    return f"transition of `{state.name}` {event}"


def _event(event: Event) -> str:
    return f"{event.kind} {event.name}".strip()


def _output(emit: Emit) -> str:
    return f"{emit.kind} {emit.interface}".strip()


def _target(statement: Statement) -> str:
    return name_of(statement.location) if isinstance(statement, Assign) else ""
