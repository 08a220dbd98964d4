"""Plain SCXML: what its events mean on the middleware.

The earlier tool names events ``CMD_TICK``, ``TICK_RESPONSE``, ``CMD_HALT``, ``HALT_RESPONSE`` and, for
a component X with an interface Y, ``X.Y.Call``, ``X.Y.Return``, ``X.Y.Sub`` and ``X.Y.Pub``. They are
mapped to declared interfaces here; what is not of that form stays an event of the machine's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Emit,
    Event,
    EventKind,
    Interface,
    InterfaceKind,
    Machine,
    OutputKind,
    Raise,
    Statement,
    Transition,
)
from m2c.model.nesting import with_written
from m2c.model.structure import note_read_as
from m2c.model.walk import changed, statements_of, with_event_name

_TREE_EVENTS = {
    "CMD_TICK": ("tick", True),
    "TICK_RESPONSE": ("tick", False),
    "CMD_HALT": ("halt", True),
    "HALT_RESPONSE": ("halt", False),
}
_SUFFIXES: dict[str, tuple[InterfaceKind, EventKind | OutputKind]] = {
    "Call": (InterfaceKind.CLIENT, OutputKind.REQUEST),
    "Pub": (InterfaceKind.PUBLISHER, OutputKind.PUBLISH),
    "Return": (InterfaceKind.CLIENT, EventKind.RESPONSE),
    "Sub": (InterfaceKind.SUBSCRIBER, EventKind.MESSAGE),
}

_SAID = {
    (InterfaceKind.SERVER, True): "a request to",
    (InterfaceKind.SERVER, False): "a response of",
    (InterfaceKind.CLIENT, True): "a response of",
    (InterfaceKind.CLIENT, False): "a call of",
    (InterfaceKind.SUBSCRIBER, True): "a message on",
    (InterfaceKind.PUBLISHER, False): "a message on",
}
"""What goes over an interface, in words; True: to the machine."""

Meaning = tuple[InterfaceKind, str, EventKind | OutputKind]
"""The interface's kind, its channel, and what goes over it."""


def meaning_of(event: str, skill: str) -> Meaning | None:
    """What ``event`` of the plain machine of ``skill`` means; None if it is the machine's own."""
    if event in _TREE_EVENTS:
        service, incoming = _TREE_EVENTS[event]
        direction = EventKind.REQUEST if incoming else OutputKind.RESPONSE
        return InterfaceKind.SERVER, f"/{skill}/{service}", direction
    if means_channel(event):
        *parts, suffix = event.split(".")
        kind, direction_of_suffix = _SUFFIXES[suffix]
        return kind, "/" + "/".join(parts), direction_of_suffix
    return None


def means_channel(event: str) -> bool:
    """Whether ``event`` is called as plain SCXML calls what goes over a channel."""
    parts = event.split(".")
    return event in _TREE_EVENTS or (len(parts) >= 3 and parts[-1] in _SUFFIXES)


def bind_plain_events(
    machine: Machine,
    library: InterfaceLibrary,
    reference: Machine | None,
    channels: Mapping[str, str],
    log: DiagnosticLog,
) -> Machine:
    """The same machine with its middleware events on declared interfaces.

    Args:
        machine: as read, all events internal.
        library: interface types, for channels that nobody declares.
        reference: the machine that this one stands in for; its interfaces are taken first.
        channels: type of every channel that the system's machines declare.
        log: where ``unbound-event`` goes (an event of the known form whose type cannot be found).

    Returns:
        ``machine`` itself if it has no middleware event.
    """
    binder = _Binder(machine, library, reference, channels, log)
    used = [name for name in _event_names(machine) if binder.meaning(name) is not None]
    if not used:
        return machine
    return binder.bind()


class _Binder:
    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary,
        reference: Machine | None,
        channels: Mapping[str, str],
        log: DiagnosticLog,
    ) -> None:
        self._machine = machine
        self._library = library
        self._log = log
        self._known = dict(channels)
        if reference is not None:
            for interface in reference.interfaces:
                self._known[interface.channel or ""] = interface.type_name
        name = machine.name
        self._tick_kind = "Action" if name.endswith("Action") else "Condition"
        for suffix in ("Condition", "Action"):
            name = name.removesuffix(suffix)
        self._name = reference.name if reference is not None else name
        self._noted: set[str] = set()
        self._interfaces: dict[tuple[InterfaceKind, str], Interface] = {}

    def meaning(self, event: str) -> Meaning | None:
        """See :func:`meaning_of`."""
        return meaning_of(event, self._name)

    def bind(self) -> Machine:
        at, name = self._machine.position, self._machine.name
        if name != self._name:
            note_read_as(at, "scxml", name, f"the skill `{self._name}`", self._log)
        bound = with_written(
            self._machine, lambda state: changed(state, self._statement, self._transition)
        )
        interfaces = tuple(self._interfaces.values())
        return msgspec.structs.replace(bound, name=self._name, interfaces=interfaces)

    def _interface(self, meaning: Meaning, at: Position, event: str) -> str:
        kind, channel, direction = meaning
        if (kind, channel) not in self._interfaces:
            type_name = self._type(kind, channel)
            if type_name is None:
                folder = (
                    "msg" if kind in (InterfaceKind.SUBSCRIBER, InterfaceKind.PUBLISHER) else "srv"
                )
                self._log.error(
                    "unbound-event",
                    at,
                    "",
                    f"`{event}` means {channel}, whose type is not known",
                    f"read it together with a machine that declares {channel}, or add the .{folder} "
                    "definition",
                )
            self._interfaces[kind, channel] = Interface(
                kind=kind, name=channel, position=at, channel=channel, type_name=type_name or ""
            )
        if event not in self._noted:
            self._noted.add(event)
            note_read_as(
                at,
                "",
                event,
                f"{_SAID[kind, isinstance(direction, EventKind)]} {channel}",
                self._log,
            )
        return channel

    def _type(self, kind: InterfaceKind, channel: str) -> str | None:
        if channel in self._known:
            return self._known[channel]
        last = channel.rpartition("/")[2]
        if kind is InterfaceKind.SERVER:
            last = f"Tick{self._tick_kind}" if last == "tick" else "HaltAction"
        folder = "msg" if kind in (InterfaceKind.SUBSCRIBER, InterfaceKind.PUBLISHER) else "srv"
        found = [name for name in self._library.names(folder) if name.endswith(f"/{last}")]
        return found[0] if len(found) == 1 else None

    def _transition(self, transition: Transition) -> Transition:
        event = transition.event
        if event is not None and event.kind is EventKind.INTERNAL:
            meaning = self.meaning(event.name)
            if meaning is not None and isinstance(meaning[2], EventKind):
                name = self._interface(meaning, transition.position, event.name)
                transition = with_event_name(transition, event.name)
                event = Event(meaning[2], name)
        return msgspec.structs.replace(transition, event=event)

    def _statement(self, statement: Statement) -> Statement:
        match statement:
            case Raise(event=event, position=position, fields=fields, external=True):
                meaning = self.meaning(event)
                if meaning is None or not isinstance(meaning[2], OutputKind):
                    return statement
                name = self._interface(meaning, position, event)
                return Emit(kind=meaning[2], interface=name, position=position, fields=fields)
            case _:
                return statement


def _event_names(machine: Machine) -> Iterator[str]:
    for state in machine.states:
        for transition in state.transitions:
            if transition.event is not None:
                yield transition.event.name
    for statement in statements_of(machine):
        if isinstance(statement, Raise):
            yield statement.event
