"""Messages as bytes: typed on the way out, checked on the way in.

What every transport of this repository puts on its wire: the struct as a MessagePack map, with the
type's name beside it, so that the type can be checked before decoding.
"""

from __future__ import annotations

import itertools
from typing import Any

import msgspec

from transports.interface import Message, TransportError

MOST_DEPTH = 128
"""How deep what is not of a known type may be nested; messages of ROS are at most some ten deep. What is
read here is written again elsewhere, deeper in the stack, and msgspec's limit is that of Python's stack."""
_NESTED = frozenset((dict, list, tuple))

_UNDECODABLE = (msgspec.DecodeError, UnicodeError, RecursionError)
"""Every way in which bad input can fail."""

_encode = msgspec.msgpack.Encoder().encode
_decode_any = msgspec.msgpack.Decoder().decode


class PayloadError(ValueError):
    """A payload that is not a message of the expected type; the text says what is wrong."""


class TypedCodec:
    """Encodes and decodes the messages of one type."""

    __slots__ = ("_decode", "_message", "type_name")

    def __init__(self, type_name: str, message: type[Message]) -> None:
        self.type_name = type_name
        self._message = message
        self._decode = msgspec.msgpack.Decoder(message).decode

    def encode(self, message: Message) -> bytes:
        """The payload; TransportError if ``message`` is of another type."""
        if (
            message.__class__ is not self._message
            and getattr(message, "__type_name__", None) != self.type_name
        ):
            raise TransportError(
                f"expected a message of type {self.type_name}, got {type(message).__name__}"
            )
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


def decode_with(decode: Any, data: bytes | str) -> Any:
    """``decode(data)`` of msgspec, every way in which bad input can fail being a PayloadError."""
    try:
        return decode(data)
    except _UNDECODABLE as error:
        raise PayloadError(str(error)) from error


def plain(payload: bytes) -> Any:
    """A payload as maps, lists and scalars; PayloadError if it is no MessagePack, or nested too deep."""
    return shallow(decode_with(_decode_any, payload), len(payload))


def shallow(value: Any, size: int) -> Any:
    """``value``, which was decoded from ``size`` bytes; PayloadError if it is nested too deep."""
    if size <= MOST_DEPTH:  # each level takes a byte at least
        return value
    level: list[Any] = [value] if value.__class__ in _NESTED else []
    for _ in range(MOST_DEPTH):
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
    raise PayloadError(f"it is nested deeper than {MOST_DEPTH}")
