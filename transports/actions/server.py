"""The server's end of an action."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from transports.actions.parts import (
    CANCEL_ACCEPTED,
    CANCEL_REJECTED,
    CANCEL_TERMINATED,
    CANCEL_UNKNOWN,
    STATUS_CODES,
    CancelResponse,
    GoalInfo,
    GoalStatusArray,
    GoalStatusEntry,
    Time,
    hex_id,
    parts_of,
    wire_id,
)
from transports.interface import (
    Action,
    GoalHandle,
    GoalStatus,
    Message,
    Publisher,
    Request,
    Transport,
    TransportError,
)


def serve_action(
    transport: Transport,
    action: Action,
    goal: Callable[[GoalHandle], None],
    cancel: Callable[[GoalHandle], None],
) -> None:
    """Serve ``action`` on ``transport``; see ``Transport.serve_action``."""
    _ActionServer(transport, action, goal, cancel)


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
        self._feedback.publish(self._parts.feedback.message(wire_id(goal_id), feedback))

    def publish_status(self) -> None:
        entries = [
            GoalStatusEntry(GoalInfo(wire_id(key), goal.stamp), STATUS_CODES[goal.status])
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
        goal_id = hex_id(request.data.goal_id)
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
            goal = self._goals.get(hex_id(info.goal_id))
            if goal is None or goal.status is None or goal.has_ended:
                request.respond(CancelResponse(_refusal(goal)))
                return
            chosen = [goal]
        else:
            limit = (info.stamp.sec, info.stamp.nanosec)
            wanted = hex_id(info.goal_id) if named else ""
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
        infos = [GoalInfo(wire_id(goal.goal_id), goal.stamp) for goal in chosen]
        request.respond(CancelResponse(CANCEL_ACCEPTED, infos))
        if fresh:
            self.publish_status()
        for goal in fresh:
            self._on_cancel(goal)

    def _get_result(self, request: Request) -> None:
        goal = self._goals.get(hex_id(request.data.goal_id))
        if goal is None:
            request.fail("no such goal")
        elif goal.has_ended and goal.status is not None:
            request.respond(self.result_response(goal.status, goal.result))
        else:
            goal.waiting.append(request)


def _refusal(goal: _Goal | None) -> int:
    """Why ``goal`` cannot be canceled, as a return code."""
    if goal is None:
        return CANCEL_UNKNOWN
    return CANCEL_TERMINATED if goal.has_ended else CANCEL_REJECTED
