"""``node.py`` of a generated package: the machine's channels, and a method per output."""

from __future__ import annotations

import json

from m2c.codegen.layout import INDENT, call
from m2c.codegen.names import attribute, snake
from m2c.codegen.outputs import EXTRA_OUTPUTS, output_doc, output_protocol, parameters
from m2c.codegen.ports import OUTPUT_VERB, OutputPort, PortNames, emits_of, events_of, key
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Event,
    EventKind,
    Interface,
    InterfaceKind,
    Machine,
    OutputKind,
)

_GOAL_EVENTS = {
    "accepted": EventKind.GOAL_ACCEPTED,
    "rejected": EventKind.GOAL_REJECTED,
    "feedback": EventKind.FEEDBACK,
    "succeeded": EventKind.SUCCEEDED,
    "aborted": EventKind.ABORTED,
    "canceled": EventKind.CANCELED,
}
_PORT_METHOD = {
    OutputKind.PUBLISH: "publish",
    OutputKind.REQUEST: "call",
    OutputKind.RESPONSE: "respond",
    OutputKind.SEND_GOAL: "send_goal",
    OutputKind.SEND_CANCEL: "send_cancel",
    OutputKind.ACCEPT_GOAL: "accept",
    OutputKind.REJECT_GOAL: "reject",
    OutputKind.FEEDBACK: "feedback",
    OutputKind.SUCCEED: "succeed",
    OutputKind.ABORT: "abort",
    OutputKind.CANCEL: "canceled",
}
_CHANNEL_CLASS = {
    InterfaceKind.PUBLISHER: "Topic",
    InterfaceKind.SUBSCRIBER: "Topic",
    InterfaceKind.SERVER: "Service",
    InterfaceKind.CLIENT: "Service",
    InterfaceKind.ACTION_SERVER: "Action",
    InterfaceKind.ACTION_CLIENT: "Action",
}


