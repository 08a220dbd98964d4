"""What a monitor observes of a machine, and which parts of it cannot be checked, and why."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import msgspec

from m2c.diagnostics import Position
from m2c.model.machine import (
    Cancel,
    Emit,
    Event,
    EventKind,
    InterfaceKind,
    Log,
    Machine,
    OutputKind,
    Raise,
    State,
    Statement,
    Transition,
)
from m2c.model.scopes import interface_kind_of
from m2c.model.walk import assigned_by, with_inner, with_threads
from moon.explain.contents import (
    all_statements,
    draws,
    effects,
    expressions,
    variables_read,
)
from moon.oracle.bounds import Bounds

_MAX_STATES = 4
"""States that are named of those in a compound one."""
OWN = "its node, when it takes it"
OTHERS = "its publisher; taken within the latency bound of that"

_INPUTS = {
    InterfaceKind.SUBSCRIBER: ((EventKind.MESSAGE, "message", OTHERS),),
    InterfaceKind.SERVER: ((EventKind.REQUEST, "request", OWN),),
    InterfaceKind.CLIENT: (
        (EventKind.RESPONSE, "response", OWN),
        (EventKind.CALL_ERROR, "failed call", OWN),
    ),
    InterfaceKind.ACTION_SERVER: (
        (EventKind.GOAL, "goal", OWN),
        (EventKind.CANCEL, "cancel request", OWN),
    ),
    InterfaceKind.ACTION_CLIENT: (
        (EventKind.GOAL_ACCEPTED, "acceptance", OWN),
        (EventKind.GOAL_REJECTED, "rejection", OWN),
        (EventKind.FEEDBACK, "feedback", OTHERS),
        (EventKind.SUCCEEDED, "success", OWN),
        (EventKind.ABORTED, "abortion", OWN),
        (EventKind.CANCELED, "cancellation", OWN),
        (EventKind.GOAL_FAILED, "failed goal", OWN),
    ),
}
_OUTPUTS = {
    OutputKind.PUBLISH: "message",
    OutputKind.REQUEST: "request",
    OutputKind.RESPONSE: "response",
    OutputKind.SEND_GOAL: "goal",
    OutputKind.SEND_CANCEL: "cancel request",
    OutputKind.ACCEPT_GOAL: "acceptance",
    OutputKind.REJECT_GOAL: "rejection",
    OutputKind.FEEDBACK: "feedback",
    OutputKind.SUCCEED: "success",
    OutputKind.ABORT: "abortion",
    OutputKind.CANCEL: "cancellation",
}
_INSIDE = {
    OutputKind.BT_RETURN_STATUS: "the status goes to the behaviour tree, inside the policy's process",
    OutputKind.BT_RETURN_HALTED: "the answer goes to the behaviour tree, inside the policy's process",
    OutputKind.BT_SET_OUTPUT: "the port is on the tree's blackboard, inside the policy's process",
    OutputKind.BT_TICK_CHILD: "children are ticked inside the policy's process",
    OutputKind.BT_HALT_CHILD: "children are halted inside the policy's process",
    OutputKind.START_THREAD: "threads are started inside the node",
    OutputKind.THREAD_FREE: "threads report this to their machine inside the node",
}


class Input(msgspec.Struct, frozen=True):
    """Something that the machine takes.

    Attributes:
        what: message, request, response, failed call, goal…
        channel: where it is received.
        type_name: the channel's type.
        stamped_by: whose stamp says when it was taken.
        taken: whether any transition takes it; what none takes is discarded, and that is checked.
    """

    what: str
    channel: str
    type_name: str
    stamped_by: str
    taken: bool


class Output(msgspec.Struct, frozen=True):
    """Something that the machine sends.

    Attributes:
        what: message, request, response, goal…
        channel: where it is received.
        type_name: the channel's type.
        deadline_s: how long it may take from the step that owes it.
        places: ``file:line:column`` of the elements that send it; without any it may never come.
    """

    what: str
    channel: str
    type_name: str
    deadline_s: float
    places: tuple[str, ...]


class Timer(msgspec.Struct, frozen=True):
    """An input that nobody publishes: time itself.

    Attributes:
        what: ``rate``, ``after`` or ``delayed event``.
        name: the timer's, the state's or the event's.
        period_s: between two of it, or until it comes; None if an expression says it.
        tolerance_s: how much later it may come.
        place: where the model has it.
    """

    what: str
    name: str
    period_s: float | None
    tolerance_s: float
    place: str


class Unchecked(msgspec.Struct, frozen=True):
    """A part of the model that no observation can contradict at once.

    Attributes:
        what: the part.
        why: what hides it.
        place: ``file:line:column``.
    """

    what: str
    why: str
    place: str


class Observables(msgspec.Struct, frozen=True):
    """All that is observed of one machine.

    Attributes:
        machine: its name; also its node's.
        file: its model.
        monitored: whether it runs on a node of its own; plugins run in the policy's process.
        transitions: how many it has, those of its action threads included.
        inputs, outputs, timers: what is observed.
        unchecked: what is not, or only by what the machine does later.
    """

    machine: str
    file: str
    monitored: bool
    transitions: int
    inputs: tuple[Input, ...]
    outputs: tuple[Output, ...]
    timers: tuple[Timer, ...]
    unchecked: tuple[Unchecked, ...]


def observables(machine: Machine, plugin: bool = False) -> Observables:
    """What a monitor observes of ``machine`` with the bounds that it has by default."""
    bounds, parts = Bounds(), with_threads(machine)
    unchecked = [*_whole(machine, plugin), *_nameless(machine)]
    for part in parts:
        unchecked += _hidden_transitions(part)
    unchecked += _inside(all_statements(machine))
    return Observables(
        machine.name,
        machine.position.file,
        not plugin,
        sum(len(state.transitions) for part in parts for state in with_inner(part.written)),
        tuple(_inputs(machine, parts)),
        tuple(_outputs(machine, bounds)),
        tuple(dict.fromkeys(_timers(parts, bounds))),
        tuple(dict.fromkeys(unchecked)),
    )


def _inputs(machine: Machine, parts: Sequence[Machine]) -> Iterator[Input]:
    taken = {
        (transition.event.kind, transition.event.name)
        for part in parts
        for state in part.states
        for transition in state.transitions
        if transition.event is not None
    }
    for interface in machine.interfaces:
        if interface.channel is None or interface.own:
            continue
        for kind, what, stamped_by in _INPUTS.get(interface.kind, ()):
            is_taken = (kind, interface.name) in taken
            if is_taken or kind in (EventKind.MESSAGE, EventKind.REQUEST, EventKind.GOAL):
                yield Input(what, interface.channel, interface.type_name, stamped_by, is_taken)


def _outputs(machine: Machine, bounds: Bounds) -> Iterator[Output]:
    places: dict[tuple[OutputKind, str], list[str]] = {}
    for statement in all_statements(machine):
        if isinstance(statement, Emit) and statement.kind in _OUTPUTS:
            found = places.setdefault((statement.kind, statement.interface), [])
            found.append(str(statement.position))
    for interface in machine.interfaces:
        if interface.channel is None:
            continue
        for kind, what in _OUTPUTS.items():
            sent = places.get((kind, interface.name), [])
            usual = kind in (OutputKind.PUBLISH, OutputKind.REQUEST, OutputKind.RESPONSE)
            if interface_kind_of(kind) is interface.kind and (sent or usual):
                yield Output(
                    what,
                    interface.channel,
                    interface.type_name,
                    bounds.deadline / 1e9,
                    tuple(dict.fromkeys(sent)),
                )


def _timers(parts: Sequence[Machine], bounds: Bounds) -> Iterator[Timer]:
    tolerance_s = bounds.latency / 1e9
    for interface in parts[0].interfaces:
        if interface.kind is InterfaceKind.TIMER and interface.rate_hz > 0:
            period_s = 1 / interface.rate_hz
            place = str(interface.position)
            yield Timer("rate", interface.name, period_s, tolerance_s, place)
    for part in parts:
        for state in part.states:
            for transition in state.transitions:
                if transition.after_s is not None:
                    place = str(transition.position)
                    name = transition.of or state.name
                    yield Timer("after", name, transition.after_s, tolerance_s, place)
    for statement in all_statements(parts[0]):
        if isinstance(statement, Raise) and statement.delay_s is not None:
            delay = getattr(statement.delay_s, "value", None)
            known = float(delay) if isinstance(delay, int | float) else None
            place = str(statement.position)
            yield Timer("delayed event", statement.event, known, tolerance_s, place)


def _whole(machine: Machine, plugin: bool) -> Iterator[Unchecked]:
    if plugin:
        yield Unchecked(
            "the whole plugin",
            "it runs inside the policy's process, on the policy's node; what it sends and gets there "
            "is not distinguished from what the rest of the policy does",
            str(machine.position),
        )


def _nameless(machine: Machine) -> Iterator[Unchecked]:
    for interface in machine.interfaces:
        if interface.channel is None:
            yield Unchecked(
                f"{interface.kind.noun} {interface.name}",
                f"its channel is the value of port `{interface.port}`, known only at run time"
                if interface.port
                else "its channel is known only at run time",
                str(interface.position),
            )


def _hidden_transitions(machine: Machine) -> Iterator[Unchecked]:
    """The transitions that send nothing which leaves the process, or that leave a choice open.

    One of a compound state is told once: of all states in it, or of those in which it is so.
    """
    copies: dict[tuple[Position, Event | None], dict[str, list[Transition]]] = {}
    states = {state.name: state for state in machine.states}
    for state in machine.states:
        for item in state.transitions:
            found = copies.setdefault((item.position, item.event), {})
            found.setdefault(state.name, []).append(item)
    read = variables_read(machine)
    for (_, event), taken_in in sorted(copies.items(), key=lambda item: item[0][0]):
        told: dict[tuple[str, Position], list[str]] = {}
        for name, same in taken_in.items():
            for reason in dict.fromkeys(_whys(machine, states[name], same, read)):
                told.setdefault(reason, []).append(name)
        first, (one, *_) = next(iter(taken_in.items()))
        what = f"{one.of or first}: {_trigger(event, one.after_s)}"
        for (why, place), names in told.items():
            yield Unchecked(what + _where(names, len(taken_in)), why, str(place))


def _where(states: list[str], count: int) -> str:
    """In which of the ``count`` states that have a transition something holds; "" if in all."""
    if len(states) == count:
        return ""
    if len(states) > _MAX_STATES:
        return f" in {len(states)} of {count} states"
    return f" in {', '.join(states)}"


def _whys(
    machine: Machine, state: State, same: list[Transition], read: set[str]
) -> Iterator[tuple[str, Position]]:
    """What no observation contradicts of a transition of ``state``, and where that stands.

    ``same`` has the transition, once for each state that a history may remember.
    """
    nameless = {i.name for i in machine.interfaces if i.channel is None}
    silent = []
    for transition in same:
        run = effects(machine, state, transition)
        sent = [s for s in run if isinstance(s, Emit) and s.kind in _OUTPUTS]
        if not sent:
            silent.append((transition, run))
        elif all(output.interface in nameless for output in sent):
            why = "all that it sends goes to channels known only at run time"
            yield why, transition.position
    if silent:
        yield _only_inside(state, silent, read), same[0].position
    for transition in same:
        if any(target.probability is not None for target in transition.targets):
            names = " or ".join(target.state for target in transition.targets)
            yield f"its target is chosen at random: {names} are both right", transition.position
        if transition.cond is not None and draws(transition.cond):
            why = "its condition is random: taken and not taken are both right"
            yield why, transition.position
        for statement in effects(machine, state, transition):
            if any(draws(value) for value in expressions(statement)):
                why = "a value is drawn at random: any that can be drawn is right"
                yield why, statement.position


def _only_inside(
    state: State, silent: list[tuple[Transition, list[Statement]]], read: set[str]
) -> str:
    """Why transitions with what they run cannot be seen, and by what they show later."""
    shows = []
    run = [statement for _, statements in silent for statement in statements]
    targets = {target.state for transition, _ in silent for target in transition.targets}
    others = targets - {state.name}
    if others:
        names = " or ".join(sorted(others))
        become = names if len(others) <= _MAX_STATES else f"one of {len(others)} states"
        shows.append(f"the state becomes {become}")
    every = {name for item in run for name in assigned_by(item)}
    written = every & read
    if written:
        shows.append(f"{', '.join(sorted(written))} {'is' if len(written) == 1 else 'are'} set")
    events = {s.event for s in run if isinstance(s, Raise)}
    if events:
        shows.append(f"{', '.join(sorted(events))} is sent to itself")
    if any(isinstance(s, Cancel) for s in run):
        shows.append("a delayed event is cancelled")
    inner = [s for s in run if isinstance(s, Emit) and s.kind in _INSIDE]
    if inner:
        shows.append("what it sends stays inside the process")
    if not shows and every:
        return f"it sets only {', '.join(sorted(every))}, which nothing reads"
    if not shows:
        only = "it only logs" if any(isinstance(s, Log) for s in run) else "it does nothing"
        return f"{only}: whether it is taken makes no difference that can be observed"
    return f"nothing leaves the process ({'; '.join(shows)}): it shows in what is sent later"


def _inside(statements: Iterable[Statement]) -> Iterator[Unchecked]:
    for statement in statements:
        if isinstance(statement, Emit) and statement.kind in _INSIDE:
            name = str(statement.kind).replace("_", " ").replace("bt ", "")
            yield Unchecked(name, _INSIDE[statement.kind], str(statement.position))
        elif isinstance(statement, Log):
            what = f"log {statement.label}".rstrip()
            yield Unchecked(what, "logs are not observed", str(statement.position))


def _trigger(event: Event | None, after_s: float | None) -> str:
    if event is None:
        return "eventless transition"
    if after_s is not None:
        return f"after {after_s:g} s"
    kind = str(event.kind).replace("_", " ").replace("bt ", "tree's ")
    return f"{kind} {event.name}".rstrip()
