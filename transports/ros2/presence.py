"""What a node says of itself when it is ready, or listens.

ROS 2 shows a node as soon as it exists, and its endpoints one by one. So a node that is ready
publishes, transient_local on ``<namespace>/_m2c/nodes``, what it has declared (JSON in a
``std_msgs/msg/String``).
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from rclpy.qos import QoSProfile

from transports.payloads import PayloadError, decode_with
from transports.ros2 import native, qos

TOPIC = "/_m2c/nodes"
MOST_ENDPOINTS = 4096
"""That a node says to be its own; of what it has beyond, ROS 2 tells whose it is."""


class Presence(msgspec.Struct):
    """What a node says of itself.

    Attributes:
        node: its name.
        since_ns: when it began to connect, ns since the epoch, on its clock.
        publishes, subscribes, serves, calls: full names of what it had declared.
        taps: globs of what it listens to, and with them it declares to receive what matches.
        refused: topics that its taps cannot receive.
        is_ready: whether it has announced itself; else it only says to what it listens, and is not up.
        found: if it listens, the nodes of which it has been told that they are up.
        endpoints: its own in the participant in which it says so, each by the last four bytes of its GID,
            hexadecimal; what its taps have is not among them. None at all: the participant is its own.
        host: of which host it is (``transports.host.ID``); "": it does not say.
    """

    node: Annotated[str, msgspec.Meta(min_length=1, max_length=255)]
    since_ns: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] = 0
    publishes: list[str] = msgspec.field(default_factory=list)
    subscribes: list[str] = msgspec.field(default_factory=list)
    serves: list[str] = msgspec.field(default_factory=list)
    calls: list[str] = msgspec.field(default_factory=list)
    taps: list[str] = msgspec.field(default_factory=list)
    refused: list[str] = msgspec.field(default_factory=list)
    is_ready: bool = True
    found: list[str] = msgspec.field(default_factory=list)
    endpoints: Annotated[
        list[Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{8}$", max_length=8)]],
        msgspec.Meta(max_length=MOST_ENDPOINTS),
    ] = msgspec.field(default_factory=list)
    host: Annotated[str, msgspec.Meta(pattern="^([0-9a-f]{32})?$", max_length=32)] = ""

    def gids(self, participant: bytes) -> frozenset[bytes]:
        """Of its endpoints, as it is in ``participant``."""
        return frozenset(participant + bytes.fromhex(endpoint) for endpoint in self.endpoints)


encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(Presence).decode


def profile(depth: int) -> QoSProfile:
    """Of who says it and who reads it; ``depth``: so many are kept."""
    return qos.profile(reliable=True, transient_local=True, depth=depth)


def entity_of(gid: bytes) -> str:
    """An endpoint as ``Presence.endpoints`` has it."""
    return gid[native.PREFIX_BYTES :].hex()


def read_presence(payload: bytes) -> Presence:
    """What a node says of itself in a serialized String; PayloadError if it is no such thing.

    That is 4 bytes of CDR header, the text's length, itself, NUL.
    """
    if len(payload) < _TEXT_AT:
        raise PayloadError("it is no String")
    length = int.from_bytes(payload[4:_TEXT_AT], "little" if payload[1] & 1 else "big")
    presence: Presence = decode_with(_decode, payload[_TEXT_AT : _TEXT_AT + max(length - 1, 0)])
    return presence


_TEXT_AT = 8