class NodeWriter:
    """Writes the node class of one machine."""

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary,
        names: PortNames,
        class_of: dict[str, str],
        class_name: str,
    ) -> None:
        self._machine = machine
        self._library = library
        self._names = names
        self._class_of = class_of
        self._class_name = class_name
        self._threads = [
            (thread, f"{class_name}Thread" if index == 0 else f"{class_name}Thread{index + 1}")
            for index, thread in enumerate(machine.threads)
        ]
        handled = {event: names.event(event) for event in events_of(machine)}
        self._handled = handled
        self._thread_handled = {
            event: names.event(event)
            for thread in machine.threads
            for event in events_of(thread.machine)
        }
        self._emits = list(
            dict.fromkeys(
                [
                    *emits_of(machine),
                    *(item for thread in machine.threads for item in emits_of(thread.machine)),
                ]
            )
        )

    def output_protocol(self) -> list[str]:
        """The ``Outputs`` protocol that the machine sends through."""
        return output_protocol(
            self._machine, self._emits, self.extra_outputs, self._names, self._class_of
        )

    extra_outputs: tuple[str, ...] = ()

    @property
    def is_plugin(self) -> bool:
        """Whether the machine is a behaviour-tree plugin."""
        kinds = {event.kind for event in self._handled}
        return bool(kinds & {EventKind.BT_TICK, EventKind.BT_HALT})

    def lines(self) -> list[str]:
        """Channel constants and the node class."""
        lines: list[str] = []
        for interface in self._channels():
            if interface.port is None:
                lines += self._channel_constant(interface)
        lines += ["", "", f"class {self._class_name}Node:"]
        lines += [f'{INDENT}"""Binds ``{self._machine.name}`` to its channels."""', ""]
        lines += self._constructor()
        lines += self._lifecycle()
        for kind, name in self._emits:
            lines += self._output_method(kind, name)
        lines += self._extra_methods()
        return lines

    def _channels(self) -> list[Interface]:
        unique: dict[str, Interface] = {}
        for interface in self._machine.interfaces:
            if interface.kind is not InterfaceKind.TIMER:
                unique.setdefault(key(interface), interface)
        return list(unique.values())

    def _constant(self, interface: Interface) -> str:
        return self._names.short(interface).upper()

    def _channel_constant(self, interface: Interface) -> list[str]:
        channel = f'"{interface.channel}"'
        arguments = [channel, f'"{interface.type_name}"', *self._classes(interface)]
        arguments += ["Reliability.BEST_EFFORT"] if interface.best_effort else []
        arguments += ["latched=True"] if interface.latched else []
        return call(f"{self._constant(interface)} = {_CHANNEL_CLASS[interface.kind]}", arguments, 0)

    def _classes(self, interface: Interface) -> list[str]:
        match _CHANNEL_CLASS[interface.kind]:
            case "Topic":
                types = [self._library.message(interface.type_name)]
            case "Service":
                service = self._library.service(interface.type_name)
                types = [service.request, service.response]
            case _:
                action = self._library.action(interface.type_name)
                types = [action.goal, action.result, action.feedback]
        return [self._class_of[kind.name] for kind in types]

    def _channel_text(self, interface: Interface) -> str:
        if interface.port is None:
            return self._constant(interface)
        classes = ", ".join(self._classes(interface))
        return (
            f'{_CHANNEL_CLASS[interface.kind]}(ports["{interface.port}"], '
            f'"{interface.type_name}", {classes})'
        )

    def _constructor(self) -> list[str]:
        accepted = ["self", "transport: Transport"]
        if self.is_plugin:
            accepted.append("tree: TreeSide")
        accepted.append("settings: NodeSettings = DEFAULT_SETTINGS")
        if self.is_plugin or self._machine.ports:
            accepted.append("ports: Mapping[str, Any] = MappingProxyType({})")
        lines = call("def __init__", accepted, 1, " -> None:")
        body = [f"self.machine = {self._class_name}({', '.join(self._machine_arguments())})"]
        for thread, thread_class in self._threads:
            body.append(f"self._threads_{self._thread_name(thread.interface)} = [")
            arguments = [
                "self",
                *(["ports"] if self._needs_ports(thread_class) else []),
                "thread_id",
            ]
            body.append(
                f"{INDENT}{thread_class}({', '.join(arguments)}) for thread_id in range({thread.count})"
            )
            body.append("]")
        name = "transport.node"
        body += call("binding = Binding", ["transport", name, "settings", "self._state"], 0)
        body.append("self._binding = binding")
        if self.is_plugin:
            body.append("self._tree = tree")
        for interface in self._machine.interfaces:
            body += self._bind(interface)
        return [*lines, *(f"{INDENT * 2}{line}" for line in body)]

    ports_users: frozenset[str] = frozenset()

    def _needs_ports(self, class_name: str) -> bool:
        return class_name in self.ports_users

    def _machine_arguments(self) -> list[str]:
        return ["self", *(["ports"] if self._needs_ports(self._class_name) else [])]

    def _thread_name(self, interface_name: str) -> str:
        interface = self._machine.interface(interface_name, InterfaceKind.ACTION_SERVER)
        return self._names.short(interface) if interface is not None else snake(interface_name)

    def _handler(self, kind: EventKind, interface: Interface) -> str:
        port = self._handled.get(Event(kind, interface.name))
        return f"self.machine.{port.method}" if port is not None else "None"

    def _bind(self, interface: Interface) -> list[str]:
        short = self._names.short(interface)
        channel = self._channel_text(interface) if interface.kind is not InterfaceKind.TIMER else ""
        match interface.kind:
            case InterfaceKind.PUBLISHER:
                return call(f"self._{short}_publisher = binding.publisher", [channel], 0)
            case InterfaceKind.SUBSCRIBER:
                handler = self._handler(EventKind.MESSAGE, interface)
                return (
                    [] if handler == "None" else _bind_call("binding.subscribe", [channel, handler])
                )
            case InterfaceKind.SERVER:
                handler = self._handler(EventKind.REQUEST, interface)
                return _bind_call(f"self._{short}_server = binding.server", [channel, handler])
            case InterfaceKind.CLIENT:
                arguments = [
                    channel,
                    self._handler(EventKind.RESPONSE, interface),
                    self._handler(EventKind.CALL_ERROR, interface),
                ]
                return _bind_call(f"self._{short}_client = binding.client", arguments)
            case InterfaceKind.ACTION_SERVER:
                cancel = self._handler(EventKind.CANCEL, interface)
                if Event(EventKind.CANCEL, interface.name) in self._thread_handled:
                    cancel = f"self._cancel_{short}"
                arguments = [channel, self._handler(EventKind.GOAL, interface), cancel]
                return _bind_call(f"self._{short}_server = binding.action_server", arguments)
            case InterfaceKind.ACTION_CLIENT:
                handlers = [
                    f"{field}={handler}"
                    for field, kind in _GOAL_EVENTS.items()
                    if (handler := self._handler(kind, interface)) != "None"
                ]
                lines = _bind_call("handlers = GoalHandlers", handlers)
                return [
                    *lines,
                    *_bind_call(
                        f"self._{short}_client = binding.action_client", [channel, "handlers"]
                    ),
                ]
            case InterfaceKind.TIMER:
                return self._bind_timer(interface)

    def _bind_timer(self, interface: Interface) -> list[str]:
        event = Event(EventKind.TIMER, interface.name)
        name = json.dumps(interface.name)
        lines = []
        if event in self._handled:
            handler = f"self.machine.{self._handled[event].method}"
            lines += _bind_call("binding.timer", [repr(interface.rate_hz), handler, name])
        for thread, _ in self._threads:
            if event in events_of(thread.machine):
                threads = f"self._threads_{self._thread_name(thread.interface)}"
                method = self._thread_handled[event].method
                lines.append(f"for thread in {threads}:")
                timer = f"binding.timer({interface.rate_hz!r}, thread.{method}, {name})"
                lines.append(f"{INDENT}{timer}")
        return lines

    def _lifecycle(self) -> list[str]:
        lines = ["", f"{INDENT}def start(self) -> None:"]
        lines.append(f'{INDENT * 2}"""Enter the machine\'s initial state."""')
        for thread, _ in self._threads:
            lines.append(
                f"{INDENT * 2}for thread in self._threads_{self._thread_name(thread.interface)}:"
            )
            lines.append(f"{INDENT * 3}thread.start()")
        lines.append(f"{INDENT * 2}self.machine.start()")
        lines += [
            "",
            f"{INDENT}def _state(self) -> str:",
            f"{INDENT * 2}return self.machine.state.value",
        ]
        if self.is_plugin:
            for kind, method in ((EventKind.BT_TICK, "tick"), (EventKind.BT_HALT, "halt")):
                handled = any(event.kind is kind for event in self._handled)
                lines += ["", f"{INDENT}def {method}(self) -> None:"]
                lines.append(f'{INDENT * 2}"""The behaviour tree {method}s this node."""')
                if kind is EventKind.BT_TICK:
                    lines += [f"{INDENT * 2}self.machine.on_tick()"] if handled else []
                elif handled:
                    lines.append(f"{INDENT * 2}if not self.machine.on_halt():")
                    lines.append(f"{INDENT * 3}self._tree.return_halted()  # nothing to halt")
                else:
                    lines.append(f"{INDENT * 2}self._tree.return_halted()")
            lines += self._child_method("child_status", EventKind.BT_CHILD_STATUS, ("status",))
            lines += self._child_method("child_halted", EventKind.BT_CHILD_HALTED, ())
        for interface in self._machine.interfaces:
            event = Event(EventKind.CANCEL, interface.name)
            if interface.kind is InterfaceKind.ACTION_SERVER and event in self._thread_handled:
                lines += self._cancel_method(interface, event)
        return lines

    def _child_method(self, name: str, kind: EventKind, arguments: tuple[str, ...]) -> list[str]:
        """What a child answers; a model names it by its number, or by a variable that has it."""
        events = [event for event in self._handled if event.kind is kind]
        if not events:
            return []
        accepted = "".join(f", {argument}: str" for argument in arguments)
        what = "returned a status" if arguments else "was halted"
        lines = ["", f"{INDENT}def {name}(self, child: int{accepted}) -> None:"]
        lines.append(f'{INDENT * 2}"""A child of this node {what}."""')
        for event in events:
            number = event.name
            if not number.isdigit():
                number = f"self.machine.{attribute(number)}"
            method = f"self.machine.{self._handled[event].method}({', '.join(arguments)})"
            lines.append(f"{INDENT * 2}if child == {number} and {method}:")
            lines.append(f"{INDENT * 3}return")
        text = f'"state %s discards that child %s {what}", self._state(), child'
        return [*lines, *call("self._binding.log.warning", [text], 2)]

    def _cancel_method(self, interface: Interface, event: Event) -> list[str]:
        short = self._names.short(interface)
        lines = ["", f"{INDENT}def _cancel_{short}(self, goal_id: int) -> None:"]
        if event in self._handled:
            lines.append(f"{INDENT * 2}self.machine.{self._handled[event].method}(goal_id)")
        for thread, _ in self._threads:
            if event in events_of(thread.machine):
                lines.append(
                    f"{INDENT * 2}for thread in self._threads_{self._thread_name(thread.interface)}:"
                )
                lines.append(f"{INDENT * 3}thread.{self._thread_handled[event].method}(goal_id)")
        return lines

    def _output_method(self, kind: OutputKind, name: str) -> list[str]:
        port = self._names.output(kind, name)
        lines = ["", *call(f"def {port.method}", parameters(port, self._class_of), 1, " -> None:")]
        lines.append(f'{INDENT * 2}"""{output_doc(kind, self._names.channel(name, kind))}"""')
        arguments = [parameter for parameter, _ in port.parameters]
        if port.data is not None:
            arguments.append(port.data_name)
        return [*lines, *self._output_body(kind, port, arguments)]

    def _output_body(self, kind: OutputKind, port: OutputPort, arguments: list[str]) -> list[str]:
        match kind:
            case OutputKind.BT_RETURN_STATUS:
                return [f"{INDENT * 2}self._tree.return_status(status)"]
            case OutputKind.BT_RETURN_HALTED:
                return [f"{INDENT * 2}self._tree.return_halted()"]
            case OutputKind.BT_SET_OUTPUT:
                return [f"{INDENT * 2}self._tree.set_output(key, value)"]
            case OutputKind.BT_TICK_CHILD | OutputKind.BT_HALT_CHILD:
                return [f"{INDENT * 2}self._tree.{port.method}(child)"]
            case OutputKind.START_THREAD:
                start = self._thread_handled.get(Event(EventKind.THREAD_START, port.interface))
                short = self._thread_name(port.interface)
                if start is None:
                    return [f'{INDENT * 2}self._binding.log.error("no thread %s", thread_id)']
                return [
                    f"{INDENT * 2}thread = self._threads_{short}[thread_id]",
                    *call(
                        "self._binding.post",
                        [f"lambda: thread.{start.method}(goal, goal_id, thread_id)"],
                        2,
                    ),
                ]
            case OutputKind.THREAD_FREE:
                free = self._handled.get(Event(EventKind.THREAD_FREE, port.interface))
                if free is None:
                    return [f'{INDENT * 2}self._binding.log.debug("thread %s is free", thread_id)']
                return call(
                    "self._binding.post",
                    [f"lambda: self.machine.{free.method}(goal_id, thread_id)"],
                    2,
                )
        short = port.method.removeprefix(f"{_verb(kind)}_")
        role = {
            OutputKind.PUBLISH: "publisher",
            OutputKind.REQUEST: "client",
            OutputKind.SEND_GOAL: "client",
            OutputKind.SEND_CANCEL: "client",
        }.get(kind, "server")
        return call(f"self._{short}_{role}.{_PORT_METHOD[kind]}", arguments, 2)

    def _extra_methods(self) -> list[str]:
        lines: list[str] = []
        for method in self.extra_outputs:
            extra = EXTRA_OUTPUTS[method]
            lines += ["", *call(f"def {method}", ["self", *extra.parameters], 1, " -> None:")]
            lines.append(f'{INDENT * 2}"""{extra.doc}"""')
            lines += call(f"self._binding.{extra.method}", extra.arguments, 2)
        return lines


def _verb(kind: OutputKind) -> str:
    return OUTPUT_VERB[kind]


def _bind_call(head: str, arguments: list[str]) -> list[str]:
    """A call inside ``__init__``: it will stand two levels deep."""
    return [line[len(INDENT) * 2 :] for line in call(head, arguments, 2)]
