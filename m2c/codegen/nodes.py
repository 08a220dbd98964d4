"""A node's facts: what binds its machine to channels, and what the machine sends through it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from m2c.codegen import program
from m2c.codegen.context import MachineContext
from m2c.codegen.interfaces import class_names, message_classes, needed_structures
from m2c.codegen.machines import machine_program
from m2c.codegen.names import MODULE_NAMES, distinct, machine_class
from m2c.codegen.ports import (
    OUTPUT_VERB,
    OutputPort,
    PortNames,
    emits_of,
    events_of,
    key,
    output_doc,
)
from m2c.codegen.program import Endpoint, Output, Parameter
from m2c.codegen.source import Source, name
from m2c.model.datatypes import Array, DataType, Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Event, EventKind, Interface, InterfaceKind, Machine, OutputKind

_GOAL_EVENTS = {
    "accepted": EventKind.GOAL_ACCEPTED,
    "rejected": EventKind.GOAL_REJECTED,
    "feedback": EventKind.FEEDBACK,
    "succeeded": EventKind.SUCCEEDED,
    "aborted": EventKind.ABORTED,
    "canceled": EventKind.CANCELED,
}
_HANDLED = {
    InterfaceKind.PUBLISHER: (),
    InterfaceKind.SUBSCRIBER: (EventKind.MESSAGE,),
    InterfaceKind.SERVER: (EventKind.REQUEST,),
    InterfaceKind.CLIENT: (EventKind.RESPONSE, EventKind.CALL_ERROR),
    InterfaceKind.ACTION_SERVER: (EventKind.GOAL, EventKind.CANCEL),
    InterfaceKind.ACTION_CLIENT: (),
    InterfaceKind.TIMER: (),
}
_PORT_METHOD = {
    OutputKind.PUBLISH: "publisher.publish",
    OutputKind.REQUEST: "client.call",
    OutputKind.RESPONSE: "server.respond",
    OutputKind.SEND_GOAL: "client.send_goal",
    OutputKind.SEND_CANCEL: "client.send_cancel",
    OutputKind.ACCEPT_GOAL: "server.accept",
    OutputKind.REJECT_GOAL: "server.reject",
    OutputKind.FEEDBACK: "server.feedback",
    OutputKind.SUCCEED: "server.succeed",
    OutputKind.ABORT: "server.abort",
    OutputKind.CANCEL: "server.canceled",
}
"""The end of a channel that an output leaves by, and its method."""
_SHAPES = {
    InterfaceKind.PUBLISHER: "Topic",
    InterfaceKind.SUBSCRIBER: "Topic",
    InterfaceKind.SERVER: "Service",
    InterfaceKind.CLIENT: "Service",
    InterfaceKind.ACTION_SERVER: "Action",
    InterfaceKind.ACTION_CLIENT: "Action",
}
_BINDING_OUTPUTS: dict[str, tuple[str, str, tuple[tuple[str, str], ...], str]] = {
    "start_delay": (
        "Start the delay of a transition.",
        "start_delay",
        (("name", "str"), ("delay_s", "float")),
        "self.machine.on_elapsed",
    ),
    "stop_delay": ("Cancel the delay of a transition.", "stop_delay", (("name", "str"),), ""),
    "send_self": (
        "Send an event to the machine itself.",
        "send_self",
        (("event", "str"), ("data", "Any"), ("delay_s", "float"), ("send_id", "str")),
        "self.machine.on_event",
    ),
    "cancel_send": ("Cancel a delayed send.", "cancel_send", (("send_id", "str"),), ""),
    "log": ("Write a line to the node's log.", "say", (("label", "str"), ("text", "str")), ""),
    "fault": (
        "What could not be evaluated, and where in the model.",
        "fault",
        (("place", "str"), ("text", "str")),
        "",
    ),
}
"""Outputs that are no messages: doc string, method of the binding, parameters, and what it is given
besides them."""


def node_program(machine: Machine, library: InterfaceLibrary, package: str) -> program.NodeProgram:
    """All facts of a node.

    Args:
        machine: its model, without errors (``m2c check``).
        library: the types of its channels.
        package: the dotted name of its Python package.
    """
    return _NodeFacts(machine, library, package).facts()


class _NodeFacts:
    def __init__(self, machine: Machine, library: InterfaceLibrary, package: str) -> None:
        self._machine = machine
        self._library = library
        self._package = package
        self._names = PortNames(machine, library)
        own = machine_class(machine.name)
        self._classes = [own, *(_thread_class(own, index) for index in range(len(machine.threads)))]
        self._owners = [machine, *(thread.machine for thread in machine.threads)]
        taken = {*MODULE_NAMES, f"{own}Node", *self._classes, *(f"{c}State" for c in self._classes)}
        structures = needed_structures(_structures(machine, library))
        self._class_of = class_names(structures, taken)
        self._messages = message_classes(structures, self._class_of)
        self._machines = tuple(
            machine_program(
                MachineContext(owner, library, self._names, self._class_of, made, index > 0)
            )
            for index, (owner, made) in enumerate(zip(self._owners, self._classes, strict=True))
        )
        self._context = MachineContext(machine, library, self._names, self._class_of, own)
        self._handled = {event: self._names.event(event) for event in events_of(machine)}
        self._thread_handled = {
            event: self._names.event(event)
            for thread in machine.threads
            for event in events_of(thread.machine)
        }
        self._channels = self._all_channels({*taken, *self._class_of.values()})

    def facts(self) -> program.NodeProgram:
        """All of it."""
        kinds = {event.kind for event in self._handled}
        is_plugin = bool(kinds & {EventKind.BT_TICK, EventKind.BT_HALT})
        return program.NodeProgram(
            name=self._machine.name,
            package=name(self._package),
            class_name=name(f"{self._classes[0]}Node"),
            machines=self._machines,
            messages=self._messages,
            channels=tuple(self._channels.values()),
            endpoints=tuple(self._endpoint(interface) for interface in self._machine.interfaces),
            outputs=(*self._message_outputs(), *self._binding_outputs()),
            threads=tuple(
                program.ThreadProgram(
                    self._threads(thread.interface), made.class_name, thread.count, made.uses_ports
                )
                for thread, made in zip(self._machine.threads, self._machines[1:], strict=True)
            ),
            cancels=tuple(self._cancels()),
            is_plugin=is_plugin,
            takes_ports=is_plugin or bool(self._machine.ports),
            ticked=EventKind.BT_TICK in kinds,
            halted=EventKind.BT_HALT in kinds,
            child_status=tuple(self._child_handlers(EventKind.BT_CHILD_STATUS)),
            child_halted=tuple(self._child_handlers(EventKind.BT_CHILD_HALTED)),
        )

    # -- channels -----------------------------------------------------------------------------

    def _all_channels(self, taken: set[str]) -> dict[str, program.Channel]:
        found: dict[str, program.Channel] = {}
        for interface in self._machine.interfaces:
            identity = key(interface)
            if interface.kind is InterfaceKind.TIMER or identity in found:
                continue
            constant = distinct(self._names.short(interface).upper(), taken)
            taken.add(constant)
            found[identity] = program.Channel(
                shape=name(_SHAPES[interface.kind]),
                constant=name(constant),
                name=interface.channel if interface.port is None else None,
                port=interface.port,
                type_name=interface.type_name,
                classes=tuple(
                    name(self._class_of[kind.name])
                    for kind in _interface_structures(interface, self._library)
                ),
                best_effort=interface.best_effort,
                latched=interface.latched,
            )
        return found

    def _endpoint(self, interface: Interface) -> Endpoint:
        short = self._names.short(interface)
        role = interface.kind.value
        end = role.removeprefix("action_")
        if interface.kind is InterfaceKind.TIMER:
            return Endpoint(
                role,
                name(short),
                timer_name=interface.name,
                rate_hz=interface.rate_hz,
                timer_handlers=tuple(self._timer_handlers(interface)),
            )
        handlers = [self._handler(kind, interface) for kind in _HANDLED[interface.kind]]
        cancel = Event(EventKind.CANCEL, interface.name)
        if interface.kind is InterfaceKind.ACTION_SERVER and cancel in self._thread_handled:
            handlers[1] = Source(f"self._cancel_{short}")
        named: list[tuple[Source, Source]] = []
        if interface.kind is InterfaceKind.ACTION_CLIENT:
            for keyword, kind in _GOAL_EVENTS.items():
                handler = self._handler(kind, interface)
                if handler is not None:
                    named.append((name(keyword), handler))
        return Endpoint(
            role,
            name(f"_{short}_{end}"),
            self._channels[key(interface)],
            tuple(handlers),
            tuple(named),
        )

    def _handler(self, kind: EventKind, interface: Interface) -> Source | None:
        port = self._handled.get(Event(kind, interface.name))
        return name(f"self.machine.{port.method}") if port is not None else None

    def _timer_handlers(self, interface: Interface) -> Iterator[program.TimerHandler]:
        event = Event(EventKind.TIMER, interface.name)
        if event in self._handled:
            yield program.TimerHandler(name(f"self.machine.{self._handled[event].method}"), None)
        for thread in self._machine.threads:
            if event in events_of(thread.machine):
                method = name(self._thread_handled[event].method)
                yield program.TimerHandler(method, self._threads(thread.interface))

    def _threads(self, interface_name: str) -> Source:
        """The attribute with the machines that execute the goals of an action server."""
        return name(f"_threads_{self._names.named(interface_name, EventKind.GOAL)}")

    def _cancels(self) -> Iterator[program.CancelMethod]:
        for interface in self._machine.interfaces:
            event = Event(EventKind.CANCEL, interface.name)
            if interface.kind is InterfaceKind.ACTION_SERVER and event in self._thread_handled:
                method = name(self._thread_handled[event].method)
                yield program.CancelMethod(
                    name(f"_cancel_{self._names.short(interface)}"),
                    self._handler(EventKind.CANCEL, interface),
                    tuple(
                        (self._threads(thread.interface), method)
                        for thread in self._machine.threads
                        if event in events_of(thread.machine)
                    ),
                )

    def _child_handlers(self, kind: EventKind) -> Iterator[program.ChildHandler]:
        """A model names a child by its number, or by a variable that has it."""
        for event, port in self._handled.items():
            if event.kind is kind:
                child = Source(self._context.child(event.name, "self.machine"))
                yield program.ChildHandler(child, name(f"self.machine.{port.method}"))

    # -- outputs ------------------------------------------------------------------------------

    def _message_outputs(self) -> Iterator[Output]:
        emits = dict.fromkeys(item for owner in self._owners for item in emits_of(owner))
        for kind, interface in emits:
            port = self._names.output(kind, interface)
            parameters = [Parameter(name(item), Source(of)) for item, of in port.parameters]
            if port.data is not None:
                data = name(self._class_of[port.data.name])
                parameters.append(Parameter(name(port.data_name), data))
            role, target, handler = self._leaves_by(kind, port)
            yield Output(
                name(port.method),
                tuple(parameters),
                output_doc(kind, interface, self._names),
                role,
                target,
                tuple(parameter.name for parameter in parameters),
                handler,
            )

    def _leaves_by(self, kind: OutputKind, port: OutputPort) -> tuple[str, Source, Source | None]:
        """Role, target and handler of an output; see :class:`m2c.codegen.program.Output`."""
        match kind:
            case OutputKind.START_THREAD:
                start = self._thread_handled.get(Event(EventKind.THREAD_START, port.interface))
                handler = name(start.method) if start is not None else None
                return "start_thread", self._threads(port.interface), handler
            case OutputKind.THREAD_FREE:
                free = self._handled.get(Event(EventKind.THREAD_FREE, port.interface))
                handler = name(free.method) if free is not None else None
                return "free_thread", name("self.machine"), handler
        if kind not in _PORT_METHOD:
            return "call", name(f"self._tree.{port.method}"), None
        short = port.method.removeprefix(f"{OUTPUT_VERB[kind]}_")
        return "call", name(f"self._{short}_{_PORT_METHOD[kind]}"), None

    def _binding_outputs(self) -> Iterator[Output]:
        called = {call.function for made in self._machines for call in program.calls_of(made)}
        fails = any(made.may_fail for made in self._machines)
        for method, (says, bound, parameters, besides) in _BINDING_OUTPUTS.items():
            if f"self._outputs.{method}" in called or (method == "fault" and fails):
                listed = tuple(Parameter(name(item), name(kind)) for item, kind in parameters)
                given = [parameter.name for parameter in listed]
                yield Output(
                    name(method),
                    listed,
                    Source(says),
                    "call",
                    name(f"self._binding.{bound}"),
                    (*given, *([name(besides)] if besides else [])),
                )


def _thread_class(own: str, index: int) -> str:
    return f"{own}Thread" if index == 0 else f"{own}Thread{index + 1}"


def _structures(machine: Machine, library: InterfaceLibrary) -> Iterator[Structure]:
    for interface in machine.interfaces:
        yield from _interface_structures(interface, library)
    for owner in [machine, *(thread.machine for thread in machine.threads)]:
        for data in owner.data:
            yield from _contained(data.type)


def _contained(kind: DataType) -> Iterable[Structure]:
    if isinstance(kind, Array):
        return _contained(kind.element)
    return [kind] if isinstance(kind, Structure) and kind.name else []


def _interface_structures(interface: Interface, library: InterfaceLibrary) -> list[Structure]:
    """The types of the messages of an interface's channel, in the order in which it is made of them."""
    match interface.kind:
        case InterfaceKind.PUBLISHER | InterfaceKind.SUBSCRIBER:
            return [library.message(interface.type_name)]
        case InterfaceKind.SERVER | InterfaceKind.CLIENT:
            service = library.service(interface.type_name)
            return [service.request, service.response]
        case InterfaceKind.ACTION_SERVER | InterfaceKind.ACTION_CLIENT:
            action = library.action(interface.type_name)
            return [action.goal, action.result, action.feedback]
        case InterfaceKind.TIMER:
            return []
