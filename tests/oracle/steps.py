"""A machine, run one input at a time, all of its choices followed: the reference's small steps.

Written from W3C SCXML (3.13, appendix D) and docs/language.md and docs/values.md, with expressions by
``m2c.language.evaluate``; it shares nothing else with the generated code or with the oracle.
"""

from __future__ import annotations

import copy
import itertools
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import msgspec

from m2c.language import ecmascript
from m2c.language.datatypes import DataType
from m2c.language.evaluate import evaluate
from m2c.language.expressions import (
    ArrayFrom,
    ArrayLiteral,
    Binary,
    Conditional,
    Expression,
    Index,
    Literal,
    Logical,
    MathCall,
    Member,
    ObjectLiteral,
    Parameter,
    Unary,
    Variable,
)
from m2c.language.values import convert
from m2c.model.machine import (
    Assign,
    Block,
    Cancel,
    Delay,
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
    Transition,
)
from m2c.model.walk import delays_of, draws, rewritten

MAX_STEPS = 1000
"""Eventless transitions and internal events in one macrostep before it is an endless loop."""

SENT_BY = {
    OutputKind.PUBLISH: InterfaceKind.PUBLISHER,
    OutputKind.REQUEST: InterfaceKind.CLIENT,
    OutputKind.RESPONSE: InterfaceKind.SERVER,
}


class UnsupportedError(ValueError):
    """The model uses something that the reference does not know (actions, behaviour trees)."""


class EndlessLoopError(Exception):
    """The machine never becomes stable."""


class Call(msgspec.Struct, frozen=True):
    """Who asked: the caller and the number of its call."""

    client: str = ""
    number: int = 0


class Output(msgspec.Struct, frozen=True):
    """Something that the machine sends; ``call`` says which request a response answers."""

    kind: OutputKind
    channel: str
    data: dict[str, Any]
    call: Call | None = None


Moment = tuple[int, int]
"""Something happens at one moment between these times (ns)."""


class Timer(msgspec.Struct, frozen=True):
    """What comes later: a delayed transition's event, or one that the machine sent itself.

    Attributes:
        event: which.
        data: of one that was sent.
        id: by which that is cancelled.
        number: among those of a configuration.
        began: when its delay began.
        delay_ns: how long that is.
    """

    event: Event
    data: Any
    id: str
    number: int
    began: Moment
    delay_ns: int


class Configuration(msgspec.Struct, frozen=True):
    """A stable machine: its state, its data, the unanswered requests of each service, and what comes later."""

    state: str
    data: dict[str, Any]
    waiting: dict[str, tuple[Call, ...]]
    timers: tuple[Timer, ...] = ()


Outcome = tuple[Configuration, tuple[Output, ...]]


class Stepper:
    """Runs one machine.

    Raises:
        UnsupportedError: the machine has something that the reference does not know.
    """

    def __init__(self, machine: Machine) -> None:
        if machine.threads or machine.ports:
            raise UnsupportedError("action threads and behaviour-tree ports")
        self.machine = machine
        self.states = {state.name: state for state in machine.states}
        self.types = {data.name: data.type for data in machine.data}
        self.random_values = random_values(machine)

    def start(self, now: Moment = (0, 0)) -> list[Outcome]:
        """What entering the initial state can lead to, between the two times of ``now``."""
        return _outcomes(lambda choose: _Macrostep(self, None, choose, now).start())

    def take(
        self,
        before: Configuration,
        event: Event,
        data: Any,
        call: Call | None = None,
        now: Moment = (0, 0),
    ) -> list[Outcome]:
        """What taking ``event`` can lead to: an outcome for every way chance can go.

        It is taken between the two times of ``now``.
        """
        return _outcomes(
            lambda choose: _Macrostep(self, before, choose, now).take(event, data, call)
        )

    def ring(self, before: Configuration, timer: Timer, now: Moment) -> list[Outcome]:
        """What ``timer`` of ``before`` can lead to."""
        timers = tuple(item for item in before.timers if item is not timer)
        without = msgspec.structs.replace(before, timers=timers)
        return self.take(without, timer.event, timer.data, None, now)


# -- chance -----------------------------------------------------------------------------------

