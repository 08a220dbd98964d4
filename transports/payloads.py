"""Messages as bytes: typed on the way out, checked on the way in.

What every transport of this repository puts on its wire: the struct as a MessagePack map, with the
type's name beside it, so that the type can be checked before decoding.
"""

from __future__ import annotations

import itertools
from typing import Any

import msgspec

from transports.fields_read import UNREAD_KEPT, Paths, inside
from transports.interface import Message, TransportError

MOST_DEPTH = 128
"""How deep what is not of a known type may be nested; messages of ROS are at most some ten deep. What is
read here is written again elsewhere, deeper in the stack, and msgspec's limit is that of Python's stack."""
_TOO_DEEP = f"it is nested deeper than {MOST_DEPTH}"
SMALL_BYTES = 4096
"""So much is decoded whole, whatever is read of it: to leave out a part of it would take longer."""
_LARGE_ITEM = 64
"""Bytes of an element that is looked at by itself: that takes as long as to make so many."""
_NESTED = frozenset((dict, list, tuple))

_UNDECODABLE = (msgspec.DecodeError, UnicodeError, RecursionError)
"""Every way in which bad input can fail."""

_encode = msgspec.msgpack.Encoder().encode
_decode_any = msgspec.msgpack.Decoder().decode
_FIRST = msgspec.defstruct(
    "_First",
    [(f"item_{place}", msgspec.Raw, msgspec.UNSET) for place in range(UNREAD_KEPT)],
    array_like=True,
)
"""The first elements of an array; msgspec passes over those behind without making them."""
_FLAT: Any = _FIRST | str | int | float | bool | None
_decode_parts = msgspec.msgpack.Decoder(dict[Any, dict[Any, msgspec.Raw] | _FLAT] | _FLAT).decode
_decode_map = msgspec.msgpack.Decoder(dict[Any, msgspec.Raw]).decode
_decode_items = msgspec.msgpack.Decoder(list[msgspec.Raw]).decode
_LONGER = object()
"""An array of which more is read than its first elements."""


class PayloadError(ValueError):
    """A payload that is not a message of the expected type; the text says what is wrong."""


def require_type(message: Message, type_name: str) -> None:
    """TransportError unless ``message`` is of this type, by whichever class."""
    if getattr(message, "__type_name__", None) != type_name:
        raise TransportError(
            f"expected a message of type {type_name}, got {type(message).__name__}"
        )


class TypedCodec:
    """Encodes and decodes the messages of one type."""

    __slots__ = ("_decode", "_message", "type_name")

    def __init__(self, type_name: str, message: type[Message]) -> None:
        self.type_name = type_name
        self._message = message
        self._decode = msgspec.msgpack.Decoder(message).decode

    def encode(self, message: Message) -> bytes:
        """The payload; TransportError if ``message`` is of another type."""
        if message.__class__ is not self._message:
            require_type(message, self.type_name)
        return _encode(message)

    def decode_bytes(self, payload: bytes) -> Any:
        """The message; PayloadError if ``payload`` is none of this type."""
        try:
            return self._decode(payload)
        except _UNDECODABLE as error:
            raise PayloadError(str(error)) from error

    def require(self, type_name: str) -> None:
        """PayloadError unless ``type_name``, that of a payload, is this codec's."""
        if type_name != self.type_name:
            raise PayloadError(f"expected type {self.type_name}, got {type_name}")


def decode_with(decode: Any, data: Any) -> Any:
    """``decode(data)`` of msgspec, every way in which bad input can fail being a PayloadError."""
    try:
        return decode(data)
    except _UNDECODABLE as error:
        raise PayloadError(str(error)) from error


def plain(payload: bytes, read: Paths | None = None) -> Any:
    """A payload as maps, lists and scalars; PayloadError if it is no MessagePack, or nested too deep.

    Args:
        payload: the message.
        read: the fields that are read of it: of the sequences that are not, only the first
            ``fields_read.UNREAD_KEPT`` elements are made. None: all.
    """
    if read is None or len(payload) <= SMALL_BYTES:
        return shallow(decode_with(_decode_any, payload), len(payload))
    return decode_with(lambda data: _parts(data, read, MOST_DEPTH), payload)


def _parts(payload: Any, read: Paths | None, depth: int) -> Any:
    """What is read of ``payload``, which is nested ``depth`` deep at most, and the beginning of the rest."""
    if depth < 1:
        raise PayloadError(_TOO_DEEP)
    try:
        part = None if read is None or len(payload) <= UNREAD_KEPT else _decode_parts(payload)
    except msgspec.ValidationError:  # bytes, or an extension type: no message has one
        part = None
    if part.__class__ is dict:
        found = {key: _part(value, inside(read, key), depth - 1) for key, value in part.items()}
        if longer := [key for key, value in found.items() if value is _LONGER]:
            whole = _decode_map(payload)
            found.update((key, _parts(whole[key], inside(read, key), depth - 1)) for key in longer)
        return found
    made = _LONGER if part is None else _part(part, read, depth)
    if made is not _LONGER:
        return made
    if part is not None and len(payload) > SMALL_BYTES:
        first = [len(item) for item in msgspec.structs.astuple(part)]
        if sum(first) > len(first) * _LARGE_ITEM:  # of such elements, too, not all may be read
            return [_parts(item, read, depth - 1) for item in _decode_items(payload)]
    return shallow(_decode_any(payload), len(payload), depth)


def _part(value: Any, read: Paths | None, depth: int) -> Any:
    """The same of a value that is decoded so; ``_LONGER`` if that lacks something of it."""
    if value.__class__ is _FIRST:
        items = [item for item in msgspec.structs.astuple(value) if item is not msgspec.UNSET]
        if len(items) == UNREAD_KEPT and (read is None or read):
            return _LONGER
        return [_parts(item, read, depth - 1) for item in items]
    if value.__class__ is dict:
        return {key: _parts(item, inside(read, key), depth - 1) for key, item in value.items()}
    return value


def shallow(value: Any, size: int, depth: int = MOST_DEPTH) -> Any:
    """``value``, which was decoded from ``size`` bytes; PayloadError if it is nested below ``depth``."""
    if size <= depth:  # each level takes a byte at least
        return value
    level: list[Any] = [value] if value.__class__ in _NESTED else []
    for _ in range(depth):
        level = [
            inner
            for outer in level
            # most of what is long are scalars, and this passes over twenty million of them in half a second
            if outer.__class__ is dict or not _NESTED.isdisjoint(map(type, outer))
            for inner in (
                itertools.chain(outer, outer.values()) if outer.__class__ is dict else outer
            )
            if inner.__class__ in _NESTED
        ]
        if not level:
            return value
    raise PayloadError(_TOO_DEEP)
