"""One run to completion of a machine, interpreted (W3C SCXML 3.13 and appendix D, flat machines).

The generated code is compiled from the same ``Machine``; this is the other implementation of its
semantics. Choices that the model leaves open are followed one after the other: a step is taken again
for each of their outcomes.
"""

from __future__ import annotations

import copy
import functools
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from m2c.model.datatypes import BOOL, STRING, Array, DataType, Structure, is_integer
from m2c.model.diagnostics import Position
from m2c.model.durations import parse_duration
from m2c.model.expressions import Expression, Index, Literal, Member, ObjectLiteral, Variable
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Assign,
    Cancel,
    Emit,
    EventKind,
    If,
    Log,
    Machine,
    OutputKind,
    Raise,
    State,
    Statement,
    Transition,
)
from m2c.model.scopes import event_parts, output_data_type
from m2c.model.typing import Scope, type_of
from m2c.model.walk import root_of, statements_of
from m2c.runtime import ecmascript
from moon.oracle.expressions import Closures, zero
from moon.oracle.liveness import live_variables
from moon.oracle.unknowns import Unknown, anything

MAX_STEPS = 1000
"""Eventless transitions and internal events in one macrostep; more is an endless loop, which ends
the macrostep (as in generated code)."""

MAX_OUTCOMES = 64
"""So many outcomes of one step are followed; a step with more is too open to be checked."""

KEPT_STEPS = 64
"""Steps whose outcome is remembered, for each machine."""

FEW = 8
"""A draw among so many numbers is followed number by number."""

EventKey = tuple[EventKind, str]
Action = Callable[["Step"], None]


class TooOpenError(Exception):
    """A step has more outcomes than can be followed."""


class Output:
    """Something a machine sends, as the model says it."""

    __slots__ = ("fields", "goal", "interface", "kind", "position", "thread", "transition")

    def __init__(
        self,
        kind: OutputKind,
        interface: str,
        fields: Any,
        goal: Any,
        thread: Any,
        position: Position,
        transition: Position,
    ) -> None:
        self.kind = kind
        self.interface = interface
        self.fields = fields
        self.goal = goal
        self.thread = thread
        self.position = position
        self.transition = transition


class Delayed:
    """A timer that a step starts: an ``after`` transition, or an event sent to oneself."""

    __slots__ = ("data", "delay_s", "event", "id")

    def __init__(self, event: EventKey, delay_s: Any, data: Any, identifier: str) -> None:
        self.event = event
        self.delay_s = delay_s
        self.data = data
        self.id = identifier


class Step:
    """A macrostep being taken: what changes, and what comes of it."""

    __slots__ = (
        "_position",
        "data",
        "effect",
        "internal",
        "message",
        "outputs",
        "parts",
        "scheduled",
        "state",
        "tape",
        "transition",
    )

    def __init__(
        self, state: int, data: tuple[Any, ...], message: Any, parts: Mapping[str, Any], tape: Any
    ) -> None:
        self.state = state
        self.data = list(data)
        self.message = message
        self.parts = parts
        self.tape = tape
        self._position = 0
        self.outputs: list[Output] = []
        self.scheduled: list[Delayed | str] = []
        """In order: what is started, and the ids of what is cancelled."""
        self.internal: deque[tuple[str, Any]] = deque()
        self.transition: Position | None = None
        self.effect: Any = None
        """Kept by who takes this step again and again; see ``moon.oracle.shortcuts``."""

    def choose(self, count: int) -> int:
        """Which of ``count`` outcomes this pass follows."""
        if self._position == len(self.tape):
            self.tape.append([0, count])
        pick: int = self.tape[self._position][0]
        self._position += 1
        return pick

    def either(self) -> bool:
        """A condition that can go either way."""
        return self.choose(2) == 0

    def settled(self, value: Any) -> Any:
        """``value``; if it is one of a few numbers, each of them in turn: ranges forget that two
        unknown values are the same one.
        """
        if value.__class__ is not Unknown or not value.integer:
            return value
        count = value.high - value.low + 1
        if not count <= FEW:
            return value
        number = int(value.low) + self.choose(int(count))
        self.replace(value, number)
        return number

    def replace(self, unknown: Unknown, value: Any) -> None:
        """From now on, ``unknown`` is known to be ``value``."""
        data = self.data
        for place, held in enumerate(data):
            if held is unknown:
                data[place] = value


