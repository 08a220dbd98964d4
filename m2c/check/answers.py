"""Requests that nobody would ever answer: discarded by a state, or taken and forgotten."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from m2c.check.paths import (
    leaving_at_once,
    open_branches,
    possible_targets,
    reachable,
    statements_of,
    takable,
)
from m2c.model.diagnostics import DiagnosticLog
from m2c.model.machine import (
    Emit,
    Event,
    EventKind,
    If,
    InterfaceKind,
    Machine,
    OutputKind,
    State,
    Statement,
    Transition,
)
from m2c.model.scopes import interface_kind_of

_ENDS = {OutputKind.SUCCEED, OutputKind.ABORT, OutputKind.CANCEL}
_DECISIONS = {OutputKind.ACCEPT_GOAL, OutputKind.REJECT_GOAL}


class _Duty(msgspec.Struct, frozen=True):
    """What taking an event obliges a machine to send, and what to say if it never does."""

    event: EventKind
    outputs: frozenset[OutputKind]
    what: str
    hint: str


_DUTIES = (
    _Duty(
        EventKind.GOAL,
        frozenset(_DECISIONS | _ENDS),
        "takes a goal of {channel} that no path ever accepts or rejects: its client would wait for "
        "ever",
        "add <ros_action_accept_goal> or <ros_action_reject_goal>",
    ),
    _Duty(
        EventKind.BT_TICK,
        frozenset({OutputKind.BT_RETURN_STATUS}),
        "takes a tick that no path ever answers: the tree would wait in vain",
        "add <bt_return_status>",
    ),
    _Duty(
        EventKind.BT_HALT,
        frozenset({OutputKind.BT_RETURN_HALTED}),
        "takes a halt that no path ever answers: the tree would wait in vain",
        "add <bt_return_halted>",
    ),
)


def check_answers(machine: Machine, log: DiagnosticLog) -> None:
    """Warn of requests, goals and ticks whose sender would never hear of them again.

    Rules: ``request-discarded`` (a state in which nothing takes a request that others take) and
    ``request-unanswered`` (a request is taken, and no path from there has an answer to it). A path
    is any sequence of transitions that can be taken, so that every warning is a certainty.
    """
    names = reachable(machine)
    states = [state for state in machine.states if state.name in names]
    for state in states:
        _check_discarded(machine, states, state, log)
        for transition in takable(state):
            if transition.event is not None:
                _check_answered(machine, state, transition, log)


def _check_discarded(
    machine: Machine, states: list[State], state: State, log: DiagnosticLog
) -> None:
    if leaving_at_once(state) is not None:
        return
    taken = {item.event for item in takable(state)}
    for interface in machine.interfaces:
        event = Event(EventKind.REQUEST, interface.name)
        if interface.kind is not InterfaceKind.SERVER or event in taken:
            continue
        if any(item.event == event for other in states for item in takable(other)):
            log.warning(
                "request-discarded",
                state.position,
                "state",
                f"state `{state.name}` discards a request to {interface.channel}: its caller would "
                "never be answered",
                "add <ros_service_handle_request> to the state",
            )


def _check_answered(
    machine: Machine, state: State, transition: Transition, log: DiagnosticLog
) -> None:
    event = transition.event
    assert event is not None
    kind = interface_kind_of(event.kind)
    interface = machine.interface(event.name, kind) if kind is not None else None
    channel = (interface.channel if interface is not None else None) or event.name
    what = hint = ""
    if event.kind is EventKind.REQUEST:
        if not _responds(machine, state, transition, event.name):
            what = (
                f"takes a request to {channel} that no path ever answers: its caller would never "
                "be answered"
            )
            hint = "add <ros_service_send_response> to a path from here"
    else:
        duty = next((item for item in _DUTIES if item.event is event.kind), None)
        if duty is None:
            return
        sent = _outputs_from(machine, state, transition, event.name)
        if not sent & duty.outputs:
            what, hint = duty.what.format(channel=channel), duty.hint
        elif OutputKind.ACCEPT_GOAL in sent and not sent & _ENDS:
            what = (
                f"takes a goal of {channel} that is accepted and never ends: its client would "
                "never get a result"
            )
            hint = "add <ros_action_succeed>, <ros_action_aborted> or <ros_action_canceled>"
    if what:
        log.warning(
            "request-unanswered",
            transition.position,
            transition.element,
            f"state `{state.name}` {what}",
            hint,
        )


def _outputs_from(
    machine: Machine, start: State, first: Transition, interface: str
) -> set[OutputKind]:
    """What can be sent on ``interface`` once ``first`` is taken, by action threads too."""
    sent: set[OutputKind] = set()
    seen: set[str] = set()
    pending = [(start, first)]
    while pending:
        state, transition = pending.pop()
        for after, statements in _steps(machine, state, transition):
            sent |= {
                item.kind
                for item in _open(statements)
                if isinstance(item, Emit) and item.interface == interface
            }
            if after.name not in seen:
                seen.add(after.name)
                pending += [(after, following) for following in takable(after)]
    return sent | _sent_by_threads(machine, interface)


def _sent_by_threads(machine: Machine, interface: str) -> set[OutputKind]:
    return {
        item.kind
        for thread in machine.threads
        for state in thread.machine.states
        for item in statements_of(state)
        if isinstance(item, Emit) and item.interface == interface
    }


def _responds(machine: Machine, start: State, first: Transition, service: str) -> bool:
    """Whether some path from ``first`` answers the request to ``service`` that it takes.

    A response answers the request being processed, else the oldest one that waits (docs/decisions,
    2). So while a later request is being processed, the first response is that one's.
    """
    if OutputKind.RESPONSE in _sent_by_threads(machine, service):
        return True
    request = Event(EventKind.REQUEST, service)
    seen: set[tuple[str, bool]] = set()
    pending = [(start, first, False)]  # the last: a later request is processed and unanswered
    while pending:
        state, transition, other = pending.pop()
        for after, statements in _steps(machine, state, transition):
            responses = _most_responses(statements, service)
            if responses > other:
                return True
            # a response may stand in a branch that is not taken: both ways are followed
            for still in {other, other and not responses}:
                if (after.name, still) not in seen:
                    seen.add((after.name, still))
                    for following in takable(after):
                        modes = _during(following, request, still)
                        pending += [(after, following, mode) for mode in modes]
    return False


def _during(transition: Transition, request: Event, other: bool) -> set[bool]:
    """Whether a later request is being processed once ``transition`` is taken."""
    if transition.event is None:
        return {other}
    if transition.event.kind is EventKind.INTERNAL:  # raised in the same run to completion, or sent
        return {other, False}
    return {transition.event == request}


def _steps(
    machine: Machine, state: State, transition: Transition
) -> Iterator[tuple[State, tuple[Statement, ...]]]:
    """Each way ``transition`` can go: the state it ends in, and the statements that run."""
    if not transition.targets:
        yield state, transition.body
    for target in possible_targets(transition):
        after = machine.state(target.state)
        yield after, (*state.on_exit, *transition.body, *target.body, *after.on_entry)


def _open(statements: tuple[Statement, ...]) -> Iterator[Statement]:
    """Every statement that can run."""
    for statement in statements:
        yield statement
        if isinstance(statement, If):
            for body in open_branches(statement):
                yield from _open(body)


def _most_responses(statements: tuple[Statement, ...], service: str) -> int:
    """The most responses of ``service`` that ``statements`` can send."""
    most = 0
    for statement in statements:
        if isinstance(statement, If):
            bodies = open_branches(statement)
            most += max((_most_responses(body, service) for body in bodies), default=0)
        elif isinstance(statement, Emit):
            most += statement.kind is OutputKind.RESPONSE and statement.interface == service
    return most
