"""Actions on any transport's topics and services, under the names that ROS 2 gives their parts.

Design: https://design.ros2.org/articles/actions.html. An action ``/a`` is the services
``/a/_action/send_goal``, ``/a/_action/cancel_goal`` and ``/a/_action/get_result`` and the topics
``/a/_action/feedback`` and ``/a/_action/status``. ``get_result`` is answered when the goal ends.
"""

from __future__ import annotations

import functools
import logging
import uuid
from collections.abc import Callable
from typing import Any, ClassVar

import msgspec

from transports.interface import (
    Action,
    CallOutcome,
    CallResult,
    GoalEvents,
    GoalHandle,
    GoalStatus,
    Message,
    Publisher,
    Request,
    Service,
    Topic,
    Transport,
    TransportError,
)

RESULT_TIMEOUT_S = 24 * 3600.0
"""How long a client waits for the result of a goal that was accepted."""

STATUS_CODES = {
    GoalStatus.ACCEPTED: 1,
    GoalStatus.EXECUTING: 2,
    GoalStatus.CANCELING: 3,
    GoalStatus.SUCCEEDED: 4,
    GoalStatus.CANCELED: 5,
    GoalStatus.ABORTED: 6,
}
"""action_msgs/msg/GoalStatus."""
_STATUS_OF = {code: status for status, code in STATUS_CODES.items()}
_CANCEL_ACCEPTED, _CANCEL_REJECTED, _CANCEL_UNKNOWN, _CANCEL_TERMINATED = 0, 1, 2, 3
"""action_msgs/srv/CancelGoal return codes."""
_REFUSALS = {
    _CANCEL_REJECTED: "the server refuses",
    _CANCEL_UNKNOWN: "the server does not know it",
    _CANCEL_TERMINATED: "it has ended already",
}

LOG = logging.getLogger("transports.actions")


class _Part(msgspec.Struct, forbid_unknown_fields=True):
    __type_name__: ClassVar[str] = ""


class Time(_Part):
    """``builtin_interfaces/msg/Time``."""

    __type_name__: ClassVar[str] = "builtin_interfaces/msg/Time"
    sec: int = 0
    nanosec: int = 0


class GoalId(_Part):
    """``unique_identifier_msgs/msg/UUID``."""

    __type_name__: ClassVar[str] = "unique_identifier_msgs/msg/UUID"
    uuid: list[int] = msgspec.field(default_factory=lambda: [0] * 16)


class GoalInfo(_Part):
    """``action_msgs/msg/GoalInfo``."""

    __type_name__: ClassVar[str] = "action_msgs/msg/GoalInfo"
    goal_id: GoalId = msgspec.field(default_factory=GoalId)
    stamp: Time = msgspec.field(default_factory=Time)


class GoalStatusEntry(_Part):
    """``action_msgs/msg/GoalStatus``."""

    __type_name__: ClassVar[str] = "action_msgs/msg/GoalStatus"
    goal_info: GoalInfo = msgspec.field(default_factory=GoalInfo)
    status: int = 0


class GoalStatusArray(_Part):
    """``action_msgs/msg/GoalStatusArray``."""

    __type_name__: ClassVar[str] = "action_msgs/msg/GoalStatusArray"
    status_list: list[GoalStatusEntry] = msgspec.field(default_factory=list)


class CancelRequest(_Part):
    """``action_msgs/srv/CancelGoal_Request``."""

    __type_name__: ClassVar[str] = "action_msgs/srv/CancelGoal_Request"
    goal_info: GoalInfo = msgspec.field(default_factory=GoalInfo)


class CancelResponse(_Part):
    """``action_msgs/srv/CancelGoal_Response``."""

    __type_name__: ClassVar[str] = "action_msgs/srv/CancelGoal_Response"
    return_code: int = 0
    goals_canceling: list[GoalInfo] = msgspec.field(default_factory=list)


class ActionParts(msgspec.Struct, frozen=True):
    """The channels that an action is made of."""

    send_goal: Service
    cancel_goal: Service
    get_result: Service
    feedback: Topic
    status: Topic


@functools.lru_cache(maxsize=256)
def parts_of(action: Action) -> ActionParts:
    """The services and topics of ``action``, with ROS 2's names and types."""
    prefix = f"{action.name}/_action"
    kind = action.type_name

    def message(suffix: str, *fields: Any) -> type[Message]:
        name = f"{kind}_{suffix}"
        return msgspec.defstruct(
            name.rpartition("/")[2],
            fields,
            namespace={"__type_name__": name},
            forbid_unknown_fields=True,
        )

    return ActionParts(
        Service(
            f"{prefix}/send_goal",
            f"{kind}_SendGoal",
            message("SendGoal_Request", ("goal_id", GoalId), ("goal", action.goal)),
            message("SendGoal_Response", ("accepted", bool), ("stamp", Time)),
        ),
        Service(
            f"{prefix}/cancel_goal", "action_msgs/srv/CancelGoal", CancelRequest, CancelResponse
        ),
        Service(
            f"{prefix}/get_result",
            f"{kind}_GetResult",
            message("GetResult_Request", ("goal_id", GoalId)),
            message("GetResult_Response", ("status", int), ("result", action.result)),
        ),
        Topic(
            f"{prefix}/feedback",
            f"{kind}_FeedbackMessage",
            message("FeedbackMessage", ("goal_id", GoalId), ("feedback", action.feedback)),
        ),
        Topic(f"{prefix}/status", "action_msgs/msg/GoalStatusArray", GoalStatusArray, latched=True),
    )


