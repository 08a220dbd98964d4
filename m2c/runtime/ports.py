"""The ends of a machine's channels: what a request, a call or a goal is until it has been answered.

Made by the binding (``m2c/runtime/binding.py``); everything here runs on the transport's executor.
"""

from __future__ import annotations

import copy
import logging
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec

from transports.interface import (
    ActionClient,
    CallOutcome,
    CallResult,
    Client,
    GoalEvents,
    GoalHandle,
    GoalStatus,
    Message,
    Publisher,
    Request,
    TransportError,
)

RESULT_CODES = {GoalStatus.SUCCEEDED: 4, GoalStatus.CANCELED: 5, GoalStatus.ABORTED: 6}
"""``_wrapped_result.code``: action_msgs/msg/GoalStatus."""


class Owner(msgspec.Struct, frozen=True):
    """The machine whose ends these are.

    Attributes:
        log: its node's.
        state: says the active state, for messages.
        fault: reports, once for a channel, what the transport refuses there.
    """

    log: logging.Logger
    state: Callable[[], str]
    fault: Callable[[str, str], None]


class PublisherPort:
    """A publisher. What the transport cannot carry (a string longer than its bound) is reported once."""

    def __init__(
        self, publisher: Publisher, channel: str, fault: Callable[[str, str], None]
    ) -> None:
        self._publisher = publisher
        self._channel = channel
        self._fault = fault

    def publish(self, message: Message) -> None:
        """Publish ``message``."""
        try:
            self._publisher.publish(message)
        except TransportError as error:
            self._fault(self._channel, str(error))


class OwnEventPort:
    """A publisher of an event that the machine takes, too, and nobody else sends.

    Args:
        port: publishes it to the others.
        again: queues a message of the machine's own.
    """

    def __init__(self, port: Publisher, again: Callable[[Message], None]) -> None:
        self._port = port
        self._again = again

    def publish(self, message: Message) -> None:
        """Publish ``message``, and queue a copy: who takes it may change it."""
        self._port.publish(message)
        self._again(copy.deepcopy(message))


class ServerPort:
    """The requests of one service that wait for an answer.

    A response answers the request being processed, else the oldest unanswered one. One that the transport
    cannot carry is reported, and its request stays unanswered.
    """

    def __init__(self, channel: str, owner: Owner) -> None:
        self._channel = channel
        self._log = owner.log
        self._state = owner.state
        self._fault = owner.fault
        self._waiting: deque[Request] = deque()
        self._current: Request | None = None

    def handle(self, request: Request, handler: Callable[[Any], bool] | None) -> bool:
        """Process ``request``; whether a transition takes it.

        What handles ``error.execution`` may have answered one of which a condition failed: it is taken then.
        """
        self._waiting.append(request)
        self._current = request
        taken = handler(request.data) if handler is not None else False
        self._current = None
        if taken or request not in self._waiting:
            return True
        self._waiting.remove(request)
        return False

    def discard(self) -> None:
        """A request that no transition takes is never answered."""
        self._log.warning("state %s discards a request to %s", self._state(), self._channel)

    def respond(self, response: Message) -> None:
        """Answer a request."""
        if not self._waiting:
            self._log.warning("a response on %s, but no request is waiting", self._channel)
            return
        request = self._waiting[0]
        if self._current is not None and self._current in self._waiting:
            request = self._current
        self._waiting.remove(request)
        try:
            request.respond(response)
        except TransportError as error:
            self._fault(self._channel, str(error))


class ClientPort:
    """Calls of one service. A failed one that the machine does not handle is logged."""

    def __init__(
        self,
        client: Client,
        channel: str,
        timeout_s: float,
        response: Callable[[Any], object] | None,
        error: Callable[[], bool] | None,
        owner: Owner,
    ) -> None:
        self._client = client
        self._channel = channel
        self._timeout_s = timeout_s
        self._response = response
        self._error = error
        self._log = owner.log
        self._state = owner.state
        self._fault = owner.fault

    def call(self, request: Message) -> None:
        """Send ``request`` and go on; the response is an event."""
        try:
            self._client.call(request, self._done, self._timeout_s)
        except TransportError as error:
            self._fault(self._channel, str(error))

    def _done(self, result: CallResult) -> None:
        if result.outcome is CallOutcome.RESPONSE:
            if self._response is not None:
                self._response(result.response)
            return
        state = self._state()
        if self._error is None or not self._error():
            self._log.error(
                "state %s does not handle a failed call of %s: %s",
                state,
                self._channel,
                result.error or result.outcome,
            )


