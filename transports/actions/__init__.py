"""Actions on any transport's topics and services, under the names that ROS 2 gives their parts.

Design: https://design.ros2.org/articles/actions.html. An action ``/a`` is the services
``/a/_action/send_goal``, ``/a/_action/cancel_goal`` and ``/a/_action/get_result`` and the topics
``/a/_action/feedback`` and ``/a/_action/status``. ``get_result`` is answered when the goal ends.
"""

from __future__ import annotations

from transports.actions.client import RESULT_TIMEOUT_S, SimpleActionClient, action_client
from transports.actions.parts import (
    STATUS_CODES,
    ActionParts,
    CancelRequest,
    CancelResponse,
    GoalId,
    GoalInfo,
    GoalStatusArray,
    GoalStatusEntry,
    Time,
    parts_of,
)
from transports.actions.server import serve_action

__all__ = [
    "RESULT_TIMEOUT_S",
    "STATUS_CODES",
    "ActionParts",
    "CancelRequest",
    "CancelResponse",
    "GoalId",
    "GoalInfo",
    "GoalStatusArray",
    "GoalStatusEntry",
    "SimpleActionClient",
    "Time",
    "action_client",
    "parts_of",
    "serve_action",
]
