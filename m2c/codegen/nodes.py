"""A node's facts: what binds its machine to channels, and what the machine sends through it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from m2c.codegen import program
from m2c.codegen.context import MachineContext
from m2c.codegen.interfaces import class_names, message_classes, needed_structures
from m2c.codegen.machines import machine_program
from m2c.codegen.names import MODULE_NAMES, distinct, machine_class
from m2c.codegen.ports import PortNames, key
from m2c.codegen.program import Endpoint, Output
from m2c.codegen.source import Source, name
from m2c.language.datatypes import (
    FLOATS,
    INTEGER_RANGES,
    Array,
    DataType,
    Primitive,
    Structure,
    describe,
)
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Event, EventKind, Interface, InterfaceKind, Machine, OutputKind
from m2c.model.walk import emits_of, events_of, with_threads

_GOAL_EVENTS = {
    "accepted": EventKind.GOAL_ACCEPTED,
    "rejected": EventKind.GOAL_REJECTED,
    "feedback": EventKind.FEEDBACK,
    "succeeded": EventKind.SUCCEEDED,
    "aborted": EventKind.ABORTED,
    "canceled": EventKind.CANCELED,
    "failed": EventKind.GOAL_FAILED,
}
_ENDS: dict[InterfaceKind, tuple[str, tuple[EventKind, ...]]] = {
    InterfaceKind.PUBLISHER: ("Topic", ()),
    InterfaceKind.SUBSCRIBER: ("Topic", (EventKind.MESSAGE,)),
    InterfaceKind.SERVER: ("Service", (EventKind.REQUEST,)),
    InterfaceKind.CLIENT: ("Service", (EventKind.RESPONSE, EventKind.CALL_ERROR)),
    InterfaceKind.ACTION_SERVER: ("Action", (EventKind.GOAL, EventKind.CANCEL)),
    InterfaceKind.ACTION_CLIENT: ("Action", ()),
    InterfaceKind.TIMER: ("", (EventKind.TIMER,)),
}
"""What the channel of an interface is, and the events whose handlers it is given in order."""
_SHARED = {EventKind.MESSAGE: "take", EventKind.CANCEL: "cancel"}
"""Events of a channel that concern the machine and its threads, and what the node calls telling them all."""

_OF_LAUNCHERS = {Primitive(name) for name in (*INTEGER_RANGES, *FLOATS, "bool", "string")}
"""What a parameter of ROS 2 may be, or some of what it may have several of."""
_TAKEN = ("use_sim_time", "call_timeout_s")
"""Parameters that a node has anyway."""


def node_program(
    machine: Machine, library: InterfaceLibrary, package: str, is_stepwise: bool = False
) -> program.NodeProgram:
    """All facts of a node.

    Args:
        machine: its model, without errors (``m2c check``).
        library: the types of its channels.
        package: the dotted name of its Python package.
        is_stepwise: for ``m2c run --semantics as2fm``: what the templates ``stepwise_….py.j2`` need.
    """
    return _NodeFacts(machine, library, package, is_stepwise).facts()


class _NodeFacts:
    def __init__(
        self, machine: Machine, library: InterfaceLibrary, package: str, is_stepwise: bool
    ) -> None:
        self._machine = machine
        self._library = library
        self._package = package
        self._names = PortNames(machine, library)
        own = machine_class(machine.name)
        self._classes = [own, *(_thread_class(own, index) for index in range(len(machine.threads)))]
        self._owners = with_threads(machine)
        taken = {*MODULE_NAMES, f"{own}Node", *self._classes, *(f"{c}State" for c in self._classes)}
        structures = needed_structures(_structures(machine, library))
        self._class_of = class_names(structures, taken)
        self._messages = message_classes(structures, self._class_of)
        contexts = [
            MachineContext(
                owner, library, self._names, self._class_of, made, index > 0, is_stepwise
            )
            for index, (owner, made) in enumerate(zip(self._owners, self._classes, strict=True))
        ]
        self._context = contexts[0]
        self._machines = tuple(map(machine_program, contexts))
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
            outputs=tuple(self._outputs()),
            threads=tuple(
                program.ThreadProgram(
                    attribute=self._threads(thread.interface),
                    class_name=made.class_name,
                    count=thread.count,
                    uses_ports=made.uses_ports,
                    uses_random=made.uses_random,
                )
                for thread, made in zip(self._machine.threads, self._machines[1:], strict=True)
            ),
            shared=tuple(self._shared()),
            is_plugin=is_plugin,
            takes_ports=is_plugin or bool(self._machine.ports),
            parameters=() if is_plugin else tuple(self._parameters()),
            ticked=EventKind.BT_TICK in kinds,
            halted=EventKind.BT_HALT in kinds,
            child_status=self._children(EventKind.BT_CHILD_STATUS),
            child_halted=self._children(EventKind.BT_CHILD_HALTED),
        )

    def _parameters(self) -> Iterator[tuple[str, str, str]]:
        for data in self._machine.data:
            element = data.type.element if isinstance(data.type, Array) else data.type
            if element in _OF_LAUNCHERS and data.name not in _TAKEN:
                yield data.name, str(self._context.attribute(data.name)), describe(data.type)

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
                shape=name(_ENDS[interface.kind][0]),
                constant=name(constant),
                name=interface.channel if interface.port is None else None,
                port=interface.port,
                type_name=interface.type_name,
                classes=tuple(
                    name(self._class_of[kind.name])
                    for kind in _interface_structures(interface, self._library)
                ),
                best_effort=interface.best_effort,
                transient_local=interface.transient_local,
            )
        return found

    def _endpoint(self, interface: Interface) -> Endpoint:
        short = self._names.short(interface)
        role = interface.kind.value
        timer = interface.kind is InterfaceKind.TIMER
        handlers = [
            Source(f"self.{self._shared_method(kind, interface)}")
            if kind in _SHARED and self._each(kind, interface)
            else self._handler(kind, interface)
            for kind in _ENDS[interface.kind][1]
            if not interface.own
        ]
        if interface.kind is InterfaceKind.PUBLISHER:
            handlers = [
                handler
                for item in self._machine.interfaces
                if item.own and item.channel == interface.channel
                if (handler := self._handler(EventKind.MESSAGE, item))
            ]
        named = {}
        if interface.kind is InterfaceKind.ACTION_CLIENT:
            named = {word: self._handler(kind, interface) for word, kind in _GOAL_EVENTS.items()}
        return Endpoint(
            name(role),
            name(f"_{short}_{role.removeprefix('action_')}"),
            None if timer else self._channels[key(interface)],
            tuple(handlers),
            tuple((name(word), handler) for word, handler in named.items() if handler is not None),
            interface.name if timer else "",
            interface.rate_hz,
            interface.port if timer else None,
            self._each(EventKind.TIMER, interface) if timer else (),
        )

    def _handler(self, kind: EventKind, interface: Interface) -> Source | None:
        port = self._handled.get(Event(kind, interface.name))
        return name(f"self.machine.{port.method}") if port is not None else None

    def _each(self, kind: EventKind, interface: Interface) -> program.Parameters:
        """The threads that an event concerns: the attribute that has them, and their method."""
        event = Event(kind, interface.name)
        return tuple(
            (self._threads(thread.interface), name(self._names.event(event).method))
            for thread in self._machine.threads
            if event in events_of(thread.machine)
        )

    def _threads(self, interface_name: str) -> Source:
        """The attribute with the machines that execute the goals of an action server."""
        return name(f"_threads_{self._names.named(interface_name, EventKind.GOAL)}")

    def _shared(self) -> Iterator[program.SharedMethod]:
        for interface in self._machine.interfaces:
            for kind in _ENDS[interface.kind][1]:
                each = self._each(kind, interface) if kind in _SHARED else ()
                if each:
                    port = self._names.event(Event(kind, interface.name))
                    parameters = [(name(item), Source(of)) for item, of in port.parameters]
                    if port.data is not None:
                        of = self._class_of[port.data.name]
                        parameters.insert(0, (name(port.data_name), name(of)))
                    yield program.SharedMethod(
                        self._shared_method(kind, interface),
                        tuple(parameters),
                        self._handler(kind, interface),
                        each,
                    )

    def _shared_method(self, kind: EventKind, interface: Interface) -> Source:
        return name(f"_{_SHARED[kind]}_{self._names.short(interface)}")

    def _children(self, kind: EventKind) -> program.Parameters:
        """What is called when a child answers; a model names one by its number, or a variable."""
        return tuple(
            (
                Source(self._context.child(event.name, "self.machine")),
                name(f"self.machine.{port.method}"),
            )
            for event, port in self._handled.items()
            if event.kind is kind
        )

    def _outputs(self) -> Iterator[Output]:
        methods: set[str] = set()
        for kind, interface in dict.fromkeys(
            item for owner in self._owners for item in emits_of(owner)
        ):
            port = self._names.output(kind, interface)
            if port.method in methods:
                continue  # one method for all output ports, one for all children
            methods.add(port.method)
            parameters = [(name(item), Source(of)) for item, of in port.parameters]
            if port.data is not None:
                parameters.append((name(port.data_name), name(self._class_of[port.data.name])))
            leaves_by = name(f"self.{port.leaves_by}") if port.leaves_by else None
            handler = threads = None
            if kind is OutputKind.START_THREAD:
                start = self._thread_handled.get(Event(EventKind.THREAD_START, interface))
                handler = name(start.method) if start is not None else None
                threads = self._threads(interface)
            elif kind is OutputKind.THREAD_FREE:
                free = self._handled.get(Event(EventKind.THREAD_FREE, interface))
                handler = name(free.method) if free is not None else None
            yield Output(
                name(port.method), tuple(parameters), port.doc, leaves_by, handler, threads
            )


def _thread_class(own: str, index: int) -> str:
    return f"{own}Thread" if index == 0 else f"{own}Thread{index + 1}"


def _structures(machine: Machine, library: InterfaceLibrary) -> Iterator[Structure]:
    for interface in machine.interfaces:
        yield from _interface_structures(interface, library)
    for owner in with_threads(machine):
        kinds = [*(data.type for data in owner.data), *(port.type for port in owner.ports)]
        for kind in kinds:
            yield from _contained(kind)


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
