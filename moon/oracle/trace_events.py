"""What an observation is to a machine: an input, an output, or nothing; and who makes that of it.

``Channels`` chooses the reader of each observation by its source, channel and kind.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any

from m2c.model.datatypes import Structure
from m2c.model.machine import EventKind, InterfaceKind, OutputKind
from m2c.model.values import zero
from transports.interface import CallOutcome, Observation, ObservationKind

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
        "_twin",
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
        self._twin: TraceEvent | None = None

    @property
    def stamp_ns(self) -> int:
        """When it happened, as of an observation."""
        return self.stamp

    @property
    def base(self) -> TraceEvent:
        """The fact itself, where this is one that was perhaps taken already."""
        return self._base or self  # not kept as a reference to itself: that would be a cycle

    def as_may_be_lost(self) -> TraceEvent:
        """The same fact for a hypothesis in which it may have been taken already."""
        if self.may_be_lost:
            return self
        if self._twin is None:
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
            self._twin = twin
        return self._twin


# --- readers --------------------------------------------------------------------------------------

Reader = Callable[[Observation], TraceEvent | None]
"""Makes a fact of an observation, if it is one."""


class Port:
    """One part of an interface: how observations on its channel are read."""

    __slots__ = ("data", "interface", "kind", "part", "template")

    def __init__(
        self, kind: InterfaceKind, interface: str, part: str = "", data: Structure | None = None
    ) -> None:
        self.kind = kind
        self.interface = interface
        self.part = part
        self.data = data
        self.template = None if data is None else zero(data)


def strange(seen: Observation) -> TraceEvent:
    """Something for which the model has no words."""
    return TraceEvent(seen, Role.UNDECLARED)


def asking(name: str) -> Reader:
    """Requests to the machine, as who sends them tells it."""
    return lambda seen: TraceEvent(seen, Role.ASKED, name)


_TIMED_OUT = f"{CallOutcome.TIMEOUT}:"
_REFUSED = f"{CallOutcome.REMOTE_ERROR}:"


def answered(name: str) -> Reader:
    """What the machine answered to them, as who got it tells it, or that no answer came in time.

    An answer may be a refusal: the request was received then. A call that failed otherwise shows nothing.
    """

    def answer(seen: Observation) -> TraceEvent | None:
        if not seen.error or seen.error.startswith(_REFUSED):
            return TraceEvent(seen, Role.ANSWERED, name)
        return (
            TraceEvent(seen, Role.UNANSWERED, name) if seen.error.startswith(_TIMED_OUT) else None
        )

    return answer


def at_the_server(name: str, node: str) -> Reader:
    """What the server of a call tells of it, where ``node`` is its client."""
    return lambda seen: TraceEvent(seen, Role.OTHER_END, name) if seen.client == node else None


def taking(role: Role, name: str, kind: EventKind, template: Any) -> Reader:
    """Inputs; ``template``: zero values of all fields."""
    event = (kind, name)
    return lambda seen: TraceEvent(seen, role, name, event, None, complete(seen.data, template))


def took(name: str) -> Reader:
    """Reports of the machine's node that it took a message of a topic; who published it has the contents."""
    event = (EventKind.MESSAGE, name)
    return lambda seen: TraceEvent(seen, Role.TAKEN, name, event)


def giving(name: str, kind: OutputKind, template: Any) -> Reader:
    """Outputs; ``template``: zero values of all fields."""
    return lambda seen: TraceEvent(
        seen, Role.OUTPUT, name, None, kind, complete(seen.data, template)
    )


def served(name: str, kind: ObservationKind, own: bool, template: Any) -> Reader | None:
    """Events of one kind of a service that the machine serves; ``own``: told by its own node."""
    match kind:
        case ObservationKind.REQUEST_RECEIVED if own:
            return taking(Role.INPUT, name, EventKind.REQUEST, template)
        case ObservationKind.RESPONSE_SENT if own:
            return _answering(name)
        case ObservationKind.REQUEST_SENT if not own:
            return asking(name)
        case ObservationKind.RESPONSE_RECEIVED if not own:
            return answered(name)
    return None


def _answering(name: str) -> Reader:
    def answer(seen: Observation) -> TraceEvent | None:
        if seen.error:
            return None  # the transport refuses a request that is none
        return TraceEvent(seen, Role.OUTPUT, name, None, OutputKind.RESPONSE, seen.data)

    return answer


_ENDS = {4: OutputKind.SUCCEED, 5: OutputKind.CANCEL, 6: OutputKind.ABORT}
"""action_msgs/msg/GoalStatus: how a goal can end."""
_ENDED = {4: EventKind.SUCCEEDED, 5: EventKind.CANCELED, 6: EventKind.ABORTED}


