"""CDR, the wire form of ROS 2, read into plain maps, lists and scalars.

Plain CDR: OMG CORBA 3.0 (formal/02-06-51), chapter 15.3, behind RTPS's encapsulation header (RTPS 2.5,
formal/22-04-01, 10.2.1). Types are not described here: who knows one, from a recording's schema or from
rclpy's class, composes what reads it of :func:`structure`, :func:`sequence` and :func:`string`. The types of
a stranger stay data so: no code is made of their names. See docs/decisions/0028-one-reader-of-cdr.md.

All raise :class:`CdrError`, struct.error or UnicodeDecodeError for bytes that are not of the type, and make
nothing that is larger than what the bytes can hold.
"""

from __future__ import annotations

import struct
import sys
from array import array
from collections.abc import Callable, Iterable
from typing import Any

HEADER_BYTES = 4
"""The encapsulation header: two bytes say which encoding, two are options, which plain CDR has none of."""
LITTLE_ENDIAN = b"\x00\x01"
"""How the header of plain CDR begins, least significant bytes first; most significant first: two zeros."""
MAX_ITEMS = 1 << 20
"""Messages or strings in one sequence: each is an object here, however few bytes it has there."""

CODES = {
    **{"bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B"},
    **{"int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"},
    **{"float32": "f", "float64": "d"},
}
"""The scalars, by their names in ROS 2 interface definitions, as ``struct`` calls them."""
SIZES = {name: struct.calcsize(f"<{code}") for name, code in CODES.items()}
"""Bytes of a scalar, and its alignment."""

Read = Callable[[bytes, int], tuple[Any, int]]
"""(payload, position) to (value, position after it); positions count from behind the header."""
Kind = str | Read
"""What reads a value, or for a scalar its name in :data:`CODES`."""


class CdrError(ValueError):
    """Bytes that are no message of the type, or a type that cannot be read; the text says where."""


def layouts(scalars: Iterable[str], order: str = "<") -> list[struct.Struct]:
    """How scalars that follow each other lie, padding included: by where they begin, modulo 8.

    Args:
        scalars: their names in :data:`CODES`.
        order: of bytes, "<" or ">".
    """
    names = tuple(scalars)
    found = []
    for begin in range(8):
        position, layout = begin, order
        for name in names:
            padding = -position % SIZES[name]
            layout += "x" * padding + CODES[name]
            position += padding + SIZES[name]
        found.append(struct.Struct(layout))
    return found


def structure(fields: Iterable[tuple[str, Kind]], order: str = "<") -> Read:
    """What reads a structure into a map.

    Args:
        fields: their names and kinds, in the order of the definition.
        order: of bytes, "<" or ">".
    """
    steps: list[tuple[tuple[str, ...], list[tuple[_Unpack, int]], Read | None]] = []
    run: list[tuple[str, str]] = []
    for name, kind in fields:
        if isinstance(kind, str):
            run.append((name, kind))
            continue
        if run:
            steps.append((*_run(run, order), None))
            run = []
        steps.append(((name,), [], kind))
    if not steps:
        return _scalars(run, order) if run else _empty
    if run:
        steps.append((*_run(run, order), None))

    def members(data: bytes, position: int) -> tuple[dict[str, Any], int]:
        value: dict[str, Any] = {}
        for names, tables, read in steps:
            if read is None:
                unpack, size = tables[position & 7]
                value.update(zip(names, unpack(data, position), strict=True))
                position += size
            else:
                value[names[0]], position = read(data, position)
        return value, position

    return members


def _empty(data: bytes, position: int) -> tuple[dict[str, Any], int]:
    """A structure without fields: rosidl gives it one byte."""
    return {}, _within(data, position, 1)


def _scalars(run: list[tuple[str, str]], order: str) -> Read:
    """A structure of nothing but scalars."""
    names, tables = _run(run, order)

    def scalars(data: bytes, position: int) -> tuple[dict[str, Any], int]:
        unpack, size = tables[position & 7]
        return dict(zip(names, unpack(data, position), strict=True)), position + size

    return scalars


_Unpack = Callable[[bytes, int], tuple[Any, ...]]


def _run(
    run: list[tuple[str, str]], order: str
) -> tuple[tuple[str, ...], list[tuple[_Unpack, int]]]:
    """Names of scalars in a row, and how they are taken at once: by where they begin, modulo 8."""
    names = tuple(name for name, _ in run)
    found = layouts((kind for _, kind in run), order)
    return names, [(layout.unpack_from, layout.size) for layout in found]


def string(order: str = "<") -> Read:
    """What reads a string of 8-bit characters, which are UTF-8."""
    length_of = struct.Struct(order + "I").unpack_from

    def text(data: bytes, position: int) -> tuple[str, int]:
        begin = position + -position % 4 + 4
        (length,) = length_of(data, begin - 4)
        end = _within(data, begin, length)
        if not length:  # some writers count no NUL
            return "", end
        return data[begin : end - (data[end - 1] == 0)].decode(), end

    return text


def sequence(
    element: Kind, count: int | None = None, order: str = "<", kept: int = sys.maxsize
) -> Read:
    """What reads a sequence, or an array, into a list.

    Args:
        element: what it holds.
        count: of the elements of an array; None: a sequence, which says it itself.
        order: of bytes, "<" or ">".
        kept: so many elements are in the list at most; those behind are passed over.

    Raises:
        CdrError: an array of no elements.
    """
    if count == 0:  # ROS 2 has none; of what takes no bytes, some bytes could promise any number
        raise CdrError("arrays of no elements are not supported")
    if isinstance(element, str):
        return _scalar_items(element, count, order, kept)
    read, fixed = element, count
    length_of = struct.Struct(order + "I").unpack_from

    def items(data: bytes, position: int) -> tuple[list[Any], int]:
        length = fixed
        if length is None:
            position += -position % 4 + 4
            (length,) = length_of(data, position - 4)
            if not length:
                return [], position
        _within(data, position, length)  # each takes a byte at least
        if length > MAX_ITEMS:
            raise CdrError(f"a sequence of {length} items at byte {position + HEADER_BYTES}")
        found = []
        for _ in range(min(length, kept)):
            item, position = read(data, position)
            found.append(item)
        for _ in range(length - kept):
            position = read(data, position)[1]
        return found, position

    return items


def _scalar_items(name: str, fixed: int | None, order: str, kept: int) -> Read:
    code, size = CODES[name], SIZES[name]
    is_swapped = (order == "<") != (sys.byteorder == "little")
    length_of = struct.Struct(order + "I").unpack_from

    def scalar_items(data: bytes, position: int) -> tuple[list[Any], int]:
        length = fixed
        if length is None:
            position += -position % 4 + 4
            (length,) = length_of(data, position - 4)
            if not length:
                return [], position
        position += -position % size
        end = _within(data, position, length * size)
        taken = data[position : end if length <= kept else position + kept * size]
        if code == "B":
            return list(taken), end
        if code == "?":
            return list(map(bool, taken)), end
        found = array(code, taken)  # struct makes a tuple of them first
        if is_swapped:
            found.byteswap()
        return found.tolist(), end

    return scalar_items


def _within(data: bytes, position: int, count: int) -> int:
    """``position + count``, if ``data`` is that long."""
    end = position + count
    if end > len(data):
        raise CdrError(
            f"at byte {position + HEADER_BYTES} it promises {count} more bytes, "
            f"and has {max(0, len(data) - position)}"
        )
    return end
