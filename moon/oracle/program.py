"""A machine as a program: one run to completion of it, interpreted.

The generated code is compiled from the same ``Machine``; this is the other implementation of its
semantics (W3C SCXML 3.13 and appendix D, flat machines). Choices that the model leaves open are followed
one after the other: a step is taken again for each of their outcomes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from m2c.language.datatypes import BOOL, STRING, DataType, Structure, is_integer
from m2c.language.expressions import Literal, ObjectLiteral
from m2c.language.macrostep import ERROR_EXECUTION, MAX_STEPS, matches
from m2c.language.typing import Scope
from m2c.language.values import zero
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    ActionThread,
    Emit,
    EventKind,
    InterfaceKind,
    Machine,
    OutputKind,
    Raise,
)
from m2c.model.scopes import event_parts, interface_kind_of, readable_ports
from m2c.model.walk import assigned_by, chooses, draws, failure_of_goals, statements_of
from moon.oracle.compiling import (
    Action,
    Compiler,
    StateProgram,
    TransitionProgram,
    holds,
    live_variables,
)
from moon.oracle.expressions import Closures
from moon.oracle.steps import Delayed, Step, TooOpenError
from moon.oracle.trace_events import EventKey
from moon.oracle.unknowns import Unknown, frozen, unknown_of, unknowns_in
from transports.bounded import BoundedDict

MAX_OUTCOMES = 256
"""So many outcomes of one step are followed; a step with more is too open to be checked."""

MAX_LENGTH = 4 * MAX_STEPS
"""So many transitions without an event, and internal events, are followed in all outcomes of one step."""

LONG_STEP = 50
"""A step with more transitions without an event, and internal events, takes longer than to look for one that
began alike.
"""

KEPT_STEPS = 64
"""Steps whose outcome is remembered, for each machine."""


_OF_ACTION = ("/_action/send_goal", "/_action/cancel_goal", "/_action/get_result")
_SERVICES = {
    InterfaceKind.SERVER: ("",),
    InterfaceKind.CLIENT: ("",),
    InterfaceKind.ACTION_SERVER: _OF_ACTION,
    InterfaceKind.ACTION_CLIENT: _OF_ACTION,
}
"""The services of an interface, each by what follows its channel."""


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
        self.live = live_variables(machine, library, self._owner)
        """Variables that make a difference to what is seen; others are left as they begin."""
        self._exact, self._begin = self._compiled(symbolic=False)
        self.states = self._exact
        self._made_symbolic: tuple[list[StateProgram], Action | None] | None = None
        self._known = frozenset(event for state in self.states for event in state.by_event)
        self.looks_again = any(state.looks_again for state in self.states)
        """Whether an event that no transition takes may make a difference."""
        self.draws = draws(machine)
        """Whether values are drawn at random."""
        self._repeatable = self._events_of_plain_values()
        self._steps: BoundedDict[Any, tuple[tuple[bool, Step]]] = BoundedDict(KEPT_STEPS)
        """Outcomes of steps taken before; nobody changes a step that was taken."""
        self._long: set[tuple[int, EventKey]] = set()
        """Of these states and events a step was long: their outcomes are remembered by all that is known."""
        self._long_steps: BoundedDict[Any, tuple[list[Unknown], list[tuple[bool, Step]]]]
        self._long_steps = BoundedDict(KEPT_STEPS)
        """The same of long steps, with the unknown values that the step began with."""
        self.chooses = chooses(machine)
        """Whether a transition leads to one of several states."""
        self.handles_errors = any(
            matches(ERROR_EXECUTION, prefix)
            for state in self.states
            for prefix, _ in state.internal
        )
        """Whether a condition that fails may lead to something."""
        self.assigned = frozenset(
            name for item in statements_of(machine) for name in assigned_by(item)
        )
        """Variables that change."""

    def _compiled(self, symbolic: bool) -> tuple[list[StateProgram], Action | None]:
        compiler = Compiler(self.machine, self._library, self._owner, self.live, symbolic)
        return compiler.states(), compiler.begin()

    @property
    def _symbolic(self) -> tuple[list[StateProgram], Action | None]:
        """The states for steps with unknown values, made when the first such step is taken."""
        made = self._made_symbolic
        if made is None:  # mypyc knows no functools.cached_property: it would be made for each step
            made = self._made_symbolic = self._compiled(symbolic=True)
        return made

    def initial_data(self) -> tuple[Any, ...]:
        """The datamodel before the first step."""
        made: list[Any] = []
        step = Step(self.initial, (), None, {}, [])
        ports = readable_ports(self.machine)
        scope = Scope(self._types, {}, ports, self.machine.lenient)
        closures = Closures(self.variables, scope, True)
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
            unknown_of(self._types[name]) if name in self.assigned and name in self.live else value
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
        if self._long and (state, event) in self._long:
            return self._long_outcomes(state, data, message, parts, event, symbolic)
        if symbolic or self.chooses:
            return self._outcomes(state, data, message, parts, event, symbolic)
        if parts or event not in self._repeatable:
            step = Step(state, data, message, parts, None)
            taken = self._deliver(step, self._exact, event)
            if step.length > LONG_STEP:
                self._long.add((state, event))
            return ((taken, step),)
        key = (state, data, event, tuple(message.items()) if message else ())
        known = self._steps.get(key)
        if known is None:
            step = Step(state, data, message, parts, None)
            known = self._steps[key] = ((self._deliver(step, self._exact, event), step),)
        return known

    def _long_outcomes(
        self,
        state: int,
        data: tuple[Any, ...],
        message: Any,
        parts: Mapping[str, Any],
        event: EventKey,
        symbolic: bool,
    ) -> Iterable[tuple[bool, Step]]:
        """As ``_outcomes``: what was taken before is not taken again with other unknown values.

        No two steps share an unknown value that they did not begin with: a step may draw it, or calculate
        it from values that differ.
        """
        began: dict[int, Unknown] = {}
        unknowns_in((data, message, parts), began)
        place = (state, event, symbolic, frozen((data, message, parts), {}))
        known = self._long_steps.get(place)
        if known is None:
            outcomes = list(self._outcomes(state, data, message, parts, event, symbolic))
            self._long_steps[place] = (list(began.values()), outcomes)
            return outcomes
        before, outcomes = known
        if not symbolic:
            return outcomes
        found = {id(old): (old, new) for old, new in zip(before, began.values(), strict=True)}
        return [(taken, step.renamed(found)) for taken, step in outcomes]

    def _is_known(self, event: EventKey) -> bool:
        """Whether the machine gets ``event``: what no state waits for does not reach it."""
        return event in self._known or event[0] is EventKind.INTERNAL

    def events_in(self, state: int) -> Collection[EventKey]:
        """The events from others that may do something in ``state``."""
        program = self.states[state]
        return self._known if program.looks_again else program.by_event.keys()

    def handles(self, state: int, event: EventKey) -> bool:
        """Whether ``event`` may do something in ``state``."""
        program = self.states[state]
        if event in program.by_event or (program.looks_again and self._is_known(event)):
            return True
        if event[0] is not EventKind.INTERNAL:
            return False
        return any(matches(event[1], prefix) for prefix, _ in program.internal)

    def _outcomes(
        self,
        state: int,
        data: tuple[Any, ...],
        message: Any,
        parts: Mapping[str, Any],
        event: EventKey | None,
        symbolic: bool,
    ) -> Iterator[tuple[bool, Step]]:
        states, begin = self._symbolic if symbolic else (self._exact, self._begin)
        tape: list[list[int]] = []
        length = 0
        for _ in range(MAX_OUTCOMES):
            step = Step(state, data, message, parts, tape)
            if event is None:
                taken = True
                if begin is not None:
                    begin(step)
                self._enter(step, states, state)
                self._complete_macrostep(step, states)
            else:
                taken = self._deliver(step, states, event)
                if step.length > LONG_STEP:
                    self._long.add((state, event))
            yield taken, step
            while tape and tape[-1][0] + 1 == tape[-1][1]:
                tape.pop()
            if not tape:
                return
            tape[-1][0] += 1
            length += step.length
            if length > MAX_LENGTH:
                break
        raise TooOpenError(
            f"{self.machine.name}: a step in state {states[state].name} has more than "
            f"{MAX_OUTCOMES} outcomes, or too long ones"
        )

    def _deliver(self, step: Step, states: list[StateProgram], event: EventKey) -> bool:
        program = states[step.state]
        if event[0] is EventKind.INTERNAL:
            found = [t for prefix, t in program.internal if matches(event[1], prefix)]
        else:
            found = program.by_event.get(event, [])
        if self._follow_first(step, states, found):
            self._complete_macrostep(step, states)
            return True
        if step.internal or (program.looks_again and self._is_known(event)):
            self._complete_macrostep(step, states)  # a condition failed, or may hold now
        return False

    def _follow(
        self, step: Step, states: list[StateProgram], transition: TransitionProgram
    ) -> None:
        step.transition = transition.position
        step.tested.clear()
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

    def _complete_macrostep(self, step: Step, states: list[StateProgram]) -> None:
        asked, waiting = -1, 0
        for _ in range(MAX_STEPS):
            step.length += 1
            if self._follow_first(step, states, states[step.state].eventless):
                asked = -1
                continue
            if not step.internal:
                return
            name, data = step.internal.popleft()
            step.message, step.parts = data, {"name": name}
            found = [t for prefix, t in states[step.state].internal if matches(name, prefix)]
            taken = self._follow_first(step, states, found)
            if taken or data is not None or name != ERROR_EXECUTION:
                asked = -1
                continue
            if step.asked == asked and len(step.internal) >= waiting and _is_failing(step):
                return  # conditions that fail, and are tested again as they failed: an endless loop
            asked, waiting = step.asked, len(step.internal)

    def _follow_first(
        self, step: Step, states: list[StateProgram], transitions: list[TransitionProgram]
    ) -> bool:
        """Take the first of ``transitions`` that is enabled; whether there is one."""
        for transition in transitions:
            if transition.condition is None or holds(step, transition.condition):
                self._follow(step, states, transition)
                return True
        return False

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


def _is_failing(step: Step) -> bool:
    """Whether nothing but what failed waits to be processed."""
    return all(event == (ERROR_EXECUTION, None) for event in step.internal)


def _is_plain(kind: DataType) -> bool:
    return kind in (BOOL, STRING) or is_integer(kind)


def _fixed_delay(sent: Raise) -> float | None:
    """How long after it was sent an event comes (s); None: that is computed."""
    if sent.delay_s is None:
        return 0.0
    value = sent.delay_s.value if isinstance(sent.delay_s, Literal) else None
    return float(value) if isinstance(value, int | float) else None


_MACHINE_ALONE = (0,)


class Program:
    """A machine and its action threads, ready to be stepped, and what is known of them beforehand.

    Args:
        machine: the model.
        library: its message types.

    Attributes:
        parts: the machine, then each of its action threads; a place in it is called an *instance*.
        threads: of each part after the first: its declaration, and which of its threads it is.
        draws: whether values are drawn at random.
        certain: whether a step of the machine has one outcome, where all values are known.
        call_failures: the events that a call failed which make a difference to what is seen.
        goal_failures: of each action of which it sends goals: the event that a goal failed, likewise.
        periodic: the periodic timers that matter: instance, event, period (ns).
        sent_to_itself: events that the machine sends itself, at once or with a delay, those that it publishes
            among them, and its threads' starts
            and ends: (instance, event, the send's id, whether it has data), and the longest delay (s), None
            where that is not known. What has no delay has no id: it cannot be cancelled.
    """

    def __init__(self, machine: Machine, library: InterfaceLibrary) -> None:
        self.machine = machine
        self.library = library
        main = MachineProgram(machine, library)
        self.parts = [main]
        self.threads: list[tuple[ActionThread, int]] = []
        for thread in machine.threads:
            program = MachineProgram(thread.machine, library, machine)
            for number in range(thread.count):
                self.parts.append(program)
                self.threads.append((thread, number))
        self.draws = any(program.draws for program in self.parts)
        self.certain = not self.draws and not main.chooses
        self._effective = {
            event
            for program in self.parts
            for state in program.states
            for event, transitions in state.by_event.items()
            if any(t.body is not None or t.targets for t in transitions)
            or program.looks_again
            or (program.handles_errors and any(t.condition is not None for t in transitions))
        }
        self.call_failures = [
            event for event in self._effective if event[0] is EventKind.CALL_ERROR
        ]
        self.goal_failures = {
            interface.name: failure
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.ACTION_CLIENT
            and (failure := (failure_of_goals(machine, interface.name), interface.name))
            in self._effective
        }
        takers: dict[EventKey, list[int]] = {}
        for instance, program in enumerate(self.parts[1:], 1):
            for event in {event for state in program.states for event in state.by_event}:
                if event[0] in (EventKind.MESSAGE, EventKind.CANCEL):
                    takers.setdefault(event, [0]).append(instance)
        self._takers = takers
        rates = {
            interface.name: round(1e9 / interface.rate_hz)
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.TIMER and interface.rate_hz > 0
        }
        self.periodic = [
            (instance, (EventKind.TIMER, name), period)
            for instance, program in enumerate(self.parts)
            for name, period in rates.items()
            if any(name in state.timers for state in program.states)
        ]
        self.sent_to_itself = list(self._sends().items())
        self._channels: dict[tuple[InterfaceKind | None, str], str | None] = {
            (interface.kind, interface.name): interface.channel for interface in machine.interfaces
        }

    def _sends(self) -> dict[tuple[int, EventKey, str, bool], float | None]:
        """The events that instances send themselves, and their longest delay (s); None: it is not known."""
        found: dict[tuple[int, EventKey, str, bool], float | None] = {}
        own = {item.name for item in self.machine.interfaces if item.own}
        for instance, program in enumerate(self.parts):
            for item in statements_of(program.machine):
                if isinstance(item, Emit):
                    found.update(dict.fromkeys(self._of_threads(item), 0.0))
                    if item.kind is OutputKind.PUBLISH and item.interface in own:
                        found[instance, (EventKind.MESSAGE, item.interface), "", True] = 0.0
                if not isinstance(item, Raise) or not item.external:
                    continue
                event, delay_s = (EventKind.INTERNAL, item.event), _fixed_delay(item)
                if not delay_s:  # it is on the queue then, and cannot be cancelled
                    found.setdefault((instance, event, "", bool(item.fields)), 0.0)
                if delay_s == 0:
                    continue
                place = (instance, event, item.id, bool(item.fields))
                longest = found.get(place, 0.0)
                is_known = longest is not None and delay_s is not None
                found[place] = max(longest or 0.0, delay_s or 0.0) if is_known else None
        return found

    def _of_threads(self, emit: Emit) -> list[tuple[int, EventKey, str, bool]]:
        """What ``emit`` puts on the queue, if it starts or frees a thread: as ``sent_to_itself`` has it."""
        name = emit.interface
        if emit.kind is OutputKind.THREAD_FREE:
            return [(0, (EventKind.THREAD_FREE, name), "", False)]
        if emit.kind is not OutputKind.START_THREAD:
            return []
        started = (
            instance
            for instance, (thread, _) in enumerate(self.threads, 1)
            if thread.interface == name
        )
        return [(instance, (EventKind.THREAD_START, name), "", True) for instance in started]

    def unknown_data(self) -> list[tuple[Any, ...]]:
        """The datamodel of each part when nothing is known of what happened."""
        return [program.unknown_data() for program in self.parts]

    def takers_of(self, event: EventKey) -> Sequence[int]:
        """The instances that take a message or a cancel request: the machine, then its threads that have
        a handler.
        """
        return self._takers.get(event, _MACHINE_ALONE)

    def instances_of(self, interface: str, number: int) -> list[int]:
        """The instances that are thread ``number`` of an action thread of ``interface``."""
        return [
            instance
            for instance, (thread, which) in enumerate(self.threads, 1)
            if thread.interface == interface and which == number
        ]

    def changes_something(self, event: EventKey | None) -> bool:
        """Whether ``event`` can make a difference to what is seen, in any state."""
        return event in self._effective

    def services(self) -> list[str]:
        """Channels on which the machine calls or is called, those of its actions included."""
        return [
            interface.channel + part
            for interface in self.machine.interfaces
            for part in _SERVICES.get(interface.kind, ())
            if interface.channel
        ]

    def taken_topics(self) -> dict[str, EventKind]:
        """Channels of others whose messages can make a difference to what is seen, and as which input."""
        found: dict[str, EventKind] = {}
        for kind, ending, event in (
            (InterfaceKind.SUBSCRIBER, "", EventKind.MESSAGE),
            (InterfaceKind.ACTION_CLIENT, "/_action/feedback", EventKind.FEEDBACK),
        ):
            for interface in self.machine.interfaces:
                channel = interface.channel
                if (
                    interface.kind is kind
                    and not interface.own
                    and channel
                    and self.changes_something((event, interface.name))
                ):
                    found[channel + ending] = event
        return found

    def declared_channel(self, kind: OutputKind, interface: str) -> str | None:
        """The channel by which an output leaves; None: it is only known at run time."""
        return self._channels.get((interface_kind_of(kind), interface))

    def channel_of_output(self, kind: OutputKind, interface: str) -> str:
        """The same for messages to people: the interface's name where the channel is not known."""
        return self.declared_channel(kind, interface) or interface
