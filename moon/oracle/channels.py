"""What an observation means to a machine: an input, an output, or nothing.

Where both ends of a call are heard, the machine's own end counts (design, section 6): requests it
received and responses it sent for what it serves, requests it sent and responses it received for what
it calls. Those and what it publishes come from one process and are totally ordered by their stamps.
Messages of others on its topics are not ordered against them.
"""

from __future__ import annotations

import copy
from enum import IntEnum
from typing import Any

from m2c.model.datatypes import DataType, Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import EventKind, InterfaceKind, Machine, OutputKind
from moon.oracle.expressions import zero
from transports.interface import Observation, ObservationKind

EventKey = tuple[EventKind, str]

MIDDLEWARE_CHANNELS = ("/rosout", "/parameter_events", "/policy/ticks", "/moon/")
"""Beginnings of channels that nodes use without their models saying so."""

MIDDLEWARE_ENDINGS = (
    "/describe_parameters",
    "/get_parameter_types",
    "/get_parameters",
    "/list_parameters",
    "/set_parameters",
    "/set_parameters_atomically",
    "/get_type_description",
)
"""Ends of services that every ROS 2 node has."""


_KEPT_CALLS = 512
"""Calls of an action's services of which the goal is remembered."""


_SENDINGS = (
    ObservationKind.MESSAGE,
    ObservationKind.REQUEST_SENT,
    ObservationKind.RESPONSE_SENT,
)


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
    STRANGE = 6
    """Something the machine sent where its model says nothing."""


