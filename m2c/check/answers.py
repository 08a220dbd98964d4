"""Requests that nobody would ever answer: discarded by a state, or taken and forgotten."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from m2c.check.ahead import Ahead
from m2c.check.copies import in_all_copies
from m2c.check.paths import leaving_at_once, reachable
from m2c.diagnostics import DiagnosticLog
from m2c.model.machine import (
    Event,
    EventKind,
    InterfaceKind,
    Machine,
    OutputKind,
    State,
    Transition,
)
from m2c.model.scopes import interface_kind_of
from m2c.model.walk import emits_of

_ENDS = {OutputKind.SUCCEED, OutputKind.ABORT, OutputKind.CANCEL}
_RESULTS = frozenset({EventKind.SUCCEEDED, EventKind.ABORTED, EventKind.CANCELED})
_ANSWERS = frozenset({EventKind.GOAL_ACCEPTED, EventKind.GOAL_REJECTED})
_BY_ITSELF = frozenset({EventKind.AFTER, EventKind.TIMER, EventKind.INTERNAL})
"""Events that come although nobody else sends anything."""
_DECISIONS = frozenset({OutputKind.ACCEPT_GOAL, OutputKind.REJECT_GOAL})


class _Duty(msgspec.Struct, frozen=True):
    """What taking an event obliges a machine to send, and what to say if it never does."""

    event: EventKind
    outputs: frozenset[OutputKind]
    what: str
    hint: str


_DUTIES = (
    _Duty(
        EventKind.GOAL,
        _DECISIONS,
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

    Rules: ``request-discarded`` (a state in which nothing takes a request that others take),
    ``request-unanswered`` (a request is taken, and no path from there has an answer to it) and
    ``goal-failure-unhandled`` (a state waits for a goal, and its server may die). A path is any
    sequence of transitions that can be taken, so that every warning is a certainty.
    """
    ahead = Ahead(machine)
    names = reachable(machine)
    found = [state for state in machine.states if state.name in names]
    taken = {item.event for state in found for item in ahead.takable[state.name]}
    for state in found:
        _check_discarded(ahead, state, taken, log)
        _check_goals(ahead, state, taken, log)
    for name, transition, (what, hint) in _unanswered(ahead, found):
        said = f"state `{name}` {what}"
        log.warning("request-unanswered", transition.position, transition.element, said, hint)


def _check_discarded(
    ahead: Ahead, state: State, elsewhere: set[Event | None], log: DiagnosticLog
) -> None:
    if leaving_at_once(state) is not None:
        return
    taken = {item.event for item in ahead.takable[state.name]}
    for interface in ahead.machine.interfaces:
        event = Event(EventKind.REQUEST, interface.name)
        if interface.kind is not InterfaceKind.SERVER or event in taken:
            continue
        if event in elsewhere:
            log.warning(
                "request-discarded",
                state.position,
                "state",
                f"state `{state.name}` discards a request to {interface.channel}: its caller would "
                "never be answered",
                "add <ros_service_handle_request> to the state",
            )


def _check_goals(
    ahead: Ahead, state: State, elsewhere: set[Event | None], log: DiagnosticLog
) -> None:
    """Warn if ``state`` waits for the end of a goal for ever when the goal's server dies."""
    if leaving_at_once(state) is not None:
        return
    takable = ahead.takable[state.name]
    if any(_leaves_by_itself(item, state) for item in takable):
        return
    taken = {item.event for item in takable}
    for interface in ahead.machine.interfaces:
        if interface.kind is not InterfaceKind.ACTION_CLIENT:
            continue
        failure = Event(EventKind.GOAL_FAILED, interface.name)
        # without any handler of failures, one before acceptance is a rejection
        awaited = _RESULTS | (_ANSWERS if failure in elsewhere else frozenset())
        if failure not in taken and any(Event(kind, interface.name) in taken for kind in awaited):
            log.warning(
                "goal-failure-unhandled",
                state.position,
                "state",
                f"state `{state.name}` waits for a goal of {interface.channel or interface.name}, and "
                "waits for ever if the goal's server dies",
                "add <ros_action_handle_error> to the state",
            )


def _leaves_by_itself(transition: Transition, state: State) -> bool:
    """Whether ``transition`` leads out of ``state`` although nobody else sends anything."""
    event = transition.event
    is_own = event is not None and event.kind in _BY_ITSELF
    return is_own and any(target.state != state.name for target in transition.targets)


def _unanswered(
    ahead: Ahead, states: Sequence[State]
) -> Iterator[tuple[str, Transition, tuple[str, str]]]:
    """What is taken in ``states`` and never answered: the state's name, what is wrong, what would be right.

    Of a transition of a compound state, that is said of each state in it; once, if it is so in all.
    """
    faults = {state.name: _faults(ahead, state) for state in states}
    whole = in_all_copies(states, lambda state: faults[state.name])
    once = {(item.position, item.event): False for _, item, _ in whole}
    for state in states:
        for index, fault in faults[state.name].items():
            item = state.transitions[index]
            key = (item.position, item.event)
            if key not in once:
                yield state.name, item, fault
            elif not once[key]:
                once[key] = True
                yield item.of or state.name, item, fault


def _faults(ahead: Ahead, state: State) -> dict[int, tuple[str, str]]:
    takable = set(map(id, ahead.takable[state.name]))
    found = ((index, item) for index, item in enumerate(state.transitions) if id(item) in takable)
    told = ((index, _fault(ahead, state, item)) for index, item in found)
    return {index: fault for index, fault in told if fault is not None}


def _fault(ahead: Ahead, state: State, transition: Transition) -> tuple[str, str] | None:
    event = transition.event
    if event is None:
        return None
    kind = interface_kind_of(event.kind)
    interface = ahead.machine.interface(event.name, kind) if kind is not None else None
    channel = (interface.channel if interface is not None else None) or event.name
    what = hint = ""
    if event.kind is EventKind.REQUEST:
        if not ahead.responds(state, transition, event.name):
            what = (
                f"takes a request to {channel} that no path ever answers: its caller would never "
                "be answered"
            )
            hint = "add <ros_service_send_response> to a path from here"
    else:
        duty = next((item for item in _DUTIES if item.event is event.kind), None)
        if duty is None:
            return None
        sent = ahead.outputs(state, transition, event.name)
        if not sent & duty.outputs:
            what, hint = duty.what.format(channel=channel), duty.hint
        elif sent & _ENDS and (OutputKind.ACCEPT_GOAL, event.name) not in emits_of(ahead.machine):
            what = f"takes a goal of {channel}, and goals are ended there that no state accepts"
            hint = "add <ros_action_accept_goal>"
        elif OutputKind.ACCEPT_GOAL in sent and not sent & _ENDS:
            what = (
                f"takes a goal of {channel} that is accepted and never ends: its client would "
                "never get a result"
            )
            hint = "add <ros_action_succeed>, <ros_action_aborted> or <ros_action_canceled>"
    return (what, hint) if what else None
