"""How a message looks on the wire.

Payload: the struct as a MessagePack map. Encoding: ``application/msgpack;<type name>``, so that
the type can be checked before decoding and any tool can read the contents without it. Attachment:
two 8-byte little-endian numbers (of a publication: its sequence on its channel, and its order among
all that the node tells; of a call: its number, and 0), then the name of the sending node in UTF-8.
"""

from __future__ import annotations

import logging
import struct
from typing import Any, NamedTuple

import zenoh

from transports import payloads
from transports.interface import Message
from transports.payloads import PayloadError, TypedCodec

LOG = logging.getLogger("transports.zenoh")
"""Where this transport reports what it dropped."""

MEDIA_TYPE = "application/msgpack"
UNSPECIFIED = "zenoh/bytes"
"""What Zenoh says of a payload whose sender named no encoding: then only decoding can tell."""

_NO_CONTENTS = b"\x80"
"""An empty map: what a tool sends that calls without a payload."""

_NUMBERS = struct.Struct("<QQ")


class Codec(TypedCodec):
    """Encodes and decodes the messages of one type, as Zenoh carries them."""

    __slots__ = ("encoding",)

    def __init__(self, type_name: str, message: type[Message]) -> None:
        super().__init__(type_name, message)
        self.encoding = zenoh.Encoding(f"{MEDIA_TYPE};{type_name}")

    def decode(self, payload: bytes, encoding: zenoh.Encoding | None) -> Any:
        """The message; PayloadError if it is none of this type."""
        if encoding is not None and encoding != self.encoding:
            found = str(encoding)
            if found != UNSPECIFIED:
                self.require(found.removeprefix(MEDIA_TYPE + ";"))
        return self.decode_bytes(payload)


def contents(payload: zenoh.ZBytes | None) -> bytes:
    """A copy of what came; of nothing, the message that has all its defaults.

    A copy, because what Zenoh hands over is a part of the buffer that it received into: who keeps that has
    Zenoh receive into a new one of 64 KB.
    """
    return _NO_CONTENTS if payload is None else payload.to_bytes()


class Sent(NamedTuple):
    """What an attachment tells; see the module's text."""

    number: int
    order: int
    node: str


UNKNOWN = Sent(-1, -1, "")
"""Of what another tool sent."""


def attachment(number: int, order: int, node: bytes) -> bytes:
    """The attachment of publication or call ``number`` of ``node`` (its name in UTF-8)."""
    return _NUMBERS.pack(number, order) + node


def read_attachment(data: zenoh.ZBytes | None) -> Sent:
    """What an attachment tells; ``UNKNOWN`` if it is none of ours."""
    if data is None:
        return UNKNOWN
    raw = data.to_bytes()
    if len(raw) < _NUMBERS.size:
        return UNKNOWN
    try:
        number, order = _NUMBERS.unpack_from(raw)
        return Sent(number, order, raw[_NUMBERS.size :].decode())
    except UnicodeDecodeError:
        return UNKNOWN


def report_payload(channel: str, source: str, error: PayloadError) -> None:
    """Report a payload that was dropped: channel, source, and where in the message."""
    payloads.report_payload(LOG, channel, source, error)
