"""Interfaces that a machine declares and does not use."""

from __future__ import annotations

from m2c.diagnostics import DiagnosticLog
from m2c.model.machine import Event, EventKind, Interface, InterfaceKind, Machine
from m2c.model.scopes import interface_kind_of
from m2c.model.walk import emits_of, events_of, with_threads

_INPUTS = {
    InterfaceKind.SUBSCRIBER: (EventKind.MESSAGE, "its messages are never read"),
    InterfaceKind.SERVER: (EventKind.REQUEST, "its requests are never answered"),
    InterfaceKind.TIMER: (EventKind.TIMER, "its callbacks are never handled"),
    InterfaceKind.ACTION_SERVER: (EventKind.GOAL, "its goals are never handled"),
}


def check_interfaces(machine: Machine, log: DiagnosticLog) -> None:
    """Warn of interfaces nobody uses (``unused-interface``) and inputs nobody reads (``unread-input``)."""
    owners = with_threads(machine)
    events = {event for owner in owners for event in events_of(owner)}
    outputs = {output for owner in owners for output in emits_of(owner)}
    used = {(interface_kind_of(kind), name) for kind, name in outputs}
    used |= {(interface_kind_of(event.kind), event.name) for event in events}
    timers = {event.name for event in events if event.kind is EventKind.TIMER}
    used |= {(InterfaceKind.TIMER, name) for name in timers}
    used |= {(InterfaceKind.ACTION_SERVER, thread.interface) for thread in machine.threads}
    for interface in machine.interfaces:
        if (interface.kind, interface.name) not in used:
            shown = interface.channel or interface.name
            what = f"the {interface.kind.noun} {shown} is declared and never used"
            hint = "use it, or remove the declaration"
            if interface.kind in _INPUTS:
                _warn_unread(interface, log)
            else:
                log.warning("unused-interface", interface.position, "", what, hint)
        elif interface.kind in _INPUTS:
            kind, _ = _INPUTS[interface.kind]
            if Event(kind, interface.name) not in events:
                _warn_unread(interface, log)
        elif (
            interface.kind is InterfaceKind.CLIENT
            and Event(EventKind.RESPONSE, interface.name) not in events
        ):
            what = f"the client {interface.channel}: its responses are never read"
            hint = "handle it with <ros_service_handle_response>"
            log.warning("unread-input", interface.position, "", what, hint)


def _warn_unread(interface: Interface, log: DiagnosticLog) -> None:
    reason = _INPUTS[interface.kind][1]
    shown = interface.channel or interface.name
    what = f"the {interface.kind.noun} {shown}: {reason}"
    log.warning(
        "unread-input", interface.position, "", what, "handle it, or remove the declaration"
    )
