"""What an observation means to a machine: an input, an output, or nothing.

Where both ends of a call are heard, the machine's own end counts (design, section 6): requests it
received and responses it sent for what it serves, requests it sent and responses it received for what
it calls. Those and what it publishes come from one process and are totally ordered by their stamps.
Messages of others on its topics are not ordered against them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from m2c.model.datatypes import DataType
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import EventKind, InterfaceKind, Machine, OutputKind
from moon.oracle.trace_events import (
    Port,
    Reader,
    Role,
    TraceEvent,
    answered,
    at_the_server,
    complete,
    giving,
    of_action_client,
    of_action_server,
    served,
    strange,
    taking,
    took,
)
from transports.interface import Observation, ObservationKind

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

AT_THE_SERVER = (ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT)


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
    def is_plain(self) -> bool:
        """Whether each topic that the machine takes is one interface: a message is one input then."""
        counts = (
            sum(port.kind is InterfaceKind.SUBSCRIBER for port in ports)
            for ports in self.ports.values()
        )
        return max(counts, default=0) <= 1

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
            return (strange,)
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
                return taking(Role.MESSAGE, name, EventKind.MESSAGE, template)
            case InterfaceKind.SUBSCRIBER if own and kind is ObservationKind.MESSAGE_TAKEN:
                return took(name)
            case InterfaceKind.PUBLISHER if own and kind is ObservationKind.MESSAGE:
                return giving(name, OutputKind.PUBLISH, template)
            case InterfaceKind.SERVER:
                return served(name, kind, own, template)
            case InterfaceKind.CLIENT if own:
                return self._called(name, kind, template)
            case InterfaceKind.ACTION_SERVER if own:
                return self._of_action(port, kind, of_action_server)
            case InterfaceKind.CLIENT if kind in AT_THE_SERVER:
                return at_the_server(name, self.node)
            case InterfaceKind.ACTION_SERVER if port.part == "send_goal":
                return served(name, kind, own, template)
            case InterfaceKind.ACTION_SERVER if kind is ObservationKind.RESPONSE_RECEIVED:
                return answered(name)
            case InterfaceKind.ACTION_CLIENT if own or (
                port.part == "feedback" and kind is ObservationKind.MESSAGE
            ):
                return self._of_action(port, kind, of_action_client)
            case InterfaceKind.ACTION_CLIENT if kind in AT_THE_SERVER:
                return at_the_server(name, self.node)
        return None

    def _called(self, name: str, kind: ObservationKind, template: Any) -> Reader | None:
        node = self.node
        if kind is ObservationKind.REQUEST_SENT:

            def sent(seen: Observation) -> TraceEvent | None:
                if seen.client != node:
                    return None
                return TraceEvent(seen, Role.OUTPUT, name, None, OutputKind.REQUEST, seen.data)

            return sent
        if kind is not ObservationKind.RESPONSE_RECEIVED:
            return None
        answer, failure = (EventKind.RESPONSE, name), (EventKind.CALL_ERROR, name)

        def received(seen: Observation) -> TraceEvent | None:
            if seen.client != node:
                return None
            if seen.error:
                return TraceEvent(seen, Role.INPUT, name, failure)
            return TraceEvent(seen, Role.INPUT, name, answer, None, complete(seen.data, template))

        return received

    def _of_action(
        self,
        port: Port,
        kind: ObservationKind,
        read: Callable[[Port, Observation], TraceEvent | None],
    ) -> Reader:
        if kind is ObservationKind.MESSAGE:
            return lambda seen: read(port, seen)

        def remembering(seen: Observation) -> TraceEvent | None:
            fact = read(port, seen)
            if fact is not None:
                self._remember_goal(fact)
            return fact

        return remembering

    def _remember_goal(self, fact: TraceEvent) -> None:
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
