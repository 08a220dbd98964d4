"""Which channel, kinds and fields a declared port listens to; the same for both kinds of files."""

from __future__ import annotations

from moon.properties.property import REQUESTS, RESPONSES
from transports.interface import ObservationKind

MESSAGES = (ObservationKind.MESSAGE,)

Place = tuple[str, tuple[ObservationKind, ...], tuple[str, ...]]
"""(channel, kinds, fields that lead to what the user calls the message)."""

SERVICE_PARTS = ("request", "response")
ACTION_PARTS = ("goal", "feedback", "result", "cancel")


def absolute(name: str) -> str:
    """``name`` as an absolute channel name."""
    return name if name.startswith("/") else f"/{name}"


def topic_place(name: str) -> Place:
    """A topic's messages."""
    return absolute(name), MESSAGES, ()


def service_place(name: str, part: str) -> Place:
    """A service's requests or responses."""
    return absolute(name), REQUESTS if part == "request" else RESPONSES, ()


def action_place(name: str, part: str) -> Place:
    """A part of an action, under ROS 2's names for it."""
    prefix = f"{absolute(name)}/_action"
    match part:
        case "goal":
            return f"{prefix}/send_goal", REQUESTS, ("goal",)
        case "feedback":
            return f"{prefix}/feedback", MESSAGES, ("feedback",)
        case "result":
            return f"{prefix}/get_result", RESPONSES, ("result",)
        case _:
            return f"{prefix}/cancel_goal", REQUESTS, ()


def goal_id_place(name: str) -> Place:
    """The id of the goal sent last."""
    return f"{absolute(name)}/_action/send_goal", REQUESTS, ("goal_id", "uuid")


def result_code_place(name: str) -> Place:
    """How the last goal ended (action_msgs/msg/GoalStatus: 4 succeeded, 5 canceled, 6 aborted)."""
    return f"{absolute(name)}/_action/get_result", RESPONSES, ("status",)
