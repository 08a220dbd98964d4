"""One reader of CDR: what a tap on ROS 2 and a reader of recordings make of the same bytes."""

from __future__ import annotations

import struct
import subprocess
import sys
from typing import Any

import pytest

from m2c.language.datatypes import Array, Primitive, Structure
from moon.recording.cdr import Decoder, part_reader
from transports import cdr

HEADER = b"\x00\x01\x00\x00"
TEXT = Structure("std_msgs/msg/String", (("data", Primitive("string")),))
EMPTY = Structure("std_msgs/msg/Empty", ())


def by_rclpy(name: str, payload: bytes) -> Any:
    """What a subscriber gets; CdrError if rclpy refuses."""
    from rclpy.serialization import deserialize_message
    from std_msgs import msg

    from transports.ros2.messages import plain_of

    return plain_of(deserialize_message(payload, getattr(msg, name)))


def by_tap(name: str, payload: bytes) -> Any:
    from std_msgs import msg

    from transports.ros2 import cdr as of_ros2

    return of_ros2.reader(getattr(msg, name))(payload)


@pytest.mark.ros2
@pytest.mark.parametrize(
    "body", [b"\4\0\0\0abc\0", b"\3\0\0\0abc", b"\0\0\0\0", b"\1\0\0\0\0"], ids=repr
)
def test_a_string_is_whole_whether_a_nul_ends_it_or_not(body: bytes) -> None:
    payload = HEADER + body
    assert Decoder(TEXT)(payload) == by_tap("String", payload) == by_rclpy("String", payload)


@pytest.mark.ros2
def test_a_structure_without_fields_takes_a_byte() -> None:
    assert Decoder(EMPTY)(HEADER + b"\0") == by_tap("Empty", HEADER + b"\0") == {}
    for read in (Decoder(EMPTY), lambda payload: by_tap("Empty", payload)):
        with pytest.raises(cdr.CdrError, match="at byte 4 it promises 1 more bytes, and has 0"):
            read(HEADER)
    with pytest.raises(Exception, match="failed to deserialize"):
        by_rclpy("Empty", HEADER)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("begin", range(8))
def test_scalars_are_aligned_wherever_a_structure_begins(begin: int, order: str) -> None:
    kind = Structure(
        "p/msg/Mixed",
        (
            ("flag", Primitive("bool")),
            ("real", Primitive("float64")),
            ("name", Primitive("string")),
            ("small", Primitive("int16")),
            ("many", Array(Primitive("uint32"))),
            ("two", Array(Primitive("int64"), 2, True)),
        ),
    )
    wanted = {"flag": True, "real": 1.5, "name": "ab", "small": -2, "many": [7], "two": [-1, 9]}
    out = bytearray(begin)

    def put(code: str, *values: Any) -> None:
        size = struct.calcsize(f"<{code[-1]}")
        out.extend(bytes(-len(out) % size) + struct.pack(order + code, *values))

    put("?", True)
    put("d", 1.5)
    put("I", 3)
    out.extend(b"ab\0")
    put("h", -2)
    put("I", 1)
    put("I", 7)
    put("2q", -1, 9)
    assert part_reader(kind, order)(bytes(out), begin) == (wanted, len(out))


def test_more_items_than_anybody_sends_are_refused_before_they_are_made() -> None:
    read = cdr.sequence(cdr.structure([]))
    for count, is_read in ((cdr.MAX_ITEMS, True), (cdr.MAX_ITEMS + 1, False)):
        payload = struct.pack("<I", count) + bytes(count)
        if is_read:
            assert len(read(payload, 0)[0]) == count
            continue
        with pytest.raises(cdr.CdrError, match=f"a sequence of {count} items at byte 8"):
            read(payload, 0)


def test_an_array_of_no_elements_is_refused_when_its_type_is_read() -> None:
    with pytest.raises(cdr.CdrError, match="arrays of no elements"):
        cdr.sequence("uint8", 0)


def test_recordings_are_read_where_there_is_no_ros_2() -> None:
    code = "import sys; sys.modules['rclpy'] = None; import moon.recording.reader, transports.cdr"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
