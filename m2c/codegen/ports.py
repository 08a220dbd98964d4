"""The methods by which a generated machine and its node speak: one per event, one per output."""

from __future__ import annotations

import msgspec

from m2c.codegen.names import channel_names, snake
from m2c.codegen.source import Source, doc
from m2c.model.datatypes import Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Emit,
    Event,
    EventKind,
    Interface,
    Machine,
    OutputKind,
)
from m2c.model.scopes import event_data_type, event_parts, interface_kind_of, output_data_type
from m2c.model.walk import statements_of

_EVENT_SUFFIX = {
    EventKind.MESSAGE: "message",
    EventKind.REQUEST: "request",
    EventKind.RESPONSE: "response",
    EventKind.CALL_ERROR: "error",
    EventKind.GOAL: "goal",
    EventKind.CANCEL: "cancel",
    EventKind.GOAL_ACCEPTED: "accepted",
    EventKind.GOAL_REJECTED: "rejected",
    EventKind.FEEDBACK: "feedback",
    EventKind.SUCCEEDED: "succeeded",
    EventKind.ABORTED: "aborted",
    EventKind.CANCELED: "canceled",
    EventKind.THREAD_START: "thread_start",
    EventKind.THREAD_FREE: "thread_free",
    EventKind.TIMER: "timer",
}
_DATA_NAMES = {
    EventKind.MESSAGE: "msg",
    EventKind.REQUEST: "req",
    EventKind.RESPONSE: "res",
    EventKind.GOAL: "goal",
    EventKind.THREAD_START: "goal",
    EventKind.FEEDBACK: "feedback",
    EventKind.SUCCEEDED: "result",
    EventKind.ABORTED: "result",
    EventKind.CANCELED: "result",
}
OUTPUT_VERB = {
    OutputKind.PUBLISH: "publish",
    OutputKind.REQUEST: "call",
    OutputKind.RESPONSE: "respond",
    OutputKind.SEND_GOAL: "send_goal",
    OutputKind.SEND_CANCEL: "send_cancel",
    OutputKind.ACCEPT_GOAL: "accept_goal",
    OutputKind.REJECT_GOAL: "reject_goal",
    OutputKind.FEEDBACK: "feedback",
    OutputKind.SUCCEED: "succeed",
    OutputKind.ABORT: "abort",
    OutputKind.CANCEL: "canceled",
    OutputKind.START_THREAD: "start_thread",
    OutputKind.THREAD_FREE: "free_thread",
    OutputKind.BT_RETURN_STATUS: "return_status",
    OutputKind.BT_RETURN_HALTED: "return_halted",
    OutputKind.BT_SET_OUTPUT: "set_output",
    OutputKind.BT_TICK_CHILD: "tick_child",
    OutputKind.BT_HALT_CHILD: "halt_child",
}
_DATA_ARGUMENT = {
    OutputKind.PUBLISH: "message",
    OutputKind.REQUEST: "request",
    OutputKind.RESPONSE: "response",
    OutputKind.SEND_GOAL: "goal",
    OutputKind.START_THREAD: "goal",
    OutputKind.FEEDBACK: "feedback",
    OutputKind.SUCCEED: "result",
    OutputKind.ABORT: "result",
    OutputKind.CANCEL: "result",
}
ON_EVENT = (("name", "str"), ("data", "Any = None"))
"""Parameters of the method that takes what a machine sends to itself."""

_GOAL_OUTPUTS = frozenset(
    {
        *(OutputKind.ACCEPT_GOAL, OutputKind.REJECT_GOAL, OutputKind.FEEDBACK, OutputKind.SUCCEED),
        *(OutputKind.ABORT, OutputKind.CANCEL, OutputKind.START_THREAD, OutputKind.THREAD_FREE),
        OutputKind.SEND_CANCEL,
    }
)


class EventPort(msgspec.Struct, frozen=True):
    """One method of the machine: what it is called and what it is given."""

    event: Event
    method: str
    data: Structure | None
    data_name: str
    parameters: tuple[tuple[str, str], ...]


