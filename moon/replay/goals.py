"""Goals as they were recorded: accepted or not, their feedback, how and when they ended."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import msgspec

from moon.replay.calls import RecordedCall
from moon.tap.action_parts import SEPARATOR
from transports.actions.parts import hex_of
from transports.interface import Observation


class RecordedGoal(msgspec.Struct):
    """One goal.

    Attributes:
        goal_id: its id, 32 hex digits.
        call: the call by which it was sent; its response says whether it was accepted.
        feedback: each with the time from the acceptance (ns).
        canceled_ns: from the acceptance to the request to cancel it; None if nobody asked.
        ended_ns: from the acceptance to its end; None if that was not recorded.
        status: how it ended (action_msgs/msg/GoalStatus).
        result: its result.
    """

    goal_id: str
    call: RecordedCall
    feedback: list[tuple[int, Any]] = msgspec.field(default_factory=list)
    canceled_ns: int | None = None
    ended_ns: int | None = None
    status: int = 0
    result: Any = None

    @property
    def goal(self) -> Any:
        """What was asked."""
        return self.call.request["goal"]

    @property
    def accepted(self) -> bool:
        """Whether the server took it."""
        return bool(self.call.response and self.call.response["accepted"])

    @property
    def server(self) -> str:
        """Who served it."""
        return self.call.server


class GoalBook:
    """Puts goals together: feedback as it is read, the rest from the calls of the action's services."""

    def __init__(self) -> None:
        self._feedback: dict[str, list[tuple[int, Any]]] = defaultdict(list)

    def note_feedback(self, seen: Observation) -> None:
        """Take note of a message of a feedback topic; one without a goal's id says nothing."""
        found = id_in(seen.data)
        if found and isinstance(seen.data, dict):
            self._feedback[found].append((seen.stamp_ns, seen.data.get("feedback")))

    def goals(self, action: str, calls: dict[str, list[RecordedCall]]) -> list[RecordedGoal]:
        """The goals of ``action``, in the order in which they were sent."""
        prefix = f"{action}{SEPARATOR}"
        found: dict[str, RecordedGoal] = {}
        for call in calls.get(f"{prefix}send_goal", ()):
            goal_id = id_in(call.request)
            if goal_id and "goal" in call.request and call.is_served and goal_id not in found:
                found[goal_id] = RecordedGoal(goal_id, call)
        for goal_id, goal in found.items():
            accepted_ns = goal.call.answered_ns
            goal.feedback = [(at - accepted_ns, data) for at, data in self._feedback[goal_id]]
        for call in calls.get(f"{prefix}cancel_goal", ()):
            info = call.request.get("goal_info") if isinstance(call.request, dict) else None
            canceled = found.get(id_in(info))
            if canceled is not None and canceled.canceled_ns is None:
                canceled.canceled_ns = call.asked_ns - canceled.call.answered_ns
        for call in calls.get(f"{prefix}get_result", ()):
            ended = found.get(id_in(call.request))
            if ended is not None and isinstance(call.response, dict) and ended.ended_ns is None:
                ended.ended_ns = call.answered_ns - ended.call.answered_ns
                ended.status = call.response.get("status", 0)
                ended.result = call.response.get("result")
        return list(found.values())


def id_in(data: Any) -> str:
    """The goal's id in a part of an action, 32 hex digits; empty if there is none."""
    try:
        return hex_of(data["goal_id"]["uuid"])
    except (KeyError, TypeError):
        return ""
