"""An action is five channels; people read it as one thing with parts.

ROS 2 names them ``<action>/_action/send_goal``, ``cancel_goal`` and ``get_result`` (services) and
``feedback`` and ``status`` (topics): https://design.ros2.org/articles/actions.html.
"""

from __future__ import annotations

from typing import Any

from moon.wording import Word, goal_id

SEPARATOR = "/_action/"
"""Between the name of an action and that of one of its channels."""

_ASKED = {"send_goal": "goal", "get_result": "result request", "cancel_goal": "cancel"}
_ANSWERED = {"send_goal": "goal response", "get_result": "result", "cancel_goal": "cancel response"}
_TOPICS = {"feedback": "feedback", "status": "status"}
_CHANNELS = {"send_goal": "goal", "get_result": "result", "cancel_goal": "cancel"} | _TOPICS

_STATUS = ("unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted")
"""Indexed by the codes of action_msgs/msg/GoalStatus."""
_CANCEL = ("accepted", "rejected", "unknown goal", "goal has ended")
"""Indexed by the return codes of action_msgs/srv/CancelGoal."""


def action_of(channel: str) -> str:
    """The action that ``channel`` is a part of; empty if it is none."""
    action, separator, part = channel.rpartition(SEPARATOR)
    return action if separator and part in _CHANNELS else ""


def part_of(channel: str, kind: str) -> str:
    """The part of its action that a line of ``kind`` on ``channel`` is, e.g. ``goal response``."""
    last = channel.rpartition(SEPARATOR)[2]
    if last in _TOPICS:
        return _TOPICS[last]
    return (_ANSWERED if kind == "response" else _ASKED)[last]


def label(channel: str) -> str:
    """How a channel is named where all that happens on it is one row: ``/a (goal)``."""
    action = action_of(channel)
    return f"{action} ({_CHANNELS[channel.rpartition(SEPARATOR)[2]]})" if action else channel


def waits_for_the_goal(channel: str) -> bool:
    """Whether a response on ``channel`` comes only when a goal ends, however long that takes."""
    return channel.endswith(SEPARATOR + "get_result")


def essence(part: str, data: Any) -> tuple[str, Any]:
    """What a person wants to read of a message of an action: its goal's id, and what is in it.

    The id is empty where the message has none. Contents that do not look like ``part`` (a tool of
    somebody else's sent them) are returned as they are.
    """
    try:
        return _essence(part, data)
    except (KeyError, TypeError, IndexError):
        return "", data


def _essence(part: str, data: Any) -> tuple[str, Any]:
    match part:
        case "goal":
            return goal_id(data["goal_id"]), data["goal"]
        case "goal response":
            return "", Word("accepted" if data["accepted"] else "rejected")
        case "result request":
            return goal_id(data["goal_id"]), {}
        case "result":
            return "", {"status": _named(_STATUS, data["status"])} | data["result"]
        case "feedback":
            return goal_id(data["goal_id"]), data["feedback"]
        case "cancel":
            return goal_id(data["goal_info"]["goal_id"]), {}
        case "cancel response":
            return "", _named(_CANCEL, data["return_code"])
        case _:
            return "", {
                goal_id(entry["goal_info"]["goal_id"]): _named(_STATUS, entry["status"])
                for entry in data["status_list"]
            }


def _named(names: tuple[str, ...], code: int) -> Word:
    return Word(names[code] if 0 <= code < len(names) else str(code))
