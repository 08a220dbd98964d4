"""What an observation is to a machine: an input, an output, or nothing.

Where both ends of a call are observed, the machine's own end counts (design, section 6): requests it
received and responses it sent for what it serves, requests it sent and responses it received for what
it calls. Those and what it publishes come from one process and are totally ordered by their stamps.
Messages of others on its topics are not ordered against them.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from m2c.model.machine import EventKind, OutputKind
from moon.oracle.calls import Call
from transports.actions.parts import hex_of
from transports.actions.rules import Stamp
from transports.interface import Observation

EventKey = tuple[EventKind, str]


class Role(IntEnum):
    """What an observation is to the machine."""

    MESSAGE = 0
    """An input from a topic: taken at some time after it was sent."""
    INPUT = 1
    """An input stamped where the machine took it."""
    OUTPUT = 2
    """Something the machine sent."""
    STATUS = 3
    """The status of all goals of an action that the machine serves."""
    RESULT = 4
    """The result of a goal, sent to who asked for it."""
    ASKED = 5
    """A request that another node sent to the machine, as that node reports it."""
    ANSWERED = 6
    """The machine's answer to such a request, as that node reports it: the request was taken up."""
    UNDECLARED = 7
    """Something the machine sent where its model says nothing."""
    UNANSWERED = 8
    """Who sent such a request has waited for the answer in vain, as it reports."""
    UNREACHED = 9
    """Who sent such a request knows of nobody who serves it, as it reports."""
    OTHER_END = 10
    """What the server of a call that the machine made reports of it."""
    TAKEN = 11
    """The machine's node took a message of a topic, as it reports; it becomes an INPUT."""


class TraceEvent:
    """An observation, as one machine sees it.

    Attributes:
        stamp: when it happened (ns).
        role: what it is to the machine.
        event: the event it is, for inputs.
        output: the kind of output, for outputs.
        interface: the interface's name.
        data: the message.
        call: which; of a message taken, who published it, its number, and in which life.
        goal: a goal's id (32 hex digits).
        sent: when another node sent it (ns), by that one's report; 0 where that is not known.
        stream: source and channel: the events of one stream keep their order.
        ahead: the clock by which it is stamped may be so far ahead of the machine's (ns).
        is_linked: whether who sent it certainly was linked to the machine's node.
        may_be_lost: whether the machine may never have got it (set by the oracle).
        observation: what was observed.
    """

    __slots__ = (
        "_base",
        "_twin",
        "ahead",
        "call",
        "data",
        "event",
        "goal",
        "interface",
        "is_linked",
        "may_be_lost",
        "observation",
        "output",
        "role",
        "sent",
        "stamp",
        "stream",
    )

    def __init__(
        self,
        observation: Observation,
        role: Role,
        interface: str = "",
        event: EventKey | None = None,
        output: OutputKind | None = None,
        data: Any = None,
        goal: str = "",
    ) -> None:
        self.observation = observation
        self.stamp = observation.stamp_ns
        self.role = role
        self.interface = interface
        self.event = event
        self.output = output
        self.data = data
        self.goal = goal
        self.sent = 0
        self.ahead = 0
        self.call: Call = (observation.client, observation.call, observation.client_life)
        self.stream = (observation.source, observation.channel)
        self.is_linked = True
        self.may_be_lost = False
        self._base: TraceEvent | None = None
        self._twin: TraceEvent | None = None

    @property
    def stamp_ns(self) -> int:
        """When it may have happened first (ns), by the clock of the machine."""
        return self.stamp - self.ahead

    @property
    def base(self) -> TraceEvent:
        """The event itself, where this is one that was perhaps taken already."""
        return self._base or self  # not kept as a reference to itself: that would be a cycle

    def as_may_be_lost(self) -> TraceEvent:
        """The same event for a hypothesis in which it may have been taken already."""
        if self.may_be_lost:
            return self
        if self._twin is None:
            twin = TraceEvent(
                self.observation,
                self.role,
                self.interface,
                event=self.event,
                output=self.output,
                data=self.data,
                goal=self.goal,
            )
            twin.may_be_lost, twin._base = True, self
            self._twin = twin
        return self._twin


def goal_id(data: Any) -> str:
    """The id of the goal that a part of an action is about."""
    return identifier(data["goal_id"])


def identifier(wire: Any) -> str:
    """A ``unique_identifier_msgs/msg/UUID`` as 32 hex digits."""
    return hex_of(wire["uuid"])


def stamp_of(data: Any) -> Stamp:
    """The ``builtin_interfaces/msg/Time`` of a part of an action; fields left out are zero."""
    stamp = data.get("stamp") or {}
    return stamp.get("sec", 0), stamp.get("nanosec", 0)


def complete(data: Any, template: Any) -> Any:
    """``data`` with zero values for fields that its sender left out."""
    if template is None or data is None:
        return template if data is None else data
    if len(data) == len(template):
        return data
    return {**template, **data}
