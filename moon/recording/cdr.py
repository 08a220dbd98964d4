"""CDR, the wire form of ROS 2, read into plain maps, lists and scalars.

OMG CORBA 3.0 (formal/02-06-51), chapter 15.3, with RTPS's encapsulation header (formal/22-04-01,
10.2.1): plain CDR, either byte order. The result is what ``transports.ros2.messages.plain_of`` makes
of rclpy's message. The rosbags library reads CDR into classes that it makes by ``exec`` of code with
names from the file; here the types of a stranger's file stay data.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from m2c.model.datatypes import Array, DataType, Primitive, Structure

HEADER_BYTES = 4
_PADDING_BYTES = 3
"""A message may be filled up to a multiple of four."""
MAX_ITEMS = 1 << 20
"""Messages or strings in one sequence: each is an object here, however few bytes it has there."""

CODES = {
    **{"bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B"},
    **{"int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"},
    **{"float32": "f", "float64": "d"},
}
_SIZES = {name: struct.calcsize(f"<{code}") for name, code in CODES.items()}

_Value = Callable[[bytes, int], tuple[Any, int]]
"""(payload, position) to (value, position after it)."""
_Step = Callable[[bytes, int, dict[str, Any]], int]


class CdrError(ValueError):
    """Bytes that are no message of the type; the text says where."""


class Decoder:
    """Decodes the messages of one type.

    Raises:
        CdrError: CDR has no form for a field of it that this reads.
    """

    __slots__ = ("_big", "_little", "_structure")

    def __init__(self, structure: Structure) -> None:
        self._structure = structure
        self._little = _structure_reader(structure, "<")
        self._big: _Value | None = None

    @property
    def structure(self) -> Structure:
        """The type."""
        return self._structure

    def __call__(self, data: bytes) -> dict[str, Any]:
        """The message in ``data``, encapsulation header included; CdrError if it is none."""
        if len(data) < HEADER_BYTES or data[0] or data[1] > 1:
            raise CdrError(f"unknown encapsulation {data[:2].hex() or '(empty)'} at byte 0")
        read: _Value | None = self._little
        if not data[1]:
            read = self._big = self._big or _structure_reader(self._structure, ">")
        assert read is not None
        payload = data[HEADER_BYTES:]
        try:
            value, end = read(payload, 0)
        except struct.error as error:
            raise CdrError(f"it ends at byte {len(data)}, too early") from error
        except UnicodeDecodeError as error:
            raise CdrError("a string in it is no UTF-8") from error
        if end + _PADDING_BYTES < len(payload):
            raise CdrError(f"it should end at byte {end + HEADER_BYTES}, and has {len(data)}")
        decoded: dict[str, Any] = value
        return decoded


def part_reader(structure: Structure) -> _Value:
    """Reads a structure inside a message: from (payload without its header, position), little endian.

    It raises CdrError, struct.error or UnicodeDecodeError if there is none.
    """
    return _structure_reader(structure, "<")


def _structure_reader(structure: Structure, order: str) -> _Value:
    if not structure.fields:  # rosidl gives an empty structure one byte
        return lambda data, position: ({}, _require(data, position, 1))
    steps: list[_Step] = []
    run: list[tuple[str, str]] = []
    for name, kind in structure.fields:
        if isinstance(kind, Primitive) and kind.name in CODES:
            run.append((name, kind.name))
            continue
        if run:
            steps.append(_run_reader(run, order))
            run = []
        steps.append(_field_reader(name, _reader(kind, order)))
    if not steps:
        return _flat_reader(run, order)
    if run:
        steps.append(_run_reader(run, order))

    def read(data: bytes, position: int) -> tuple[dict[str, Any], int]:
        value: dict[str, Any] = {}
        for step in steps:
            position = step(data, position, value)
        return value, position

    return read


def _field_reader(name: str, read: _Value) -> _Step:
    def step(data: bytes, position: int, value: dict[str, Any]) -> int:
        value[name], position = read(data, position)
        return position

    return step


def _run_reader(run: list[tuple[str, str]], order: str) -> _Step:
    """Scalars in a row, as a part of a structure."""
    names, tables = _run(run, order)

    def step(data: bytes, position: int, value: dict[str, Any]) -> int:
        unpack, size = tables[position & 7]
        value.update(zip(names, unpack(data, position), strict=True))
        return position + size

    return step


def _flat_reader(run: list[tuple[str, str]], order: str) -> _Value:
    """A structure of nothing but scalars."""
    names, tables = _run(run, order)

    def read(data: bytes, position: int) -> tuple[dict[str, Any], int]:
        unpack, size = tables[position & 7]
        return dict(zip(names, unpack(data, position), strict=True)), position + size

    return read


_Unpack = Callable[[bytes, int], tuple[Any, ...]]


def _run(
    run: list[tuple[str, str]], order: str
) -> tuple[tuple[str, ...], list[tuple[_Unpack, int]]]:
    """Names of scalars in a row, and how they are taken at once: by where they begin, modulo 8."""
    names = tuple(name for name, _ in run)
    tables: list[tuple[_Unpack, int]] = []
    for begin in range(8):
        position, layout = begin, order
        for _, kind in run:
            padding = -position % _SIZES[kind]
            layout += "x" * padding + CODES[kind]
            position += padding + _SIZES[kind]
        tables.append((struct.Struct(layout).unpack_from, position - begin))
    return names, tables


def _reader(kind: DataType, order: str) -> _Value:
    match kind:
        case Primitive("string"):
            return _string_reader(order)
        case Primitive(name) if name in CODES:
            unpack, size = struct.Struct(order + CODES[name]).unpack_from, _SIZES[name]

            def scalar(data: bytes, position: int) -> tuple[Any, int]:
                position += -position % size
                return unpack(data, position)[0], position + size

            return scalar
        case Primitive(name):
            raise CdrError(f"values of type {name} are not supported")
        case Structure():
            return _structure_reader(kind, order)
        case Array(element, length, fixed):
            return _array_reader(element, length if fixed else None, order)


def _string_reader(order: str) -> _Value:
    unpack = struct.Struct(order + "I").unpack_from

    def text(data: bytes, position: int) -> tuple[str, int]:
        begin = position + -position % 4 + 4
        (length,) = unpack(data, begin - 4)
        end = begin + length
        _require(data, begin, length)
        if not length:  # some writers count no NUL
            return "", end
        return data[begin : end - (data[end - 1] == 0)].decode(), end

    return text


def _array_reader(element: DataType, fixed: int | None, order: str) -> _Value:
    """A sequence, or an array of ``fixed`` elements."""
    if fixed == 0:  # ROS 2 has none; of what takes no bytes, some bytes could promise any number
        raise CdrError("arrays of no elements are not supported")
    count_of = struct.Struct(order + "I").unpack_from
    scalar = element.name if isinstance(element, Primitive) and element.name in CODES else ""
    code, size = CODES.get(scalar, ""), _SIZES.get(scalar, 1)
    read = None if scalar else _reader(element, order)

    def items(data: bytes, position: int) -> tuple[list[Any], int]:
        count = fixed
        if count is None:
            position += -position % 4
            (count,) = count_of(data, position)
            position += 4
        if not count:
            return [], position
        if read is None:
            position += -position % size
            end = _require(data, position, count * size)
            return list(struct.unpack_from(f"{order}{count}{code}", data, position)), end
        _require(data, position, count)
        if count > MAX_ITEMS:
            raise CdrError(f"a sequence of {count} items at byte {position + HEADER_BYTES}")
        found = []
        for _ in range(count):
            item, position = read(data, position)
            found.append(item)
        return found, position

    return items


def _require(data: bytes, position: int, count: int) -> int:
    """``position + count``, if ``data`` is that long."""
    end = position + count
    if end > len(data):
        raise CdrError(
            f"at byte {position + HEADER_BYTES} it promises {count} more bytes, "
            f"and has {max(0, len(data) - position)}"
        )
    return end
