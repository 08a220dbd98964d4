"""What an observation means to a machine: an input, an output, or nothing.

Where both ends of a call are heard, the machine's own end counts (design, section 6): requests it
received and responses it sent for what it serves, requests it sent and responses it received for what
it calls. Those and what it publishes come from one process and are totally ordered by their stamps.
Messages of others on its topics are not ordered against them.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
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
        droppable: whether the machine may never have got it (set by the oracle).
        observation: what was observed.
    """

    __slots__ = (
        "_base",
        "_perhaps",
        "call",
        "data",
        "droppable",
        "event",
        "goal",
        "interface",
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
        self._base: Fact | None = None
        self._perhaps: Fact | None = None

    @property
    def lane(self) -> tuple[str, str]:
        """Source and channel: facts of one lane keep their order."""
        return (self.observation.source, self.observation.channel)

    @property
    def base(self) -> Fact:
        """The fact itself, where this is one that was perhaps taken already."""
        return self._base or self  # not kept as a reference to itself: that would be a cycle

    def perhaps(self) -> Fact:
        """The same fact for a hypothesis in which it may have been taken already."""
        if self.droppable:
            return self
        if self._perhaps is None:
            twin = copy.copy(self)
            twin.droppable, twin._base = True, self
            self._perhaps = twin
        return self._perhaps


Reader = Callable[[Observation], Fact | None]
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

    @property
    def hears_others(self) -> bool:
        """Whether the machine takes what others publish: only its own node stamps all the rest."""
        return any(
            port.kind is InterfaceKind.SUBSCRIBER or port.part == "feedback"
            for ports in self.ports.values()
            for port in ports
            if port.kind in (InterfaceKind.SUBSCRIBER, InterfaceKind.ACTION_CLIENT)
        )

    def name_of(self, kind: InterfaceKind, interface: str) -> str:
        """The name under which the channel of ``interface`` is known: one per channel and kind."""
        return self.aliases.get((kind, interface), interface)

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether observations like this can mean anything to the machine."""
        return source == self.node or bool(self.readers(channel, source, kind))

    def readers(self, channel: str, source: str, kind: ObservationKind) -> tuple[Reader, ...]:
        """What makes facts of the observations of one source, channel and kind."""
        ports = self.ports.get(channel)
        own = source == self.node
        if own and kind in _SENDINGS and self._is_strange(channel, ports, kind):
            return (_strange,)
        made = (self._reader(port, kind, own) for port in ports or ())
        return tuple(reader for reader in made if reader is not None)

    def _is_strange(self, channel: str, ports: list[Port] | None, kind: ObservationKind) -> bool:
        """Whether the machine's model has no words for its sending this."""
        if ports is None:
            return not channel.startswith(MIDDLEWARE_CHANNELS) and not channel.endswith(
                MIDDLEWARE_ENDINGS
            )
        serves_only = all(port.kind is InterfaceKind.SERVER for port in ports)
        return serves_only and kind is ObservationKind.REQUEST_SENT

    def _reader(self, port: Port, kind: ObservationKind, own: bool) -> Reader | None:
        name, template = port.interface, port.template
        match port.kind:
            case InterfaceKind.SUBSCRIBER if kind is ObservationKind.MESSAGE:
                return _taking(Role.MESSAGE, name, EventKind.MESSAGE, template)
            case InterfaceKind.PUBLISHER if own and kind is ObservationKind.MESSAGE:
                return _giving(name, OutputKind.PUBLISH, template)
            case InterfaceKind.SERVER:
                return _served(name, kind, own, template)
            case InterfaceKind.CLIENT if own:
                return self._called(name, kind, template)
            case InterfaceKind.ACTION_SERVER if own:
                return self._of_action(port, kind, _of_action_server)
            case InterfaceKind.ACTION_SERVER:
                asked = port.part == "send_goal" and kind is ObservationKind.REQUEST_SENT
                return _asking(name) if asked else None
            case InterfaceKind.ACTION_CLIENT if own or (
                port.part == "feedback" and kind is ObservationKind.MESSAGE
            ):
                return self._of_action(port, kind, _of_action_client)
        return None

    def _called(self, name: str, kind: ObservationKind, template: Any) -> Reader | None:
        node = self.node
        if kind is ObservationKind.REQUEST_SENT:

            def sent(seen: Observation) -> Fact | None:
                if seen.client != node:
                    return None
                return Fact(seen, Role.OUTPUT, name, None, OutputKind.REQUEST, seen.data)

            return sent
        if kind is not ObservationKind.RESPONSE_RECEIVED:
            return None
        answer, failure = (EventKind.RESPONSE, name), (EventKind.CALL_ERROR, name)

        def received(seen: Observation) -> Fact | None:
            if seen.client != node:
                return None
            if seen.error:
                return Fact(seen, Role.INPUT, name, failure)
            return Fact(seen, Role.INPUT, name, answer, None, complete(seen.data, template))

        return received

    def _of_action(
        self, port: Port, kind: ObservationKind, read: Callable[[Port, Observation], Fact | None]
    ) -> Reader:
        if kind is ObservationKind.MESSAGE:
            return lambda seen: read(port, seen)

        def remembering(seen: Observation) -> Fact | None:
            fact = read(port, seen)
            if fact is not None:
                self._remember_goal(fact)
            return fact

        return remembering

    def _remember_goal(self, fact: Fact) -> None:
        """Responses of an action's services do not name their goal; their requests do."""
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


def _strange(seen: Observation) -> Fact:
    return Fact(seen, Role.STRANGE)


def _asking(name: str) -> Reader:
    return lambda seen: Fact(seen, Role.ASKED, name)


def _taking(role: Role, name: str, kind: EventKind, template: Any) -> Reader:
    event = (kind, name)
    return lambda seen: Fact(seen, role, name, event, None, complete(seen.data, template))


def _giving(name: str, kind: OutputKind, template: Any) -> Reader:
    return lambda seen: Fact(seen, Role.OUTPUT, name, None, kind, complete(seen.data, template))


def _served(name: str, kind: ObservationKind, own: bool, template: Any) -> Reader | None:
    match kind:
        case ObservationKind.REQUEST_RECEIVED if own:
            return _taking(Role.INPUT, name, EventKind.REQUEST, template)
        case ObservationKind.RESPONSE_SENT if own:
            return _answering(name)
        case ObservationKind.REQUEST_SENT if not own:
            return _asking(name)
    return None


def _answering(name: str) -> Reader:
    def answer(seen: Observation) -> Fact | None:
        if seen.error:
            return None  # the transport refuses a request that is none
        return Fact(seen, Role.OUTPUT, name, None, OutputKind.RESPONSE, seen.data)

    return answer


_ENDS = {4: OutputKind.SUCCEED, 5: OutputKind.CANCEL, 6: OutputKind.ABORT}
"""action_msgs/msg/GoalStatus: how a goal can end."""
_ENDED = {4: EventKind.SUCCEEDED, 5: EventKind.CANCELED, 6: EventKind.ABORTED}


def _of_action_server(port: Port, observation: Observation) -> Fact | None:
    data, name = observation.data, port.interface
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


def _of_action_client(port: Port, observation: Observation) -> Fact | None:
    data, name = observation.data, port.interface
    if port.part == "feedback" and observation.kind is ObservationKind.MESSAGE:
        feedback = complete(data["feedback"], port.template)
        event = (EventKind.FEEDBACK, name)
        return Fact(observation, Role.MESSAGE, name, event, None, feedback, goal_id(data))
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
