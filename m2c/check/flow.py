"""Flow: states nobody reaches, requests nobody answers, transitions that never run."""

from __future__ import annotations

from collections.abc import Iterator

from m2c.model.diagnostics import DiagnosticLog
from m2c.model.expressions import Literal
from m2c.model.machine import (
    Emit,
    Event,
    EventKind,
    If,
    Interface,
    InterfaceKind,
    Machine,
    State,
    Statement,
    Transition,
)
from m2c.model.scopes import interface_kind_of

_INPUTS = {
    InterfaceKind.SUBSCRIBER: (EventKind.MESSAGE, "its messages are never read"),
    InterfaceKind.SERVER: (EventKind.REQUEST, "its requests are never answered"),
    InterfaceKind.TIMER: (EventKind.TIMER, "its callbacks are never handled"),
    InterfaceKind.ACTION_SERVER: (EventKind.GOAL, "its goals are never handled"),
}


def check_flow(machine: Machine, log: DiagnosticLog) -> None:
    """Warn of what a machine can never do.

    Rules: ``unreachable-state``, ``request-discarded``, ``shadowed-transition``,
    ``eventless-cycle``, ``unread-input``, ``unused-interface``.
    """
    reachable = _reachable(machine)
    for state in machine.states:
        if state.name not in reachable:
            what = f"state `{state.name}` cannot be reached from `{machine.initial}`"
            log.warning("unreachable-state", state.position, "state", what)
        else:
            _check_requests(machine, state, log)
        _check_shadowing(state, log)
    _check_eventless_cycles(machine, log)
    _check_interfaces(machine, log)
    for thread in machine.threads:
        check_flow_of_thread(thread.machine, log)


def check_flow_of_thread(machine: Machine, log: DiagnosticLog) -> None:
    """The same for an action thread, whose interfaces belong to the machine around it."""
    reachable = _reachable(machine)
    for state in machine.states:
        if state.name not in reachable:
            what = f"state `{state.name}` cannot be reached from `{machine.initial}`"
            log.warning("unreachable-state", state.position, "state", what)
        _check_shadowing(state, log)
    _check_eventless_cycles(machine, log)


def _reachable(machine: Machine) -> set[str]:
    states = {state.name: state for state in machine.states}
    found: set[str] = set()
    pending = [machine.initial]
    while pending:
        name = pending.pop()
        if name in found or name not in states:
            continue
        found.add(name)
        for transition in states[name].transitions:
            pending += [target.state for target in transition.targets]
    return found


def _always(transition: Transition) -> bool:
    cond = transition.cond
    return cond is None or (isinstance(cond, Literal) and cond.value is True)


def _is_transient(state: State) -> bool:
    """Whether the machine never waits in ``state``: an eventless transition always leaves it."""
    return any(item.event is None and _always(item) for item in state.transitions)


def _check_requests(machine: Machine, state: State, log: DiagnosticLog) -> None:
    if _is_transient(state):
        return
    taken = {item.event for item in state.transitions}
    for interface in machine.interfaces:
        if interface.kind is not InterfaceKind.SERVER:
            continue
        event = Event(EventKind.REQUEST, interface.name)
        if event not in taken and any(
            item.event == event for other in machine.states for item in other.transitions
        ):
            log.warning(
                "request-discarded",
                state.position,
                "state",
                f"state `{state.name}` discards a request to {interface.channel}: its caller would "
                "never be answered",
                "add <ros_service_handle_request> to the state",
            )


def _check_shadowing(state: State, log: DiagnosticLog) -> None:
    certain: dict[Event | None, Transition] = {}
    for transition in state.transitions:
        earlier = certain.get(transition.event)
        if earlier is not None:
            log.warning(
                "shadowed-transition",
                transition.position,
                transition.element,
                f"never taken: the transition at {earlier.position.line}:{earlier.position.column} "
                "takes the same event and has no condition",
                "put it before that one, or give that one a condition",
            )
        elif _always(transition):
            certain[transition.event] = transition


def _check_eventless_cycles(machine: Machine, log: DiagnosticLog) -> None:
    """A cycle of unconditional eventless transitions never ends."""
    following: dict[str, Transition] = {}
    for state in machine.states:
        for transition in state.transitions:
            if transition.event is None and _always(transition):
                following[state.name] = transition
                break
    reported: set[str] = set()
    for start in following:
        path: list[str] = []
        name = start
        while name in following and name not in path:
            path.append(name)
            targets = following[name].targets
            name = targets[0].state if len(targets) == 1 else ("" if targets else name)
        if name in path and name not in reported:
            cycle = path[path.index(name) :]
            reported.update(cycle)
            names = " -> ".join([*cycle, cycle[0]])
            log.warning(
                "eventless-cycle",
                following[name].position,
                following[name].element,
                f"endless eventless transitions: {names}",
                "wait for an event, or add a condition",
            )


def _check_interfaces(machine: Machine, log: DiagnosticLog) -> None:
    used: set[tuple[InterfaceKind | None, str]] = set()
    events: set[Event] = set()
    owners = [machine, *(thread.machine for thread in machine.threads)]
    for owner in owners:
        for state in owner.states:
            for transition in state.transitions:
                if transition.event is not None:
                    events.add(transition.event)
                    used.add((interface_kind_of(transition.event.kind), transition.event.name))
                    if transition.event.kind is EventKind.TIMER:
                        used.add((InterfaceKind.TIMER, transition.event.name))
            for statement in _statements(state):
                if isinstance(statement, Emit):
                    used.add((interface_kind_of(statement.kind), statement.interface))
    used |= {(InterfaceKind.ACTION_SERVER, thread.interface) for thread in machine.threads}
    for interface in machine.interfaces:
        if (interface.kind, interface.name) not in used:
            shown = interface.channel or interface.name
            what = f"the {interface.kind} {shown} is declared and never used"
            hint = "use it, or remove the declaration"
            if interface.kind in _INPUTS:
                _warn_unread(interface, log)
            else:
                log.warning("unused-interface", interface.position, "", what, hint)
        elif interface.kind in _INPUTS:
            kind, _ = _INPUTS[interface.kind]
            if Event(kind, interface.name) not in events:
                _warn_unread(interface, log)
        elif (
            interface.kind is InterfaceKind.CLIENT
            and Event(EventKind.RESPONSE, interface.name) not in events
        ):
            what = f"the client {interface.channel}: its responses are never read"
            log.warning("unread-input", interface.position, "", what)


def _warn_unread(interface: Interface, log: DiagnosticLog) -> None:
    reason = _INPUTS[interface.kind][1]
    shown = interface.channel or interface.name
    what = f"the {interface.kind} {shown}: {reason}"
    log.warning(
        "unread-input", interface.position, "", what, "handle it, or remove the declaration"
    )


def _statements(state: State) -> Iterator[Statement]:
    def flatten(statements: tuple[Statement, ...]) -> Iterator[Statement]:
        for statement in statements:
            yield statement
            if isinstance(statement, If):
                for _, body in statement.branches:
                    yield from flatten(body)

    yield from flatten(state.on_entry)
    yield from flatten(state.on_exit)
    for transition in state.transitions:
        yield from flatten(transition.body)
        for target in transition.targets:
            yield from flatten(target.body)
