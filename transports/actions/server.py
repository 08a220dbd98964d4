"""The server's end of an action; what its goals may do is in ``transports.actions.rules``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from transports.actions import rules
from transports.actions.parts import (
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
from transports.actions.rules import Act, CancelScope, Phase, ResultAnswer
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
        self._request = request
        self.phase = Phase.NEW
        self.end: GoalStatus | None = None
        self.result: Any = None
        self.waiting: list[Request] = []
        self.stamp = Time()

    @property
    def goal_id(self) -> str:
        return self._id

    @property
    def goal(self) -> Any:
        return self._goal

    @property
    def status(self) -> GoalStatus | None:
        """As it is published; None while nobody has answered it."""
        return self.end or _STATUSES.get(self.phase)

    def is_in(self, scope: CancelScope) -> bool:
        """Whether a cancel request means it."""
        stamp = (self.stamp.sec, self.stamp.nanosec)
        return scope.includes(self._id, self.phase, stamp) is True

    def accept(self) -> None:
        self.phase = self._after(Act.ACCEPT)
        self.stamp = self._server.stamp()
        self._request.respond(self._server.goal_response(True, self.stamp))
        self._server.publish_status()

    def reject(self) -> None:
        self.phase = self._after(Act.REJECT)
        self._server.forget(self)
        self._request.respond(self._server.goal_response(False, self._server.stamp()))
        for waiting in self.waiting:
            waiting.fail("the goal was rejected")
        self.waiting.clear()

    def publish_feedback(self, feedback: Message) -> None:
        self._after(Act.FEEDBACK)
        self._server.publish_feedback(self._id, feedback)

    def succeed(self, result: Message) -> None:
        self._end(Act.SUCCEED, GoalStatus.SUCCEEDED, result)

    def abort(self, result: Message) -> None:
        self._end(Act.ABORT, GoalStatus.ABORTED, result)

    def canceled(self, result: Message) -> None:
        self._end(Act.CANCEL, GoalStatus.CANCELED, result)

    def _after(self, act: Act) -> Phase:
        """Where the goal stands after ``act``; TransportError if it may not be done."""
        phase = rules.after(self.phase, act)
        if phase is not None:
            return phase
        name = self._server.name
        if act in (Act.ACCEPT, Act.REJECT):
            raise TransportError(f"{name}: cannot {act} a goal that was answered")
        if act is Act.CANCEL and self.phase is Phase.RUNNING:
            raise TransportError(
                f"{name}: cannot end a goal as canceled that nobody asked to cancel"
            )
        what = "send feedback of" if act is Act.FEEDBACK else "end"
        state = "has ended" if self.phase is Phase.ENDED else "was not accepted"
        raise TransportError(f"{name}: cannot {what} a goal that {state}")

    def _end(self, act: Act, status: GoalStatus, result: Message) -> None:
        self.phase = self._after(act)
        self.end = status
        self.result = result
        for request in self.waiting:
            request.respond(self._server.result_response(status, result))
        self.waiting.clear()
        self._server.publish_status()


_STATUSES = {Phase.RUNNING: GoalStatus.EXECUTING, Phase.CANCELING: GoalStatus.CANCELING}


class _ActionServer:
    """All goals of one action. Ended ones are kept for clients that ask for the result late."""

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
            GoalStatusEntry(GoalInfo(wire_id(key), goal.stamp), STATUS_CODES[status])
            for key, goal in self._goals.items()
            if (status := goal.status) is not None
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
        ended = [key for key, goal in self._goals.items() if goal.phase is Phase.ENDED]
        for key in rules.forgotten(ended):
            del self._goals[key]
        goal = _Goal(self, goal_id, request.data.goal, request)
        self._goals[goal_id] = goal
        self._on_goal(goal)

    def _cancel_goal(self, request: Request) -> None:
        info: GoalInfo = request.data.goal_info
        scope = CancelScope(hex_id(info.goal_id), (info.stamp.sec, info.stamp.nanosec))
        code = scope.return_code((key, goal.phase) for key, goal in self._goals.items())
        chosen = [goal for goal in self._goals.values() if goal.is_in(scope)]
        fresh = [goal for goal in chosen if goal.phase is not Phase.CANCELING]
        for goal in chosen:
            goal.phase = Phase.CANCELING
        infos = [GoalInfo(wire_id(goal.goal_id), goal.stamp) for goal in chosen]
        request.respond(CancelResponse(code, infos))
        if fresh:
            self.publish_status()
        for goal in fresh:
            self._on_cancel(goal)

    def _get_result(self, request: Request) -> None:
        goal = self._goals.get(hex_id(request.data.goal_id))
        answer = rules.result_answer(None if goal is None else goal.phase)
        if goal is None or answer is ResultAnswer.NO_SUCH_GOAL:
            request.fail(answer)
        elif goal.end is not None and answer is ResultAnswer.NOW:
            request.respond(self.result_response(goal.end, goal.result))
        else:
            goal.waiting.append(request)
