"""What an observation is to a machine: an input, an output, or nothing; and who makes that of it.

Where both ends of a call are observed, the machine's own end counts (design, section 6): requests it
received and responses it sent for what it serves, requests it sent and responses it received for what
it calls. Those and what it publishes come from one process and are totally ordered by their stamps.
Messages of others on its topics are not ordered against them.

``Channels`` chooses what reads the observations of one source, channel and kind, and ``SourceStreams`` keeps
that, with the numbers of what was received.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import IntEnum
from typing import Any

from m2c.language.datatypes import DataType, Structure
from m2c.language.values import zero
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import EventKind, InterfaceKind, Machine, OutputKind
from m2c.model.walk import failure_of_goals
from moon.feed.numbers import Numbers, Place
from moon.oracle.bounds import FOREVER
from moon.oracle.calls import Call, is_nameless
from transports.actions.parts import SERVICES, TOPICS, channel_of_part, whole_of
from transports.actions.rules import Stamp
from transports.bounded import BoundedDict
from transports.interface import SERVER_END, CallOutcome, Observation, ObservationKind
from transports.sequences import Sequence

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


# --- readers --------------------------------------------------------------------------------------

Reader = Callable[[Observation], TraceEvent | None]
"""Makes a trace event of an observation, if it is one."""


class Port:
    """One part of an interface: how observations on its channel are read."""

    __slots__ = ("data", "failure", "interface", "kind", "part", "template")

    def __init__(
        self,
        kind: InterfaceKind,
        interface: str,
        part: str = "",
        data: Structure | None = None,
        failure: EventKind = EventKind.GOAL_REJECTED,
    ) -> None:
        self.failure = failure
        """Of an action client: the event of a goal that is not answered, or whose server ends."""
        self.kind = kind
        self.interface = interface
        self.part = part
        self.data = data
        self.template = None if data is None else zero(data)


def _undeclared(seen: Observation) -> TraceEvent:
    """Something for which the model has no words."""
    return TraceEvent(seen, Role.UNDECLARED)


def _is_own_call(seen: Observation, node: str) -> bool:
    """Whether what ``node`` itself reports is of a call that it made; its name there may not be known yet."""
    return seen.client == node or is_nameless(seen.client)


def _asking(name: str) -> Reader:
    """Requests to the machine, as who sends them reports it."""
    return lambda seen: TraceEvent(seen, Role.ASKED, name)


_FAILED: dict[str, Role] = {
    CallOutcome.REMOTE_ERROR: Role.ANSWERED,
    CallOutcome.TIMEOUT: Role.UNANSWERED,
    CallOutcome.UNAVAILABLE: Role.UNREACHED,
}
"""What a call that failed is to its server's machine. A refusal is an answer: it was received then."""


def _answered(name: str) -> Reader:
    """What the machine answered to them, as who got it reports it, or why no answer came."""

    def answer(seen: Observation) -> TraceEvent | None:
        outcome = seen.error.partition(":")[0]
        role = _FAILED.get(outcome) if outcome else Role.ANSWERED
        return None if role is None else TraceEvent(seen, role, name)

    return answer


def _at_the_server(name: str, node: str) -> Reader:
    """What the server of a call reports of it, where ``node`` is its client."""
    return lambda seen: TraceEvent(seen, Role.OTHER_END, name) if seen.client == node else None


def _taking(role: Role, name: str, kind: EventKind, template: Any) -> Reader:
    """Inputs; ``template``: zero values of all fields."""
    event = (kind, name)
    return lambda seen: TraceEvent(
        seen, role, name, event=event, data=complete(seen.data, template)
    )


def _took(name: str, kind: EventKind) -> Reader:
    """Reports of the machine's node that it took a message of a topic; who published it has the contents."""
    event = (kind, name)
    return lambda seen: TraceEvent(seen, Role.TAKEN, name, event)


def _giving(name: str, kind: OutputKind, template: Any) -> Reader:
    """Outputs; ``template``: zero values of all fields."""
    return lambda seen: TraceEvent(
        seen, Role.OUTPUT, name, output=kind, data=complete(seen.data, template)
    )


def _served(name: str, kind: ObservationKind, own: bool, template: Any) -> Reader | None:
    """Events of one kind of a service that the machine serves; ``own``: reported by its own node."""
    match kind:
        case ObservationKind.REQUEST_RECEIVED if own:
            return _taking(Role.INPUT, name, EventKind.REQUEST, template)
        case ObservationKind.RESPONSE_SENT if own:
            return _answer_sent(name)
        case ObservationKind.REQUEST_SENT if not own:
            return _asking(name)
        case ObservationKind.RESPONSE_RECEIVED if not own:
            return _answered(name)
    return None


def _answer_sent(name: str) -> Reader:
    def answer(seen: Observation) -> TraceEvent | None:
        if seen.error:
            return None  # the transport refuses a request that is none
        return TraceEvent(seen, Role.OUTPUT, name, output=OutputKind.RESPONSE, data=seen.data)

    return answer