class Fact:
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
        lane: source and channel: facts of one lane keep their order.
        droppable: whether the machine may never have got it (set by the oracle).
        observation: what was observed.
        base: the fact itself, where this is one that was perhaps taken already.
    """

    __slots__ = (
        "_perhaps",
        "base",
        "call",
        "data",
        "droppable",
        "event",
        "goal",
        "interface",
        "lane",
        "observation",
        "output",
        "role",
        "stamp",
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
        self.droppable = False
        self.base = self
        self._perhaps: Fact | None = None
        self.lane = (observation.source, observation.channel)

    def perhaps(self) -> Fact:
        """The same fact for a hypothesis in which it may have been taken already."""
        if self.droppable:
            return self
        if self._perhaps is None:
            twin = copy.copy(self)
            twin.droppable, twin.base = True, self
            self._perhaps = twin
        return self._perhaps


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


class Channels:
    """The channels of one machine and what observations on them mean.

    Args:
        machine: the model.
        library: its message types.
        node: name of the node that runs it.
    """

    def __init__(self, machine: Machine, library: InterfaceLibrary, node: str) -> None:
        self.node = node
        self.ports: dict[str, list[Port]] = {}
        self.types: dict[tuple[OutputKind, str], DataType | None] = {}
        """Type of the message of each output."""
        self.aliases: dict[tuple[InterfaceKind, str], str] = {}
        self._goals: dict[tuple[str, str, int], str] = {}
        self._sent: dict[str, None] = {}
        for interface in machine.interfaces:
            channel, name, kind = interface.channel, interface.name, interface.kind
            if channel is None:
                continue
            match kind:
                case InterfaceKind.PUBLISHER | InterfaceKind.SUBSCRIBER:
                    message = library.message(interface.type_name)
                    self._add(channel, Port(kind, name, "", message))
                    self.types[OutputKind.PUBLISH, name] = message
                case InterfaceKind.SERVER | InterfaceKind.CLIENT:
                    service = library.service(interface.type_name)
                    serves = kind is InterfaceKind.SERVER
                    self._add(
                        channel,
                        Port(kind, name, "", service.request if serves else service.response),
                    )
                    self.types[OutputKind.RESPONSE, name] = service.response
                    self.types[OutputKind.REQUEST, name] = service.request
                case InterfaceKind.ACTION_SERVER | InterfaceKind.ACTION_CLIENT:
                    action = library.action(interface.type_name)
                    for part in ("send_goal", "cancel_goal", "get_result", "feedback", "status"):
                        inner = {
                            "send_goal": action.goal,
                            "get_result": action.result,
                            "feedback": action.feedback,
                        }.get(part)
                        self._add(f"{channel}/_action/{part}", Port(kind, name, part, inner))
                    self.types[OutputKind.SEND_GOAL, name] = action.goal
                    self.types[OutputKind.FEEDBACK, name] = action.feedback
                    for output in (OutputKind.SUCCEED, OutputKind.ABORT, OutputKind.CANCEL):
                        self.types[output, name] = action.result

    def _add(self, channel: str, port: Port) -> None:
        ports = self.ports.setdefault(channel, [])
        for known in ports:
            if known.kind is port.kind and port.kind is not InterfaceKind.SUBSCRIBER:
                self.aliases[port.kind, port.interface] = known.interface
                return
        ports.append(port)

    def name_of(self, kind: InterfaceKind, interface: str) -> str:
        """The name under which the channel of ``interface`` is known: one per channel and kind."""
        return self.aliases.get((kind, interface), interface)

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether observations like this can mean anything to the machine."""
        ports = self.ports.get(channel)
        if source == self.node:
            return True
        if ports is None:
            return False
        if kind is ObservationKind.MESSAGE:
            return any(
                port.kind is InterfaceKind.SUBSCRIBER or port.part == "feedback" for port in ports
            )
        serves = any(
            port.kind is InterfaceKind.SERVER
            or (port.kind is InterfaceKind.ACTION_SERVER and port.part == "send_goal")
            for port in ports
        )
        return serves and kind is ObservationKind.REQUEST_SENT

    def facts(self, observation: Observation) -> list[Fact]:
        """What ``observation`` is to the machine: usually one fact or none."""
        ports = self.ports.get(observation.channel)
        own = observation.source == self.node
        if ports is None:
            if own and self._is_strange(observation):
                return [Fact(observation, Role.STRANGE)]
            return []
        facts: list[Fact] = []
        for port in ports:
            fact = self._fact(port, observation, own)
            if fact is not None:
                if port.part:
                    self._remember_goal(fact)
                facts.append(fact)
        serves_only = all(port.kind is InterfaceKind.SERVER for port in ports)
        if own and serves_only and observation.kind is ObservationKind.REQUEST_SENT:
            return [Fact(observation, Role.STRANGE)]
        return facts

    def _remember_goal(self, fact: Fact) -> None:
        """Responses of an action's services do not name their goal; their requests do."""
        if fact.observation.kind is ObservationKind.MESSAGE:
            return
        place = (fact.observation.channel, *fact.call)
        if fact.goal:
            self._goals[place] = fact.goal
            if fact.output is OutputKind.SEND_GOAL:
                self._sent[fact.goal] = None
                if len(self._sent) > _KEPT_CALLS:
                    del self._sent[next(iter(self._sent))]
            if len(self._goals) > _KEPT_CALLS:
                del self._goals[next(iter(self._goals))]
        else:
            fact.goal = self._goals.get(place, "")

    def forget_goals(self) -> None:
        """From here on, goals that were sent before may or may not be under way."""
        self._sent.clear()

    def was_sent(self, goal: str) -> bool:
        """Whether the machine was heard sending this goal since its past is known."""
        return goal in self._sent

    def _is_strange(self, observation: Observation) -> bool:
        if observation.kind not in _SENDINGS:
            return False
        channel = observation.channel
        return not channel.startswith(MIDDLEWARE_CHANNELS) and not channel.endswith(
            MIDDLEWARE_ENDINGS
        )

    def _fact(self, port: Port, observation: Observation, own: bool) -> Fact | None:
        kind, name = observation.kind, port.interface
        match port.kind:
            case InterfaceKind.SUBSCRIBER:
                if kind is ObservationKind.MESSAGE:
                    data = complete(observation.data, port.template)
                    return Fact(
                        observation, Role.MESSAGE, name, (EventKind.MESSAGE, name), None, data
                    )
            case InterfaceKind.PUBLISHER:
                if own and kind is ObservationKind.MESSAGE:
                    data = complete(observation.data, port.template)
                    return Fact(observation, Role.OUTPUT, name, None, OutputKind.PUBLISH, data)
            case InterfaceKind.SERVER:
                return self._served(port, observation, own)
            case InterfaceKind.CLIENT:
                return self._called(port, observation, own)
            case InterfaceKind.ACTION_SERVER:
                return _of_action_server(port, observation, own)
            case InterfaceKind.ACTION_CLIENT:
                return _of_action_client(port, observation, own)
        return None

    def _served(self, port: Port, observation: Observation, own: bool) -> Fact | None:
        name = port.interface
        match observation.kind:
            case ObservationKind.REQUEST_RECEIVED if own:
                data = complete(observation.data, port.template)
                return Fact(observation, Role.INPUT, name, (EventKind.REQUEST, name), None, data)
            case ObservationKind.RESPONSE_SENT if own:
                if observation.error:
                    return None  # the transport refuses a request that is none
                return Fact(
                    observation, Role.OUTPUT, name, None, OutputKind.RESPONSE, observation.data
                )
            case ObservationKind.REQUEST_SENT if observation.source != self.node:
                return Fact(observation, Role.ASKED, name)
        return None

    def _called(self, port: Port, observation: Observation, own: bool) -> Fact | None:
        if not own or observation.client != self.node:
            return None
        name = port.interface
        match observation.kind:
            case ObservationKind.REQUEST_SENT:
                return Fact(
                    observation, Role.OUTPUT, name, None, OutputKind.REQUEST, observation.data
                )
            case ObservationKind.RESPONSE_RECEIVED:
                if observation.error:
                    return Fact(observation, Role.INPUT, name, (EventKind.CALL_ERROR, name))
                data = complete(observation.data, port.template)
                return Fact(observation, Role.INPUT, name, (EventKind.RESPONSE, name), None, data)
        return None


