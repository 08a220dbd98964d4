"""QoS profiles: what a channel asks of DDS, and what a tap asks to hear who is there."""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)

from transports.interface import Reliability, Topic

DEPTH = 1000
"""Messages kept for a reader that does not keep up. ROS 2's usual 10 lose most of a burst, and
keeping all would have a slow reader hold up who publishes."""
LATCHED_DEPTH = 1
"""Who comes late gets the last message."""
TAP_DEPTH = 5000


def profile(reliable: bool, latched: bool, depth: int) -> QoSProfile:
    """A profile that keeps the last ``depth`` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def of_publisher(topic: Topic) -> QoSProfile:
    """What a publisher of ``topic`` offers."""
    reliable = topic.reliability is Reliability.RELIABLE
    return profile(reliable, topic.latched, LATCHED_DEPTH if topic.latched else DEPTH)


def of_subscription(topic: Topic) -> QoSProfile:
    """What a subscription of ``topic`` asks for."""
    return profile(topic.reliability is Reliability.RELIABLE, topic.latched, DEPTH)


def to_hear_all(offered: Iterable[Any]) -> QoSProfile:
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
    """Why a subscription that asks for ``requested`` cannot hear a publisher; empty if it can."""
    compatible, reason = qos_check_compatible(offered, requested)
    return reason if compatible == QoSCompatibility.ERROR else ""
