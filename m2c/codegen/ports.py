"""The methods by which a generated machine and its node speak: one per event, one per output."""

from __future__ import annotations

import msgspec

from m2c.codegen.names import channel_names, distinct, snake
from m2c.codegen.source import Source, doc
from m2c.language.datatypes import Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Event, EventKind, Interface, InterfaceKind, Machine, OutputKind
from m2c.model.scopes import event_data_type, event_parts, interface_kind_of, output_data_type
from m2c.model.walk import events_of

_EVENTS: dict[EventKind, tuple[str, str, str]] = {
    EventKind.INTERNAL: (
        "event",
        "",
        "An event that the machine sent or raised, or that is sent to it.",
    ),
    EventKind.AFTER: ("elapsed", "", "A state's ``after`` delay has elapsed."),
    EventKind.MESSAGE: ("message", "msg", "A message on ``{}``."),
    EventKind.REQUEST: ("request", "req", "A request to ``{}``."),
    EventKind.RESPONSE: ("response", "res", "The response to a call of ``{}``."),
    EventKind.CALL_ERROR: ("error", "", "A call of ``{}`` failed."),
    EventKind.GOAL: ("goal", "goal", "A goal of ``{}``."),
    EventKind.CANCEL: ("cancel", "", "A request to cancel a goal of ``{}``."),
    EventKind.GOAL_ACCEPTED: ("accepted", "", "The goal sent to ``{}`` was accepted."),
    EventKind.GOAL_REJECTED: ("rejected", "", "The goal sent to ``{}`` was rejected."),
    EventKind.FEEDBACK: ("feedback", "feedback", "Feedback of ``{}``."),
    EventKind.SUCCEEDED: ("succeeded", "result", "The goal sent to ``{}`` succeeded."),
    EventKind.ABORTED: ("aborted", "result", "The goal sent to ``{}`` was aborted."),
    EventKind.CANCELED: ("canceled", "result", "The goal sent to ``{}`` was canceled."),
    EventKind.GOAL_FAILED: ("failed", "", "The goal sent to ``{}`` failed, and is over."),
    EventKind.THREAD_START: ("thread_start", "goal", "A goal of ``{}`` is to be executed."),
    EventKind.THREAD_FREE: ("thread_free", "", "A thread of ``{}`` has become free."),
    EventKind.TIMER: ("timer", "", "The timer ``{}``."),
    EventKind.BT_TICK: ("tick", "", "The behaviour tree ticks this node."),
    EventKind.BT_HALT: ("halt", "", "The behaviour tree halts this node."),
    EventKind.BT_CHILD_STATUS: ("status", "", "Child {} returned a status."),
    EventKind.BT_CHILD_HALTED: ("halted", "", "Child {} was halted."),
}
"""What the method of an event is called, what its data is called, and what its doc string says."""

_ALONE = {
    EventKind.INTERNAL: (("name", "str"), ("data", "Any = None")),
    EventKind.AFTER: (("delay", "str"),),
    EventKind.BT_TICK: (),
    EventKind.BT_HALT: (),
}
"""Events of no interface, and the parameters of their methods, of which a machine has one for all."""

_WITHOUT_DATA: dict[EventKind | OutputKind, InterfaceKind] = {
    EventKind.CALL_ERROR: InterfaceKind.CLIENT,
    EventKind.TIMER: InterfaceKind.TIMER,
}
_OF_CHILDREN = (EventKind.BT_CHILD_STATUS, EventKind.BT_CHILD_HALTED)

_OUTPUTS: dict[OutputKind, tuple[str, str, str, str]] = {
    OutputKind.PUBLISH: ("publish", "message", "publisher.publish", "Publish on ``{}``."),
    OutputKind.REQUEST: (
        "call",
        "request",
        "client.call",
        "Call ``{}``; the response is an event.",
    ),
    OutputKind.RESPONSE: ("respond", "response", "server.respond", "Answer a request to ``{}``."),
    OutputKind.SEND_GOAL: ("send_goal", "goal", "client.send_goal", "Send a goal to ``{}``."),
    OutputKind.SEND_CANCEL: (
        "send_cancel",
        "",
        "client.send_cancel",
        "Ask ``{}`` to cancel a goal.",
    ),
    OutputKind.ACCEPT_GOAL: ("accept_goal", "", "server.accept", "Accept a goal of ``{}``."),
    OutputKind.REJECT_GOAL: ("reject_goal", "", "server.reject", "Reject a goal of ``{}``."),
    OutputKind.FEEDBACK: ("feedback", "feedback", "server.feedback", "Send feedback of ``{}``."),
    OutputKind.SUCCEED: ("succeed", "result", "server.succeed", "End a goal of ``{}``: succeeded."),
    OutputKind.ABORT: ("abort", "result", "server.abort", "End a goal of ``{}``: aborted."),
    OutputKind.CANCEL: ("canceled", "result", "server.canceled", "End a goal of ``{}``: canceled."),
    OutputKind.START_THREAD: (
        "start_thread",
        "goal",
        "",
        "Have a thread of ``{}`` execute a goal.",
    ),
    OutputKind.THREAD_FREE: ("free_thread", "", "", "A thread of ``{}`` is free again."),
    OutputKind.BT_RETURN_STATUS: (
        "return_status",
        "",
        "",
        "Return a status to the behaviour tree.",
    ),
    OutputKind.BT_RETURN_HALTED: (
        *("return_halted", "", ""),
        "Tell the behaviour tree that this node is halted.",
    ),
    OutputKind.BT_SET_OUTPUT: ("set_output", "", "", "Set an output port."),
    OutputKind.BT_TICK_CHILD: ("tick_child", "", "", "Tick a child."),
    OutputKind.BT_HALT_CHILD: ("halt_child", "", "", "Halt a child."),
}
"""What the method of an output is called, what its data is called, the end of a channel that it leaves
by, and what its doc string says."""