Choose = Callable[[int], int]


class _UndecidedError(Exception):
    def __init__(self, options: int) -> None:
        super().__init__(options)
        self.options = options


def _outcomes(run: Callable[[Choose], Outcome]) -> list[Outcome]:
    """Run again and again, once for every sequence of choices that it can be asked for."""
    found: dict[str, Outcome] = {}
    scripts: list[tuple[int, ...]] = [()]
    while scripts:
        script = scripts.pop()
        remaining = deque(script)

        def choose(options: int, remaining: deque[int] = remaining) -> int:
            if not remaining:
                raise _UndecidedError(options)
            return remaining.popleft()

        try:
            outcome = run(choose)
            found[repr(outcome)] = outcome
        except _UndecidedError as undecided:
            scripts += [(*script, option) for option in range(undecided.options)]
    return list(found.values())


def random_values(machine: Machine) -> tuple[float, ...]:
    """Values of ``Math.random()`` on either side of, and at, every number that the model has.

    That is every outcome, where the drawn number is only compared with numbers, or multiplied by a
    whole one and rounded.
    """
    if not draws(machine):
        return ()
    marks = {0.0, 1.0}
    for number in _numbers(machine):
        if 0 < number < 1:
            marks.add(float(number))
        if float(number).is_integer() and 1 < number <= 8:
            marks |= {k / number for k in range(1, int(number))}
    ordered = sorted(marks)
    between = [(low + high) / 2 for low, high in itertools.pairwise(ordered)]
    return tuple(sorted({*ordered[:-1], *between}))


def _numbers(value: Any) -> Iterator[float]:
    match value:
        case Literal(value=number):
            if isinstance(number, int | float) and not isinstance(number, bool):
                yield number
        case msgspec.Struct():
            for name in value.__struct_fields__:
                yield from _numbers(getattr(value, name))
        case tuple():
            for item in value:
                yield from _numbers(item)


def _indexed(expression: Expression, depth: int, index: int) -> Expression:
    """``expression`` for one ``index`` of an ``Array.from`` inside ``depth`` others."""

    def number(node: Expression) -> Expression:
        known = isinstance(node, Parameter) and node.depth == depth
        return Literal(value=index) if known else node

    return rewritten(expression, number)


def _drawn(
    expression: Expression,
    values: tuple[float, ...],
    choose: Choose,
    evaluated: Callable[[Expression], Any],
) -> Expression:
    """``expression`` with a chosen value in place of each ``Math.random()``, elements written out."""

    def inside(inner: Expression) -> Expression:
        return _drawn(inner, values, choose, evaluated)

    replace = msgspec.structs.replace
    match expression:
        case MathCall(function="random"):
            return Literal(value=values[choose(len(values))])
        case MathCall():
            return replace(expression, arguments=tuple(map(inside, expression.arguments)))
        case Member():
            return replace(expression, object=inside(expression.object))
        case Index():
            inner = inside(expression.object)
            return replace(expression, object=inner, index=inside(expression.index))
        case Unary():
            return replace(expression, operand=inside(expression.operand))
        case Binary() | Logical():
            left = inside(expression.left)
            return replace(expression, left=left, right=inside(expression.right))
        case Conditional():
            return replace(
                expression,
                test=inside(expression.test),
                then=inside(expression.then),
                otherwise=inside(expression.otherwise),
            )
        case ArrayLiteral():
            return replace(expression, elements=tuple(map(inside, expression.elements)))
        case ArrayFrom(item=item, depth=depth):
            count = ecmascript.to_length(evaluated(inside(expression.length)), expression.most)
            items = (inside(_indexed(item, depth, index)) for index in range(count))
            return ArrayLiteral(elements=tuple(items))
        case ObjectLiteral():
            entries = tuple((key, inside(value)) for key, value in expression.entries)
            return replace(expression, entries=entries)
        case _:
            return expression


# -- one macrostep ----------------------------------------------------------------------------


