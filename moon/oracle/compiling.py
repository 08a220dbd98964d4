"""A machine made ready to be stepped: closures instead of a tree to be walked, and the step that they change.

A variable that no condition, output or delay depends on, not even through others, only multiplies
hypotheses: its assignments are left out (live variable analysis over the whole machine).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any

from m2c.diagnostics import Position
from m2c.language import ecmascript
from m2c.language.certainty import Certainty, Fit
from m2c.language.datatypes import ANY, INT64, Array, DataType, Structure, part
from m2c.language.durations import seconds
from m2c.language.expressions import (
    EventData,
    Expression,
    Index,
    Literal,
    Member,
    PortInput,
    Variable,
    nodes,
)
from m2c.language.macrostep import ERROR_EXECUTION, prefix_of
from m2c.language.text import expression_text
from m2c.language.typing import Scope, type_of
from m2c.language.values import zero
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Assign,
    Block,
    Cancel,
    Delay,
    Emit,
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
    Transition,
)
from m2c.model.scopes import event_parts, output_data_type, readable_ports
from m2c.model.walk import assigned_by, delays_of, flat, is_draw, looks_again, root_of, variables_of
from moon.oracle.expressions import Closures
from moon.oracle.steps import FEW, QUEUED_OUTPUTS, Delayed, Output, Step, TooOpenError
from moon.oracle.trace_events import EventKey
from moon.oracle.unknowns import Unknown, anything, unknown_of

Action = Callable[["Step"], None]


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

    __slots__ = (
        "by_event",
        "delays",
        "enter",
        "eventless",
        "internal",
        "leave",
        "looks_again",
        "name",
        "pending",
        "timers",
    )

    def __init__(self, name: str) -> None:
        self.name = name
        self.enter: Action | None = None
        self.leave: Action | None = None
        self.delays: list[tuple[EventKey, float]] = []
        """Those that begin when it is entered."""
        self.pending: list[tuple[EventKey, float]] = []
        """Those that may be on while it is active: with those of compound states around it."""
        self.by_event: dict[EventKey, list[TransitionProgram]] = {}
        self.eventless: list[TransitionProgram] = []
        self.internal: list[tuple[str, TransitionProgram]] = []
        self.timers: frozenset[str] = frozenset()
        self.looks_again = False


def remembered(condition: Callable[[Step], bool]) -> Callable[[Step], bool]:
    """``condition``, which depends on data alone: it comes to the same until a transition is taken.

    Where data are unknown that is a choice, and the same one. A macrostep tests a condition again after each
    internal event; one that fails is such an event itself.
    """
    number = id(condition)

    def test(step: Step) -> bool:
        if number not in step.tested:
            step.asked += 1
            step.tested[number] = None
            step.tested[number] = condition(step)
        known = step.tested[number]
        if known is None:
            raise ecmascript.ExecutionError("a condition that failed before")
        return known

    return test


def holds(step: Step, condition: Callable[[Step], bool]) -> bool:
    """Whether ``condition`` holds; one that fails does not, and is an error of the machine's."""
    try:
        return condition(step)
    except ecmascript.ExecutionError:
        step.internal.append((ERROR_EXECUTION, None))
        return False


# --- compiling ------------------------------------------------------------------------------------