_ENDS = {4: OutputKind.SUCCEED, 5: OutputKind.CANCEL, 6: OutputKind.ABORT}
"""action_msgs/msg/GoalStatus: how a goal can end."""
_ENDED = {4: EventKind.SUCCEEDED, 5: EventKind.CANCELED, 6: EventKind.ABORTED}


def _of_action_server(port: Port, observation: Observation, own: bool) -> Fact | None:
    data, name = observation.data, port.interface
    if not own:
        asked = port.part == "send_goal" and observation.kind is ObservationKind.REQUEST_SENT
        return Fact(observation, Role.ASKED, name) if asked else None
    match port.part, observation.kind:
        case "send_goal", ObservationKind.REQUEST_RECEIVED:
            goal = complete(data["goal"], port.template)
            event = (EventKind.GOAL, name)
            return Fact(observation, Role.INPUT, name, event, None, goal, goal_id(data))
        case "send_goal", ObservationKind.RESPONSE_SENT if not observation.error:
            kind = OutputKind.ACCEPT_GOAL if data["accepted"] else OutputKind.REJECT_GOAL
            return Fact(observation, Role.OUTPUT, name, None, kind)
        case "cancel_goal", ObservationKind.REQUEST_RECEIVED:
            event = (EventKind.CANCEL, name)
            return Fact(observation, Role.INPUT, name, event, None, data["goal_info"])
        case "get_result", ObservationKind.RESPONSE_SENT if not observation.error:
            kind = _ENDS.get(data["status"], OutputKind.ABORT)
            return Fact(observation, Role.RESULT, name, None, kind, data["result"])
        case "get_result", ObservationKind.REQUEST_RECEIVED:
            return Fact(observation, Role.RESULT, name, None, None, None, goal_id(data))
        case "feedback", ObservationKind.MESSAGE:
            kind = OutputKind.FEEDBACK
            return Fact(observation, Role.OUTPUT, name, None, kind, data["feedback"], goal_id(data))
        case "status", ObservationKind.MESSAGE:
            ends = [
                (identifier(entry["goal_info"]["goal_id"]), _ENDS[entry["status"]])
                for entry in data["status_list"]
                if entry["status"] in _ENDS
            ]
            return Fact(observation, Role.STATUS, name, None, None, ends)
    return None


def _of_action_client(port: Port, observation: Observation, own: bool) -> Fact | None:
    data, name = observation.data, port.interface
    if port.part == "feedback" and observation.kind is ObservationKind.MESSAGE:
        feedback = complete(data["feedback"], port.template)
        event = (EventKind.FEEDBACK, name)
        return Fact(observation, Role.MESSAGE, name, event, None, feedback, goal_id(data))
    if not own:
        return None
    match port.part, observation.kind:
        case "send_goal", ObservationKind.REQUEST_SENT:
            kind = OutputKind.SEND_GOAL
            return Fact(observation, Role.OUTPUT, name, None, kind, data["goal"], goal_id(data))
        case "send_goal", ObservationKind.RESPONSE_RECEIVED:
            accepted = not observation.error and data["accepted"]
            kind_of = EventKind.GOAL_ACCEPTED if accepted else EventKind.GOAL_REJECTED
            return Fact(observation, Role.INPUT, name, (kind_of, name))
        case "cancel_goal", ObservationKind.REQUEST_SENT:
            kind = OutputKind.SEND_CANCEL
            return Fact(
                observation, Role.OUTPUT, name, None, kind, None, goal_id(data["goal_info"])
            )
        case "get_result", ObservationKind.REQUEST_SENT:
            return Fact(observation, Role.RESULT, name, None, None, None, goal_id(data))
        case "get_result", ObservationKind.RESPONSE_RECEIVED:
            ended = None if observation.error else _ENDED.get(data["status"])
            if ended is None:
                return Fact(observation, Role.INPUT, name, (EventKind.GOAL_REJECTED, name))
            result = complete(data["result"], port.template)
            return Fact(observation, Role.INPUT, name, (ended, name), None, result)
    return None


def goal_id(data: Any) -> str:
    """The id of the goal that a part of an action is about."""
    return identifier(data["goal_id"])


def identifier(wire: Any) -> str:
    """A ``unique_identifier_msgs/msg/UUID`` as 32 hex digits."""
    return bytes(octet & 0xFF for octet in wire["uuid"]).hex()


def complete(data: Any, template: Any) -> Any:
    """``data`` with zero values for fields that its sender left out."""
    if template is None or data is None:
        return template if data is None else data
    if len(data) == len(template):
        return data
    return {**template, **data}