class OutputPort(msgspec.Struct, frozen=True):
    """One method of ``Outputs``: what it is called and what it is given."""

    kind: OutputKind
    interface: str
    method: str
    data: Structure | None
    data_name: str
    parameters: tuple[tuple[str, str], ...]


class PortNames:
    """Short names of a machine's interfaces, equal in the machine, its threads and its node."""

    def __init__(self, machine: Machine, library: InterfaceLibrary) -> None:
        self._machine = machine
        self._library = library
        self._short = channel_names([key(interface) for interface in machine.interfaces])

    def short(self, interface: Interface) -> str:
        """The name that stands for ``interface`` in method names."""
        return self._short[key(interface)]

    def channel(self, name: str, kind: EventKind | OutputKind) -> str:
        """What interface ``name`` is called in texts: its channel, where the model gives it."""
        interface_kind = interface_kind_of(kind)
        kinds = (interface_kind,) if interface_kind is not None else ()
        interface = self._machine.interface(name, *kinds) if kinds else None
        return interface.channel or name if interface is not None else name

    def named(self, name: str, kind: EventKind | OutputKind) -> str:
        """The name that stands in method names for interface ``name``, of an event or output of ``kind``."""
        interface_kind = interface_kind_of(kind)
        kinds = (interface_kind,) if interface_kind is not None else ()
        interface = self._machine.interface(name, *kinds)
        return self.short(interface) if interface is not None else snake(name)

    def event(self, event: Event) -> EventPort:
        """The method that takes ``event``."""
        parts = event_parts(event, self._machine, self._library)
        data = event_data_type(event, self._machine, self._library)
        match event.kind:
            case EventKind.INTERNAL:
                return EventPort(event, "on_event", None, "data", ON_EVENT)
            case EventKind.AFTER:
                return EventPort(event, "on_elapsed", None, "data", (("delay", "str"),))
            case EventKind.BT_TICK | EventKind.BT_HALT:
                return EventPort(
                    event, "on_tick" if event.kind is EventKind.BT_TICK else "on_halt", None, "", ()
                )
            case EventKind.BT_CHILD_STATUS:
                return EventPort(
                    event, f"on_child_{snake(event.name)}_status", None, "", (("status", "str"),)
                )
            case EventKind.BT_CHILD_HALTED:
                return EventPort(event, f"on_child_{snake(event.name)}_halted", None, "", ())
        method = f"on_{self.named(event.name, event.kind)}_{_EVENT_SUFFIX[event.kind]}"
        data_name = _DATA_NAMES.get(event.kind, "data")
        parameters = [(part, "int") for part in ("goal_id", "thread_id", "code") if part in parts]
        return EventPort(event, method, data, data_name, tuple(parameters))

    def output(self, kind: OutputKind, name: str) -> OutputPort:
        """The method by which an output of ``kind`` leaves on interface ``name``."""
        data = output_data_type(kind, name, self._machine, self._library)
        verb = OUTPUT_VERB[kind]
        parameters: list[tuple[str, str]] = []
        match kind:
            case OutputKind.BT_RETURN_STATUS:
                return OutputPort(kind, name, verb, None, "", (("status", "str"),))
            case OutputKind.BT_RETURN_HALTED:
                return OutputPort(kind, name, verb, None, "", ())
            case OutputKind.BT_SET_OUTPUT:
                return OutputPort(kind, name, verb, None, "", (("key", "str"), ("value", "object")))
            case OutputKind.BT_TICK_CHILD | OutputKind.BT_HALT_CHILD:
                return OutputPort(kind, name, verb, None, "", (("child", "int"),))
        if kind in (OutputKind.START_THREAD, OutputKind.THREAD_FREE):
            parameters.append(("thread_id", "int"))
        if kind in _GOAL_OUTPUTS:
            optional = kind is OutputKind.SEND_CANCEL
            parameters.append(("goal_id", "int | None" if optional else "int"))
        method = f"{verb}_{self.named(name, kind)}"
        return OutputPort(kind, name, method, data, _DATA_ARGUMENT.get(kind, ""), tuple(parameters))


