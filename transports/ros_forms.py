"""What messages of ROS 2 mean as observations, whoever reads them: a tap from rclpy, or a bag.

Three forms are more than they seem: service events (``<service>/_service_event``), a
``std_msgs/msg/String`` that carries a message without a ROS type, and the record of a call that ended
without a response (on ``/_m2c/call_errors``).
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from transports.interface import Observation, ObservationKind
from transports.payloads import PayloadError, decode_with, shallow
from transports.service_events import KIND_OF_EVENT, TYPE_SUFFIX

_PREFIX_BYTES = 12
"""Of a GID: the participant (DDS-RTPS 9.3.1)."""
_MOST_LIFE = 2**63 - 1


def life_of(gid: bytes) -> int:
    """The life of the node with an endpoint of this GID: all that a process opens has one participant.

    The two ends of a call know its client by different endpoints of that.
    """
    return int.from_bytes(gid[:_PREFIX_BYTES], "big") & _MOST_LIFE


def _life_of_text(gid: str) -> int:
    try:
        return life_of(bytes.fromhex(gid))
    except ValueError:
        return 0


OWN_PACKAGES = ("m2c/", "moon_msgs/")
"""Packages of types that have no ROS definition: what the tools report to each other."""
STRING = "std_msgs/msg/String"
CALL_ERRORS = "/_m2c/call_errors"
"""Where it is reported how calls ended without a response."""


class Carried(msgspec.Struct, frozen=True):
    """A message without a ROS type, and the type that it has here."""

    m2c_type: str
    message: Any


_decode_carried = msgspec.json.Decoder(Carried).decode


def carried_message(text: str) -> Carried | None:
    """What a String carries, if it carries one of our messages."""
    if not text.startswith('{"m2c_type":'):
        return None
    try:
        return read_carried(text)
    except PayloadError:
        return None


def read_carried(text: str) -> Carried:
    """What a String carries; PayloadError if that is none of our messages."""
    carried: Carried = decode_with(_decode_carried, text)
    shallow(carried.message, len(text))
    return carried


class CallError(msgspec.Struct, frozen=True):
    """A call that did not end in a response.

    Attributes:
        service, type_name: full name and type.
        by_server: whether the server says so (it failed the request), or the client (how it ended).
        client, gid: the calling node and its GID as the server sees it, hexadecimal.
        call: the number of the client's call.
        error: ``remote_error: …``, ``timeout: …``, ``unavailable: …``.
        node: who says so.
        stamp_ns: when, ns since the epoch.
    """

    service: str
    type_name: str
    by_server: bool
    client: str
    gid: str
    call: int
    error: str
    node: str
    stamp_ns: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]


_decode_error = msgspec.json.Decoder(CallError).decode


def read_call_error(text: str) -> CallError:
    """The record; PayloadError if it is none."""
    error: CallError = decode_with(_decode_error, text)
    return error


class Received(msgspec.Struct, frozen=True):
    """How something was received.

    Attributes:
        at_ns: when.
        source: who published it; empty where not known.
        sequence: its number as a publication; -1 where not known.
        life: of who published it (``Observation.life``); 0 where not known.
    """

    at_ns: int
    source: str = ""
    sequence: int = -1
    life: int = 0


class CallEvent(msgspec.Struct, frozen=True):
    """What an event of a call says.

    Attributes:
        event_type: of its ``service_msgs/msg/ServiceEventInfo``.
        stamp_ns: of the same.
        call: its ``sequence_number``.
        client: who calls.
        client_life: of who calls (``Observation.client_life``); 0 where not known.
        contents: the request or response, plain; None if the event has none.
    """

    event_type: int
    stamp_ns: int
    call: int
    client: str
    client_life: int
    contents: Any


def of_message(
    channel: str, type_name: str, data: Any, stamp_ns: int, received: Received
) -> Observation:
    """A message of a topic; ``data`` is plain (maps, lists and scalars)."""
    if type_name == STRING:
        carried = carried_message(data["data"])
        if carried is not None:
            type_name, data = carried.m2c_type, carried.message
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=received.at_ns,
        channel=channel,
        kind=ObservationKind.MESSAGE,
        type_name=type_name,
        data=data,
        source=received.source,
        sequence=received.sequence,
        life=received.life,
    )


def is_request(event_type: int) -> bool:
    """Whether an event of ``service_msgs/msg/ServiceEventInfo.event_type`` is about a request."""
    return KIND_OF_EVENT[event_type] in (
        ObservationKind.REQUEST_SENT,
        ObservationKind.REQUEST_RECEIVED,
    )


def of_event(channel: str, type_name: str, event: CallEvent, received: Received) -> Observation:
    """One of the four events of a call.

    Args:
        channel: the service.
        type_name: of the event (``pkg/srv/Name_Event``).
        event: what it says.
        received: how.
    """
    part = "_Request" if is_request(event.event_type) else "_Response"
    return Observation(
        stamp_ns=event.stamp_ns,
        received_ns=received.at_ns,
        channel=channel,
        kind=KIND_OF_EVENT[event.event_type],
        type_name=type_name.removesuffix(TYPE_SUFFIX) + part,
        data=event.contents,
        source=received.source,
        sequence=received.sequence,
        client=event.client,
        call=event.call,
        life=received.life,
        client_life=event.client_life,
    )


def of_call_error(error: CallError, channel: str, received_ns: int, life: int = 0) -> Observation:
    """The end of a call that had no response.

    Args:
        error: as it was reported.
        channel: the service without its namespace.
        received_ns: when it was received.
        life: of who reported it; 0 where not known.
    """
    return Observation(
        stamp_ns=error.stamp_ns,
        received_ns=received_ns,
        channel=channel,
        kind=ObservationKind.RESPONSE_SENT
        if error.by_server
        else ObservationKind.RESPONSE_RECEIVED,
        type_name=f"{error.type_name}_Response",
        data=None,
        source=error.node,
        client=error.client,
        call=error.call,
        error=error.error,
        life=life,
        client_life=_life_of_text(error.gid),
    )
