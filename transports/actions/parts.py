"""An action as services and topics, with the messages that ROS 2 gives them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, ClassVar

import msgspec

from transports.interface import (
    Action,
    GoalStatus,
    Message,
    Service,
    Topic,
)

STATUS_CODES = {
    GoalStatus.ACCEPTED: 1,
    GoalStatus.EXECUTING: 2,
    GoalStatus.CANCELING: 3,
    GoalStatus.SUCCEEDED: 4,
    GoalStatus.CANCELED: 5,
    GoalStatus.ABORTED: 6,
}
"""action_msgs/msg/GoalStatus."""
STATUS_OF = {code: status for status, code in STATUS_CODES.items()}


SERVICES = ("send_goal", "cancel_goal", "get_result")
TOPICS = ("feedback", "status")
"""The parts of an action, as they are called below it."""


def channel_of_part(action: str, part: str) -> str:
    """``/drive/_action/feedback`` of ``/drive`` and ``feedback``."""
    return f"{action}/_action/{part}"


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
    name_of = functools.partial(channel_of_part, action.name)
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
            name_of("send_goal"),
            f"{kind}_SendGoal",
            message("SendGoal_Request", ("goal_id", GoalId), ("goal", action.goal)),
            message("SendGoal_Response", ("accepted", bool), ("stamp", Time)),
        ),
        Service(
            name_of("cancel_goal"), "action_msgs/srv/CancelGoal", CancelRequest, CancelResponse
        ),
        Service(
            name_of("get_result"),
            f"{kind}_GetResult",
            message("GetResult_Request", ("goal_id", GoalId)),
            message("GetResult_Response", ("status", int), ("result", action.result)),
        ),
        Topic(
            name_of("feedback"),
            f"{kind}_FeedbackMessage",
            message("FeedbackMessage", ("goal_id", GoalId), ("feedback", action.feedback)),
        ),
        Topic(
            name_of("status"),
            "action_msgs/msg/GoalStatusArray",
            GoalStatusArray,
            transient_local=True,
        ),
    )


def wire_id(goal_id: str) -> GoalId:
    """``goal_id`` as it travels."""
    return GoalId(list(bytes.fromhex(goal_id)))


def hex_id(wire: GoalId) -> str:
    """The goal id that travels as ``wire``."""
    return hex_of(wire.uuid)


def hex_of(octets: Sequence[int]) -> str:
    """The octets of a ``unique_identifier_msgs/msg/UUID``, int8 as some write it, as hex digits."""
    return bytes([octet & 0xFF for octet in octets]).hex()