def of_action_server(port: Port, observation: Observation) -> TraceEvent | None:
    """What the node of an action server tells of one part of the action."""
    data, name = observation.data, port.interface
    match port.part, observation.kind:
        case "send_goal", ObservationKind.REQUEST_RECEIVED:
            goal = complete(data["goal"], port.template)
            event = (EventKind.GOAL, name)
            return TraceEvent(observation, Role.INPUT, name, event, None, goal, goal_id(data))
        case "send_goal", ObservationKind.RESPONSE_SENT if not observation.error:
            kind = OutputKind.ACCEPT_GOAL if data["accepted"] else OutputKind.REJECT_GOAL
            return TraceEvent(observation, Role.OUTPUT, name, None, kind)
        case "cancel_goal", ObservationKind.REQUEST_RECEIVED:
            event = (EventKind.CANCEL, name)
            return TraceEvent(observation, Role.INPUT, name, event, None, data["goal_info"])
        case "get_result", ObservationKind.RESPONSE_SENT if not observation.error:
            kind = _ENDS.get(data["status"], OutputKind.ABORT)
            return TraceEvent(observation, Role.RESULT, name, None, kind, data["result"])
        case "get_result", ObservationKind.REQUEST_RECEIVED:
            return TraceEvent(observation, Role.RESULT, name, None, None, None, goal_id(data))
        case "feedback", ObservationKind.MESSAGE:
            kind = OutputKind.FEEDBACK
            return TraceEvent(
                observation, Role.OUTPUT, name, None, kind, data["feedback"], goal_id(data)
            )
        case "status", ObservationKind.MESSAGE:
            ends = [
                (identifier(entry["goal_info"]["goal_id"]), _ENDS[entry["status"]])
                for entry in data["status_list"]
                if entry["status"] in _ENDS
            ]
            return TraceEvent(observation, Role.STATUS, name, None, None, ends)
    return None


def of_action_client(port: Port, observation: Observation) -> TraceEvent | None:
    """What the node of an action client tells of one part of the action; feedback is told by the server's."""
    data, name = observation.data, port.interface
    if port.part == "feedback" and observation.kind is ObservationKind.MESSAGE:
        feedback = complete(data["feedback"], port.template)
        event = (EventKind.FEEDBACK, name)
        return TraceEvent(observation, Role.MESSAGE, name, event, None, feedback, goal_id(data))
    match port.part, observation.kind:
        case "send_goal", ObservationKind.REQUEST_SENT:
            kind = OutputKind.SEND_GOAL
            return TraceEvent(
                observation, Role.OUTPUT, name, None, kind, data["goal"], goal_id(data)
            )
        case "send_goal", ObservationKind.RESPONSE_RECEIVED:
            accepted = not observation.error and data["accepted"]
            kind_of = EventKind.GOAL_ACCEPTED if accepted else EventKind.GOAL_REJECTED
            return TraceEvent(observation, Role.INPUT, name, (kind_of, name))
        case "cancel_goal", ObservationKind.REQUEST_SENT:
            kind = OutputKind.SEND_CANCEL
            return TraceEvent(
                observation, Role.OUTPUT, name, None, kind, None, goal_id(data["goal_info"])
            )
        case "get_result", ObservationKind.REQUEST_SENT:
            return TraceEvent(observation, Role.RESULT, name, None, None, None, goal_id(data))
        case "get_result", ObservationKind.RESPONSE_RECEIVED:
            ended = None if observation.error else _ENDED.get(data["status"])
            if ended is None:
                return TraceEvent(observation, Role.INPUT, name, (EventKind.GOAL_REJECTED, name))
            result = complete(data["result"], port.template)
            return TraceEvent(observation, Role.INPUT, name, (ended, name), None, result)
    return None


def goal_id(data: Any) -> str:
    """The id of the goal that a part of an action is about."""
    return identifier(data["goal_id"])


def identifier(wire: Any) -> str:
    """A ``unique_identifier_msgs/msg/UUID`` as 32 hex digits."""
    octets = wire["uuid"]
    try:
        return bytes(octets).hex()
    except ValueError:  # int8, as some write it
        return bytes(octet & 0xFF for octet in octets).hex()


def complete(data: Any, template: Any) -> Any:
    """``data`` with zero values for fields that its sender left out."""
    if template is None or data is None:
        return template if data is None else data
    if len(data) == len(template):
        return data
    return {**template, **data}
