"""Plain maps, lists and scalars written as CDR: the other half of :mod:`moon.recording.cdr`.

What is written must be read again as it was, to the bit and to the type: a verdict's explanation shows
it. So an encoder takes nothing but what its decoder would give: an ``int`` where a float belongs, a
``float32`` with more digits than it can hold, a field that is missing or not of the type have no exact
form. :func:`as_typed` makes the nearest that has.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from operator import itemgetter
from typing import Any

from m2c.language.datatypes import Array, DataType, Primitive, Structure
from transports.cdr import CODES, HEADER_BYTES, LITTLE_ENDIAN, MAX_ITEMS, SIZES, CdrError, layouts

HEADER = LITTLE_ENDIAN + bytes(HEADER_BYTES - len(LITTLE_ENDIAN))
"""Plain CDR, little endian (RTPS 2.5, 10.2.1)."""

_FLOAT32 = struct.Struct("<f")
_LENGTH = struct.Struct("<I")
_PADDING = (b"", b"\0", b"\0\0", b"\0\0\0", b"\0" * 4, b"\0" * 5, b"\0" * 6, b"\0" * 7)

Write = Callable[[Any, bytearray], None]
"""Appends a value to its message, which begins with :data:`HEADER`: alignment counts from there on."""


class InexactError(ValueError):
    """A value that CDR would not give back as it is."""


def encoder(structure: Structure) -> Write:
    """What writes values of ``structure``; it raises InexactError for any other.

    Raises:
        CdrError: CDR has no form for a field of it that this writes.
    """
    write = _structure_writer(structure)

    def encode(value: Any, out: bytearray) -> None:
        try:
            write(value, out)
        except (struct.error, UnicodeEncodeError, KeyError, TypeError, RecursionError) as error:
            raise InexactError from error

    return encode


def _structure_writer(structure: Structure) -> Write:
    names = tuple(name for name, _ in structure.fields)
    if not names:  # rosidl gives an empty structure one byte

        def empty(value: Any, out: bytearray) -> None:
            if type(value) is not dict or value:
                raise InexactError
            out.append(0)

        return empty
    steps: list[Write] = []
    run: list[tuple[str, str]] = []
    for name, kind in structure.fields:
        if isinstance(kind, Primitive) and kind.name in CODES:
            run.append((name, kind.name))
            continue
        if run:
            steps.append(_run_writer(run))
            run = []
        steps.append(_field_writer(name, _writer(kind)))
    if run:
        steps.append(_run_writer(run))

    def write(value: Any, out: bytearray) -> None:
        if type(value) is not dict or tuple(value) != names:  # the order is shown, too
            raise InexactError
        for step in steps:
            step(value, out)

    return write


def _field_writer(name: str, write: Write) -> Write:
    def step(value: Any, out: bytearray) -> None:
        write(value[name], out)

    return step


def _run_writer(run: list[tuple[str, str]]) -> Write:
    """Scalars in a row at once; their padding depends on where they begin, modulo 8."""
    names = tuple(name for name, _ in run)
    types = tuple(_class_of(kind) for _, kind in run)
    singles = tuple(name for name, kind in run if kind == "float32")
    found = layouts(kind for _, kind in run)
    packs = [found[(begin - len(HEADER)) % 8].pack for begin in range(8)]
    if len(names) == 1:
        (name,), (only,) = names, types

        def one(value: Any, out: bytearray) -> None:
            item = value[name]
            if type(item) is not only or (singles and not _is_single(item)):
                raise InexactError
            out += packs[len(out) & 7](item)

        return one
    take = itemgetter(*names)

    def step(value: Any, out: bytearray) -> None:
        items = take(value)
        if tuple(map(type, items)) != types:
            raise InexactError
        if singles and not all(_is_single(value[name]) for name in singles):
            raise InexactError
        out += packs[len(out) & 7](*items)

    return step


def _writer(kind: DataType) -> Write:
    match kind:
        case Primitive("string"):
            return _write_string
        case Primitive(name) if name in CODES:
            return _scalar_writer(name)
        case Primitive(name):
            raise CdrError(f"values of type {name} are not supported")
        case Structure():
            return _structure_writer(kind)
        case Array(Array(), _, _):
            raise CdrError("arrays of arrays are not supported")  # a definition cannot say them
        case Array(element, length, fixed):
            return _array_writer(element, length, fixed)


def _scalar_writer(name: str) -> Write:
    expected, single = _class_of(name), name == "float32"
    pack, size = struct.Struct(f"<{CODES[name]}").pack, SIZES[name]

    def scalar(value: Any, out: bytearray) -> None:
        if type(value) is not expected or (single and not _is_single(value)):
            raise InexactError
        out += _PADDING[(len(HEADER) - len(out)) % size]
        out += pack(value)

    return scalar


def _write_string(value: Any, out: bytearray) -> None:
    if type(value) is not str:
        raise InexactError
    text = value.encode()
    out += _PADDING[-len(out) % 4]
    out += _LENGTH.pack(len(text) + 1)
    out += text
    out.append(0)


def _array_writer(element: DataType, length: int | None, fixed: bool) -> Write:
    scalar = element.name if isinstance(element, Primitive) and element.name in CODES else ""
    code, single = CODES.get(scalar, ""), scalar == "float32"
    size = SIZES.get(scalar, 1)
    expected = {_class_of(scalar)} if scalar else set()
    write = None if scalar else _writer(element)

    def items(value: Any, out: bytearray) -> None:
        if type(value) is not list:
            raise InexactError
        count = len(value)
        if fixed:
            if count != length:
                raise InexactError
        else:
            if (length is not None and count > length) or count > MAX_ITEMS:
                raise InexactError
            out += _PADDING[-len(out) % 4]
            out += _LENGTH.pack(count)
        if write is not None:
            for item in value:
                write(item, out)
        elif value:
            if set(map(type, value)) != expected or (single and not all(map(_is_single, value))):
                raise InexactError
            out += _PADDING[(len(HEADER) - len(out)) % size]
            out += struct.pack(f"<{count}{code}", *value)

    return items


def _class_of(name: str) -> type:
    return bool if name == "bool" else float if name in ("float32", "float64") else int


def _is_single(value: Any) -> bool:
    """Whether a ``float32`` holds it."""
    try:
        held: float = _FLOAT32.unpack(_FLOAT32.pack(value))[0]
    except OverflowError:
        return False
    return held == value or math.isnan(value)


def as_typed(value: Any, kind: DataType) -> Any:
    """The value of ``kind`` that is nearest to ``value``: what is missing is zero, the rest dropped.

    Raises:
        InexactError: none is.
    """
    match kind:
        case Structure(_, fields):
            if value is not None and not isinstance(value, dict):
                raise InexactError
            given = value or {}
            return {name: as_typed(given.get(name), item) for name, item in fields}
        case Array(element, length, fixed):
            if isinstance(value, bytes):
                value = list(value)
            elif value is None:
                value = []
            if not isinstance(value, list):
                raise InexactError
            if fixed:
                value = value + [None] * ((length or 0) - len(value))
            return [as_typed(item, element) for item in value]
        case Primitive("string"):
            if value is not None and not isinstance(value, str):
                raise InexactError
            return value or ""
        case Primitive(name):
            return _as_scalar(value, name)


def _as_scalar(value: Any, name: str) -> Any:
    if value is None:
        value = 0
    if not isinstance(value, (bool, int, float)):
        raise InexactError
    made = _class_of(name)
    try:
        if made is int and value != int(value):
            raise InexactError
        if name == "float32":
            return _FLOAT32.unpack(_FLOAT32.pack(value))[0]
        return made(value)
    except (OverflowError, ValueError) as error:
        raise InexactError from error
