"""QoS profiles: what a channel asks of DDS, and what a tap asks so that it receives who is there."""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from transports.interface import Reliability, Topic

DEPTH = 1000
"""Messages kept for a reader that does not keep up. ROS 2's usual 10 lose most of a burst, and
keeping all would have a slow reader hold up who publishes."""
_INFINITE = 2**63 - 1
TRANSIENT_LOCAL_DEPTH = 1
"""Who comes late gets the last message."""
TAP_DEPTH = 5000


def profile(reliable: bool, transient_local: bool, depth: int) -> QoSProfile:
    """A profile that keeps the last ``depth`` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL
        if transient_local
        else DurabilityPolicy.VOLATILE,
    )


def of_publisher(topic: Topic) -> QoSProfile:
    """What a publisher of ``topic`` offers."""
    reliable = topic.reliability is Reliability.RELIABLE
    return profile(
        reliable, topic.transient_local, TRANSIENT_LOCAL_DEPTH if topic.transient_local else DEPTH
    )


def of_subscription(topic: Topic) -> QoSProfile:
    """What a subscription of ``topic`` asks for."""
    return profile(topic.reliability is Reliability.RELIABLE, topic.transient_local, DEPTH)


def to_receive_all(offered: Iterable[Any]) -> QoSProfile:
    """The most that every publisher of a topic offers.

    Args:
        offered: the publishers' endpoint infos (``Node.get_publishers_info_by_topic``).
    """
    profiles = [info.qos_profile for info in offered]
    return profile(
        all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles),
        bool(profiles) and all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles),
        TAP_DEPTH,
    )


def mismatch(offered: QoSProfile, requested: QoSProfile) -> str:
    """Why a subscription that asks for ``requested`` cannot receive from a publisher; empty if it can.

    What DDS compares (https://docs.ros.org/en/jazzy/Concepts/Intermediate/
    About-Quality-of-Service-Settings.html); the graph shows infinite durations as such, a profile
    written in Python as 0.
    """
    reasons = []
    for what, weaker, stronger in _ORDERED:
        asked_for, given_as = getattr(requested, what), getattr(offered, what)
        if given_as == weaker and asked_for == stronger:
            reasons.append(f"{_words(stronger)} {what} is asked for, {_words(weaker)} is offered")
    for what in ("deadline", "liveliness_lease_duration"):
        asked, given = _nanoseconds(requested, what), _nanoseconds(offered, what)
        if asked < given:
            reasons.append(f"a {what.replace('_', ' ')} of {asked / 1e9:g} s is asked for")
    return ", ".join(reasons)


def expires(offered: QoSProfile) -> bool:
    """Whether messages that nobody has taken within some time are dropped."""
    return _nanoseconds(offered, "lifespan") < _INFINITE


_ORDERED: tuple[tuple[str, Any, Any], ...] = (
    ("reliability", ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE),
    ("durability", DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL),
    ("liveliness", LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC),
)
"""Policy, and of its values the one that is not enough for who asks for the other."""


def _words(value: Any) -> str:
    return str(value.name).lower().replace("_", " ")


def _nanoseconds(found: QoSProfile, what: str) -> int:
    value: int = getattr(found, what).nanoseconds
    return value or _INFINITE
