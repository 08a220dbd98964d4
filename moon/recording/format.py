"""How the entries of a recording are laid out in an MCAP file (``docs/recording-format.md``).

Other tools find what ``ros2 bag record`` would have written. What ROS 2 does not tell is kept where it
costs them nothing: every publisher (and every client of a service) has an MCAP channel of its own, whose
metadata name it, and a message's number is in its MCAP record. What has no exact form in CDR (no type is
known, a call's error, a field that is not of its type) is kept whole on a channel of its own.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Mapping
from enum import StrEnum

from m2c.language.datatypes import Array, Primitive, Structure
from moon.recording.cdr_writing import HEADER

FORMAT_NAME = "moon.recording"
"""The metadata record at the beginning of each file."""
FORMAT_VERSION = "1"

FORM = "moon.form"
"""In a channel's metadata: what its messages are (:class:`Form`)."""
SOURCE = "moon.source"
"""In a channel's metadata: who published."""
CLIENT = "moon.client"
"""In the metadata of a service's events: whose calls."""
LIFE = "moon.life"
"""In a channel's metadata: which life of the publisher (``Observation.life``), where that is known."""
CLIENT_LIFE = "moon.client_life"
"""The same of the client."""
NUMBERS = "moon.numbers"
"""In the metadata of observations: what the records' numbers are (``numbers.Numbering``)."""
KIND = "moon.kind"
"""In the metadata of verdicts: ``model`` or ``property``."""
TURN = "moon.turn"
"""In the metadata of pulses: which turn (``entries.Turn``)."""


class Form(StrEnum):
    """What the messages of an MCAP channel are."""

    OBSERVATION = "observation"
    """Observations, as ROS 2 publishes them."""
    COPY = "copy"
    """The nearest that ROS 2 has to observations that are kept whole elsewhere: for other tools."""
    PACKED = "packed"
    """Observations kept whole, as MessagePack."""
    EVENT = "event"
    """``entries.Event`` as JSON."""
    PULSE = "pulse"
    """``entries.Pulse``: the monotonic clock, in ns."""
    VERDICT = "verdict"
    """``entries.ReportedVerdict``."""


PACKED_TOPIC = "/moon/observations"
EVENT_TOPIC = "/moon/recording"
PULSE_TOPIC = "/moon/pulse"
VERDICT_TOPIC = "/moon/verdicts"

PACKED_TYPE = Structure("moon_msgs/msg/Packed", (("msgpack", Array(Primitive("uint8"))),))
STRING_TYPE = Structure("std_msgs/msg/String", (("data", Primitive("string")),))
INT64_TYPE = Structure("std_msgs/msg/Int64", (("data", Primitive("int64")),))
_TEXTS = Array(Primitive("string"))
_EVIDENCE = Structure(
    "moon_msgs/msg/Evidence", (("stamp_ns", Primitive("int64")), ("text", Primitive("string")))
)
_DIFFERENCE = Structure(
    "moon_msgs/msg/Difference",
    (
        ("path", Primitive("string")),
        ("expected", Primitive("string")),
        ("observed", Primitive("string")),
    ),
)
VERDICT_TYPE = Structure(
    "moon_msgs/msg/Verdict",
    (
        ("machine", Primitive("string")),
        ("node", Primitive("string")),
        ("outcome", Primitive("string")),
        ("stamp_ns", Primitive("int64")),
        ("reason", Primitive("string")),
        ("expected", _TEXTS),
        ("observed", Primitive("string")),
        ("states", _TEXTS),
        ("evidence", Array(_EVIDENCE)),
        ("places", _TEXTS),
        ("channel", Primitive("string")),
        ("differences", Array(_DIFFERENCE)),
        ("cause", Primitive("string")),
    ),
)
"""As ``moon.sinks.topic.VerdictMessage`` is published."""
EARLIER_VERDICT_TYPE = Structure(VERDICT_TYPE.name, VERDICT_TYPE.fields[:-3])
"""The same in recordings of an earlier version: without its channel, its differences and its cause."""

GID_BYTES = 16
_NS = 10**9
_event_head = struct.Struct("<4sB3xiI16s4xq").pack
"""``service_msgs/msg/ServiceEventInfo``; the number is aligned to 8 bytes."""


NumberError = struct.error
"""A number that its field has no room for."""


def gid_of(client: str) -> bytes:
    """A GID for a client that is known by name: always the same for the same name."""
    return hashlib.blake2b(client.encode(errors="replace"), digest_size=GID_BYTES).digest()


def event_head(event_type: int, stamp_ns: int, gid: bytes, call: int) -> bytes:
    """The CDR of a service event up to its request; NumberError if a number is too large."""
    return _event_head(HEADER, event_type, stamp_ns // _NS, stamp_ns % _NS, gid, call)


EVENT_HEAD_BYTES = 44
"""Where the first request of an event begins, after the CDR header: alignment adds nothing to 4."""
_head_of_event = struct.Struct("<4xB31xqI").unpack_from


def read_event_head(data: bytes) -> tuple[int, int, int]:
    """Type of event, number of the call and number of requests; NumberError if there is less."""
    found: tuple[int, int, int] = _head_of_event(data)
    return found


def lives_of(metadata: Mapping[str, str]) -> tuple[int, int]:
    """The life of the publisher and of the client; 0 where the recording does not say."""
    return _life(metadata.get(LIFE, "")), _life(metadata.get(CLIENT_LIFE, ""))


def _life(text: str) -> int:
    return int(text) if text.isdecimal() and text.isascii() and len(text) <= _MOST_DIGITS else 0


_MOST_DIGITS = 19


def form_of(metadata: Mapping[str, str]) -> Form | None:
    """What the messages of a channel with ``metadata`` are; None if it is not one of ours."""
    try:
        return Form(metadata.get(FORM, ""))
    except ValueError:
        return None
