"""The channels of one machine: who makes trace events of the observations of a source, channel and kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from m2c.language.datatypes import DataType
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import EventKind, InterfaceKind, Machine, OutputKind
from m2c.model.walk import failure_of_goals
from moon.oracle.calls import Call
from moon.oracle.readers import (
    Port,
    Reader,
    answered,
    at_the_server,
    giving,
    is_own_call,
    of_action_client,
    of_action_server,
    served,
    taking,
    took,
    undeclared,
)
from moon.oracle.trace_events import Role, TraceEvent, complete
from transports.actions.parts import SERVICES, TOPICS, channel_of_part
from transports.bounded import BoundedDict
from transports.interface import SERVER_END, Observation, ObservationKind

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


_EITHER = "either"
"""Stands for the goal of a call whose number was used by two lives of its client, which are not known."""


class AmbiguousError(Exception):
    """An observation that may mean either of two things; the text says which."""


_SENDINGS = (
    ObservationKind.MESSAGE,
    ObservationKind.REQUEST_SENT,
    ObservationKind.RESPONSE_SENT,
)


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
        self._goals: BoundedDict[tuple[str, Call], str] = BoundedDict(_KEPT_CALLS)
        self._nameless: BoundedDict[tuple[str, Call], list[TraceEvent]] = BoundedDict(_KEPT_CALLS)
        """Responses whose request was not received yet."""
        self._answered: BoundedDict[tuple[str, Call], None] = BoundedDict(_KEPT_CALLS)
        self._sent: BoundedDict[str, None] = BoundedDict(_KEPT_CALLS)
        self._open_calls: dict[str, dict[Call, None]] = {}
        """By client interface: the calls that have had no response yet."""
        for interface in machine.interfaces:
            channel, name, kind = interface.channel, interface.name, interface.kind
            if channel is None or interface.own:
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
                    failure = failure_of_goals(machine, name)
                    for part in (*SERVICES, *TOPICS):
                        inner = {
                            "send_goal": action.goal,
                            "get_result": action.result,
                            "feedback": action.feedback,
                        }.get(part)
                        here = channel_of_part(channel, part)
                        self._add(here, Port(kind, name, part, inner, failure))
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

    def taken_as(self, channel: str) -> EventKind | None:
        """As which input messages of others on ``channel`` are taken; None: they are none."""
        kinds = {port.kind for port in self.ports.get(channel, ())}
        if InterfaceKind.ACTION_CLIENT in kinds:
            return EventKind.FEEDBACK
        return EventKind.MESSAGE if InterfaceKind.SUBSCRIBER in kinds else None

    def name_of(self, kind: InterfaceKind, interface: str) -> str:
        """The name under which the channel of ``interface`` is known: one per channel and kind."""
        return self.aliases.get((kind, interface), interface)

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether observations like this can mean anything to the machine."""
        return source == self.node or bool(self.readers(channel, source, kind))

    def readers(self, channel: str, source: str, kind: ObservationKind) -> tuple[Reader, ...]:
        """What makes trace events of the observations of one source, channel and kind."""
        ports = self.ports.get(channel)
        own = source == self.node
        if own and kind in _SENDINGS and self._is_undeclared(channel, ports, kind):
            return (undeclared,)
        made = (self._reader(port, kind, own) for port in ports or ())
        return tuple(reader for reader in made if reader is not None)

    def _is_undeclared(self, channel: str, ports: list[Port] | None, kind: ObservationKind) -> bool:
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
                return took(name, EventKind.MESSAGE)
            case InterfaceKind.ACTION_CLIENT if own and kind is ObservationKind.MESSAGE_TAKEN:
                return took(name, EventKind.FEEDBACK) if port.part == "feedback" else None
            case InterfaceKind.PUBLISHER if own and kind is ObservationKind.MESSAGE:
                return giving(name, OutputKind.PUBLISH, template)
            case InterfaceKind.SERVER:
                return served(name, kind, own, template)
            case InterfaceKind.CLIENT if own:
                return self._called(name, kind, template)
            case InterfaceKind.ACTION_SERVER if own:
                return self._of_action(port, kind, of_action_server)
            case InterfaceKind.CLIENT if kind in SERVER_END:
                return at_the_server(name, self.node)
            case InterfaceKind.ACTION_SERVER if port.part == "send_goal":
                return served(name, kind, own, template)
            case InterfaceKind.ACTION_SERVER if kind is ObservationKind.RESPONSE_RECEIVED:
                return answered(name)
            case InterfaceKind.ACTION_CLIENT if own or (
                port.part == "feedback" and kind is ObservationKind.MESSAGE
            ):
                return self._of_action(port, kind, of_action_client)
            case InterfaceKind.ACTION_CLIENT if kind in SERVER_END:
                return at_the_server(name, self.node)
        return None

    def _called(self, name: str, kind: ObservationKind, template: Any) -> Reader | None:
        node = self.node
        if kind is ObservationKind.REQUEST_SENT:

            def asked(seen: Observation) -> TraceEvent | None:
                if not is_own_call(seen, node):
                    return None
                sent = TraceEvent(
                    seen, Role.OUTPUT, name, output=OutputKind.REQUEST, data=seen.data
                )
                waiting = self._open_calls.setdefault(name, {})
                if len(waiting) < _KEPT_CALLS:
                    waiting[sent.call] = None
                return sent

            return asked
        if kind is not ObservationKind.RESPONSE_RECEIVED:
            return None
        answer, failure = (EventKind.RESPONSE, name), (EventKind.CALL_ERROR, name)

        def received(seen: Observation) -> TraceEvent | None:
            if not is_own_call(seen, node):
                return None
            if seen.error:
                ended = TraceEvent(seen, Role.INPUT, name, failure)
            else:
                data = complete(seen.data, template)
                ended = TraceEvent(seen, Role.INPUT, name, event=answer, data=data)
            waiting = self._open_calls.get(name, {})
            if len(waiting) < _KEPT_CALLS:
                waiting.pop(ended.call, None)
            return ended

        return received

    def is_open(self, name: str) -> bool:
        """Whether a call by the client ``name`` has had no response, as far as was received."""
        return bool(self._open_calls.get(name))

    def _of_action(
        self,
        port: Port,
        kind: ObservationKind,
        read: Callable[[Port, Observation], TraceEvent | None],
    ) -> Reader:
        if kind is ObservationKind.MESSAGE:
            return lambda seen: read(port, seen)

        def remembering(seen: Observation) -> TraceEvent | None:
            event = read(port, seen)
            if event is not None:
                self._remember_goal(event)
            return event

        return remembering

    def _remember_goal(self, event: TraceEvent) -> None:
        """Responses of an action's services do not name their goal; their requests do.

        A response may be received first: on ROS 2, that nobody serves the call has a topic of its own.
        """
        place = (event.observation.channel, event.call)
        if event.goal:
            before = self._goals.get(place)
            if before not in (None, event.goal) and not (event.call[2] or place in self._answered):
                self._goals[place] = _EITHER
                return
            self._goals[place] = event.goal
            self._answered.pop(place, None)
            for response in self._nameless.pop(place, ()):
                response.goal = event.goal
            if event.output is OutputKind.SEND_GOAL:
                self._sent[event.goal] = None
        elif place in self._goals:
            event.goal = self._goals[place]
            if event.goal == _EITHER:
                client, number, _ = event.call
                raise AmbiguousError(
                    f"{client} made call {number} on {place[0]} in two of its lives: to which an answer is "
                    "cannot be told"
                )
            self._answered[place] = None
        else:
            self._nameless[place] = [*self._nameless.get(place, ()), event]

    def forget_goals(self) -> None:
        """From here on, goals that were sent before may or may not be under way."""
        self._sent.clear()

    def was_sent(self, goal: str) -> bool:
        """Whether the machine has sent this goal since its past is known."""
        return goal in self._sent