class TransitionProgram:
    """A transition ready to be taken."""

    __slots__ = ("body", "condition", "event", "leaves", "position", "targets")

    def __init__(
        self,
        event: EventKey | None,
        condition: Callable[[Step], bool] | None,
        body: Action | None,
        targets: list[tuple[int, Action | None]],
        position: Position,
    ) -> None:
        self.event = event
        self.condition = condition
        self.body = body
        self.targets = targets
        self.leaves = bool(targets)
        self.position = position


class StateProgram:
    """A state ready to be entered and left."""

    __slots__ = ("by_event", "delays", "enter", "eventless", "internal", "leave", "name", "timers")

    def __init__(self, name: str) -> None:
        self.name = name
        self.enter: Action | None = None
        self.leave: Action | None = None
        self.delays: list[tuple[EventKey, float]] = []
        self.by_event: dict[EventKey, list[TransitionProgram]] = {}
        self.eventless: list[TransitionProgram] = []
        self.internal: list[tuple[str, TransitionProgram]] = []
        self.timers: frozenset[str] = frozenset()


class MachineProgram:
    """A machine (or an action thread) ready to be stepped.

    Args:
        machine: the model.
        library: its message types.
        owner: the machine that declares the interfaces (differs for an action thread).
    """

    def __init__(
        self, machine: Machine, library: InterfaceLibrary, owner: Machine | None = None
    ) -> None:
        self.machine = machine
        self._library = library
        self._owner = owner or machine
        self._types = {data.name: data.type for data in machine.data}
        self.variables = {data.name: place for place, data in enumerate(machine.data)}
        self.names = [data.name for data in machine.data]
        self._indices = {state.name: index for index, state in enumerate(machine.states)}
        self.initial = self._indices[machine.initial]
        self.live = live_variables(machine)
        """Variables that make a difference to what is seen; others are left as they begin."""
        self._exact = self._compile(symbolic=False)
        self.states = self._exact
        self.draws = "function='random'" in repr(machine)
        """Whether values are drawn at random."""
        self._repeatable = self._events_of_plain_values()
        self._steps: dict[Any, tuple[tuple[bool, Step]]] = {}
        """Outcomes of steps taken before; nobody changes a step that was taken."""
        self.chooses = any(
            len(transition.targets) > 1
            for state in machine.states
            for transition in state.transitions
        )
        """Whether a transition leads to one of several states."""
        self.assigned = frozenset(
            root_of(item.location) for item in statements_of(machine) if isinstance(item, Assign)
        )
        """Variables that change."""

    # --- taking steps ------------------------------------------------------------------------------

    @functools.cached_property
    def _symbolic(self) -> list[StateProgram]:
        """The states for steps with unknown values, made when the first such step is taken."""
        return self._compile(symbolic=True)

    def initial_data(self) -> tuple[Any, ...]:
        """The datamodel before the first step."""
        made: list[Any] = []
        step = Step(self.initial, (), None, {}, [])
        closures = Closures(self.variables, Scope(self._types), True)
        for data in self.machine.data:
            if isinstance(data.initial, ObjectLiteral) and not data.initial.entries:
                value = zero(data.type)
            else:
                step.data = [*made]
                value = closures.value(data.initial, data.type)(step)
            made.append(value)
        return tuple(made)

    def unknown_data(self) -> tuple[Any, ...]:
        """The datamodel when nothing is known of what happened: only what never changes is."""
        known = self.initial_data()
        return tuple(
            anything() if name in self.assigned and name in self.live else value
            for name, value in zip(self.names, known, strict=True)
        )

    def start(self, data: tuple[Any, ...]) -> Iterator[tuple[bool, Step]]:
        """Enter the initial state: every outcome."""
        return self._outcomes(self.initial, data, None, {}, None, True)

    def take(
        self,
        state: int,
        data: tuple[Any, ...],
        event: EventKey,
        message: Any,
        parts: Mapping[str, Any],
        symbolic: bool = True,
    ) -> Iterable[tuple[bool, Step]]:
        """Process ``event``: every outcome, as ``(whether a transition took it, the step)``.

        ``symbolic``: whether there may be unknown values; without any, there is one outcome
        (unless the model chooses between targets).
        """
        if symbolic or self.chooses:
            return self._outcomes(state, data, message, parts, event, symbolic)
        if parts or event not in self._repeatable:
            step = Step(state, data, message, parts, None)
            return ((self._deliver(step, self._exact, event), step),)
        key = (state, data, event, tuple(message.items()) if message else ())
        known = self._steps.get(key)
        if known is None:
            step = Step(state, data, message, parts, None)
            known = self._steps[key] = ((self._deliver(step, self._exact, event), step),)
            if len(self._steps) > KEPT_STEPS:
                del self._steps[next(iter(self._steps))]
        return known

    def handles(self, state: int, event: EventKey) -> bool:
        """Whether ``state`` has a transition on ``event``."""
        program = self.states[state]
        if event in program.by_event:
            return True
        if event[0] is not EventKind.INTERNAL:
            return False
        return any(_matches(event[1], descriptor) for descriptor, _ in program.internal)

    def _outcomes(
        self,
        state: int,
        data: tuple[Any, ...],
        message: Any,
        parts: Mapping[str, Any],
        event: EventKey | None,
        symbolic: bool,
    ) -> Iterator[tuple[bool, Step]]:
        states = self._symbolic if symbolic else self._exact
        tape: list[list[int]] = []
        for _ in range(MAX_OUTCOMES):
            step = Step(state, data, message, parts, tape)
            if event is None:
                taken = True
                self._enter(step, states, state)
                self._settle(step, states)
            else:
                taken = self._deliver(step, states, event)
            yield taken, step
            while tape and tape[-1][0] + 1 == tape[-1][1]:
                tape.pop()
            if not tape:
                return
            tape[-1][0] += 1
        raise TooOpenError(
            f"{self.machine.name}: a step in state {states[state].name} has more than "
            f"{MAX_OUTCOMES} outcomes"
        )

    def _deliver(self, step: Step, states: list[StateProgram], event: EventKey) -> bool:
        program = states[step.state]
        if event[0] is EventKind.INTERNAL:
            found = [t for descriptor, t in program.internal if _matches(event[1], descriptor)]
        else:
            found = program.by_event.get(event, [])
        for transition in found:
            if transition.condition is None or self._holds(step, transition.condition):
                self._follow(step, states, transition)
                self._settle(step, states)
                return True
        if step.internal:  # a condition failed
            self._settle(step, states)
        return False

    def _holds(self, step: Step, condition: Callable[[Step], bool]) -> bool:
        try:
            return condition(step)
        except ecmascript.ExecutionError:
            step.internal.append(("error.execution", None))
            return False

    def _follow(
        self, step: Step, states: list[StateProgram], transition: TransitionProgram
    ) -> None:
        step.transition = transition.position
        if transition.leaves:
            leave = states[step.state]
            if leave.leave is not None:
                leave.leave(step)
            for event, _ in leave.delays:
                step.scheduled.append(event[1])
        if transition.body is not None:
            transition.body(step)
        targets = transition.targets
        if not targets:
            return
        index, body = targets[step.choose(len(targets))] if len(targets) > 1 else targets[0]
        if body is not None:
            body(step)
        self._enter(step, states, index)

    def _enter(self, step: Step, states: list[StateProgram], index: int) -> None:
        step.state = index
        program = states[index]
        for event, delay_s in program.delays:
            step.scheduled.append(Delayed(event, delay_s, None, event[1]))
        if program.enter is not None:
            program.enter(step)

    def _settle(self, step: Step, states: list[StateProgram]) -> None:
        for _ in range(MAX_STEPS):
            program = states[step.state]
            for transition in program.eventless:
                if transition.condition is None or self._holds(step, transition.condition):
                    self._follow(step, states, transition)
                    break
            else:
                if not step.internal:
                    return
                name, data = step.internal.popleft()
                step.message, step.parts = data, {"name": name}
                for descriptor, transition in states[step.state].internal:
                    if _matches(name, descriptor) and (
                        transition.condition is None or self._holds(step, transition.condition)
                    ):
                        self._follow(step, states, transition)
                        break

    def _events_of_plain_values(self) -> frozenset[EventKey]:
        """Events whose step depends on whole numbers, truth values and texts alone.

        Those are equal only if they are the same; 0.0 and -0.0, or an array, are not so.
        """
        if not all(_is_plain(data.type) for data in self.machine.data):
            return frozenset()
        found = set()
        for state in self.machine.states:
            for transition in state.transitions:
                event = transition.event
                if event is None or event.kind is EventKind.INTERNAL:
                    continue
                kind = event_parts(event, self._owner, self._library).get("data")
                fields = kind.fields if isinstance(kind, Structure) else ()
                if all(_is_plain(inner) for _, inner in fields):
                    found.add((event.kind, event.name))
        return frozenset(found)

    # --- making it ready ---------------------------------------------------------------------------

    def _compile(self, symbolic: bool) -> list[StateProgram]:
        return [self._state(state, symbolic) for state in self.machine.states]

    def _state(self, state: State, symbolic: bool) -> StateProgram:
        program = StateProgram(state.name)
        closures = self._closures({}, symbolic)
        program.enter = self._block(state.on_entry, closures)
        program.leave = self._block(state.on_exit, closures)
        timers = set()
        for transition in state.transitions:
            made = self._transition(transition, symbolic)
            event = transition.event
            if event is None:
                program.eventless.append(made)
            elif event.kind is EventKind.INTERNAL:
                program.internal.append((event.name, made))
            else:
                program.by_event.setdefault((event.kind, event.name), []).append(made)
                if event.kind is EventKind.TIMER:
                    timers.add(event.name)
                if transition.after_s is not None:
                    program.delays.append(((event.kind, event.name), transition.after_s))
        program.timers = frozenset(timers)
        return program

    def _closures(self, parts: Mapping[str, DataType], symbolic: bool) -> Closures:
        return Closures(self.variables, Scope(self._types, parts), symbolic)

    def _transition(self, transition: Transition, symbolic: bool) -> TransitionProgram:
        event = transition.event
        parts = event_parts(event, self._owner, self._library)
        closures = self._closures(parts, symbolic)
        targets = [
            (self._indices[target.state], self._block(target.body, closures))
            for target in transition.targets
        ]
        return TransitionProgram(
            None if event is None else (event.kind, event.name),
            None if transition.cond is None else closures.condition(transition.cond),
            self._block(transition.body, closures),
            targets,
            transition.position,
        )

    def _block(self, statements: tuple[Statement, ...], closures: Closures) -> Action | None:
        """Executable content; an expression that fails ends it, as SCXML says."""
        if not statements:
            return None
        actions = [
            self._statement(statement, closures)
            for statement in statements
            if not self._is_dead(statement)
        ]
        if not actions:
            return None

        def run(step: Step) -> None:
            try:
                for action in actions:
                    action(step)
            except ecmascript.ExecutionError:
                step.internal.append(("error.execution", None))

        return run

    def _is_dead(self, statement: Statement) -> bool:
        return isinstance(statement, Assign) and root_of(statement.location) not in self.live

    def _statement(self, statement: Statement, closures: Closures) -> Action:
        match statement:
            case Assign(location, value):
                return self._assign(location, value, closures)
            case Emit():
                return self._emit(statement, closures)
            case Raise():
                return self._raise(statement, closures)
            case Cancel(id=identifier):
                return lambda step: step.scheduled.append(identifier)
            case Log(value=value):
                if value is None:
                    return lambda step: None
                shown = closures.value(value)
                return lambda step: _evaluate_only(shown, step)
            case If(branches):
                return self._if(branches, closures)

    def _if(self, branches: Any, closures: Closures) -> Action:
        made = [
            (
                None if test is None else closures.condition(test),
                [self._statement(item, closures) for item in body if not self._is_dead(item)],
            )
            for test, body in branches
        ]

        def run(step: Step) -> None:
            for test, body in made:
                if test is None or self._holds(step, test):
                    for action in body:
                        action(step)
                    return

        return run

    def _assign(self, location: Expression, value: Expression, closures: Closures) -> Action:
        if isinstance(location, Variable):
            place = self.variables[location.name]
            new = closures.value(value, self._types[location.name])

            def assign(step: Step) -> None:
                step.data[place] = new(step)

            return assign
        kind = type_of(location, Scope(self._types))
        new = closures.value(value, kind)
        root = self.variables[root_of(location)]
        assert isinstance(location, Member | Index)
        holder = closures.value(location.object)
        index = None if isinstance(location, Member) else closures.value(location.index)
        fill_type = type_of(location.object, Scope(self._types))
        fill = zero(fill_type.element) if isinstance(fill_type, Array) else None

        def assign_part(step: Step) -> None:
            made = new(step)
            if step.data[root].__class__ is Unknown:
                return  # a part of something unknown: still unknown
            # values are shared between hypotheses: change a copy
            step.data[root] = copy.deepcopy(step.data[root])
            target = holder(step)
            if target.__class__ is Unknown:
                return
            if isinstance(location, Member):
                ecmascript.set_member(target, location.name, made)
                return
            assert index is not None
            place = index(step)
            if place.__class__ is Unknown:
                step.data[root] = anything()
                return
            ecmascript.set_element(target, place, made, fill=copy.deepcopy(fill))

        return assign_part

    def _emit(self, emit: Emit, closures: Closures) -> Action:
        structure = output_data_type(emit.kind, emit.interface, self._owner, self._library)
        write = _message_writer(structure, emit, closures)
        goal = None if emit.goal_id is None else closures.value(emit.goal_id)
        thread = None if emit.thread_id is None else closures.value(emit.thread_id)
        kind, interface, position = emit.kind, emit.interface, emit.position

        def run(step: Step) -> None:
            step.outputs.append(
                Output(
                    kind,
                    interface,
                    write(step),
                    None if goal is None else goal(step),
                    None if thread is None else thread(step),
                    position,
                    step.transition or position,
                )
            )

        return run

    def _raise(self, statement: Raise, closures: Closures) -> Action:
        fields = [(field.name, closures.value(field.value)) for field in statement.fields]
        name = statement.event

        def data(step: Step) -> Any:
            return {key: value(step) for key, value in fields} if fields else None

        if not statement.external:
            return lambda step: step.internal.append((name, data(step)))
        written = statement.delay_s
        fixed = 0.0 if written is None else None
        if isinstance(written, Literal) and isinstance(written.value, int | float):
            fixed = float(written.value)
        delay = None if written is None else closures.value(written)
        identifier = statement.id

        def send(step: Step) -> None:
            seconds = fixed
            if seconds is None and delay is not None:
                seconds = _seconds(delay(step))
            step.scheduled.append(
                Delayed((EventKind.INTERNAL, name), seconds, data(step), identifier)
            )

        return send


