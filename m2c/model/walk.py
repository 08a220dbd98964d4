"""Walking over a machine: its statements with those inside others, and what an expression names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar, cast

import msgspec

from m2c.diagnostics import Position
from m2c.language.expressions import (
    EventData,
    Expression,
    Index,
    Literal,
    MathCall,
    Member,
    Node,
    PortInput,
    Variable,
    children,
    nodes,
)
from m2c.model.machine import (
    Assign,
    Block,
    Emit,
    Event,
    EventKind,
    Foreach,
    If,
    InterfaceKind,
    Log,
    Machine,
    OutputKind,
    Raise,
    State,
    Statement,
    Target,
    Transition,
)

Part = TypeVar("Part")


def bodies(statement: Statement) -> tuple[tuple[Statement, ...], ...]:
    """What stands inside ``statement``: the branches of an ``<if>``, the content of a block or a loop."""
    match statement:
        case If(branches=branches):
            return tuple(body for _, body in branches)
        case Block(body=body) | Foreach(body=body):
            return (body,)
        case _:
            return ()


def assigned_by(statement: Statement) -> tuple[str, ...]:
    """The variables that ``statement`` itself assigns, or parts of them."""
    match statement:
        case Assign(location=location):
            return (root_of(location),)
        case Foreach(item=item, index=index):
            return (item, index) if index else (item,)
        case _:
            return ()


def flat(statements: Iterable[Statement]) -> Iterator[Statement]:
    """``statements`` with those inside them, in document order."""
    for statement in statements:
        yield statement
        for body in bodies(statement):
            yield from flat(body)


def replaced(
    statements: Iterable[Statement], change: Callable[[Statement], Statement]
) -> tuple[Statement, ...]:
    """``statements`` with each, those inside others too, as ``change`` makes it."""
    return tuple(_replaced(statement, change) for statement in statements)


def _replaced(statement: Statement, change: Callable[[Statement], Statement]) -> Statement:
    match statement:
        case If(branches=branches, position=position):
            return If(tuple((cond, replaced(body, change)) for cond, body in branches), position)
        case Block(body=body) | Foreach(body=body):
            return msgspec.structs.replace(statement, body=replaced(body, change))
        case _:
            return change(statement)


def changed(
    state: State,
    statement: Callable[[Statement], Statement],
    transition: Callable[[Transition], Transition] = lambda item: item,
) -> State:
    """``state``, and those in it, with every statement as ``statement`` makes it; first every transition."""

    def made(item: Transition) -> Transition:
        new = transition(item)
        targets = tuple(
            Target(target.state, target.probability, replaced(target.body, statement))
            for target in new.targets
        )
        return msgspec.structs.replace(new, targets=targets, body=replaced(new.body, statement))

    return msgspec.structs.replace(
        state,
        on_entry=replaced(state.on_entry, statement),
        on_exit=replaced(state.on_exit, statement),
        transitions=tuple(made(item) for item in state.transitions),
        states=tuple(changed(inner, statement, transition) for inner in state.states),
        initial=None if state.initial is None else made(state.initial),
        histories=tuple(
            msgspec.structs.replace(item, default=made(item.default)) for item in state.histories
        ),
    )


def rewritten(part: Part, change: Callable[[Expression], Expression]) -> Part:
    """``part`` of a machine with every expression as ``change`` makes it; what is assigned to stays."""
    if isinstance(part, tuple):
        return cast(Part, tuple(rewritten(item, change) for item in part))
    if not isinstance(part, msgspec.Struct):
        return part
    kept = "location" if isinstance(part, Assign) else ""
    new = {
        name: rewritten(value, change)
        for name in part.__struct_fields__
        if name != kept and isinstance(value := getattr(part, name), tuple | msgspec.Struct)
    }
    made = msgspec.structs.replace(part, **new) if new else part
    return cast(Part, change(cast(Expression, made))) if isinstance(made, Node) else made


def with_event_name(transition: Transition, name: str) -> Transition:
    """``transition``, which only the event ``name`` takes: ``_event.name`` is that."""

    def named(node: Expression) -> Expression:
        if isinstance(node, EventData) and node.part == "name":
            return Literal(value=name, position=node.position)
        return node

    return rewritten(transition, named)


def with_machine_name(machine: Machine) -> Machine:
    """``machine`` with its name for ``_name`` (W3C SCXML 5.10), in action threads too."""
    parts = with_threads(machine)
    if not any("_name" in variables_of(it) for part in parts for it in expressions_of(part)):
        return machine
    if any(data.name == "_name" for part in parts for data in part.data):
        return machine

    def named(node: Expression) -> Expression:
        if isinstance(node, Variable) and node.name == "_name":
            return Literal(value=machine.name, position=node.position)
        return node

    return rewritten(machine, named)


def with_threads(machine: Machine) -> tuple[Machine, ...]:
    """``machine``, then the machines of its action threads."""
    return (machine, *(thread.machine for thread in machine.threads))


def statements_in(state: State) -> Iterator[Statement]:
    """Every statement of ``state``: on entry, of its transitions, of what is in it, on exit."""
    yield from flat(state.on_entry)
    for transition in (*state.transitions, *ways_into(state)):
        yield from flat(transition.body)
        for target in transition.targets:
            yield from flat(target.body)
    for inner in state.states:
        yield from statements_in(inner)
    yield from flat(state.on_exit)


def with_inner(states: Iterable[State]) -> Iterator[State]:
    """``states`` with those inside them, in document order."""
    for state in states:
        yield state
        yield from with_inner(state.states)


def ways_into(state: State) -> tuple[Transition, ...]:
    """What leads to a state in the compound state ``state``, without an event."""
    initial = () if state.initial is None else (state.initial,)
    return (*initial, *(history.default for history in state.histories))


def delays_of(state: State) -> dict[str, float]:
    """The events of the delayed transitions of ``state`` itself, and after how long they come (s)."""
    return {
        item.event.name: item.after_s
        for item in state.transitions
        if item.event is not None and item.after_s is not None and not item.of
    }


def has_timers(machine: Machine) -> bool:
    """Whether what ``machine`` does, or one of its action threads, depends on how much time has passed."""
    machines = (machine, *(thread.machine for thread in machine.threads))
    return any(item.kind is InterfaceKind.TIMER for item in machine.interfaces) or any(
        any(
            item.after_s is not None
            for state in with_inner(it.states)
            for item in state.transitions
        )
        or any(isinstance(item, Raise) and item.delay_s is not None for item in statements_of(it))
        for it in machines
    )


def statements_of(machine: Machine) -> Iterator[Statement]:
    """Every statement of ``machine``, without those of its action threads."""
    yield from flat(machine.on_start)
    for state in machine.states:
        yield from statements_in(state)


def expressions_of(machine: Machine) -> Iterator[Expression]:
    """Every expression of ``machine``, without those of its action threads and those inside others."""
    yield from (data.initial for data in machine.data)
    yield from expressions_among(flat(machine.on_start))
    yield from expressions_in(machine.states)


def expressions_in(states: Iterable[State]) -> Iterator[Expression]:
    """Every expression of ``states`` and of those inside them, without those inside others."""
    for state in with_inner(states):
        yield from (item.cond for item in state.transitions if item.cond is not None)
        yield from (field.value for field in state.done_data)
    for state in states:
        yield from expressions_among(statements_in(state))


def expressions_among(statements: Iterable[Statement]) -> Iterator[Expression]:
    """Every expression of ``statements``, without those of statements inside them and those inside others."""
    for statement in statements:
        match statement:
            case Assign(location=location, value=value):
                yield from (location, value)
            case Emit(fields=fields, goal_id=goal, thread_id=thread):
                yield from (field.value for field in fields)
                yield from (number for number in (goal, thread) if number is not None)
            case Raise(fields=fields, delay_s=delay):
                yield from (field.value for field in fields)
                yield from () if delay is None else (delay,)
            case If(branches=branches):
                yield from (test for test, _ in branches if test is not None)
            case Foreach(array=array):
                yield array
            case Log(value=value) if value is not None:
                yield value


def draws(machine: Machine) -> bool:
    """Whether ``machine`` draws values at random, without its action threads: ``Math.random()``."""
    return any(is_draw(part) for whole in expressions_of(machine) for part in nodes(whole))


def is_draw(expression: Expression) -> bool:
    """Whether ``expression`` itself is a random draw, not whether one is in it."""
    return isinstance(expression, MathCall) and expression.function == "random"


def looks_again(state: State) -> bool:
    """Whether an eventless transition of ``state`` may be enabled later though no variable has changed.

    W3C SCXML tests them after each event, whether or not a transition took it (appendix D, mainEventLoop):
    that makes a difference where a condition draws a number or reads a port of the behaviour tree.
    """
    return any(
        is_draw(part) or isinstance(part, PortInput)
        for item in state.transitions
        if item.event is None and item.cond is not None
        for part in nodes(item.cond)
    )


def chooses(machine: Machine) -> bool:
    """Whether a transition of ``machine`` leads to one of several states, by chance."""
    return any(len(item.targets) > 1 for state in machine.states for item in state.transitions)


def ports_read(machine: Machine) -> dict[str, Position]:
    """The ports that ``<bt_get_input>`` reads in content and data, and where first."""
    found: dict[str, Position] = {}
    for expression in expressions_of(machine):
        if isinstance(expression, PortInput):
            found.setdefault(expression.key, expression.position)
    return found


def events_of(machine: Machine) -> list[Event]:
    """Every event that some transition of ``machine`` waits for, in document order, each once."""
    found = (item.event for state in machine.states for item in state.transitions)
    return list(dict.fromkeys(event for event in found if event is not None))


def failure_of_goals(machine: Machine, interface: str) -> EventKind:
    """What ``machine`` gets when a goal that it sent by ``interface`` is not answered, or its server ends.

    A model that nowhere has ``<ros_action_handle_error>`` for it takes it for a rejection.
    """
    is_handled = Event(EventKind.GOAL_FAILED, interface) in events_of(machine)
    return EventKind.GOAL_FAILED if is_handled else EventKind.GOAL_REJECTED


def emits_of(machine: Machine) -> list[tuple[OutputKind, str]]:
    """Every output that ``machine`` can send, in document order, each once."""
    found = (item for item in statements_of(machine) if isinstance(item, Emit))
    return list(dict.fromkeys((item.kind, item.interface) for item in found))


def variables_of(expression: Expression | None) -> list[str]:
    """Names of the variables of ``expression``, each once, in order of appearance."""
    found: dict[str, None] = {}
    pending = [] if expression is None else [expression]
    while pending:
        here = pending.pop()
        if isinstance(here, Variable):
            found[here.name] = None
        pending.extend(reversed(children(here)))
    return list(found)


def root_of(location: Expression) -> str:
    """The variable that ``location`` is, or is a part of; "" if it is none's."""
    while isinstance(location, Member | Index):
        location = location.object
    return location.name if isinstance(location, Variable) else ""
