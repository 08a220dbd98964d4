"""Responses that answer nothing: a second one to a request, or one where no request was taken."""

from __future__ import annotations

from collections.abc import Iterator

from m2c.check.ahead import Ahead
from m2c.check.paths import open_branches, truth
from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.ecmascript import ExecutionError
from m2c.language.evaluate import evaluate
from m2c.language.expressions import is_settled
from m2c.model.machine import (
    Block,
    Emit,
    Event,
    EventKind,
    Field,
    Foreach,
    If,
    InterfaceKind,
    Machine,
    OutputKind,
    Statement,
)
from m2c.model.walk import emits_of, statements_of

_MANY = 8
"""So many requests that wait, or more: nobody counts on."""
_TICKS = ("TickAction", "TickCondition")
"""Services that answer a tick, by the last part of their type."""
_STATUSES = (0, 1, 2)
"""SUCCESS, FAILURE, RUNNING (``bt_interfaces``)."""


def check_responses(machine: Machine, log: DiagnosticLog) -> None:
    """Report what a response cannot be: rules ``response-without-request`` and ``bad-status``.

    The first is a warning, and certain: whatever path leads to that response, no request of its service
    waits there (or, after an ``<if>`` with a response: none on the path through it). A machine that
    handles errors of execution may end a block before its response, and is left out.
    """
    servers = {item.name: item for item in machine.interfaces if item.kind is InterfaceKind.SERVER}
    sent = (item for thread in machine.threads for item in emits_of(thread.machine))
    by_threads = {name for kind, name in sent if kind is OutputKind.RESPONSE}
    taken = {item.event for state in machine.states for item in state.transitions}
    for name, server in servers.items():
        is_taken = Event(EventKind.REQUEST, name) in taken  # else that is said of its declaration
        if is_taken and name not in by_threads and not _handles_errors(machine):
            _check_requested(machine, name, server.channel or name, log)
        if server.type_name.rpartition("/")[2] in _TICKS:
            _check_status(machine, name, log)


def _handles_errors(machine: Machine) -> bool:
    return any(
        item.event is not None
        and item.event.kind is EventKind.INTERNAL
        and (item.event.name or "*").split(".")[0] in ("error", "*")
        for state in machine.states
        for item in state.transitions
    )


def _check_requested(machine: Machine, service: str, channel: str, log: DiagnosticLog) -> None:
    waiting = _Waiting(machine, service)
    for at, answered in sorted(waiting.idle.items()):
        what = f"no request to {channel} waits for this response: "
        if answered is None:
            what += "on every path to it each is answered before, or none is taken"
            hint = "respond once for each <ros_service_handle_request>"
        else:
            what += f"the one at {answered.line}:{answered.column} has answered it"
            hint = "remove one of them, or put this one into an <else>"
        log.warning("response-without-request", at, "ros_service_send_response", what, hint)


class _Waiting:
    """How many requests of a service may wait in each state, at most.

    Attributes:
        idle: responses at which none waits, and the response before, if that is on the same path.
    """

    def __init__(self, machine: Machine, service: str) -> None:
        self._service = service
        self._request = Event(EventKind.REQUEST, service)
        self._ahead = Ahead(machine)
        self._states = {state.name: state for state in machine.states}
        self._begin = (*machine.on_start, *self._states[machine.initial].on_entry)
        most = self._fixpoint(machine.initial)
        # by response: the one before it on some path, or None; and those for which one may wait
        self._found: dict[Position, Position | None] = {}
        self._wanted: set[Position] = set()
        self._run(self._begin, 0)
        for name, waiting in most.items():
            for _, statements, before in self._steps(name, waiting):
                self._run(statements, before)
        self.idle = {
            at: first
            for at, first in self._found.items()
            if first is not None or at not in self._wanted
        }

    def _fixpoint(self, initial: str) -> dict[str, int]:
        """By state that is reached, how many may wait there."""
        self._found, self._wanted = {}, set()
        most = {initial: self._run(self._begin, 0)}
        pending = [initial]
        while pending:
            name = pending.pop()
            for after, statements, before in self._steps(name, most[name]):
                left = self._run(statements, before)
                if left > most.get(after, -1):
                    most[after] = left
                    pending.append(after)
        return most

    def _steps(self, name: str, waiting: int) -> Iterator[tuple[str, tuple[Statement, ...], int]]:
        """Each step from the state ``name``: where it leads, what runs, how many wait before."""
        state = self._states[name]
        for transition in self._ahead.takable[name]:
            taken = transition.event == self._request
            for after, statements in self._ahead.steps(state, transition):
                yield after.name, statements, min(waiting + taken, _MANY)

    def _run(self, statements: tuple[Statement, ...], waiting: int) -> int:
        """How many may wait after ``statements``, with ``waiting`` before; notes what is answered."""
        earlier: Position | None = None  # the response on a path through the <if>s so far
        one = waiting <= 1
        for statement in statements:
            if isinstance(statement, If):
                if one and earlier is None:
                    earlier = self._surely(statement)
                waiting = self._branches(statement, waiting)
            elif isinstance(statement, Foreach):
                self._run(statement.body, waiting)  # perhaps: the array may be empty
            elif isinstance(statement, Block):
                waiting = self._run(statement.body, waiting)
            elif self._responds(statement):
                at = statement.position
                self._found.setdefault(at, None)
                if earlier is not None:
                    self._found[at] = earlier
                elif waiting:
                    self._wanted.add(at)
                if waiting < _MANY:
                    waiting = max(waiting - 1, 0)
                if one and earlier is None:
                    earlier = at
        return waiting

    def _branches(self, statement: If, waiting: int) -> int:
        ends = [self._run(body, waiting) for body in open_branches(statement)]
        if not any(truth(cond) for cond, _ in statement.branches):
            ends.append(waiting)  # none is taken
        return max(ends)

    def _surely(self, statement: If) -> Position | None:
        """A response of a branch of ``statement`` that nothing in it makes depend on more."""
        for body in open_branches(statement):
            for item in body:
                if self._responds(item):
                    return item.position
        return None

    def _responds(self, statement: Statement) -> bool:
        return (
            isinstance(statement, Emit)
            and statement.kind is OutputKind.RESPONSE
            and statement.interface == self._service
        )


def _check_status(machine: Machine, service: str, log: DiagnosticLog) -> None:
    for field in _statuses(machine, service):
        try:
            value = evaluate(field.value, {}, {})
        except ExecutionError:
            continue
        if isinstance(value, int | float) and value not in _STATUSES:
            what = f"{value:g} is not a status"
            hint = "one of 0 (SUCCESS), 1 (FAILURE), 2 (RUNNING)"
            log.error("bad-status", field.value.position, "field", what, hint)


def _statuses(machine: Machine, service: str) -> Iterator[Field]:
    """The fields ``status`` of responses of ``service`` that no data can change."""
    for statement in statements_of(machine):
        if (
            isinstance(statement, Emit)
            and statement.kind is OutputKind.RESPONSE
            and statement.interface == service
        ):
            for field in statement.fields:
                if field.name == "status" and is_settled(field.value):
                    yield field
