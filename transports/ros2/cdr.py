"""Messages read from the wire as maps, lists and scalars, past rclpy's classes.

A tap hands on plain values. rclpy makes an object of each message first, whose constructor fills and
checks every field of every part of it: an event of a service takes 18 µs so, and 7 from its bytes (one after
the other; more where something else runs between). Plain CDR: OMG CORBA 3.0, formal/02-06-51, 15.3, behind
RTPS's encapsulation header. What ``moon.recording.cdr`` reads has the types that a file says; these are
those of the installed packages.
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

from transports.ros2.interfaces import ros_class
from transports.ros2.messages import plain_of, type_name_of

LITTLE_ENDIAN = b"\x00\x01"
"""How the encapsulation begins; two bytes of options follow, of which plain CDR has none."""
HEADER_BYTES = 4
_CODES = {
    **{"boolean": "?", "octet": "B", "char": "B", "int8": "b", "uint8": "B"},
    **{"int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"},
    **{"float": "f", "double": "d"},
}
_SIZES = {name: struct.calcsize(f"<{code}") for name, code in _CODES.items()}
_length = struct.Struct("<I").unpack_from

Value = Callable[[bytes, int], tuple[Any, int]]
"""(data, position) to (value, position behind it); positions count from behind the encapsulation."""


class CdrError(ValueError):
    """Bytes that are no message of the type."""


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
    return isinstance(kind, BasicType) and _SIZES.get(kind.typename, by + 1) <= by


@functools.lru_cache(maxsize=1024)
def reader(ros: Any) -> Callable[[bytes], dict[str, Any]]:
    """What reads serialized messages of rclpy's class ``ros``; it raises CdrError."""
    return reader_by(ros, structure(ros), lambda value: value)


def reader_by(
    ros: Any, read: Value | None, of_plain: Callable[[dict[str, Any]], Any]
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


def structure(ros: Any) -> Value | None:
    """What reads an ``ros`` that stands in something else; None if only rclpy can.

    It raises CdrError, struct.error and UnicodeDecodeError.
    """
    try:
        return _structure(ros)
    except _OtherwiseError:
        return None


def _by_rclpy(ros: Any, payload: bytes) -> dict[str, Any]:
    try:
        return plain_of(deserialize_message(payload, ros))
    except (_rclpy.RMWError, _rclpy.RCLError, RuntimeError) as error:
        raise CdrError(str(error)) from error


def _structure(ros: Any) -> Value:
    fields = list(zip(ros.get_fields_and_field_types(), ros.SLOT_TYPES, strict=True))
    if not fields:  # rosidl gives an empty structure one byte
        return lambda data, position: ({}, position + 1)
    steps: list[tuple[tuple[str, ...], Any]] = []
    run: list[tuple[str, str]] = []
    for name, kind in fields:
        if isinstance(kind, BasicType) and kind.typename in _CODES:
            run.append((name, kind.typename))
            continue
        if run:
            steps.append(_run(run))
            run = []
        steps.append(((name,), _reader(kind)))
    if run:
        steps.append(_run(run))

    if len(steps) == 1 and steps[0][1].__class__ is list:
        return functools.partial(_scalars, *steps[0])

    def read(data: bytes, position: int) -> tuple[dict[str, Any], int]:
        value: dict[str, Any] = {}
        for names, step in steps:
            if step.__class__ is list:
                unpack, size = step[position & 7]
                value.update(zip(names, unpack(data, position), strict=True))
                position += size
            else:
                value[names[0]], position = step(data, position)
        return value, position

    return read


def _scalars(
    names: tuple[str, ...], tables: list[tuple[Any, int]], data: bytes, position: int
) -> tuple[dict[str, Any], int]:
    unpack, size = tables[position & 7]
    return dict(zip(names, unpack(data, position), strict=True)), position + size


def _run(run: list[tuple[str, str]]) -> tuple[tuple[str, ...], list[tuple[Any, int]]]:
    """Names of scalars in a row, and how they are taken at once: by where they begin, modulo 8."""
    tables = []
    for begin in range(8):
        position, layout = begin, "<"
        for _, kind in run:
            padding = -position % _SIZES[kind]
            layout += "x" * padding + _CODES[kind]
            position += padding + _SIZES[kind]
        tables.append((struct.Struct(layout).unpack_from, position - begin))
    return tuple(name for name, _ in run), tables


def _reader(kind: Any) -> Value:
    if isinstance(kind, AbstractNestedType):
        return _items(kind.value_type, kind.size if isinstance(kind, Array) else None)
    if isinstance(kind, NamespacedType):
        return _structure(ros_class(type_name_of(kind)))
    if isinstance(kind, AbstractString):
        return _text
    if isinstance(kind, BasicType) and kind.typename in _CODES:
        _, tables = _run([("", kind.typename)])

        def scalar(data: bytes, position: int) -> tuple[Any, int]:
            unpack, size = tables[position & 7]
            return unpack(data, position)[0], position + size

        return scalar
    raise _OtherwiseError


def _text(data: bytes, position: int) -> tuple[str, int]:
    begin = position + -position % 4 + 4
    (length,) = _length(data, begin - 4)
    end = _within(data, begin, length)
    return data[begin : end - 1].decode() if length else "", end


def _items(element: Any, fixed: int | None) -> Value:
    """A sequence, or an array of ``fixed`` elements."""
    scalar = isinstance(element, BasicType) and element.typename in _CODES
    code, size = (_CODES[element.typename], _SIZES[element.typename]) if scalar else ("", 1)
    read = None if scalar else _reader(element)

    def items(data: bytes, position: int) -> tuple[list[Any], int]:
        count = fixed
        if count is None:
            position += -position % 4 + 4
            (count,) = _length(data, position - 4)
        if not count:
            return [], position
        if read is None:
            position += -position % size
            end = _within(data, position, count * size)
            if code == "B":
                return list(data[position:end]), end
            return list(struct.unpack_from(f"<{count}{code}", data, position)), end
        _within(data, position, count)  # each takes a byte at least
        found = []
        for _ in range(count):
            item, position = read(data, position)
            found.append(item)
        return found, position

    return items


def _within(data: bytes, position: int, count: int) -> int:
    """``position + count``, if ``data`` is that long."""
    end = position + count
    if end > len(data):
        raise CdrError(f"at byte {position + HEADER_BYTES} it promises {count} more, and has fewer")
    return end