class Compiler:
    """Makes closures of a machine's executable content.

    Args:
        machine: the model, or an action thread.
        library: its message types.
        owner: the machine that declares the interfaces (differs for an action thread).
        live: variables that make a difference to what is seen; assignments to others are left out.
        symbolic: whether values may be unknown.
    """

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary,
        owner: Machine,
        live: Collection[str],
        symbolic: bool,
    ) -> None:
        self._machine = machine
        self._library = library
        self._owner = owner
        self._live = live
        self._symbolic = symbolic
        self._types = {data.name: data.type for data in machine.data}
        self._variables = {data.name: place for place, data in enumerate(machine.data)}
        self._indices = {state.name: index for index, state in enumerate(machine.states)}
        self._blocks: dict[str, Action] = {}

    def begin(self) -> Action | None:
        """What is done before the initial state is entered."""
        return self._block(self._machine.on_start, self._closures({}))

    def states(self) -> list[StateProgram]:
        """All states, in the machine's order."""
        return [self._state(state) for state in self._machine.states]

    def _state(self, state: State) -> StateProgram:
        program = StateProgram(state.name)
        closures = self._closures({})
        program.enter = self._block(state.on_entry, closures)
        program.leave = self._block(state.on_exit, closures)
        timers = set()
        pending: dict[EventKey, float] = {}
        own = delays_of(state)
        for transition in state.transitions:
            made = self._transition(transition)
            event = transition.event
            if event is None:
                program.eventless.append(made)
            elif event.kind is EventKind.INTERNAL:
                program.internal.append((prefix_of(event.name), made))
            else:
                program.by_event.setdefault((event.kind, event.name), []).append(made)
                if event.kind is EventKind.TIMER:
                    timers.add(event.name)
                if transition.after_s is not None:
                    pending[event.kind, event.name] = transition.after_s
        program.timers = frozenset(timers)
        program.pending = list(pending.items())
        program.delays = [item for item in program.pending if item[0][1] in own]
        program.looks_again = looks_again(state)
        return program

    def _closures(self, parts: Mapping[str, DataType]) -> Closures:
        ports = readable_ports(self._machine)
        scope = Scope(self._types, parts, ports, self._machine.lenient)
        return Closures(self._variables, scope, self._symbolic)

    def _transition(self, transition: Transition) -> TransitionProgram:
        event = transition.event
        parts = event_parts(event, self._owner, self._library)
        closures = self._closures(parts)
        targets = [
            (self._indices[target.state], self._block(target.body, closures))
            for target in transition.targets
        ]
        return TransitionProgram(
            None if event is None else (event.kind, event.name),
            None if transition.cond is None else self._condition(transition.cond, closures),
            self._block(transition.body, closures),
            targets,
            transition.position,
        )

    def _condition(self, condition: Expression, closures: Closures) -> Callable[[Step], bool]:
        made = closures.condition(condition)
        if not self._symbolic:
            return made
        if not any(
            is_draw(node) or isinstance(node, EventData | PortInput) for node in nodes(condition)
        ):
            return remembered(made)

        def test(step: Step) -> bool:
            step.asked += 1
            return made(step)

        return test

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
                step.internal.append((ERROR_EXECUTION, None))

        return run

    def _is_dead(self, statement: Statement) -> bool:
        return isinstance(statement, Assign) and root_of(statement.location) not in self._live

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
            case Foreach():
                return self._loop(statement, closures)
            case Block(body, name=name):
                return self._named(name, body) if name else self._block(body, closures) or _nothing
            case Delay(name, None):
                return lambda step: step.scheduled.append(name)
            case Delay(name, after_s):
                event = (EventKind.AFTER, name)
                return lambda step: step.scheduled.append(Delayed(event, after_s, None, name))

    def _named(self, name: str, body: tuple[Statement, ...]) -> Action:
        """What all blocks called ``name`` do; they read no data of an event."""
        if name not in self._blocks:
            self._blocks[name] = self._block(body, self._closures({})) or _nothing
        return self._blocks[name]

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
                if test is None or holds(step, test):
                    for action in body:
                        action(step)
                    return

        return run

    def _loop(self, loop: Foreach, closures: Closures) -> Action:
        array = closures.value(loop.array)
        place = self._variables[loop.item]
        item = closures.element(loop.array, self._types[loop.item])
        counted, count = -1, item
        if loop.index:
            counted = self._variables[loop.index]
            count = closures.element(Literal(value=None), self._types[loop.index])
        body = [self._statement(it, closures) for it in loop.body if not self._is_dead(it)]

        def run(step: Step) -> None:
            found = array(step)
            if found.__class__ is Unknown:
                raise TooOpenError("a loop over an array of which nothing is known")
            for number, element in enumerate(ecmascript.elements(found)):
                step.element = element
                step.data[place] = item(step)
                if counted >= 0:
                    step.element = number
                    step.data[counted] = count(step)
                for action in body:
                    action(step)

        return run

    def _assign(self, location: Expression, value: Expression, closures: Closures) -> Action:
        if isinstance(location, Variable):
            place = self._variables[location.name]
            new = closures.value(value, self._types[location.name])

            def assign(step: Step) -> None:
                step.data[place] = new(step)

            return assign
        kind = type_of(location, Scope(self._types))
        new = closures.value(value, kind)
        root = self._variables[root_of(location)]
        assert isinstance(location, Member | Index)
        holder = closures.value(location.object)
        index = None if isinstance(location, Member) else closures.value(location.index)
        owner = type_of(location.object, Scope(self._types))
        fill = zero(owner.element) if isinstance(owner, Array) else None
        most = owner.length if isinstance(owner, Array) else None
        least = most or 0 if isinstance(owner, Array) and owner.fixed else 0
        is_column = (
            isinstance(owner, Array) and isinstance(location, Member) and location.name != "length"
        )

        may_fail = not _always_has_place(location, owner)
        question = f"has a place {expression_text(location)}"
        sets_length = isinstance(owner, Array) and isinstance(location.object, Variable)
        sets_length = sets_length and isinstance(location, Member) and location.name == "length"

        def change_something(step: Step, place: Any) -> None:
            """It is not known which part it is, nor perhaps whether ``place`` is there.

            The variable is another unknown then: what was sent before tells nothing of it.
            """
            if may_fail and not step.whether(question, place):
                raise ecmascript.ExecutionError("a place that may not be there")
            step.data[root] = anything()

        def assign_part(step: Step) -> None:
            made = new(step)
            if step.data[root].__class__ is Unknown:
                if sets_length and made.__class__ is int:
                    ecmascript.set_member([], "length", made, fill, most, least)
                    step.data[root] = _of_length(made, owner)
                    return
                change_something(step, step.data[root])
                return
            # values are shared between hypotheses: change a copy
            step.data[root] = copy.deepcopy(step.data[root])
            target = holder(step)
            if target.__class__ is Unknown:
                change_something(step, target)
                return
            if is_column and (made.__class__ is Unknown or Unknown in map(type, target)):
                change_something(step, target)
                return
            if isinstance(location, Member):
                if location.name == "length" and made.__class__ is Unknown:
                    change_something(step, made)
                    return
                ecmascript.set_member(target, location.name, made, fill, most, least)
                return
            assert index is not None
            place = index(step)
            if place.__class__ is Unknown:
                change_something(step, place)
                return
            ecmascript.set_element(target, place, made, fill, most)

        return assign_part

    def _emit(self, emit: Emit, closures: Closures) -> Action:
        structure = output_data_type(emit.kind, emit.interface, self._owner, self._library)
        ports = {port.key: port.type for port in self._machine.ports if port.output}
        write = _message_writer(structure, emit, closures, ports.get(emit.interface))
        goal = None if emit.goal_id is None else closures.value(emit.goal_id, INT64)
        thread = None if emit.thread_id is None else closures.value(emit.thread_id, INT64)
        kind, interface, position = emit.kind, emit.interface, emit.position
        own = kind is OutputKind.PUBLISH and self._takes_itself(interface)

        queued = kind in QUEUED_OUTPUTS

        def run(step: Step) -> None:
            message = write(step)
            if own:
                taken = copy.deepcopy(message)
                step.scheduled.append(Delayed((EventKind.MESSAGE, interface), 0.0, taken, ""))
            output = Output(
                kind,
                interface,
                message,
                None if goal is None else goal(step),
                None if thread is None else thread(step),
                position,
                step.transition or position,
            )
            step.outputs.append(output)
            if queued:
                step.scheduled.append(output)

        return run

    def _takes_itself(self, interface: str) -> bool:
        """Whether the machine takes what it publishes on ``interface`` from its own queue."""
        found = self._owner.interface(interface, InterfaceKind.SUBSCRIBER)
        return found is not None and found.own

    def _raise(self, statement: Raise, closures: Closures) -> Action:
        fields = [(field.name, closures.value(field.value, ANY)) for field in statement.fields]
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
            delay_s: Any = fixed  # or between which it is
            if delay_s is None and delay is not None:
                delay_s = _seconds(delay(step))
            step.scheduled.append(
                Delayed((EventKind.INTERNAL, name), delay_s, data(step), identifier)
            )

        return send


