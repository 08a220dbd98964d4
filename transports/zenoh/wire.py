"""How a message looks on the wire.

Payload: the struct as a MessagePack map. Encoding: ``application/msgpack;<type name>``, so that
the type can be checked before decoding and any tool can read the contents without it. Attachment:
two 8-byte little-endian numbers (of a publication: its sequence on its channel, and its order among
all that the node reports; of a call: its number, and the life of who calls), then the name of the sending
node in UTF-8.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import zenoh

from transports.interface import Message
from transports.payloads import TypedCodec
from transports.zenoh.tokens import MOST_NAME

"""Where this transport reports what it dropped."""

MEDIA_TYPE = "application/msgpack"
UNSPECIFIED = "zenoh/bytes"
"""What Zenoh says of a payload whose sender named no encoding: then only decoding can tell."""

_NO_CONTENTS = b"\x80"
"""An empty map: what a tool sends that calls without a payload."""

_NUMBERS = struct.Struct("<QQ")

MOST_NUMBER = 2**63 - 1
"""What fits in every form of recording; a node that counts a million a second needs 300 000 years for it."""
_MOST_BYTES = _NUMBERS.size + 4 * MOST_NAME
"""Of an attachment; a character in UTF-8 has up to four bytes."""
MOST_TYPE_NAME = 512
"""Characters of a type's name: twice the longest of ROS 2 (package and message, 255 each)."""


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
    """What an attachment says; see the module's text."""

    number: int
    order: int
    node: str


UNKNOWN = Sent(-1, -1, "")
"""Of what another tool sent."""


def attachment(number: int, order: int, node: bytes) -> bytes:
    """The attachment of publication or call ``number`` of ``node`` (its name in UTF-8).

    ``order``: of a call, the life of ``node``.
    """
    return _NUMBERS.pack(number, order) + node


def life_of(session: object) -> int:
    """The life of a session's nodes (``Observation.life``), by the session's id: each has one of its own.

    Args:
        session: its id, whose ``str`` is hexadecimal.
    """
    return int(str(session), 16) & MOST_NUMBER


def read_attachment(data: zenoh.ZBytes | None) -> Sent:
    """What an attachment says; ``UNKNOWN`` if it is none of ours. Nothing is raised."""
    return UNKNOWN if data is None else sent_of(data.to_bytes())


def sent_of(raw: bytes) -> Sent:
    """As ``read_attachment``."""
    if not _NUMBERS.size <= len(raw) <= _MOST_BYTES:
        return UNKNOWN
    number, order = _NUMBERS.unpack_from(raw)
    if number > MOST_NUMBER or order > MOST_NUMBER:
        return UNKNOWN
    try:
        node = raw[_NUMBERS.size :].decode()
    except UnicodeDecodeError:
        return UNKNOWN
    return Sent(number, order, node) if node.isprintable() else UNKNOWN


def type_of(encoding: str) -> str:
    """The type's name in the text of an encoding; empty if it names none, or what can be no name."""
    name = "" if encoding == UNSPECIFIED else encoding.removeprefix(MEDIA_TYPE + ";")
    return name if len(name) <= MOST_TYPE_NAME and name.isprintable() else ""
