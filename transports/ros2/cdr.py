"""Messages read from the wire as maps, lists and scalars, past rclpy's classes.

A tap hands on plain values. rclpy makes an object of each message first, whose constructor fills and
checks every field of every part of it; reading the bytes takes less than half as long (decision 28). Plain
CDR: OMG CORBA 3.0, formal/02-06-51, 15.3, behind RTPS's encapsulation header: :mod:`transports.cdr`, composed
by the types of the installed packages. What it does not read, rclpy does.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.serialization import deserialize_message
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    Array,
    BasicType,
    NamespacedType,
)

from transports import cdr
from transports.cdr import CODES, HEADER_BYTES, LITTLE_ENDIAN, SIZES, CdrError, Kind, Read
from transports.fields_read import Paths, inside, kept
from transports.ros2.interfaces import ros_class
from transports.ros2.messages import plain_of, type_name_of

_SCALARS = {
    **{name: name for name in CODES},
    **{"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"},
}
"""rosidl's scalars, which have the names of OMG IDL, by their names in ROS 2."""


class _OtherwiseError(Exception):
    """A type that rclpy reads."""


def can_move(ros: Any, by: int) -> bool:
    """Whether what rclpy serializes of its class ``ros`` may stand ``by`` bytes further on, before more.

    Not where a scalar is larger, as it is aligned. Nor with wide strings: behind these, Fast DDS's type
    support leaves room that it does not use, so where the message ends is not known.
    """
    return all(_can_move(kind, by) for kind in ros.SLOT_TYPES)


def _can_move(kind: Any, by: int) -> bool:
    if isinstance(kind, AbstractNestedType):
        return _can_move(kind.value_type, by)
    if isinstance(kind, NamespacedType):
        return can_move(ros_class(type_name_of(kind)), by)
    if isinstance(kind, AbstractString):
        return True
    if not isinstance(kind, BasicType) or kind.typename not in _SCALARS:
        return False
    return SIZES[_SCALARS[kind.typename]] <= by


@functools.lru_cache(maxsize=1024)
def reader(ros: Any, read: Paths | None = None) -> Callable[[bytes], dict[str, Any]]:
    """What reads serialized messages of rclpy's class ``ros``; it raises CdrError.

    Args:
        ros: the class.
        read: the fields that are read of them (see ``structure``).
    """
    return reader_by(ros, structure(ros, read), lambda value: value)


def reader_by(
    ros: Any, read: Read | None, of_plain: Callable[[dict[str, Any]], Any]
) -> Callable[[bytes], Any]:
    """As ``reader``, for a form of one's own.

    Args:
        ros: rclpy's class.
        read: reads what stands behind the encapsulation (see ``structure``); None: only rclpy can.
        of_plain: the same of what rclpy reads, where it has to: a type or an encoding that is not ours.
    """
    if read is None:
        return lambda payload: of_plain(_by_rclpy(ros, payload))

    def message(payload: bytes) -> Any:
        if payload[: len(LITTLE_ENDIAN)] != LITTLE_ENDIAN:
            return of_plain(_by_rclpy(ros, payload))
        try:
            return read(payload[HEADER_BYTES:], 0)[0]
        except (struct.error, UnicodeDecodeError) as error:
            raise CdrError(f"it is no {ros.__name__}: {error}") from error

    return message


def structure(ros: Any, read: Paths | None = None) -> Read | None:
    """What reads an ``ros`` that stands in something else; None if only rclpy can.

    It raises CdrError, struct.error and UnicodeDecodeError.

    Args:
        ros: rclpy's class.
        read: the fields that are read of it: of the sequences that are not, only the first ``UNREAD_KEPT``
            elements are made. None: all.
    """
    try:
        return _structure(ros, read)
    except _OtherwiseError:
        return None


def _by_rclpy(ros: Any, payload: bytes) -> dict[str, Any]:
    try:
        return plain_of(deserialize_message(payload, ros))
    except (_rclpy.RMWError, _rclpy.RCLError, RuntimeError) as error:
        raise CdrError(str(error)) from error


def _structure(ros: Any, read: Paths | None) -> Read:
    fields = zip(ros.get_fields_and_field_types(), ros.SLOT_TYPES, strict=True)
    return cdr.structure([(name, _kind(kind, inside(read, name))) for name, kind in fields])


def _kind(kind: Any, read: Paths | None) -> Kind:
    if isinstance(kind, AbstractNestedType):
        count = kind.size if isinstance(kind, Array) else None
        return cdr.sequence(_kind(kind.value_type, read), count, kept=kept(read))
    if isinstance(kind, NamespacedType):
        return _structure(ros_class(type_name_of(kind)), read)
    if isinstance(kind, AbstractString):
        return cdr.string()
    if isinstance(kind, BasicType) and kind.typename in _SCALARS:
        return _SCALARS[kind.typename]
    raise _OtherwiseError
