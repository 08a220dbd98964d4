"""One node of a recording, played: it publishes, answers, asks and drives as it did then."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import msgspec

from moon.recording.reader import Recording
from moon.replay import types
from moon.replay.calls import Answers, RecordedCall
from moon.replay.goals import RecordedGoal
from transports.interface import (
    Action,
    ActionClient,
    CallOutcome,
    CallResult,
    Client,
    Connection,
    GoalEvents,
    GoalHandle,
    GoalStatus,
    Publisher,
    Request,
    Service,
    Timer,
)

NS = 1_000_000_000
_SHOWN = 120
"""Characters shown of a request."""

_SUCCEEDED, _CANCELED, _ABORTED = 4, 5, 6
"""action_msgs/msg/GoalStatus."""


class Counts(msgspec.Struct):
    """What happened in a replay.

    Attributes:
        published: messages.
        equal: answers to a request equal to the recorded one.
        other: answers to a request that is not: the next one in order.
        unanswered: requests and goals that had no answer then, and have none now.
        without: requests for which no answer was left.
        asked: requests and goals that were sent as then.
        differently: those that were answered otherwise than then.
    """

    published: int = 0
    equal: int = 0
    other: int = 0
    unanswered: int = 0
    without: int = 0
    asked: int = 0
    differently: int = 0


class ReplayedNode:
    """Plays one node on a connection of its own; all of it runs on that connection's executor.

    Args:
        transport: the connection.
        recording: knows the types.
        rate: how many recorded seconds pass in one.
        say: called with what a person should know, one sentence each.
        counts: what happens is counted there.
    """

    def __init__(
        self,
        transport: Connection,
        recording: Recording,
        rate: float,
        say: Callable[[str], None],
        counts: Counts,
    ) -> None:
        self.transport = transport
        self._recording = recording
        self._rate = rate
        self._say = say
        self._counts = counts
        self._publishers: dict[str, tuple[Publisher, Any]] = {}
        self._clients: dict[str, tuple[Client, Service]] = {}
        self._drivers: dict[str, tuple[ActionClient, Action]] = {}
        self._goals: dict[str, str] = {}
        """Ids of goals that were sent now, by the id that they had then."""

    # --- what is declared ----------------------------------------------------------------------------

    def publish_on(self, channel: str, type_name: str) -> None:
        """Declare a topic; UnknownTypeError if its type is not known."""
        topic = types.topic(self._recording, channel, type_name)
        self._publishers[channel] = (self.transport.publisher(topic), topic.message)

    def serve(self, channel: str, calls: list[RecordedCall]) -> None:
        """Serve a service with the answers of ``calls``; UnknownTypeError as above."""
        service = types.service(self._recording, channel)
        answers = Answers(calls, lambda call: call.request, lambda call: call.is_answered)
        self.transport.serve(service, lambda request: self._answer(service, answers, request))

    def call_on(self, channel: str) -> None:
        """Declare a client; UnknownTypeError as above."""
        service = types.service(self._recording, channel)
        self._clients[channel] = (self.transport.client(service), service)

    def serve_action(self, name: str, goals: list[RecordedGoal]) -> None:
        """Serve an action as its goals went then; UnknownTypeError as above."""
        action = types.action(self._recording, name)
        answers = Answers(goals, lambda goal: goal.goal, lambda goal: goal.call.is_answered)
        running: dict[str, _Drive] = {}

        def begin(handle: GoalHandle) -> None:
            goal = self._goal_for(name, answers, handle)
            if goal is None:
                handle.reject()
                return
            if not goal.call.is_answered:
                self._counts.unanswered += 1
                return
            running[handle.goal_id] = _Drive(self, action, handle, goal)

        def cancel(handle: GoalHandle) -> None:
            running[handle.goal_id].cancel()

        self.transport.serve_action(action, begin, cancel)

    def drive_on(self, name: str) -> None:
        """Declare an action client; UnknownTypeError as above."""
        action = types.action(self._recording, name)
        self._drivers[name] = (self.transport.action_client(action), action)

    # --- what is done --------------------------------------------------------------------------------

    def publish(self, channel: str, data: Any) -> None:
        """Publish what was published then."""
        publisher, message = self._publishers[channel]
        try:
            publisher.publish(msgspec.convert(data, message))
        except msgspec.ValidationError as error:
            self._say(f"{channel}: a message is not of its type any more: {error}")
            return
        self._counts.published += 1

    def ask(self, call: RecordedCall) -> None:
        """Ask what was asked then; an answer that differs from that of then is reported."""
        client, service = self._clients[call.channel]
        try:
            request = msgspec.convert(call.request, service.request)
        except msgspec.ValidationError as error:
            self._say(f"{call.channel}: a request is not of its type any more: {error}")
            return

        def done(result: CallResult) -> None:
            now = _answer_of(result)
            then = call.error.partition(":")[0] if call.error else call.response
            if call.answered_ns and now != then:
                self._counts.differently += 1
                self._say(
                    f"{call.channel} {shown(call.request)}: response {shown(now)}, recorded {shown(then)}"
                )

        self._counts.asked += 1
        client.call(request, done)

    def drive(self, name: str, goal: RecordedGoal) -> None:
        """Send the goal that was sent then."""
        client, action = self._drivers[name]

        def ended(goal_id: str, status: GoalStatus, result: Any) -> None:
            now = msgspec.to_builtins(result)
            if goal.ended_ns is not None and now != goal.result:
                self._counts.differently += 1
                self._say(f"{name} {shown(goal.goal)}: ended {status} {shown(now)}")

        def failed(goal_id: str, result: CallResult) -> None:
            self._counts.differently += 1
            self._say(f"{name} {shown(goal.goal)}: {result.outcome}: {result.error}")

        self._counts.asked += 1
        self._goals[goal.goal_id] = client.send_goal(
            msgspec.convert(goal.goal, action.goal),
            GoalEvents(
                accepted=_ignore, rejected=_ignore, feedback=_ignore, result=ended, failed=failed
            ),
        )

    def cancel(self, name: str, goal: RecordedGoal) -> None:
        """Ask to cancel the goal, as then."""
        goal_id = self._goals.get(goal.goal_id)
        if goal_id is not None:
            self._drivers[name][0].cancel(goal_id)

    def after(self, delay_ns: int, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` when ``delay_ns`` of recorded time have passed."""
        return self.transport.after(max(0, delay_ns) / NS / self._rate, handler)

    def report(self, sentence: str) -> None:
        """Say it to the person who replays."""
        self._say(sentence)

    # --- what is answered ----------------------------------------------------------------------------

    def _answer(self, service: Service, answers: Answers[RecordedCall], request: Request) -> None:
        data = msgspec.to_builtins(request.data)
        call, is_equal = answers.to(data)
        if call is None:
            self._counts.without += 1
            self._say(f"{service.name} {shown(data)}: no recorded answer is left")
            request.fail("no recorded answer is left")
            return
        if not call.is_answered:
            self._counts.unanswered += 1
            return
        self._note(service.name, data, is_equal)
        self.after(call.delay_ns, lambda: self._respond(service, request, call))

    def _respond(self, service: Service, request: Request, call: RecordedCall) -> None:
        if call.error:
            request.fail(call.error.partition(": ")[2] or call.error)
            return
        try:
            request.respond(msgspec.convert(call.response, service.response))
        except msgspec.ValidationError as error:
            request.fail(f"the recorded answer is not of its type any more: {error}")

    def _goal_for(
        self, name: str, answers: Answers[RecordedGoal], handle: GoalHandle
    ) -> RecordedGoal | None:
        data = msgspec.to_builtins(handle.goal)
        goal, is_equal = answers.to(data)
        if goal is None:
            self._counts.without += 1
            self._say(f"{name} {shown(data)}: no recorded goal is left: it is rejected")
            return None
        if goal.call.is_answered:
            self._note(name, data, is_equal)
        return goal

    def _note(self, channel: str, data: Any, is_equal: bool) -> None:
        if is_equal:
            self._counts.equal += 1
            return
        self._counts.other += 1
        self._say(
            f"{channel} {shown(data)}: no equal request was recorded: the next recorded response is given"
        )


