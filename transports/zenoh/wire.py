"""How a message looks on the wire.

Payload: the struct as a MessagePack map. Encoding: ``application/msgpack;<type name>``, so that
the type can be checked before decoding and any tool can read the contents without it. Attachment:
an 8-byte little-endian number (the sequence of a publication, the number of a call), then the
name of the sending node in UTF-8.
"""

from __future__ import annotations

import logging
import struct
from typing import Any

import msgspec
import zenoh

from transports.interface import Message, TransportError

LOG = logging.getLogger("transports.zenoh")
"""Where this transport reports what it dropped."""

MEDIA_TYPE = "application/msgpack"
UNSPECIFIED = "zenoh/bytes"
"""What Zenoh says of a payload whose sender named no encoding: then only decoding can tell."""

_NUMBER = struct.Struct("<Q")
_encode = msgspec.msgpack.Encoder().encode


class PayloadError(Exception):
    """A payload that is not a message of the expected type; the text says what is wrong."""


class Codec:
    """Encodes and decodes the messages of one type."""

    __slots__ = ("_decode", "_message", "encoding", "type_name")

    def __init__(self, type_name: str, message: type[Message]) -> None:
        self.type_name = type_name
        self.encoding = zenoh.Encoding(f"{MEDIA_TYPE};{type_name}")
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

    def decode(self, payload: zenoh.ZBytes | None, encoding: zenoh.Encoding | None) -> Any:
        """The message; PayloadError if it is none of this type."""
        if encoding is not None and encoding != self.encoding:
            found = str(encoding)
            if found != UNSPECIFIED:
                raise PayloadError(
                    f"expected type {self.type_name}, got {found.removeprefix(MEDIA_TYPE + ';')}"
                )
        return decode_with(self._decode, b"\x80" if payload is None else payload.to_bytes())


def decode_with(decode: Any, data: bytes) -> Any:
    """``decode(data)``, every way in which bad input can fail being a PayloadError."""
    try:
        return decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PayloadError(str(error)) from error


def attachment(number: int, node: bytes) -> bytes:
    """The attachment of publication or call ``number`` of ``node`` (its name in UTF-8)."""
    return _NUMBER.pack(number) + node


def read_attachment(data: zenoh.ZBytes | None) -> tuple[int, str]:
    """``(number, node)``; ``(-1, "")`` for what another tool sent."""
    if data is None:
        return -1, ""
    raw = data.to_bytes()
    if len(raw) < _NUMBER.size:
        return -1, ""
    try:
        return _NUMBER.unpack_from(raw)[0], raw[_NUMBER.size :].decode()
    except UnicodeDecodeError:
        return -1, ""


def report_payload(channel: str, source: str, error: PayloadError) -> None:
    """Report a payload that was dropped: channel, source, and where in the message."""
    LOG.warning("%s: message from %s dropped: %s", channel, source or "an unnamed node", error)