class ActionServerPort:
    """The goals of one action, numbered from 1."""

    def __init__(self, channel: str, owner: Owner) -> None:
        self._channel = channel
        self._log = owner.log
        self._state = owner.state
        self._goals: dict[int, GoalHandle] = {}
        self._numbers: dict[str, int] = {}
        self._unanswered: set[int] = set()
        self._last = 0

    def handle_goal(self, handle: GoalHandle, handler: Callable[[Any, int], bool] | None) -> None:
        """A new goal; one that no transition takes is rejected."""
        self._last += 1
        number = self._last
        self._goals[number] = handle
        self._numbers[handle.goal_id] = number
        self._unanswered.add(number)
        state = self._state()
        taken = handler is not None and handler(handle.goal, number)
        if not taken and number in self._unanswered:
            self._log.warning("state %s discards a goal of %s; rejected", state, self._channel)
            self.reject(number)

    def handle_cancel(self, handle: GoalHandle, handler: Callable[[int], object] | None) -> None:
        """A request to cancel a goal."""
        number = self._numbers.get(handle.goal_id)
        if number is None or handler is None:
            self._log.warning("a cancel request on %s is discarded", self._channel)
        else:
            handler(number)

    def accept(self, goal_id: int) -> None:
        """Accept a goal."""
        if (handle := self._goal(goal_id)) is not None and self._tell(handle.accept):
            self._unanswered.discard(goal_id)

    def reject(self, goal_id: int) -> None:
        """Reject a goal."""
        if (handle := self._goal(goal_id)) is not None and self._tell(handle.reject):
            self._unanswered.discard(goal_id)
            self._forget(goal_id, handle)

    def feedback(self, goal_id: int, feedback: Message) -> None:
        """Send feedback."""
        if (handle := self._goal(goal_id)) is not None:
            self._tell(handle.publish_feedback, feedback)

    def succeed(self, goal_id: int, result: Message) -> None:
        """End a goal: succeeded."""
        if (handle := self._goal(goal_id)) is not None and self._tell(handle.succeed, result):
            self._forget(goal_id, handle)

    def abort(self, goal_id: int, result: Message) -> None:
        """End a goal: aborted."""
        if (handle := self._goal(goal_id)) is not None and self._tell(handle.abort, result):
            self._forget(goal_id, handle)

    def canceled(self, goal_id: int, result: Message) -> None:
        """End a goal: canceled."""
        if (handle := self._goal(goal_id)) is not None and self._tell(handle.canceled, result):
            self._forget(goal_id, handle)

    def _tell(self, what: Callable[..., None], *arguments: Message) -> bool:
        """Whether ``what`` was done. What a goal's state does not allow is the model's fault: it is reported,
        the goal stays as it was, and the node lives.
        """
        try:
            what(*arguments)
        except TransportError as error:
            self._log.error("state %s: %s", self._state(), error)
            return False
        return True

    def _goal(self, goal_id: int) -> GoalHandle | None:
        handle = self._goals.get(goal_id)
        if handle is None:
            self._log.warning("%s has no goal %s", self._channel, goal_id)
        return handle

    def _forget(self, goal_id: int, handle: GoalHandle) -> None:
        del self._goals[goal_id]
        del self._numbers[handle.goal_id]


class GoalHandlers(msgspec.Struct, frozen=True):
    """The machine's methods for what becomes of a goal; None where the model has no handler."""

    accepted: Callable[[int], object] | None = None
    rejected: Callable[[int], object] | None = None
    feedback: Callable[[Any, int], object] | None = None
    succeeded: Callable[[Any, int, int], object] | None = None
    aborted: Callable[[Any, int, int], object] | None = None
    canceled: Callable[[Any, int, int], object] | None = None
    failed: Callable[[int], bool] | None = None


class ActionClientPort:
    """The goals that a machine sends, numbered from 1."""

    def __init__(
        self,
        client: ActionClient,
        channel: str,
        timeout_s: float,
        handlers: GoalHandlers,
        owner: Owner,
    ) -> None:
        self._client = client
        self._channel = channel
        self._timeout_s = timeout_s
        self._handlers = handlers
        self._log = owner.log
        self._state = owner.state
        self._fault = owner.fault
        self._ids: dict[int, str] = {}
        self._last = 0

    def send_goal(self, goal: Message) -> None:
        """Send a goal; what becomes of it are events."""
        self._last += 1
        number = self._last
        handlers = self._handlers
        ends = {
            GoalStatus.SUCCEEDED: handlers.succeeded,
            GoalStatus.ABORTED: handlers.aborted,
            GoalStatus.CANCELED: handlers.canceled,
        }

        def result(_: str, status: GoalStatus, message: Any) -> None:
            self._ids.pop(number, None)
            handler = ends.get(status)
            if handler is None:
                self._log.warning("a goal of %s ended: %s; no handler", self._channel, status)
            else:
                handler(message, number, RESULT_CODES[status])

        def rejected(_: str) -> None:
            self._ids.pop(number, None)
            if handlers.rejected is not None:
                handlers.rejected(number)

        def failed(goal_id: str, why: CallResult) -> None:
            reason = why.error or why.outcome
            if handlers.failed is None:  # see ``m2c.model.walk.failure_of_goals``
                self._log.error("a goal of %s failed: %s", self._channel, reason)
                rejected(goal_id)
                return
            self._ids.pop(number, None)
            state = self._state()
            if not handlers.failed(number):
                self._log.error(
                    "state %s does not handle a failed goal of %s: %s", state, self._channel, reason
                )

        def accepted(_: str) -> None:
            if handlers.accepted is not None:
                handlers.accepted(number)

        def feedback(_: str, message: Any) -> None:
            if handlers.feedback is not None:
                handlers.feedback(message, number)

        events = GoalEvents(
            accepted=accepted,
            rejected=rejected,
            feedback=feedback,
            result=result,
            failed=failed,
        )
        try:
            self._ids[number] = self._client.send_goal(goal, events, self._timeout_s)
        except TransportError as error:
            self._fault(self._channel, str(error))

    def send_cancel(self, goal_id: int | None) -> None:
        """Ask to cancel the goal; None: the last one sent."""
        number = goal_id or self._last
        if number in self._ids:
            self._client.cancel(self._ids[number])
        else:
            self._log.warning("no goal of %s to cancel", self._channel)
