"""The client's end of an action."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable
from typing import Any

from transports.actions.parts import STATUS_OF, CancelRequest, GoalInfo, hex_id, parts_of, wire_id
from transports.actions.rules import CANCEL_REJECTED, CANCEL_TERMINATED, CANCEL_UNKNOWN
from transports.interface import (
    Action,
    CallOutcome,
    CallResult,
    GoalEvents,
    Message,
    Transport,
)

RESULT_TIMEOUT_S = 24 * 3600.0
"""How long a client waits for the result of a goal that was accepted."""

_REFUSALS = {
    CANCEL_REJECTED: "the server refuses",
    CANCEL_UNKNOWN: "the server does not know it",
    CANCEL_TERMINATED: "it has ended already",
}

LOG = logging.getLogger("transports.actions")


def action_client(
    transport: Transport, action: Action, new_id: Callable[[], str] = lambda: uuid.uuid4().hex
) -> SimpleActionClient:
    """A client of ``action`` on ``transport``; see ``Transport.action_client``.

    ``new_id`` makes goal ids (32 hex digits); a transport whose runs must repeat gives its own.
    """
    return SimpleActionClient(transport, action, new_id)


class SimpleActionClient:
    """The client's end of all goals that one node sends to one action."""

    def __init__(self, transport: Transport, action: Action, new_id: Callable[[], str]) -> None:
        parts = parts_of(action)
        self._name = action.name
        self._new_id = new_id
        self._parts = parts
        self._send_goal = transport.client(parts.send_goal)
        self._cancel_goal = transport.client(parts.cancel_goal)
        self._get_result = transport.client(parts.get_result)
        self._events: dict[str, GoalEvents] = {}
        self._accepted: set[str] = set()
        self._cancel_wanted: set[str] = set()
        self._early: dict[str, list[Any]] = {}
        transport.subscribe(parts.feedback, self._receive_feedback)

    def send_goal(self, goal: Message, events: GoalEvents, timeout_s: float = 5.0) -> str:
        """Send a goal; see ``transports.interface.ActionClient``."""
        goal_id = self._new_id()
        self._events[goal_id] = events
        request = self._parts.send_goal.request(wire_id(goal_id), goal)
        self._send_goal.call(request, lambda result: self._answered(goal_id, result), timeout_s)
        return goal_id

    def cancel(self, goal_id: str) -> None:
        """Ask the server to cancel; a goal not yet accepted is canceled once it is."""
        if goal_id not in self._events:
            return
        if goal_id not in self._accepted:
            self._cancel_wanted.add(goal_id)
            return
        info = GoalInfo(wire_id(goal_id))
        self._cancel_goal.call(
            CancelRequest(info), lambda result: self._receive_cancel(goal_id, result)
        )

    def _receive_cancel(self, goal_id: str, result: CallResult) -> None:
        """A goal that goes on although it should be canceled is worth a line."""
        if result.outcome is not CallOutcome.RESPONSE:
            why = result.error or str(result.outcome)
        elif result.response.return_code in _REFUSALS and goal_id in self._events:
            why = _REFUSALS[result.response.return_code]
        else:
            return
        LOG.warning("%s: goal %s is not canceled: %s", self._name, goal_id, why)

    def _answered(self, goal_id: str, result: CallResult) -> None:
        events = self._events[goal_id]
        if result.outcome is not CallOutcome.RESPONSE:
            self._end(goal_id)
            events.failed(goal_id, result)
        elif not result.response.accepted:
            self._end(goal_id)
            events.rejected(goal_id)
        else:
            self._accepted.add(goal_id)
            request = self._parts.get_result.request(wire_id(goal_id))
            self._get_result.call(
                request, lambda answer: self._finished(goal_id, answer), RESULT_TIMEOUT_S
            )
            events.accepted(goal_id)
            if goal_id in self._cancel_wanted:
                self.cancel(goal_id)
            for feedback in self._early.pop(goal_id, ()):
                events.feedback(goal_id, feedback)

    def _finished(self, goal_id: str, answer: CallResult) -> None:
        events = self._events[goal_id]
        self._end(goal_id)
        status = (
            STATUS_OF.get(answer.response.status)
            if answer.outcome is CallOutcome.RESPONSE
            else None
        )
        if status is None:
            events.failed(goal_id, answer)
        else:
            events.result(goal_id, status, answer.response.result)

    def _receive_feedback(self, message: Any) -> None:
        goal_id = hex_id(message.goal_id)
        events = self._events.get(goal_id)
        if events is None:
            return
        if goal_id in self._accepted:
            events.feedback(goal_id, message.feedback)
        else:  # topics and services keep no common order: it may overtake the goal's response
            self._early.setdefault(goal_id, []).append(message.feedback)

    def _end(self, goal_id: str) -> None:
        self._events.pop(goal_id, None)
        self._early.pop(goal_id, None)
        self._accepted.discard(goal_id)
        self._cancel_wanted.discard(goal_id)