def serve_action(
    transport: Transport,
    action: Action,
    goal: Callable[[GoalHandle], None],
    cancel: Callable[[GoalHandle], None],
) -> None:
    """Serve ``action`` on ``transport``; see ``Transport.serve_action``."""
    _ActionServer(transport, action, goal, cancel)


def action_client(
    transport: Transport, action: Action, new_id: Callable[[], str] = lambda: uuid.uuid4().hex
) -> SimpleActionClient:
    """A client of ``action`` on ``transport``; see ``Transport.action_client``.

    ``new_id`` makes goal ids (32 hex digits); a transport whose runs must repeat gives its own.
    """
    return SimpleActionClient(transport, action, new_id)


class _Goal:
    """The server's end of one goal."""

    def __init__(self, server: _ActionServer, goal_id: str, goal: Any, request: Request) -> None:
        self._server = server
        self._id = goal_id
        self._goal = goal
        self._request: Request | None = request
        self.status: GoalStatus | None = None
        self.result: Any = None
        self.waiting: list[Request] = []
        self.stamp = Time()

    @property
    def goal_id(self) -> str:
        return self._id

    @property
    def goal(self) -> Any:
        return self._goal

    def accept(self) -> None:
        request = self._take_request("accept")
        self.status = GoalStatus.EXECUTING
        self.stamp = self._server.stamp()
        request.respond(self._server.goal_response(True, self.stamp))
        self._server.publish_status()

    def reject(self) -> None:
        request = self._take_request("reject")
        self._server.forget(self)
        request.respond(self._server.goal_response(False, self._server.stamp()))
        for waiting in self.waiting:
            waiting.fail("the goal was rejected")
        self.waiting.clear()

    def publish_feedback(self, feedback: Message) -> None:
        self._require_running("send feedback of")
        self._server.publish_feedback(self._id, feedback)

    def succeed(self, result: Message) -> None:
        self._end(GoalStatus.SUCCEEDED, result)

    def abort(self, result: Message) -> None:
        self._end(GoalStatus.ABORTED, result)

    def canceled(self, result: Message) -> None:
        if self.status is GoalStatus.EXECUTING:
            raise TransportError(
                f"{self._server.name}: cannot end a goal as canceled that nobody asked to cancel"
            )
        self._end(GoalStatus.CANCELED, result)

    @property
    def has_ended(self) -> bool:
        return self.status in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED)

    def _take_request(self, what: str) -> Request:
        request, self._request = self._request, None
        if request is None:
            raise TransportError(f"{self._server.name}: cannot {what} a goal that was answered")
        return request

    def _require_running(self, what: str) -> None:
        if self.status is None or self.has_ended:
            state = "was not accepted" if self.status is None else "has ended"
            raise TransportError(f"{self._server.name}: cannot {what} a goal that {state}")

    def _end(self, status: GoalStatus, result: Message) -> None:
        self._require_running("end")
        self.status = status
        self.result = result
        for request in self.waiting:
            request.respond(self._server.result_response(status, result))
        self.waiting.clear()
        self._server.publish_status()