_TO_THE_TREE = {
    OutputKind.BT_RETURN_STATUS: (("status", "str"),),
    OutputKind.BT_RETURN_HALTED: (),
    OutputKind.BT_SET_OUTPUT: (("key", "str"), ("value", "object")),
    OutputKind.BT_TICK_CHILD: (("child", "int"),),
    OutputKind.BT_HALT_CHILD: (("child", "int"),),
}
"""Outputs of no interface, and the parameters of their methods."""

_OF_NO_GOAL = frozenset(
    {OutputKind.PUBLISH, OutputKind.REQUEST, OutputKind.RESPONSE, OutputKind.SEND_GOAL}
)


class Port(msgspec.Struct, frozen=True):
    """One method of the machine (of an event) or of ``Outputs``.

    Attributes:
        method: what it is called.
        doc: what its doc string says.
        parameters: names and types, without the message.
        data: the type of the message that it is given, if it is given one.
        data_name: what that is called.
        leaves_by: of an output on a channel, the attribute and the method of the node that send it.
    """

    method: str
    doc: Source
    parameters: tuple[tuple[str, str], ...] = ()
    data: Structure | None = None
    data_name: str = "data"
    leaves_by: str = ""


class PortNames:
    """Short names of a machine's interfaces, equal in the machine, its threads and its node."""

    def __init__(self, machine: Machine, library: InterfaceLibrary) -> None:
        self._machine = machine
        self._library = library
        self._short = channel_names([key(interface) for interface in machine.interfaces])
        self._children: dict[str, str] = {}
        for event in events_of(machine):
            if event.kind in _OF_CHILDREN and event.name not in self._children:
                made = distinct(snake(event.name), self._children.values())
                self._children[event.name] = made

    def short(self, interface: Interface) -> str:
        """The name that stands for ``interface`` in method names."""
        return self._short[key(interface)]

    def named(self, name: str, kind: EventKind | OutputKind) -> str:
        """The name that stands in method names for interface ``name``, of an event or output of ``kind``."""
        interface = self._interface(name, kind)
        return self.short(interface) if interface is not None else snake(name)

    def _interface(self, name: str, kind: EventKind | OutputKind) -> Interface | None:
        found = _WITHOUT_DATA.get(kind) or interface_kind_of(kind)
        return self._machine.interface(name, found) if found is not None else None

    def _doc(self, text: str, name: str, kind: EventKind | OutputKind) -> Source:
        interface = self._interface(name, kind)
        channel = interface.channel if interface is not None else None
        return Source(text).format(doc(channel or name))

    def event(self, event: Event) -> Port:
        """The method that takes ``event``."""
        word, data_name, text = _EVENTS[event.kind]
        says = self._doc(text, event.name, event.kind)
        if event.kind in _ALONE:
            return Port(f"on_{word}", says, _ALONE[event.kind])
        if event.kind in _OF_CHILDREN:
            parameters = (("status", "str"),) if event.kind is EventKind.BT_CHILD_STATUS else ()
            return Port(f"on_child_{self._children[event.name]}_{word}", says, parameters)
        parts = event_parts(event, self._machine, self._library)
        return Port(
            f"on_{self.named(event.name, event.kind)}_{word}",
            says,
            tuple((part, "int") for part in ("goal_id", "thread_id", "code") if part in parts),
            event_data_type(event, self._machine, self._library),
            data_name or "data",
        )

    def output(self, kind: OutputKind, name: str) -> Port:
        """The method by which an output of ``kind`` leaves on interface ``name``."""
        verb, data_name, end, text = _OUTPUTS[kind]
        says = self._doc(text, name, kind)
        if kind in _TO_THE_TREE:
            return Port(verb, says, _TO_THE_TREE[kind], leaves_by=f"_tree.{verb}")
        parameters: list[tuple[str, str]] = []
        if kind in (OutputKind.START_THREAD, OutputKind.THREAD_FREE):
            parameters.append(("thread_id", "int"))
        if kind not in _OF_NO_GOAL:
            parameters.append(
                ("goal_id", "int | None" if kind is OutputKind.SEND_CANCEL else "int")
            )
        short = self.named(name, kind)
        return Port(
            f"{verb}_{short}",
            says,
            tuple(parameters),
            output_data_type(kind, name, self._machine, self._library),
            data_name,
            f"_{short}_{end}" if end else "",
        )


def key(interface: Interface) -> str:
    """What identifies the channel of ``interface`` within one machine."""
    return interface.channel or f"/{interface.name}"
