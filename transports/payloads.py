"""Messages as bytes: typed on the way out, checked on the way in.

What every transport of this repository puts on its wire: the struct as a MessagePack map, with the
type's name beside it, so that the type can be checked before decoding.
"""

from __future__ import annotations

import logging
from typing import Any

import msgspec

from transports.interface import Message, TransportError

_encode = msgspec.msgpack.Encoder().encode
_decode_any = msgspec.msgpack.Decoder().decode


class PayloadError(Exception):
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
        return decode_with(self._decode, payload)

    def require(self, type_name: str) -> None:
        """PayloadError unless ``type_name``, that of a payload, is this codec's."""
        if type_name != self.type_name:
            raise PayloadError(f"expected type {self.type_name}, got {type_name}")


def decode_with(decode: Any, data: bytes) -> Any:
    """``decode(data)``, every way in which bad input can fail being a PayloadError."""
    try:
        return decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PayloadError(str(error)) from error


def plain(payload: bytes) -> Any:
    """A payload as maps, lists and scalars; PayloadError if it is no MessagePack."""
    return decode_with(_decode_any, payload)


def report_payload(
    log: logging.Logger, channel: str, source: str, error: PayloadError | str
) -> None:
    """Report a payload that was dropped: channel, source, and where in the message."""
    log.warning("%s: message from %s dropped: %s", channel, source or "an unnamed node", error)
