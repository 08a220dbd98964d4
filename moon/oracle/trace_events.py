"""What an observation is to a machine: an input, an output, or nothing."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from m2c.model.machine import EventKind, OutputKind
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
    """A request that another node sent to the machine, as that node tells it."""
    ANSWERED = 6
    """The machine's answer to such a request, as that node tells it: the request was taken up."""
    UNDECLARED = 7
    """Something the machine sent where its model says nothing."""
    UNANSWERED = 8
    """Who sent such a request has waited for the answer in vain, as it tells."""
    OTHER_END = 9
    """What the server of a call that the machine made tells of it."""
    TAKEN = 10
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
        call: (client, number) of a call.
        goal: a goal's id (32 hex digits).
        stream: source and channel: facts of one stream keep their order.
        may_be_lost: whether the machine may never have got it (set by the oracle).
        observation: what was observed.
    """

    __slots__ = (
        "_base",
        "_perhaps",
        "call",
        "data",
        "event",
        "goal",
        "interface",
        "may_be_lost",
        "observation",
        "output",
        "role",
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
        self.call = (observation.client, observation.call)
        self.stream = (observation.source, observation.channel)
        self.may_be_lost = False
        self._base: TraceEvent | None = None
        self._perhaps: TraceEvent | None = None

    @property
    def base(self) -> TraceEvent:
        """The fact itself, where this is one that was perhaps taken already."""
        return self._base or self  # not kept as a reference to itself: that would be a cycle

    def perhaps(self) -> TraceEvent:
        """The same fact for a hypothesis in which it may have been taken already."""
        if self.may_be_lost:
            return self
        if self._perhaps is None:
            twin = TraceEvent(
                self.observation,
                self.role,
                self.interface,
                self.event,
                self.output,
                self.data,
                self.goal,
            )
            twin.may_be_lost, twin._base = True, self
            self._perhaps = twin
        return self._perhaps
