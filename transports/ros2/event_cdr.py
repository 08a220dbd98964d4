"""Service events as bytes: what all of them begin with is written and read at once.

rclpy makes and reads an event as any message, part by part, each an object. But an event is always the same
``service_msgs/msg/ServiceEventInfo`` and one message, the request or the response, for whose type there is
what writes and reads it. A node at work publishes four of them for each call, and a monitor reads them all.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from typing import Any

import msgspec
import numpy  # rosidl keeps arrays of fixed size in it
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.serialization import serialize_message

from transports.cdr import HEADER_BYTES, LITTLE_ENDIAN, CdrError
from transports.fields_read import Paths
from transports.ros2 import cdr
from transports.ros2.interfaces import ros_class
from transports.ros2.messages import type_name_of
from transports.service_events import REQUEST_RECEIVED

_ENCAPSULATION = LITTLE_ENDIAN + bytes(HEADER_BYTES - len(LITTLE_ENDIAN))
_INFO = "B3xiI16s4xq"
"""``ServiceEventInfo``: event type, stamp (s, ns), the client's GID, sequence number."""
_HEADERS = {
    "request": struct.Struct(f"<4s{_INFO}I"),
    "response": struct.Struct(f"<4s{_INFO}II"),
}
"""What stands before the message: encapsulation, info, the length of the sequence of requests, and that of
responses."""
_ALIGNED = {"request": 4, "response": 8}
"""The message so begins at 44 or 48, multiples of these. It is serialized by itself, from 0: a scalar with
more bytes would have to stand elsewhere."""
_info_of = struct.Struct(f"<{_INFO}I").unpack_from
_INFO_BYTES = struct.calcsize(f"<{_INFO}I")
_length = struct.Struct("<I").unpack_from
_LENGTH_BYTES = 4

Formed = Callable[[int, int, bytes, int, Any], Any]
"""(event type, stamp, gid, call, message) to what rclpy's publisher takes."""


def former(event: Any, message: Any, which: str) -> Formed:
    """What makes events of a service for rclpy's publisher, serialized if it can.

    Args:
        event: rclpy's class of the event.
        message: that of the request or response in it.
        which: "request" or "response".
    """
    begin = serialize_message(message())[:HEADER_BYTES]  # loads the type's support, too
    if begin != _ENCAPSULATION or not cdr.can_move(message, _ALIGNED[which]):
        return functools.partial(_whole, event(), f"_{which}")
    pack, serialize = _HEADERS[which].pack, _rclpy.rclpy_serialize
    if which == "response":

        def response(event_type: int, stamp_ns: int, gid: bytes, call: int, sent: Any) -> bytes:
            s, ns = divmod(stamp_ns, 10**9)
            head = pack(_ENCAPSULATION, event_type, s, ns, gid, call, 0, 1)
            return bytes(head + serialize(sent, message)[HEADER_BYTES:])

        return response

    def request(event_type: int, stamp_ns: int, gid: bytes, call: int, sent: Any) -> bytes:
        s, ns = divmod(stamp_ns, 10**9)
        body = serialize(sent, message)[HEADER_BYTES:]
        head = pack(_ENCAPSULATION, event_type, s, ns, gid, call, 1)
        return bytes(head + body + bytes(-len(body) % 4 + _LENGTH_BYTES))  # no response

    return request


def _whole(
    event: Any, which: str, event_type: int, stamp_ns: int, gid: bytes, call: int, message: Any
) -> Any:
    """``event``, which is made once: only what changes is written, and not checked again."""
    setattr(event, which, [message])
    info = event._info
    info._event_type = event_type
    info._stamp._sec, info._stamp._nanosec = divmod(stamp_ns, 10**9)
    info._client_gid = _array(gid)
    info._sequence_number = call
    return event


@functools.lru_cache(maxsize=256)
def _array(gid: bytes) -> Any:
    return numpy.frombuffer(gid, dtype=numpy.uint8)


class Event(msgspec.Struct, frozen=True):
    """An event as it was read.

    Attributes:
        event_type: of ``ServiceEventInfo``; perhaps one that does not exist.
        stamp_ns: when it happened, ns since the epoch.
        gid: of the client.
        call: the number of the client's call.
        contents: the request or response, whichever it is about, in plain values; None if it has none.
    """

    event_type: int
    stamp_ns: int
    gid: bytes
    call: int
    contents: Any


@functools.lru_cache(maxsize=1024)
def reader(event: Any, fields: Paths | None = None) -> Callable[[bytes], Event]:
    """What reads serialized events of rclpy's class ``event``; it raises CdrError.

    Args:
        event: the class.
        fields: those that are read of the request or response in it (see ``cdr.structure``).
    """
    read_request = cdr.structure(_class_in(event, "request"), fields)
    read_response = cdr.structure(_class_in(event, "response"), fields)
    if read_request is None or read_response is None:
        return cdr.reader_by(event, None, _of_plain)

    def read(data: bytes, position: int) -> tuple[Event, int]:
        event_type, s, ns, gid, call, count = _info_of(data, position)
        position += _INFO_BYTES
        contents = None
        if count:
            _at_most_one(event, count)
            contents, position = read_request(data, position)
        if event_type > REQUEST_RECEIVED:
            position += -position % _LENGTH_BYTES
            (count,) = _length(data, position)
            position += _LENGTH_BYTES
            contents = None
            if count:
                _at_most_one(event, count)
                contents, position = read_response(data, position)
        return Event(event_type, s * 10**9 + ns, gid, call, contents), position

    return cdr.reader_by(event, read, _of_plain)


def _class_in(event: Any, which: str) -> Any:
    """The class of the request or response in an event."""
    place = list(event.get_fields_and_field_types()).index(which)
    return ros_class(type_name_of(event.SLOT_TYPES[place].value_type))


def _at_most_one(event: Any, count: int) -> None:
    if count > 1:
        raise CdrError(f"it is no {event.__name__}: {count} messages where there may be one")


def _of_plain(data: dict[str, Any]) -> Event:
    info = data["info"]
    event_type: int = info["event_type"]
    contents = data["request" if event_type <= REQUEST_RECEIVED else "response"]
    return Event(
        event_type,
        info["stamp"]["sec"] * 10**9 + info["stamp"]["nanosec"],
        bytes(info["client_gid"]),
        info["sequence_number"],
        contents[0] if contents else None,
    )
