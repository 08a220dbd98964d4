"""What makes trace events of the observations of one part of an interface."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from m2c.language.datatypes import Structure
from m2c.language.values import zero
from m2c.model.machine import EventKind, InterfaceKind, OutputKind
from moon.oracle.calls import is_nameless
from moon.oracle.trace_events import Role, TraceEvent, complete, goal_id, identifier
from transports.interface import CallOutcome, Observation, ObservationKind

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


def undeclared(seen: Observation) -> TraceEvent:
    """Something for which the model has no words."""
    return TraceEvent(seen, Role.UNDECLARED)


def is_own_call(seen: Observation, node: str) -> bool:
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


def answered(name: str) -> Reader:
    """What the machine answered to them, as who got it reports it, or why no answer came."""

    def answer(seen: Observation) -> TraceEvent | None:
        outcome = seen.error.partition(":")[0]
        role = _FAILED.get(outcome) if outcome else Role.ANSWERED
        return None if role is None else TraceEvent(seen, role, name)

    return answer


def at_the_server(name: str, node: str) -> Reader:
    """What the server of a call reports of it, where ``node`` is its client."""
    return lambda seen: TraceEvent(seen, Role.OTHER_END, name) if seen.client == node else None


def taking(role: Role, name: str, kind: EventKind, template: Any) -> Reader:
    """Inputs; ``template``: zero values of all fields."""
    event = (kind, name)
    return lambda seen: TraceEvent(
        seen, role, name, event=event, data=complete(seen.data, template)
    )


def took(name: str, kind: EventKind) -> Reader:
    """Reports of the machine's node that it took a message of a topic; who published it has the contents."""
    event = (kind, name)
    return lambda seen: TraceEvent(seen, Role.TAKEN, name, event)


def giving(name: str, kind: OutputKind, template: Any) -> Reader:
    """Outputs; ``template``: zero values of all fields."""
    return lambda seen: TraceEvent(
        seen, Role.OUTPUT, name, output=kind, data=complete(seen.data, template)
    )


def served(name: str, kind: ObservationKind, own: bool, template: Any) -> Reader | None:
    """Events of one kind of a service that the machine serves; ``own``: reported by its own node."""
    match kind:
        case ObservationKind.REQUEST_RECEIVED if own:
            return taking(Role.INPUT, name, EventKind.REQUEST, template)
        case ObservationKind.RESPONSE_SENT if own:
            return _answer_sent(name)
        case ObservationKind.REQUEST_SENT if not own:
            return _asking(name)
        case ObservationKind.RESPONSE_RECEIVED if not own:
            return answered(name)
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


def of_action_server(port: Port, observation: Observation) -> TraceEvent | None:
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


def of_action_client(port: Port, observation: Observation) -> TraceEvent | None:
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
