"""CDR is read as the rosbags library reads it: all standard messages, both byte orders."""

from __future__ import annotations

import contextlib
import random
import struct
from typing import Any

import numpy
import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from m2c.language.datatypes import Array, Primitive, Structure
from moon.recording.cdr import Decoder
from moon.recording.definitions import Definitions
from transports.cdr import CdrError

STORE = get_typestore(Stores.ROS2_JAZZY)
DUMMY = "structure_needs_at_least_one_member"
INT32 = Decoder(Structure("std_msgs/msg/Int32", (("data", Primitive("int32")),)))


def drawn(kind: Any, rng: random.Random) -> Any:
    node, argument = kind
    if node == Nodetype.NAME:
        return message(argument, rng)
    if node == Nodetype.BASE:
        return scalar(argument[0], rng)
    inner, count = argument
    count = count if node == Nodetype.ARRAY else rng.randrange(4)
    items = [drawn(inner, rng) for _ in range(count)]
    if inner[0] == Nodetype.BASE and inner[1][0] != "string":
        name = inner[1][0]
        kinds = {"bool": "bool_", "byte": "uint8", "octet": "uint8", "char": "uint8"}
        return numpy.array(items, dtype=kinds.get(name, name))
    return items


def scalar(name: str, rng: random.Random) -> Any:
    if name == "string":
        return rng.choice(["", "a", "grüße", "x" * 9])
    if name == "bool":
        return rng.random() < 0.5
    if name.startswith("float"):
        return float(numpy.float32(rng.random()))
    if name in ("byte", "char", "octet"):
        return rng.randrange(128)
    return rng.randrange(2 ** (int(name.lstrip("uint")) - 1))


def message(name: str, rng: random.Random) -> Any:
    return STORE.types[name](*[drawn(kind, rng) for _, kind in STORE.fielddefs[name][1]])


def plain(value: Any) -> Any:
    if isinstance(value, numpy.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    if hasattr(value, "__msgtype__"):
        names = [name for name, _ in STORE.fielddefs[value.__msgtype__][1] if name != DUMMY]
        return {name: plain(getattr(value, name)) for name in names}
    return value


@pytest.mark.parametrize("little", [True, False])
def test_every_standard_message_is_read_as_rosbags_reads_it(little: bool):
    definitions, rng = Definitions(), random.Random(7)
    for name in STORE.fielddefs:
        decode = Decoder(definitions.structure(name))
        for _ in range(3):
            raw = bytes(STORE.serialize_cdr(message(name, rng), name, little_endian=little))
            assert decode(raw) == plain(STORE.deserialize_cdr(raw, name)), name


def test_no_cut_or_garbled_message_does_more_than_raise_its_error():
    definitions, rng = Definitions(), random.Random(8)
    for name in (
        "sensor_msgs/msg/PointCloud2",
        "action_msgs/msg/GoalStatusArray",
        "rcl_interfaces/msg/Log",
    ):
        decode = Decoder(definitions.structure(name))
        raw = bytes(STORE.serialize_cdr(message(name, rng), name))
        for end in range(len(raw) - 4):
            with pytest.raises(CdrError):
                decode(raw[:end])
        for place in range(4, len(raw)):
            for flip in (1, 0x80, 0xFF):
                garbled = raw[:place] + bytes([raw[place] ^ flip]) + raw[place + 1 :]
                with contextlib.suppress(CdrError):
                    decode(garbled)


def test_a_sequence_that_promises_more_than_there_is_is_said_with_its_place():
    decode = Decoder(Structure("p/msg/N", (("data", Array(Primitive("uint8"))),)))
    with pytest.raises(CdrError, match=r"at byte 8 it promises 4294967295 more bytes, and has 2"):
        decode(b"\0\1\0\0" + struct.pack("<I", 2**32 - 1) + b"ab")


def test_a_message_of_another_type_is_told_by_its_length():
    with pytest.raises(CdrError, match="should end at byte 8, and has 13"):
        INT32(b"\0\1\0\0" + bytes(9))


def test_an_unknown_encapsulation_is_said():
    with pytest.raises(CdrError, match="unknown encapsulation 0007"):
        INT32(b"\0\7\0\0" + bytes(4))