_ENDS = {4: OutputKind.SUCCEED, 5: OutputKind.CANCEL, 6: OutputKind.ABORT}
"""action_msgs/msg/GoalStatus: how a goal can end."""
_ENDED = {4: EventKind.SUCCEEDED, 5: EventKind.CANCELED, 6: EventKind.ABORTED}


def _of_action_server(port: Port, observation: Observation) -> TraceEvent | None:
    """What the node of an action server reports of one part of the action."""
    data, name = observation.data, port.interface
    match port.part, observation.kind:
        case "send_goal", ObservationKind.REQUEST_RECEIVED:
            goal = complete(data["goal"], port.template)
            event = (EventKind.GOAL, name)
            return TraceEvent(
                observation, Role.INPUT, name, event=event, data=goal, goal=goal_id(data)
            )
        case "send_goal", ObservationKind.RESPONSE_SENT if not observation.error:
            kind = OutputKind.ACCEPT_GOAL if data["accepted"] else OutputKind.REJECT_GOAL
            return TraceEvent(observation, Role.OUTPUT, name, output=kind)
        case "cancel_goal", ObservationKind.REQUEST_RECEIVED:
            event = (EventKind.CANCEL, name)
            return TraceEvent(observation, Role.INPUT, name, event=event, data=data["goal_info"])
        case "get_result", ObservationKind.RESPONSE_SENT if not observation.error:
            end = _ENDS.get(data["status"])  # 0 where it does not know the goal (rclcpp, rclpy)
            if end is None:
                return None
            return TraceEvent(observation, Role.RESULT, name, output=end, data=data["result"])
        case "get_result", ObservationKind.REQUEST_RECEIVED:
            return TraceEvent(observation, Role.RESULT, name, goal=goal_id(data))
        case "feedback", ObservationKind.MESSAGE:
            kind = OutputKind.FEEDBACK
            return TraceEvent(
                observation,
                Role.OUTPUT,
                name,
                output=kind,
                data=data["feedback"],
                goal=goal_id(data),
            )
        case "status", ObservationKind.MESSAGE:
            ends = [
                (identifier(entry["goal_info"]["goal_id"]), _ENDS[entry["status"]])
                for entry in data["status_list"]
                if entry["status"] in _ENDS
            ]
            return TraceEvent(observation, Role.STATUS, name, data=ends)
    return None


def _of_action_client(port: Port, observation: Observation) -> TraceEvent | None:
    """What the node of an action client reports of one part of it; feedback is reported by the server's."""
    data, name = observation.data, port.interface
    if port.part == "feedback" and observation.kind is ObservationKind.MESSAGE:
        feedback = complete(data["feedback"], port.template)
        event = (EventKind.FEEDBACK, name)
        return TraceEvent(
            observation, Role.MESSAGE, name, event=event, data=feedback, goal=goal_id(data)
        )
    match port.part, observation.kind:
        case "send_goal", ObservationKind.REQUEST_SENT:
            kind = OutputKind.SEND_GOAL
            return TraceEvent(
                observation, Role.OUTPUT, name, output=kind, data=data["goal"], goal=goal_id(data)
            )
        case "send_goal", ObservationKind.RESPONSE_RECEIVED:
            if observation.error:
                return TraceEvent(observation, Role.INPUT, name, (port.failure, name))
            kind_of = EventKind.GOAL_ACCEPTED if data["accepted"] else EventKind.GOAL_REJECTED
            return TraceEvent(observation, Role.INPUT, name, (kind_of, name))
        case "cancel_goal", ObservationKind.REQUEST_SENT:
            kind = OutputKind.SEND_CANCEL
            return TraceEvent(
                observation, Role.OUTPUT, name, output=kind, goal=goal_id(data["goal_info"])
            )
        case "get_result", ObservationKind.REQUEST_SENT:
            return TraceEvent(observation, Role.RESULT, name, goal=goal_id(data))
        case "get_result", ObservationKind.RESPONSE_RECEIVED:
            ended = None if observation.error else _ENDED.get(data["status"])
            if ended is None:
                return TraceEvent(observation, Role.INPUT, name, (port.failure, name))
            result = complete(data["result"], port.template)
            return TraceEvent(observation, Role.INPUT, name, event=(ended, name), data=result)
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