class _ActionServer:
    """All goals of one action. Ended ones are kept for clients that ask for the result late."""

    KEPT_GOALS = 64

    def __init__(
        self,
        transport: Transport,
        action: Action,
        goal: Callable[[GoalHandle], None],
        cancel: Callable[[GoalHandle], None],
    ) -> None:
        self.name = action.name
        self._transport = transport
        self._goals: dict[str, _Goal] = {}
        self._on_goal = goal
        self._on_cancel = cancel
        parts = parts_of(action)
        self._parts = parts
        self._feedback: Publisher = transport.publisher(parts.feedback)
        self._status: Publisher = transport.publisher(parts.status)
        transport.serve(parts.send_goal, self._send_goal)
        transport.serve(parts.cancel_goal, self._cancel_goal)
        transport.serve(parts.get_result, self._get_result)

    def goal_response(self, accepted: bool, stamp: Time) -> Message:
        return self._parts.send_goal.response(accepted, stamp)

    def result_response(self, status: GoalStatus, result: Message) -> Message:
        return self._parts.get_result.response(STATUS_CODES[status], result)

    def publish_feedback(self, goal_id: str, feedback: Message) -> None:
        self._feedback.publish(self._parts.feedback.message(_wire_id(goal_id), feedback))

    def publish_status(self) -> None:
        entries = [
            GoalStatusEntry(GoalInfo(_wire_id(key), goal.stamp), STATUS_CODES[goal.status])
            for key, goal in self._goals.items()
            if goal.status is not None
        ]
        self._status.publish(GoalStatusArray(entries))

    def forget(self, goal: _Goal) -> None:
        self._goals.pop(goal.goal_id, None)

    def stamp(self) -> Time:
        """Now, as a message."""
        sec, nanosec = divmod(self._transport.now_ns(), 10**9)
        return Time(sec, nanosec)

    def _send_goal(self, request: Request) -> None:
        goal_id = _hex_id(request.data.goal_id)
        if goal_id in self._goals:
            request.respond(self.goal_response(False, self.stamp()))
            return
        ended = [key for key, goal in self._goals.items() if goal.has_ended]
        for key in ended[: max(0, len(ended) - self.KEPT_GOALS)]:
            del self._goals[key]
        goal = _Goal(self, goal_id, request.data.goal, request)
        self._goals[goal_id] = goal
        self._on_goal(goal)

    def _cancel_goal(self, request: Request) -> None:
        """Cancel what ``request`` asks for (action_msgs/srv/CancelGoal): one goal; with a stamp also
        those accepted up to then; with neither id nor stamp, all.
        """
        info: GoalInfo = request.data.goal_info
        named = any(info.goal_id.uuid)
        timed = (info.stamp.sec, info.stamp.nanosec) != (0, 0)
        if named and not timed:
            goal = self._goals.get(_hex_id(info.goal_id))
            if goal is None or goal.status is None or goal.has_ended:
                request.respond(CancelResponse(_refusal(goal)))
                return
            chosen = [goal]
        else:
            limit = (info.stamp.sec, info.stamp.nanosec)
            wanted = _hex_id(info.goal_id) if named else ""
            chosen = [
                goal
                for key, goal in self._goals.items()
                if goal.status is not None
                and not goal.has_ended
                and (key == wanted or not timed or (goal.stamp.sec, goal.stamp.nanosec) <= limit)
            ]
        fresh = [goal for goal in chosen if goal.status is not GoalStatus.CANCELING]
        for goal in chosen:
            goal.status = GoalStatus.CANCELING
        infos = [GoalInfo(_wire_id(goal.goal_id), goal.stamp) for goal in chosen]
        request.respond(CancelResponse(_CANCEL_ACCEPTED, infos))
        if fresh:
            self.publish_status()
        for goal in fresh:
            self._on_cancel(goal)

    def _get_result(self, request: Request) -> None:
        goal = self._goals.get(_hex_id(request.data.goal_id))
        if goal is None:
            request.fail("no such goal")
        elif goal.has_ended and goal.status is not None:
            request.respond(self.result_response(goal.status, goal.result))
        else:
            goal.waiting.append(request)


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
        transport.subscribe(parts.feedback, self._hear_feedback)

    def send_goal(self, goal: Message, events: GoalEvents, timeout_s: float = 5.0) -> str:
        """Send a goal; see ``transports.interface.ActionClient``."""
        goal_id = self._new_id()
        self._events[goal_id] = events
        request = self._parts.send_goal.request(_wire_id(goal_id), goal)
        self._send_goal.call(request, lambda result: self._answered(goal_id, result), timeout_s)
        return goal_id

    def cancel(self, goal_id: str) -> None:
        """Ask the server to cancel; a goal not yet accepted is canceled once it is."""
        if goal_id not in self._events:
            return
        if goal_id not in self._accepted:
            self._cancel_wanted.add(goal_id)
            return
        info = GoalInfo(_wire_id(goal_id))
        self._cancel_goal.call(
            CancelRequest(info), lambda result: self._hear_cancel(goal_id, result)
        )

    def _hear_cancel(self, goal_id: str, result: CallResult) -> None:
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
            request = self._parts.get_result.request(_wire_id(goal_id))
            self._get_result.call(
                request, lambda answer: self._finished(goal_id, answer), RESULT_TIMEOUT_S
            )
            events.accepted(goal_id)
            for feedback in self._early.pop(goal_id, ()):
                events.feedback(goal_id, feedback)
            if goal_id in self._cancel_wanted:
                self.cancel(goal_id)

    def _finished(self, goal_id: str, answer: CallResult) -> None:
        events = self._events[goal_id]
        self._end(goal_id)
        status = (
            _STATUS_OF.get(answer.response.status)
            if answer.outcome is CallOutcome.RESPONSE
            else None
        )
        if status is None:
            events.failed(goal_id, answer)
        else:
            events.result(goal_id, status, answer.response.result)

    def _hear_feedback(self, message: Any) -> None:
        goal_id = _hex_id(message.goal_id)
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


def _refusal(goal: _Goal | None) -> int:
    """Why ``goal`` cannot be canceled, as a return code."""
    if goal is None:
        return _CANCEL_UNKNOWN
    return _CANCEL_TERMINATED if goal.has_ended else _CANCEL_REJECTED


def _wire_id(goal_id: str) -> GoalId:
    return GoalId(list(bytes.fromhex(goal_id)))


def _hex_id(wire: GoalId) -> str:
    return bytes(octet & 0xFF for octet in wire.uuid).hex()