class _Drive:
    """A goal that is served as one went then."""

    def __init__(
        self, node: ReplayedNode, action: Action, handle: GoalHandle, goal: RecordedGoal
    ) -> None:
        self._node = node
        self._action = action
        self._handle = handle
        self._goal = goal
        self._timers = [node.after(goal.call.delay_ns, self._begin)]
        self._ended = False

    def _begin(self) -> None:
        goal, after = self._goal, self._node.after
        if not goal.accepted:
            self._handle.reject()
            return
        self._handle.accept()
        for at_ns, feedback in goal.feedback:
            self._timers.append(after(at_ns, functools.partial(self._feed, feedback)))
        if goal.ended_ns is not None and goal.status != _CANCELED:
            self._timers.append(after(goal.ended_ns, self._finish))

    def _feed(self, data: Any) -> None:
        try:
            feedback = msgspec.convert(data, self._action.feedback)
        except msgspec.ValidationError as error:
            self._node.report(f"{self._action.name}: feedback is not of its type any more: {error}")
            return
        if not self._ended:
            self._handle.publish_feedback(feedback)

    def cancel(self) -> None:
        """Its client asks to cancel it."""
        goal = self._goal
        if goal.canceled_ns is None or goal.status != _CANCELED:
            self._node.report(f"{self._action.name} {shown(goal.goal)}: was not canceled then")
        took_ns = 0
        if goal.status == _CANCELED and goal.ended_ns is not None and goal.canceled_ns is not None:
            took_ns = goal.ended_ns - goal.canceled_ns
        self._timers.append(self._node.after(took_ns, lambda: self._end(_CANCELED)))

    def _finish(self) -> None:
        self._end(self._goal.status)

    def _end(self, status: int) -> None:
        if self._ended:
            return
        self._ended = True
        for timer in self._timers:
            timer.cancel()
        recorded = self._goal.result
        try:
            result = msgspec.convert(recorded if recorded is not None else {}, self._action.result)
        except msgspec.ValidationError as error:
            self._node.report(
                f"{self._action.name}: the result is not of its type any more: {error}"
            )
            result = self._action.result()
            status = _ABORTED
        ends = {
            _SUCCEEDED: self._handle.succeed,
            _CANCELED: self._handle.canceled,
        }
        ends.get(status, self._handle.abort)(result)


def shown(data: Any) -> str:
    """Data as a person reads it, cut short."""
    text = msgspec.json.encode(data).decode()
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def _answer_of(result: CallResult) -> Any:
    if result.outcome is CallOutcome.RESPONSE:
        return msgspec.to_builtins(result.response)
    return str(result.outcome)


def _ignore(*_: Any) -> None:
    """Nothing is to be done."""