def _nothing(step: Step) -> None:
    """What content without a statement does."""


def _of_length(count: int, kind: DataType) -> Any:
    """An array of ``count`` elements of which nothing is known."""
    if count > FEW or not isinstance(kind, Array):
        return anything()
    return [unknown_of(kind.element) for _ in range(count)]


def _always_has_place(location: Member | Index, owner: DataType) -> bool:
    """Whether assigning to ``location``, a part of a value of type ``owner``, cannot fail."""
    if isinstance(owner, Structure):
        return isinstance(location.object, Variable | Member)
    if not isinstance(owner, Array) or isinstance(location, Member):
        return False
    match location.index:
        case Member(object=inner, name="length"):
            return owner.length is None and expression_text(inner) == expression_text(
                location.object
            )
        case Literal(value=int() as place):
            return place >= 0 and (owner.length is None or place < owner.length)
        case _:
            return False


def _message_writer(
    structure: Structure | None, emit: Emit, closures: Closures, port: DataType | None
) -> Callable[[Step], Any]:
    """A closure that makes the message of an output, with zero values where no field is set."""
    if structure is None:
        if not emit.fields:
            return lambda step: None
        if emit.kind is OutputKind.BT_RETURN_STATUS:
            status = closures.status(emit.fields[0].value)
            return lambda step: {"status": status(step)}
        values = [(field.name, closures.value(field.value, port)) for field in emit.fields]
        return lambda step: {name: value(step) for name, value in values}
    template = zero(structure)
    nested = any(not isinstance(item, bool | int | float | str) for item in template.values())
    writes: list[tuple[tuple[str, ...], Callable[[Step], Any], DataType]] = []
    for field in emit.fields:
        path = tuple(field.name.split("."))
        holder_of: DataType = structure
        kind: DataType | None = structure
        for name in path:
            holder_of, kind = kind or ANY, part(kind or ANY, name)
        writes.append((path, closures.value(field.value, kind), holder_of))
    if not nested:
        flat = [(path[0], value) for path, value, _ in writes]

        def write(step: Step) -> Any:
            message = template.copy()
            for name, value in flat:
                message[name] = value(step)
            return message

        return write

    def write_nested(step: Step) -> Any:
        message = copy.deepcopy(template)
        for path, value, kind in writes:
            around, holder = message, message
            for name in path[:-1]:
                around, holder = holder, holder[name]
            made = value(step)
            if not isinstance(kind, Array):
                holder[path[-1]] = made
            elif made.__class__ is Unknown or holder.__class__ is Unknown:
                around[path[-2]] = anything()
            else:
                ecmascript.set_member(holder, path[-1], made, zero(kind.element), kind.length)
        return message

    return write_nested


def _evaluate_only(value: Callable[[Step], Any], step: Step) -> None:
    value(step)


def _seconds(value: Any) -> Any:
    """Seconds of a ``delayexpr`` (see ``m2c.language.durations.seconds``)."""
    if value.__class__ is not Unknown:
        return seconds(value)
    return value if value.anything else Unknown(value.low / 1000, value.high / 1000)


# --- live variables -------------------------------------------------------------------------------


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
    ports = readable_ports(machine)
    assigns: list[Assign] = []
    for statement, parts in _statements(machine, library, owner or machine):
        certainty = Certainty(Scope(types, parts, ports, machine.lenient))
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
            case Foreach(array=array):
                live.update((*variables_of(array), *assigned_by(statement)))
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
    yield from ((statement, {}) for statement in flat(machine.on_start))


def _cannot_fail(
    location: Expression, value: Expression, types: Mapping[str, DataType], certainty: Certainty
) -> bool:
    if not isinstance(location, Variable):
        return False
    target = types.get(location.name)
    if target is None or certainty.may_throw(value):
        return False
    return certainty.fit(value, target) is not Fit.MAY_FAIL