_EVENT_DOCS = {
    EventKind.INTERNAL: "An event that the machine sent or raised, or that is sent to it.",
    EventKind.AFTER: "A state's ``after`` delay has elapsed.",
    EventKind.MESSAGE: "A message on ``{}``.",
    EventKind.REQUEST: "A request to ``{}``.",
    EventKind.RESPONSE: "The response to a call of ``{}``.",
    EventKind.CALL_ERROR: "A call of ``{}`` failed.",
    EventKind.GOAL: "A goal of ``{}``.",
    EventKind.CANCEL: "A request to cancel a goal of ``{}``.",
    EventKind.GOAL_ACCEPTED: "The goal sent to ``{}`` was accepted.",
    EventKind.GOAL_REJECTED: "The goal sent to ``{}`` was rejected.",
    EventKind.FEEDBACK: "Feedback of ``{}``.",
    EventKind.SUCCEEDED: "The goal sent to ``{}`` succeeded.",
    EventKind.ABORTED: "The goal sent to ``{}`` was aborted.",
    EventKind.CANCELED: "The goal sent to ``{}`` was canceled.",
    EventKind.THREAD_START: "A goal of ``{}`` is to be executed.",
    EventKind.THREAD_FREE: "A thread of ``{}`` has become free.",
    EventKind.TIMER: "The timer ``{}``.",
    EventKind.BT_TICK: "The behaviour tree ticks this node.",
    EventKind.BT_HALT: "The behaviour tree halts this node.",
    EventKind.BT_CHILD_STATUS: "Child {} returned a status.",
    EventKind.BT_CHILD_HALTED: "Child {} was halted.",
}
_OUTPUT_DOCS = {
    OutputKind.PUBLISH: "Publish on ``{}``.",
    OutputKind.REQUEST: "Call ``{}``; the response is an event.",
    OutputKind.RESPONSE: "Answer a request to ``{}``.",
    OutputKind.SEND_GOAL: "Send a goal to ``{}``.",
    OutputKind.SEND_CANCEL: "Ask ``{}`` to cancel a goal.",
    OutputKind.ACCEPT_GOAL: "Accept a goal of ``{}``.",
    OutputKind.REJECT_GOAL: "Reject a goal of ``{}``.",
    OutputKind.FEEDBACK: "Send feedback of ``{}``.",
    OutputKind.SUCCEED: "End a goal of ``{}``: succeeded.",
    OutputKind.ABORT: "End a goal of ``{}``: aborted.",
    OutputKind.CANCEL: "End a goal of ``{}``: canceled.",
    OutputKind.START_THREAD: "Have a thread of ``{}`` execute a goal.",
    OutputKind.THREAD_FREE: "A thread of ``{}`` is free again.",
    OutputKind.BT_RETURN_STATUS: "Return a status to the behaviour tree.",
    OutputKind.BT_RETURN_HALTED: "Tell the behaviour tree that this node is halted.",
    OutputKind.BT_SET_OUTPUT: "Set an output port.",
    OutputKind.BT_TICK_CHILD: "Tick a child.",
    OutputKind.BT_HALT_CHILD: "Halt a child.",
}


def event_doc(event: Event, names: PortNames) -> Source:
    """What the doc string of the method that takes ``event`` says."""
    return Source(_EVENT_DOCS[event.kind]).format(doc(names.channel(event.name, event.kind)))


def output_doc(kind: OutputKind, interface: str, names: PortNames) -> Source:
    """What the doc string of the method by which an output leaves says."""
    return Source(_OUTPUT_DOCS[kind]).format(doc(names.channel(interface, kind)))


def key(interface: Interface) -> str:
    """What identifies the channel of ``interface`` within one machine."""
    return interface.channel or f"/{interface.name}"


def events_of(machine: Machine) -> list[Event]:
    """Every event that some transition of ``machine`` waits for, in document order, each once."""
    found: dict[Event, None] = {}
    for state in machine.states:
        for transition in state.transitions:
            if transition.event is not None:
                found[transition.event] = None
    return list(found)


def emits_of(machine: Machine) -> list[tuple[OutputKind, str]]:
    """Every output that ``machine`` can send, in document order, each once."""
    found: dict[tuple[OutputKind, str], None] = {}
    for statement in statements_of(machine):
        if isinstance(statement, Emit):
            found[statement.kind, statement.interface] = None
    return list(found)