def _is_plain(kind: DataType) -> bool:
    return kind in (BOOL, STRING) or is_integer(kind)


def _message_writer(
    structure: Structure | None, emit: Emit, closures: Closures
) -> Callable[[Step], Any]:
    """A closure that makes the message of an output, with zero values where no field is set."""
    if structure is None:
        if not emit.fields:
            return lambda step: None
        values = [(field.name, closures.value(field.value)) for field in emit.fields]
        return lambda step: {name: value(step) for name, value in values}
    template = zero(structure)
    nested = any(not isinstance(item, bool | int | float | str) for item in template.values())
    writes: list[tuple[tuple[str, ...], Callable[[Step], Any]]] = []
    for field in emit.fields:
        path = tuple(field.name.split("."))
        kind: DataType | None = structure
        for part in path:
            kind = kind.field(part) if isinstance(kind, Structure) else None
        writes.append((path, closures.value(field.value, kind)))
    if not nested:
        flat = [(path[0], value) for path, value in writes]

        def write(step: Step) -> Any:
            message = template.copy()
            for name, value in flat:
                message[name] = value(step)
            return message

        return write

    def write_nested(step: Step) -> Any:
        message = copy.deepcopy(template)
        for path, value in writes:
            holder = message
            for part in path[:-1]:
                holder = holder[part]
            holder[path[-1]] = value(step)
        return message

    return write_nested


def _evaluate_only(value: Callable[[Step], Any], step: Step) -> None:
    value(step)


def _seconds(value: Any) -> Any:
    """Seconds of a ``delayexpr`` (see ``m2c.runtime.machine.seconds``)."""
    if value.__class__ is Unknown:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value / 1000
    parsed = parse_duration(ecmascript.to_string(value))
    if parsed is None:
        raise ecmascript.ExecutionError(f"`{ecmascript.to_string(value)}` is not a time")
    return parsed


def _matches(name: str, descriptor: str) -> bool:
    """W3C SCXML 3.12.1."""
    if descriptor == "*":
        return True
    prefix = descriptor.removesuffix("*").removesuffix(".")
    return name == prefix or name.startswith(f"{prefix}.") or not prefix
