"""Hand on what happens on one transport to another: topics, services, actions, by name and type.

Written against ``transports.interface`` alone, so that it works between any two. Each transport runs its
handlers on a thread of its own; here, what is to be done on the other is posted to it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from transports.interface import (
    Action,
    CallOutcome,
    CallResult,
    GoalEvents,
    GoalHandle,
    GoalStatus,
    Message,
    Request,
    Service,
    Topic,
    Transport,
    TransportError,
)

PATIENCE_S = 3600.0
"""How long an answer is waited for: the caller knows better, and has given up long before."""


def forward_topic(topic: Topic, source: Transport, target: Transport) -> None:
    """Publish on ``target`` what is published on ``source``."""
    publisher = target.publisher(topic)
    source.subscribe(topic, lambda message: target.post(partial(publisher.publish, message)))


def forward_service(service: Service, server: Transport, caller: Transport) -> None:
    """Serve ``service`` on ``caller``'s side by calling who serves it on ``server``'s.

    A call that ends otherwise than in a response ends as a remote error that says how.
    """
    client = server.client(service)

    def asked(request: Request) -> None:
        def answered(result: CallResult) -> None:
            caller.post(partial(_answer, request, result))

        server.post(lambda: client.call(request.data, answered, PATIENCE_S))

    caller.serve(service, asked)


def _answer(request: Request, result: CallResult) -> None:
    if result.outcome is CallOutcome.RESPONSE:
        request.respond(result.response)
    else:
        request.fail(f"{result.outcome.value} behind the bridge: {result.error}")


def forward_action(action: Action, server: Transport, caller: Transport) -> None:
    """Serve ``action`` on ``caller``'s side by sending its goals to who serves it on ``server``'s."""
    client = server.action_client(action)
    ids: dict[str, str] = {}
    """Goals there by goals here; touched on ``server``'s thread only."""

    def goal(handle: GoalHandle) -> None:
        forwarded = _Goal(handle, action, caller)

        def over() -> None:
            ids.pop(handle.goal_id, None)

        def send() -> None:
            events = forwarded.events(over)
            ids[handle.goal_id] = client.send_goal(handle.goal, events, PATIENCE_S)

        server.post(send)

    def cancel(handle: GoalHandle) -> None:
        def pass_on() -> None:
            if handle.goal_id in ids:  # else it has just ended there
                client.cancel(ids[handle.goal_id])

        server.post(pass_on)

    caller.serve_action(action, goal, cancel)


class _Goal:
    """A goal that is pursued on the other side."""

    def __init__(self, handle: GoalHandle, action: Action, caller: Transport) -> None:
        self._handle = handle
        self._action = action
        self._caller = caller
        self._accepted = False

    def events(self, over: Callable[[], None]) -> GoalEvents:
        """What is to be heard of it there; each is handed on here, in order.

        Args:
            over: called there when the goal has ended.
        """
        post = self._caller.post

        def post_last(end: Callable[[], None]) -> None:
            over()
            post(end)

        return GoalEvents(
            accepted=lambda _: post(self._accept),
            rejected=lambda _: post_last(self._handle.reject),
            feedback=lambda _, message: post(partial(self._handle.publish_feedback, message)),
            result=lambda _, status, message: post_last(partial(self._end, status, message)),
            failed=lambda _, why: post_last(self._fail),
        )

    def _accept(self) -> None:
        self._accepted = True
        self._handle.accept()

    def _end(self, status: GoalStatus, result: Message) -> None:
        if status is GoalStatus.SUCCEEDED:
            self._handle.succeed(result)
        elif status is GoalStatus.ABORTED:
            self._handle.abort(result)
        else:
            try:
                self._handle.canceled(result)
            except TransportError:  # nobody on this side asked for it: it was cancelled over there
                self._handle.abort(result)

    def _fail(self) -> None:
        """The server there has gone, or never was."""
        if self._accepted:
            self._handle.abort(self._action.result())
        else:
            self._handle.reject()
