"""A machine, lowered to the facts of its class: which transition an event takes, what states do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence, Set

from m2c.codegen import program
from m2c.codegen.context import MachineContext
from m2c.codegen.expressions import ExpressionCompiler
from m2c.codegen.ports import Port
from m2c.codegen.source import Source, name, quoted
from m2c.codegen.statements import ON_ELAPSED, StatementLowering, call
from m2c.language.datatypes import Array, DataType, Primitive, Structure, is_integer
from m2c.language.expressions import ObjectLiteral, PortInput, nodes
from m2c.language.macrostep import ERROR_EXECUTION, prefix_of
from m2c.model.machine import Event, EventKind, Raise, State, Target, Transition
from m2c.model.scopes import event_parts
from m2c.model.walk import (
    chooses,
    delays_of,
    draws,
    events_of,
    expressions_of,
    looks_again,
    statements_of,
)


def machine_program(context: MachineContext) -> program.MachineProgram:
    """The facts of one machine (or of one that executes goals).

    It has a queue of internal events if it raises some, or waits for ``error.execution`` and may fail.
    """
    statements = statements_of(context.machine)
    raises = any(isinstance(item, Raise) and not item.external for item in statements)
    waits = any(event.kind is EventKind.INTERNAL for event in events_of(context.machine))
    if raises or waits:
        found = _MachineLowering(context, takes_internal=True).facts()
        if raises or "fault" in found.sends:
            return found
    return _MachineLowering(context, takes_internal=False).facts()


class _MachineLowering:
    """Lowers one machine; ``takes_internal``: it has a queue of internal events."""

    def __init__(self, context: MachineContext, takes_internal: bool) -> None:
        self._context = context
        self._machine = context.machine
        self._takes_internal = takes_internal
        self._statements = StatementLowering(context)
        self._events = events_of(context.machine)

    def facts(self) -> program.MachineProgram:
        """All of it."""
        machine, context = self._machine, self._context
        states = tuple(self._state(state) for state in machine.states)
        initial = machine.state(machine.initial)
        start = self._start(initial)
        methods = tuple(self._methods())
        eventless = tuple(self._eventless())
        named = any(method.name == _ON_EVENT for method in methods)
        variables = tuple(self._variables())
        uses_random = draws(machine) or chooses(machine)
        uses_ports = any(
            isinstance(part, PortInput)
            for whole in expressions_of(machine)
            for part in nodes(whole)
        )
        slots = {
            "thread_id": context.is_thread,
            "_random": uses_random,
            "_ports": uses_ports,
            "_internal": self._takes_internal,
            **{str(variable.attribute): not variable.constant for variable in variables},
        }
        sends = frozenset(self._statements.sends)
        return program.MachineProgram(
            name=machine.name,
            class_name=name(context.class_name),
            state_class=context.state_class,
            is_thread=context.is_thread,
            initial=next(state for state in states if state.name == machine.initial),
            start=(*start, *self._complete(initial)),
            states=states,
            blocks=tuple(self._statements.named.values()),
            variables=variables,
            slots=tuple(sorted(["_outputs", "state", *(slot for slot in slots if slots[slot])])),
            methods=methods,
            eventless=eventless,
            takes_internal=self._takes_internal,
            takes_named=bool(sends & {"send_self", "cancel_send"}) and not named,
            uses_random=uses_random,
            uses_ports=uses_ports,
            sends=sends,
            tests_may_fail=self._statements.tests_may_fail,
            looks_again=any(map(looks_again, machine.states)),
        )

    def _start(self, initial: State) -> tuple[program.Statement, ...]:
        around = self._statements.block(
            self._machine.on_start, self._context.compiler({}), self._machine.position
        )
        return (*around, *(self._go(initial) if _enters(initial) else ()))

    def _variables(self) -> Iterator[program.Variable]:
        compiler = self._context.compiler({})
        for data in self._machine.data:
            value = compiler.value(data.initial, data.type)
            if isinstance(data.initial, ObjectLiteral) and not data.initial.entries:
                value = compiler.zero(data.type)
            yield program.Variable(
                data.name,
                self._context.attribute(data.name),
                Source(self._annotation(data.type)),
                Source(value),
                data.name in self._context.constants,
            )

    def _annotation(self, kind: DataType) -> str:
        match kind:
            case Primitive("bool"):
                return "bool"
            case Primitive("string"):
                return "str"
            case Primitive("any") | Primitive("null"):
                return "Any"
            case Primitive() if is_integer(kind):
                return "int"
            case Primitive("number"):
                return "int | float"
            case Primitive():
                return "float"
            case Structure(structure) if structure:
                return self._context.class_of[structure]
            case Array(element, _, _):
                return f"list[{self._annotation(element)}]"
            case _:
                return "dict[str, Any]"

    # -- states -------------------------------------------------------------------------------

    def _state(self, state: State) -> program.StateProgram:
        compiler = self._context.compiler({})
        entry: list[program.Statement] = [self._is_in(state)]
        leaving = list(self._statements.block(state.on_exit, compiler, state.position))
        for delay, delay_s in delays_of(state).items():
            event = quoted(delay)
            entry.append(self._statements.sent("start_delay", event, repr(delay_s), ON_ELAPSED))
            leaving.append(self._statements.sent("stop_delay", event, ON_ELAPSED))
        entry += self._statements.block(state.on_entry, compiler, state.position)
        if state.final:
            said = quoted("the machine has reached its final state")
            entry.append(self._statements.sent("log", quoted(""), said))
        return program.StateProgram(
            name=state.name,
            constant=self._context.state_constant(state.name),
            method=self._context.state_method(state.name),
            entry=tuple(entry) if _enters(state) else (),
            exit=tuple(leaving),
        )

    def _is_in(self, state: State) -> program.Statement:
        return program.Assign(Source("self.state"), self._context.state_text(state.name))

    def _go(self, state: State) -> tuple[program.Statement, ...]:
        """What enters ``state``."""
        if _enters(state):
            return (call(f"self._enter_{self._context.state_method(state.name)}"),)
        return (self._is_in(state),)

    def _complete(self, state: State) -> tuple[program.Statement, ...]:
        """What follows the arrival in ``state``, if something may be enabled there."""
        eventless = any(transition.event is None for transition in state.transitions)
        return (_COMPLETE,) if eventless or self._takes_internal else ()

    # -- events -------------------------------------------------------------------------------

    def _methods(self) -> Iterator[program.EventMethod]:
        grouped: dict[str, list[tuple[Event, Port]]] = {}
        for event in self._events:
            port = self._context.names.event(event)
            grouped.setdefault(port.method, []).append((event, port))
        for method, found in grouped.items():
            event, port = found[0]
            if self._takes_internal and event.kind is EventKind.INTERNAL:
                continue
            reports = event.kind in _REPORT_WHETHER_TAKEN or (
                self._context.is_stepwise and event.kind in _WAIT_UNTIL_TAKEN
            )
            parameters = [(name(item), Source(kind)) for item, kind in port.parameters]
            if port.data is not None:
                data = name(self._context.class_of[port.data.name])
                parameters.insert(0, (name(port.data_name), data))
            yield program.EventMethod(
                name(method),
                tuple(parameters),
                port.doc,
                reports,
                tuple(self._branches([item for item, _ in found], port, reports)),
            )
        if self._takes_internal:
            yield self._named_events(grouped.get(_ON_EVENT, []))

    def _named_events(self, found: Sequence[tuple[Event, Port]]) -> program.EventMethod:
        """What takes an event by its name: within a macrostep, which who calls it completes."""
        branches = (
            program.StateBranch(branch.states, body)
            for branch in (
                self._branches([event for event, _ in found], found[0][1], True) if found else ()
            )
            if (body := _within_macrostep(branch.body))
        )
        return program.EventMethod(
            name("_take_event"),
            ((name("name"), Source("str")), (name("data"), Source("Any"))),
            Source("Take an event by its name, within a macrostep."),
            True,
            tuple(branches),
        )

    def _branches(
        self, events: Sequence[Event], port: Port, reports: bool
    ) -> Iterator[program.StateBranch]:
        """What each state does on any of ``events``: the first enabled transition is taken.

        States that do the same share a branch.
        """
        done = program.Done("taken" if reports else "return")
        branches: dict[tuple[program.Statement, ...], list[Source]] = {}
        for state in self._machine.states:
            found = [item for item in state.transitions if item.event in events]
            body = tuple(self._taken_first(state, found, port, done))
            if not body or body[-1] is not done:
                after = self._discarded(state, found, port)
                body = (*body, *after, *((_DISCARDED,) if after and reports else ()))
            if body:
                branches.setdefault(body, []).append(self._context.state_text(state.name))
        if not reports:
            branches.pop((done,), None)  # what is taken and does nothing needs no code
        for body, states in branches.items():
            yield program.StateBranch(tuple(states), body if reports else _without_last_done(body))

    def _discarded(
        self, state: State, transitions: Sequence[Transition], port: Port
    ) -> tuple[program.Statement, ...]:
        """What follows where none of ``transitions`` is taken.

        Eventless transitions are tested again; a condition that failed is an internal event.
        """
        complete = _COMPLETE if self._context.is_stepwise else _COMPLETE_DISCARDED
        if looks_again(state):
            return (complete,)
        may_fail = any(self._test_may_fail(transition, port) for transition in transitions)
        if not self._takes_internal or not may_fail:
            return ()
        return (program.If((program.Branch(Source("self._internal"), (complete,)),)),)

    def _test_may_fail(self, transition: Transition, port: Port) -> bool:
        compiler = self._compiler(transition, port)
        return transition.cond is not None and self._statements.may_fail(transition.cond, compiler)

    def _compiler(self, transition: Transition, port: Port | None) -> ExpressionCompiler:
        parts = event_parts(transition.event, self._machine, self._context.library)
        data_name = port.data_name if port is not None and port.data is not None else "data"
        return self._context.compiler(parts, data_name)

    def _eventless(self) -> Iterator[program.StateBranch]:
        for state in self._machine.states:
            found = [item for item in state.transitions if item.event is None]
            done = program.Done("taken" if self._context.is_stepwise else "again")
            body = self._taken_first(state, found, None, done)
            if found:
                yield program.StateBranch(
                    (self._context.state_text(state.name),), _within_macrostep(body)
                )

    def _taken_first(
        self,
        state: State,
        transitions: Sequence[Transition],
        port: Port | None,
        done: program.Done,
    ) -> list[program.Statement]:
        """What tests and takes ``transitions``, up to the first that is always enabled."""
        body: list[program.Statement] = []
        for transition in transitions:
            tested = self._transition(state, transition, port, done)
            body += tested
            if tested[-1] is done:
                break
        return body

    def _transition(
        self, state: State, transition: Transition, port: Port | None, done: program.Done
    ) -> list[program.Statement]:
        """What tests and takes ``transition``; ends in ``done`` where that is always enabled."""
        compiler = self._compiler(transition, port)
        tests: list[str] = []
        if transition.event is not None and transition.event.kind in _BY_NAME:
            test = _event_test(transition.event, self._sent_names())
            tests += [test] if test else []
        if transition.cond is not None:
            within = "and" if tests else ""
            tests.append(self._statements.condition(transition.cond, compiler, within))
        body = [*self._taken(state, transition, compiler), done]
        if not tests:
            return body
        return [program.If((program.Branch(Source(" and ".join(tests)), tuple(body)),))]

    def _taken(
        self, state: State, transition: Transition, compiler: ExpressionCompiler
    ) -> list[program.Statement]:
        taken: list[program.Statement] = []
        if transition.targets and _exits(state):
            taken.append(call(f"self._exit_{self._context.state_method(state.name)}"))
        taken += self._statements.block(transition.body, compiler, transition.position)
        if not transition.targets:
            return [*taken, *self._complete(state)]
        arrivals = [
            self._arrive(state, target, transition, compiler) for target in transition.targets
        ]
        if len(arrivals) == 1:
            return [*taken, *arrivals[0]]
        bound = 0.0
        branches = []
        for target, arrival in zip(transition.targets, arrivals, strict=True):
            bound += target.probability or 0.0
            test = Source(f"draw < {round(bound, 12)!r}")
            branches.append(program.Branch(test, tuple(arrival)))
        branches[-1] = program.Branch(None, branches[-1].body)
        return [*taken, program.Choice(tuple(branches))]

    def _arrive(
        self, source: State, target: Target, transition: Transition, compiler: ExpressionCompiler
    ) -> list[program.Statement]:
        state = self._machine.state(target.state)
        body = self._statements.block(target.body, compiler, transition.position)
        stays = source.name == state.name and not _enters(state)
        return [*body, *(() if stays else self._go(state)), *self._complete(state)]

    def _sent_names(self) -> Set[str]:
        """Names of the events that the machine can send to itself, errors included."""
        sent = {item.event for item in statements_of(self._machine) if isinstance(item, Raise)}
        return sent | {ERROR_EXECUTION}


_COMPLETE = call("self._complete_macrostep")
_COMPLETE_DISCARDED = call("self._complete_macrostep", "taken=False")
_DISCARDED = program.Done("discarded")
_ON_EVENT = "on_event"
_BY_NAME = frozenset({EventKind.INTERNAL, EventKind.AFTER})
"""Events that one method takes, all of them; which it is, is tested."""


def _enters(state: State) -> bool:
    return bool(state.on_entry or state.final or delays_of(state))


def _exits(state: State) -> bool:
    return bool(state.on_exit or delays_of(state))


def _event_test(event: Event, names: Set[str]) -> str:
    """The condition under which one of the events ``names`` is ``event``; "" where each of them is."""
    if event.kind is EventKind.AFTER:
        return f"delay == {quoted(event.name)}"
    prefix = prefix_of(event.name)
    if not prefix:
        return ""
    longer = any(other.startswith(f"{prefix}.") for other in names)
    return f"matches(name, {quoted(prefix)})" if longer else f"name == {quoted(prefix)}"


def _without_last_done(body: tuple[program.Statement, ...]) -> tuple[program.Statement, ...]:
    """``body`` without each ``Done`` behind which nothing would run anyway."""
    if not body:
        return body
    *first, last = body
    match last:
        case program.Done():
            return tuple(first)
        case program.If(branches):
            shorter = (
                program.Branch(branch.test, _without_last_done(branch.body)) for branch in branches
            )
            return (*first, program.If(tuple(shorter)))
        case _:
            return body


def _within_macrostep(body: Iterable[program.Statement]) -> tuple[program.Statement, ...]:
    """``body`` of an eventless transition, or of an internal event: who takes it completes the macrostep."""
    kept: list[program.Statement] = []
    for item in body:
        if isinstance(item, program.If | program.Choice):
            inner = [program.Branch(one.test, _within_macrostep(one.body)) for one in item.branches]
            if any(one.body for one in item.branches) and not any(one.body for one in inner):
                continue  # it completes a macrostep, and does nothing else
            kept.append(type(item)(tuple(inner)))
        elif item not in (_COMPLETE, _COMPLETE_DISCARDED, _DISCARDED):
            kept.append(item)
    return tuple(kept)


_REPORT_WHETHER_TAKEN = frozenset(
    {
        *(EventKind.REQUEST, EventKind.GOAL, EventKind.CALL_ERROR, EventKind.GOAL_FAILED),
        *(EventKind.BT_HALT, EventKind.BT_CHILD_STATUS, EventKind.BT_CHILD_HALTED),
    }
)
"""Events whose sender waits for something: the node must know of one that is discarded."""

_WAIT_UNTIL_TAKEN = frozenset(
    {
        *(EventKind.RESPONSE, EventKind.GOAL_ACCEPTED, EventKind.GOAL_REJECTED),
        *(EventKind.SUCCEEDED, EventKind.ABORTED, EventKind.CANCELED),
        *(EventKind.THREAD_START, EventKind.THREAD_FREE, EventKind.BT_TICK),
    }
)
"""What waits besides, in a run in which such events wait until a state takes them."""