# --- channels -------------------------------------------------------------------------------------

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
            return (_undeclared,)
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
                return _taking(Role.MESSAGE, name, EventKind.MESSAGE, template)
            case InterfaceKind.SUBSCRIBER if own and kind is ObservationKind.MESSAGE_TAKEN:
                return _took(name, EventKind.MESSAGE)
            case InterfaceKind.ACTION_CLIENT if own and kind is ObservationKind.MESSAGE_TAKEN:
                return _took(name, EventKind.FEEDBACK) if port.part == "feedback" else None
            case InterfaceKind.PUBLISHER if own and kind is ObservationKind.MESSAGE:
                return _giving(name, OutputKind.PUBLISH, template)
            case InterfaceKind.SERVER:
                return _served(name, kind, own, template)
            case InterfaceKind.CLIENT if own:
                return self._called(name, kind, template)
            case InterfaceKind.ACTION_SERVER if own:
                return self._of_action(port, kind, _of_action_server)
            case InterfaceKind.CLIENT if kind in SERVER_END:
                return _at_the_server(name, self.node)
            case InterfaceKind.ACTION_SERVER if port.part == "send_goal":
                return _served(name, kind, own, template)
            case InterfaceKind.ACTION_SERVER if kind is ObservationKind.RESPONSE_RECEIVED:
                return _answered(name)
            case InterfaceKind.ACTION_CLIENT if own or (
                port.part == "feedback" and kind is ObservationKind.MESSAGE
            ):
                return self._of_action(port, kind, _of_action_client)
            case InterfaceKind.ACTION_CLIENT if kind in SERVER_END:
                return _at_the_server(name, self.node)
        return None

    def _called(self, name: str, kind: ObservationKind, template: Any) -> Reader | None:
        node = self.node
        if kind is ObservationKind.REQUEST_SENT:

            def asked(seen: Observation) -> TraceEvent | None:
                if not _is_own_call(seen, node):
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
            if not _is_own_call(seen, node):
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


# --- source streams -------------------------------------------------------------------------------

KEPT_STREAMS = 4096
"""Source streams that are remembered; their names come from the wire."""


class SourceStream:
    """Observations of one source, channel and kind.

    Attributes:
        read: what makes trace events of them; None if nothing does.
        more: what makes further events of them, where they are part of several interfaces.
        taken_as: as which input the machine takes them, where they are another node's messages.
        own: whether the machine's own node is their source.
        other_end: whether they are what a server reports of the machine's calls.
        count: their numbers; None for what others report of their calls, which only adds to what is
            known.
    """

    __slots__ = ("count", "more", "other_end", "own", "read", "taken_as")

    def __init__(
        self,
        readers: tuple[Reader, ...],
        own: bool,
        other_end: bool,
        count: Sequence | None,
        taken_as: EventKind | None,
    ) -> None:
        self.read = readers[0] if readers else None
        self.more = readers[1:]
        self.taken_as = taken_as
        self.own = own
        self.other_end = other_end
        self.count = count


class SourceStreams:
    """The streams of one machine.

    Args:
        channels: the machine's.
        node: the node that runs it.
        numbers: those of all sources, if somebody else follows them; else it has its own.
    """

    def __init__(self, channels: Channels, node: str, numbers: Numbers | None = None) -> None:
        self._are_followed = numbers is not None
        self._numbers = numbers or Numbers(most=KEPT_STREAMS)
        self._channels = channels
        self.node = node
        self.opened: dict[tuple[str, str, ObservationKind], SourceStream] = {}
        """By source, channel and kind."""
        self.counts: dict[Place, Sequence] = {}
        self._first_ns: dict[str, int] = {}
        """Of each channel, when the first that was received from the machine's node happened (ns)."""
        self.received_since: int | None = None
        """From when on (ns) silence means that the machine did nothing, once something is received from it;
        FOREVER: its node is not known to be there."""

    def of(self, observation: Observation) -> SourceStream:
        """The stream that ``observation`` is in."""
        key = (observation.source, observation.channel, observation.kind)
        found = self.opened.get(key)
        if found is None:
            found = self._open(*key)
            if found.own:
                first_ns = self._first_ns.get(observation.channel, FOREVER)
                self._first_ns[observation.channel] = min(first_ns, observation.stamp_ns)
        return found

    def _open(self, source: str, channel: str, kind: ObservationKind) -> SourceStream:
        if len(self.opened) >= KEPT_STREAMS:
            # those that are in use come back; a first number says nothing about losses
            self.opened.clear()
            self.counts.clear()
        message = kind is ObservationKind.MESSAGE
        own = source == self.node
        readers = self._channels.readers(channel, source, kind)
        count = None
        if own or (message and readers):
            place = (source, channel, message)
            count = self.counts[place] = self._numbers.add(place)
        stream = self.opened[source, channel, kind] = SourceStream(
            readers,
            own,
            not own and kind in SERVER_END,
            count,
            None if own or not message else self._channels.taken_as(channel),
        )
        return stream

    def was_received(self, channel: str, by_ns: int) -> bool:
        """Whether the machine's node was heard on ``channel``, or on a part of that action, by then (ns)."""
        return any(
            first_ns <= by_ns and channel in (received, whole_of(received))
            for received, first_ns in self._first_ns.items()
        )

    def may_have_missed(self, channels: Iterable[str], by_ns: int, silent_ns: int) -> bool:
        """Whether the node may have done something by then (ns) on one of ``channels`` that was missed.

        It may if nothing of before was received there and the node was found later than ``silent_ns`` before.
        """
        if self.received_since is None or by_ns - silent_ns >= self.received_since:
            return False
        return not all(self.was_received(channel, by_ns) for channel in channels)

    def restart(self) -> None:
        """The machine's node numbers anew, and nothing was received from it yet."""
        self.received_since = None
        self._first_ns.clear()
        for key in [key for key in self.opened if key[0] == self.node]:
            del self.opened[key]
        if not self._are_followed:
            self._numbers.forget(self.node)
