"""The CDR of recordings, by the types that their schemas define: :mod:`transports.cdr`, composed.

The result is what ``transports.ros2.messages.plain_of`` makes of rclpy's message. The rosbags library reads
CDR into classes that it makes by ``exec`` of code with names from the file; here the types of a stranger's
file stay data.
"""

from __future__ import annotations

import struct
from typing import Any

from m2c.language.datatypes import Array, DataType, Primitive, Structure
from transports import cdr
from transports.cdr import CODES, HEADER_BYTES, CdrError
from transports.fields_read import Paths, inside, kept

_PADDING_BYTES = 3
"""A message may be filled up to a multiple of four."""


class Decoder:
    """Decodes the messages of one type.

    Args:
        structure: the type.
        read: the fields that are read of it; of other sequences only the beginning is made, the first
            :data:`~transports.fields_read.UNREAD_KEPT` elements. None: all.

    Raises:
        CdrError: CDR has no form for a field of it that this reads.
    """

    __slots__ = ("_big", "_little", "_read", "_structure")

    def __init__(self, structure: Structure, read: Paths | None = None) -> None:
        self._structure = structure
        self._read = read
        self._little = part_reader(structure, read=read)
        self._big: cdr.Read | None = None

    @property
    def structure(self) -> Structure:
        """The type."""
        return self._structure

    @property
    def read(self) -> Paths | None:
        """The fields that are read of it; None: all."""
        return self._read

    def __call__(self, data: bytes) -> dict[str, Any]:
        """The message in ``data``, encapsulation header included; CdrError if it is none."""
        if len(data) < HEADER_BYTES or data[0] or data[1] > 1:
            raise CdrError(f"unknown encapsulation {data[:2].hex() or '(empty)'} at byte 0")
        read: cdr.Read | None = self._little
        if not data[1]:
            read = self._big = self._big or part_reader(self._structure, ">", self._read)
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


def part_reader(structure: Structure, order: str = "<", read: Paths | None = None) -> cdr.Read:
    """Reads a structure inside a message: from (payload without its header, position).

    It raises CdrError, struct.error or UnicodeDecodeError if there is none.

    Args:
        structure: its type.
        order: of bytes, "<" (little endian) or ">".
        read: the fields that are read (see :class:`Decoder`).

    Raises:
        CdrError: CDR has no form for a field of it that this reads.
    """
    fields = [(name, _kind(kind, order, inside(read, name))) for name, kind in structure.fields]
    return cdr.structure(fields, order)


def _kind(kind: DataType, order: str, read: Paths | None) -> cdr.Kind:
    match kind:
        case Primitive("string"):
            return cdr.string(order)
        case Primitive(name) if name in CODES:
            return name
        case Primitive(name):
            raise CdrError(f"values of type {name} are not supported")
        case Structure():
            return part_reader(kind, order, read)
        case Array(element, length, fixed):
            inner = _kind(element, order, read)
            return cdr.sequence(inner, length if fixed else None, order, kept(read))
