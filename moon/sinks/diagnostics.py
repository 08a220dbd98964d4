"""Verdicts as ROS 2 diagnostics, so that the robot's own dashboards show them.

REP 107: ``/diagnostics`` carries a status per component, repeated about once a second; an aggregator
takes what is silent for stale.
"""

from __future__ import annotations

from enum import IntEnum
from typing import ClassVar

import msgspec

from moon.verdict import Outcome, Verdict
from transports.interface import Listener, Topic

DIAGNOSTICS_CHANNEL = "/diagnostics"
REPEAT_S = 1.0
"""How often every status is sent again."""
_NS = 10**9


class Level(IntEnum):
    """``diagnostic_msgs/msg/DiagnosticStatus``'s levels."""

    OK = 0
    WARN = 1
    ERROR = 2


class Time(msgspec.Struct):
    """``builtin_interfaces/msg/Time``."""

    __type_name__: ClassVar[str] = "builtin_interfaces/msg/Time"
    sec: int = 0
    nanosec: int = 0


class Header(msgspec.Struct):
    """``std_msgs/msg/Header``."""

    __type_name__: ClassVar[str] = "std_msgs/msg/Header"
    stamp: Time = msgspec.field(default_factory=Time)
    frame_id: str = ""


class KeyValue(msgspec.Struct):
    """``diagnostic_msgs/msg/KeyValue``."""

    __type_name__: ClassVar[str] = "diagnostic_msgs/msg/KeyValue"
    key: str = ""
    value: str = ""


class DiagnosticStatus(msgspec.Struct):
    """``diagnostic_msgs/msg/DiagnosticStatus``."""

    __type_name__: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticStatus"
    level: int = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: list[KeyValue] = msgspec.field(default_factory=list)


class DiagnosticArray(msgspec.Struct):
    """``diagnostic_msgs/msg/DiagnosticArray``."""

    __type_name__: ClassVar[str] = "diagnostic_msgs/msg/DiagnosticArray"
    header: Header = msgspec.field(default_factory=Header)
    status: list[DiagnosticStatus] = msgspec.field(default_factory=list)


DIAGNOSTICS = Topic(DIAGNOSTICS_CHANNEL, DiagnosticArray.__type_name__, DiagnosticArray)


def status_of(verdict: Verdict, violations: int) -> DiagnosticStatus:
    """``verdict`` as a status.

    A machine that conforms again after it was in violation is a warning: what it did stands.

    Args:
        verdict: the last one of its machine.
        violations: how many there were of it so far.
    """
    match verdict.outcome:
        case Outcome.VIOLATED:
            level, message = Level.ERROR, verdict.reason
        case Outcome.INCONCLUSIVE:
            level, message = Level.WARN, f"inconclusive: {verdict.reason}"
        case Outcome.CONFORMING:
            level, message = Level.OK, "conforming"
            if violations:
                level, message = Level.WARN, f"conforming again; violated {violations} times before"
    values = [
        KeyValue("outcome", str(verdict.outcome)),
        KeyValue("machine", verdict.machine),
        KeyValue("node", verdict.node),
        KeyValue("stamp_ns", str(verdict.stamp_ns)),
        KeyValue("violations", str(violations)),
    ]
    if (why := verdict.explanation) is not None:
        values += [KeyValue("expected", text) for text in why.expected]
        values.append(KeyValue("observed", why.observed))
        values += [KeyValue("state", text) for text in why.states]
        values += [KeyValue("evidence", item.text) for item in why.evidence]
        values += [KeyValue("place", text) for text in why.places]
    return DiagnosticStatus(level.value, f"moon: {verdict.node}", message, verdict.node, values)


class Diagnostics:
    """Publishes verdicts over ``transport``: each at once, and the last of each node every second.

    Raises:
        TransportError: ``diagnostic_msgs`` is not installed.
    """

    def __init__(self, transport: Listener) -> None:
        self._transport = transport
        self._publisher = transport.publisher(DIAGNOSTICS)
        self._statuses: dict[str, DiagnosticStatus] = {}
        self._violations: dict[str, int] = {}
        transport.every(REPEAT_S, self._repeat)

    def take(self, verdict: Verdict) -> None:
        """Publish ``verdict``."""
        violations = self._violations.get(verdict.node, 0)
        if verdict.outcome is Outcome.VIOLATED:
            violations += 1
            self._violations[verdict.node] = violations
        status = status_of(verdict, violations)
        self._statuses[verdict.node] = status
        self._publish([status])

    def _repeat(self) -> None:
        if self._statuses:
            self._publish(list(self._statuses.values()))

    def _publish(self, statuses: list[DiagnosticStatus]) -> None:
        seconds, nanoseconds = divmod(self._transport.now_ns(), _NS)
        self._publisher.publish(DiagnosticArray(Header(Time(seconds, nanoseconds)), statuses))
