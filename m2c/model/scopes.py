"""What event data means for each kind of event, from the interface definitions."""

from __future__ import annotations

from collections.abc import Iterable

from m2c.language.datatypes import ANY, INT32, INT64, STRING, DataType, Structure
from m2c.language.expressions import EventPart
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Event, EventKind, Interface, InterfaceKind, Machine, OutputKind

_EVENT_INTERFACES = {
    EventKind.MESSAGE: InterfaceKind.SUBSCRIBER,
    EventKind.REQUEST: InterfaceKind.SERVER,
    EventKind.RESPONSE: InterfaceKind.CLIENT,
    EventKind.GOAL: InterfaceKind.ACTION_SERVER,
    EventKind.CANCEL: InterfaceKind.ACTION_SERVER,
    EventKind.THREAD_START: InterfaceKind.ACTION_SERVER,
    EventKind.THREAD_FREE: InterfaceKind.ACTION_SERVER,
    EventKind.GOAL_ACCEPTED: InterfaceKind.ACTION_CLIENT,
    EventKind.GOAL_REJECTED: InterfaceKind.ACTION_CLIENT,
    EventKind.FEEDBACK: InterfaceKind.ACTION_CLIENT,
    EventKind.SUCCEEDED: InterfaceKind.ACTION_CLIENT,
    EventKind.ABORTED: InterfaceKind.ACTION_CLIENT,
    EventKind.CANCELED: InterfaceKind.ACTION_CLIENT,
    EventKind.GOAL_FAILED: InterfaceKind.ACTION_CLIENT,
}
_OUTPUT_INTERFACES = {
    OutputKind.PUBLISH: InterfaceKind.PUBLISHER,
    OutputKind.REQUEST: InterfaceKind.CLIENT,
    OutputKind.RESPONSE: InterfaceKind.SERVER,
    OutputKind.SEND_GOAL: InterfaceKind.ACTION_CLIENT,
    OutputKind.SEND_CANCEL: InterfaceKind.ACTION_CLIENT,
    OutputKind.ACCEPT_GOAL: InterfaceKind.ACTION_SERVER,
    OutputKind.REJECT_GOAL: InterfaceKind.ACTION_SERVER,
    OutputKind.FEEDBACK: InterfaceKind.ACTION_SERVER,
    OutputKind.SUCCEED: InterfaceKind.ACTION_SERVER,
    OutputKind.ABORT: InterfaceKind.ACTION_SERVER,
    OutputKind.CANCEL: InterfaceKind.ACTION_SERVER,
    OutputKind.START_THREAD: InterfaceKind.ACTION_SERVER,
    OutputKind.THREAD_FREE: InterfaceKind.ACTION_SERVER,
}


def readable_ports(machine: Machine) -> dict[str, DataType]:
    """Type of every port of ``machine`` that ``<bt_get_input>`` reads, outputs included."""
    by_direction = sorted(machine.ports, key=lambda port: not port.output)
    return {port.key: port.type for port in by_direction}


def interface_kind_of(kind: EventKind | OutputKind) -> InterfaceKind | None:
    """The kind of interface that an event comes from or an output leaves by; None if by none."""
    if isinstance(kind, EventKind):
        return _EVENT_INTERFACES.get(kind)
    return _OUTPUT_INTERFACES.get(kind)


def event_parts(
    event: Event | None, machine: Machine, library: InterfaceLibrary
) -> dict[str, DataType]:
    """Type of every ``EventData`` part that a transition on ``event`` can read.

    Raises:
        KeyError: the interface's type is not in ``library``.
    """
    if event is None:
        return {}
    if event.kind is EventKind.INTERNAL:
        return {"data": ANY, "name": STRING, "goal_id": ANY, "thread_id": ANY}
    if event.kind is EventKind.BT_CHILD_STATUS:
        return {"status": STRING}
    data = event_data_type(event, machine, library)
    parts: dict[str, DataType] = {} if data is None else {"data": data}
    for part, kind in _action_parts(event).items():
        parts[part] = kind
    return parts


def _action_parts(event: Event) -> dict[EventPart, DataType]:
    """What an event of an action has besides its message."""
    parts: dict[EventPart, DataType] = {}
    kind = interface_kind_of(event.kind)
    if kind in (InterfaceKind.ACTION_SERVER, InterfaceKind.ACTION_CLIENT):
        parts["goal_id"] = INT64
    if event.kind in (EventKind.THREAD_START, EventKind.THREAD_FREE):
        parts["thread_id"] = INT64
    if event.kind in (EventKind.SUCCEEDED, EventKind.ABORTED, EventKind.CANCELED):
        parts["code"] = INT32
    return parts


def parts_in_data(
    event: Event, interfaces: Iterable[Interface], library: InterfaceLibrary
) -> frozenset[EventPart]:
    """Parts of ``event`` that are written as fields of its data too, ``_event.data.thread_id`` (as in AS2FM).

    A field of that name in the message itself comes first.
    """
    parts = _action_parts(event)
    kind = interface_kind_of(event.kind)
    declared = (known for known in interfaces if known.kind is kind and known.name == event.name)
    interface = next(declared, None)
    if not parts or interface is None:
        return frozenset()
    try:
        data = _data_type(event.kind, interface, library)
    except KeyError:
        data = None  # reported where it is declared
    return frozenset(part for part in parts if data is None or data.field(part) is None)


def event_data_type(event: Event, machine: Machine, library: InterfaceLibrary) -> Structure | None:
    """The message type that ``event`` carries, if it carries one."""
    kind = _EVENT_INTERFACES.get(event.kind)
    interface = machine.interface(event.name, kind) if kind is not None else None
    return None if interface is None else _data_type(event.kind, interface, library)


def _data_type(
    kind: EventKind, interface: Interface, library: InterfaceLibrary
) -> Structure | None:
    match kind:
        case EventKind.MESSAGE:
            return library.message(interface.type_name)
        case EventKind.REQUEST:
            return library.service(interface.type_name).request
        case EventKind.RESPONSE:
            return library.service(interface.type_name).response
        case EventKind.GOAL | EventKind.THREAD_START:
            return library.action(interface.type_name).goal
        case EventKind.FEEDBACK:
            return library.action(interface.type_name).feedback
        case EventKind.SUCCEEDED | EventKind.ABORTED | EventKind.CANCELED:
            return library.action(interface.type_name).result
        case _:
            return None


def output_data_type(
    kind: OutputKind, name: str, machine: Machine, library: InterfaceLibrary
) -> Structure | None:
    """The message type that an output of ``kind`` on interface ``name`` carries, if any."""
    interface_kind = _OUTPUT_INTERFACES.get(kind)
    interface = machine.interface(name, interface_kind) if interface_kind is not None else None
    if interface is None:
        return None
    match kind:
        case OutputKind.PUBLISH:
            return library.message(interface.type_name)
        case OutputKind.REQUEST:
            return library.service(interface.type_name).request
        case OutputKind.RESPONSE:
            return library.service(interface.type_name).response
        case OutputKind.SEND_GOAL | OutputKind.START_THREAD:
            return library.action(interface.type_name).goal
        case OutputKind.FEEDBACK:
            return library.action(interface.type_name).feedback
        case OutputKind.SUCCEED | OutputKind.ABORT | OutputKind.CANCEL:
            return library.action(interface.type_name).result
        case _:
            return None