class _Macrostep:
    """One run to completion."""

    def __init__(
        self, stepper: Stepper, before: Configuration | None, choose: Choose, now: Moment
    ) -> None:
        self._now = now
        self._machine = stepper.machine
        self._states = stepper.states
        self._types = stepper.types
        self._values = stepper.random_values
        self._choose = choose
        self._event: dict[str, Any] = {}
        self._internal: deque[tuple[str, Any]] = deque()
        self._sent: list[Output] = []
        self._current: tuple[str, Call] | None = None
        if before is None:
            self._state = self._machine.initial
            self._data: dict[str, Any] = {}
            self._waiting: dict[str, list[Call]] = {}
            self._timers: list[Timer] = []
            for data in self._machine.data:
                self._data[data.name] = self._converted(self._value(data.initial), data.type)
        else:
            self._state = before.state
            self._data = copy.deepcopy(before.data)
            self._waiting = {name: list(calls) for name, calls in before.waiting.items()}
            self._timers = list(before.timers)

    def start(self) -> Outcome:
        """Enter the initial state, and first the compound states around it."""
        self._block(self._machine.on_start)
        self._enter(self._states[self._state])
        self._settle()
        return self._outcome()

    def take(self, event: Event, data: Any, call: Call | None) -> Outcome:
        """Take one external event; it is discarded if no transition of the state takes it."""
        self._event = {"data": data}
        if event.kind is EventKind.REQUEST:
            call = call or Call()
            self._waiting.setdefault(event.name, []).append(call)
            self._current = (event.name, call)
        if event.kind is EventKind.INTERNAL:
            self._event["name"] = event.name
            taken = self._run(partial(_is_internal, event.name))
        else:
            taken = self._run(lambda transition: transition.event == event)
        self._settle()
        if (
            not taken
            and event.kind is EventKind.REQUEST
            and call in self._waiting.get(event.name, ())
        ):
            self._waiting[event.name].remove(call)
        return self._outcome()

    def _outcome(self) -> Outcome:
        waiting = {name: tuple(calls) for name, calls in self._waiting.items() if calls}
        left = Configuration(self._state, self._data, waiting, tuple(self._timers))
        return left, tuple(self._sent)

    def _settle(self) -> None:
        """Eventless transitions first, then internal events, until there is nothing left to do."""
        for _ in range(MAX_STEPS):
            self._event = {}
            if self._run(lambda transition: transition.event is None):
                continue
            if not self._internal:
                return
            name, data = self._internal.popleft()
            self._event = {"data": data, "name": name}
            self._run(partial(_is_internal, name))
        raise EndlessLoopError(self._state)

    def _run(self, triggered: Callable[[Transition], bool]) -> bool:
        """Run the first enabled transition of the state, in document order."""
        for transition in self._states[self._state].transitions:
            if triggered(transition) and self._holds(transition.cond):
                self._follow(transition)
                return True
        return False

    def _follow(self, transition: Transition) -> None:
        if transition.targets:
            state = self._states[self._state]
            self._block(state.on_exit)
            for name in delays_of(state):
                self._later(Event(EventKind.AFTER, name), None)
        self._block(transition.body)
        if transition.targets:
            possible = [
                target
                for target in transition.targets
                if target.probability is None or target.probability > 0
            ]
            target = possible[self._choose(len(possible))] if len(possible) > 1 else possible[0]
            self._block(target.body)
            self._state = target.state
            self._enter(self._states[target.state])

    def _enter(self, state: State) -> None:
        self._block(state.on_entry)
        for name, delay_s in delays_of(state).items():
            self._later(Event(EventKind.AFTER, name), delay_s)

    def _later(self, event: Event, delay_s: float | None, data: Any = None, name: str = "") -> None:
        """``event`` comes after ``delay_s``; what delays a transition has one such event, None: none."""
        if event.kind is EventKind.AFTER:
            self._timers = [item for item in self._timers if item.event != event]
        if delay_s is None:
            return
        number = 1 + max((item.number for item in self._timers), default=0)
        self._timers.append(Timer(event, data, name, number, self._now, round(delay_s * 1e9)))

    # -- executable content -------------------------------------------------------------------

    def _block(self, statements: tuple[Statement, ...]) -> None:
        """An error ends the block and becomes an internal event (W3C SCXML 3.12.2, 4.9)."""
        try:
            for statement in statements:
                self._execute(statement)
        except ecmascript.ExecutionError:
            self._internal.append(("error.execution", None))

    def _execute(self, statement: Statement) -> None:
        match statement:
            case Assign(location=location, value=value):
                self._assign(location, copy.deepcopy(self._value(value)))
            case If(branches=branches):
                for test, body in branches:
                    if self._holds(test):
                        for inner in body:
                            self._execute(inner)
                        return
            case Foreach(array=array, item=item, index=index, body=body):
                for place, value in enumerate(ecmascript.elements(self._value(array))):
                    self._data[item] = self._converted(copy.deepcopy(value), self._types[item])
                    if index:
                        self._data[index] = self._converted(place, self._types[index])
                    for inner in body:
                        self._execute(inner)
            case Block(body=body):
                self._block(body)
            case Log(value=value):
                if value is not None:
                    self._value(value)
            case Raise(external=False, event=event, fields=fields):
                data = {field.name: self._value(field.value) for field in fields} or None
                self._internal.append((event, copy.deepcopy(data)))
            case Raise(event=event, fields=fields, delay_s=delay, id=name) if delay is not None:
                data = {field.name: self._value(field.value) for field in fields} or None
                delay_s = self._value(delay)
                if delay_s <= 0:
                    raise UnsupportedError("events that a machine sends itself at once")
                sent = Event(EventKind.INTERNAL, event)
                self._later(sent, delay_s, copy.deepcopy(data), name)
            case Cancel(id=name):
                self._timers = [item for item in self._timers if item.id != name]
            case Delay(name=name, after_s=delay_s):
                self._later(Event(EventKind.AFTER, name), delay_s)
            case Emit():
                self._emit(statement)
            case _:
                raise UnsupportedError(type(statement).__name__)

    def _assign(self, location: Expression, value: Any) -> None:
        match location:
            case Variable(name=name):
                self._data[name] = self._converted(value, self._types[name])
            case Member(object=inner, name=name):
                ecmascript.set_member(self._value(inner), name, value)
            case Index(object=inner, index=index):
                ecmascript.set_element(self._value(inner), self._value(index), value, 0)

    def _emit(self, emit: Emit) -> None:
        if emit.kind not in SENT_BY:
            raise UnsupportedError(str(emit.kind))
        interface = self._machine.interface(emit.interface, SENT_BY[emit.kind])
        assert interface is not None
        data: dict[str, Any] = {}
        for field in emit.fields:
            *path, last = field.name.split(".")
            inner = data
            for part in path:
                inner = inner.setdefault(part, {})
            inner[last] = copy.deepcopy(self._value(field.value))
        call = None
        if emit.kind is OutputKind.RESPONSE:
            call = self._answered(emit.interface)
            if call is None:
                return  # nobody waits for an answer: nothing is sent
        self._sent.append(Output(emit.kind, interface.channel or "", data, call))

    def _answered(self, service: str) -> Call | None:
        """The request being processed, else the oldest unanswered one (decision 2)."""
        waiting = self._waiting.get(service, [])
        if not waiting:
            return None
        call = waiting[0]
        if self._current is not None and self._current[0] == service:
            call = self._current[1] if self._current[1] in waiting else call
        waiting.remove(call)
        return call

    # -- expressions --------------------------------------------------------------------------

    def _value(self, expression: Expression) -> Any:
        if self._values:
            expression = _drawn(
                expression,
                self._values,
                self._choose,
                lambda inner: evaluate(inner, self._data, self._event),
            )
        return evaluate(expression, self._data, self._event)

    def _holds(self, condition: Expression | None) -> bool:
        if condition is None:
            return True
        try:
            return ecmascript.truthy(self._value(condition))
        except ecmascript.ExecutionError:
            self._internal.append(("error.execution", None))
            return False

    def _converted(self, value: Any, kind: DataType) -> Any:
        return convert(value, kind)


def _is_internal(name: str, transition: Transition) -> bool:
    event = transition.event
    if event is None or event.kind is not EventKind.INTERNAL:
        return False
    descriptor = event.name.removesuffix("*").removesuffix(".")
    return not descriptor or name == descriptor or name.startswith(f"{descriptor}.")
