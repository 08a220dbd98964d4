"""Verdicts as messages on a topic, so that other components can react to them."""

from __future__ import annotations

from typing import ClassVar

import msgspec

from moon.verdict import Verdict
from transports.interface import Listener, Topic

VERDICTS_CHANNEL = "/moon/verdicts"


class EvidenceMessage(msgspec.Struct):
    """One observation that led to a verdict (moon_msgs/msg/Evidence)."""

    __type_name__: ClassVar[str] = "moon_msgs/msg/Evidence"
    stamp_ns: int = 0
    text: str = ""


class DifferenceMessage(msgspec.Struct):
    """The first field that differs (moon_msgs/msg/Difference), as :class:`moon.verdict.Difference` has it."""

    __type_name__: ClassVar[str] = "moon_msgs/msg/Difference"
    path: str = ""
    expected: str = ""
    observed: str = ""


class VerdictMessage(msgspec.Struct):
    """A verdict with its explanation, as :class:`moon.verdict.Verdict` and ``Explanation`` have it."""

    __type_name__: ClassVar[str] = "moon_msgs/msg/Verdict"
    machine: str = ""
    node: str = ""
    outcome: str = ""
    stamp_ns: int = 0
    reason: str = ""
    expected: list[str] = msgspec.field(default_factory=list)
    observed: str = ""
    states: list[str] = msgspec.field(default_factory=list)
    evidence: list[EvidenceMessage] = msgspec.field(default_factory=list)
    places: list[str] = msgspec.field(default_factory=list)
    channel: str = ""
    differences: list[DifferenceMessage] = msgspec.field(default_factory=list)
    cause: str = ""


VERDICTS = Topic(VERDICTS_CHANNEL, VerdictMessage.__type_name__, VerdictMessage)


def message_of(verdict: Verdict) -> VerdictMessage:
    """``verdict`` as a message; without an explanation, its fields are empty."""
    message = VerdictMessage(
        verdict.machine, verdict.node, str(verdict.outcome), verdict.stamp_ns, verdict.reason
    )
    if verdict.cause is not None:
        message.cause = str(verdict.cause)
    if (why := verdict.explanation) is not None:
        message.expected = list(why.expected)
        message.observed = why.observed
        message.states = list(why.states)
        message.evidence = [EvidenceMessage(item.stamp_ns, item.text) for item in why.evidence]
        message.places = list(why.places)
        message.channel = why.channel
        message.differences = [
            DifferenceMessage(item.path, item.expected, item.observed) for item in why.differences
        ]
    return message


class VerdictTopic:
    """Publishes verdicts over ``transport``."""

    def __init__(self, transport: Listener) -> None:
        self._publisher = transport.publisher(VERDICTS)

    def take(self, verdict: Verdict) -> None:
        """Publish ``verdict``."""
        self._publisher.publish(message_of(verdict))

    def close(self) -> None:
        """The transport closes its publisher."""
