"""Damaged files: what can be read is, what cannot is said with its place, and nothing else happens."""

from __future__ import annotations

import os
import random
import struct
import zlib
from pathlib import Path

import lz4.frame
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from moon.recording.definitions import MAX_TEXT
from moon.recording.format import EVENT_TOPIC, FORM, FORMAT_NAME, FORMAT_VERSION, Form
from moon.recording.mcap_file import MAGIC, McapFile
from moon.recording.reader import RecordingError, open_recording
from moon.recording.stored import (
    MAX_BYTES,
    MESSAGES_AT_FIRST,
    TooLargeError,
    Unpacked,
    unzstd,
    zstd,
)
from tests.recording import bags
from tests.recording.damage import Checks
from transports.interface import Observation

pytestmark = pytest.mark.slow

STEP = 97
COUNT = 300


def file_of(tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode) -> Path:
    stored = bags.levels(COUNT) + bags.a_call(
        "demo/srv/Add", "/add", bags.T0 + 40 * bags.SECOND, 1, SRV
    )
    folder = bags.write(tmp_path / "bag", stored, plugin, mode)
    (file,) = [path for path in folder.iterdir() if path.name != "metadata.yaml"]
    return file


SRV = f"{bags.RULE}SRV: demo/srv/Add\n{bags.ADD}"
CASES = [
    (StoragePlugin.MCAP, CompressionMode.NONE),
    (StoragePlugin.MCAP, CompressionMode.STORAGE),
    (StoragePlugin.MCAP, CompressionMode.FILE),
    (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    (StoragePlugin.SQLITE3, CompressionMode.NONE),
    (StoragePlugin.SQLITE3, CompressionMode.FILE),
]


def read(path: Path) -> tuple[list[Observation], list[str]]:
    """What is read, and what is said; a file that is refused is said too."""
    try:
        recording = open_recording(path)
    except RecordingError as error:
        return [], [str(error)]
    seen = list(recording.entries())
    return seen, recording.faults()


@pytest.mark.parametrize(("plugin", "mode"), CASES)
def test_a_file_cut_anywhere_gives_a_beginning_of_what_it_held_and_says_so(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
):
    file = file_of(tmp_path, plugin, mode)
    whole, faults = read(file)
    assert (len(whole), faults) == (COUNT + 4, [])
    data, cut = file.read_bytes(), tmp_path / f"cut{''.join(file.suffixes)}"
    most = 0
    for end in range(0, len(data), STEP):
        cut.write_bytes(data[:end])
        seen, faults = read(cut)
        assert seen == whole[: len(seen)] or plugin is StoragePlugin.SQLITE3
        assert all(item in whole for item in seen)
        most = max(most, len(seen))
        if len(seen) < len(whole):
            assert faults
            assert all(str(cut) in said or "is not read" in said for said in faults)
    # a compressed file as small as this is one block: it is all there, or nothing of it
    assert most > 0 or mode is CompressionMode.FILE


@pytest.mark.parametrize(("plugin", "mode"), CASES)
def test_a_flipped_byte_never_gives_a_message_that_nobody_sent_unless_nothing_guards_it(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
):
    file = file_of(tmp_path, plugin, mode)
    whole, _ = read(file)
    data, bad = file.read_bytes(), tmp_path / f"bad{''.join(file.suffixes)}"
    rng = random.Random(1)
    for place in range(0, len(data), STEP):
        flipped = bytearray(data)
        flipped[place] ^= 1 << rng.randrange(8)
        bad.write_bytes(flipped)
        seen, _ = read(bad)
        assert len(seen) <= len(whole)


def records(*parts: tuple[int, bytes]) -> bytes:
    return b"".join(struct.pack("<BQ", opcode, len(data)) + data for opcode, data in parts)


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


END = ((0x0F, bytes(4)), (2, bytes(20)))
HEADER = (1, text("ros2") + text("a test"))
SCHEMA = (
    3,
    struct.pack("<H", 1) + text("std_msgs/msg/Int32") + text("ros2msg") + text("int32 data\n"),
)
CHANNEL = (4, struct.pack("<HH", 1, 1) + text("/level") + text("cdr") + struct.pack("<I", 0))


def message(number: int) -> tuple[int, bytes]:
    head = struct.pack("<HIQQ", 1, number, number, number)
    return 5, head + b"\0\1\0\0" + struct.pack("<i", number)


def chunk(
    content: bytes, packed: bytes, compression: str, size: int = -1, crc: int = 0
) -> tuple[int, bytes]:
    size = len(content) if size < 0 else size
    head = struct.pack("<QQQI", 0, 0, size, crc) + text(compression)
    return 6, head + struct.pack("<Q", len(packed)) + packed


def mcap(tmp_path: Path, *parts: tuple[int, bytes]) -> Path:
    path = tmp_path / "made.mcap"
    path.write_bytes(MAGIC + records(HEADER, SCHEMA, CHANNEL, *parts, *END))
    return path


def numbers(seen: list[Observation]) -> list[int]:
    return [item.data["data"] for item in seen]


def test_a_chunk_with_a_wrong_checksum_is_left_out_and_the_next_is_read(tmp_path: Path):
    inner = records(message(1), message(2))
    good = records(message(3))
    path = mcap(
        tmp_path,
        chunk(inner, inner, "", crc=zlib.crc32(inner) ^ 1),
        chunk(good, good, "", crc=zlib.crc32(good)),
    )
    seen, faults = read(path)
    assert numbers(seen) == [3]
    (said,) = faults
    assert said.startswith(f"{path}: byte ")
    assert said.endswith("a chunk whose checksum is wrong; it is left out")


def test_a_bomb_in_a_chunk_is_never_unpacked_beyond_what_the_chunk_declares(tmp_path: Path):
    packed = zstd.compress(bytes(64 * 1024 * 1024))
    good = records(message(3))
    path = mcap(tmp_path, chunk(b"", packed, "zstd", size=1000), chunk(good, good, ""))
    seen, faults = read(path)
    assert numbers(seen) == [3]
    assert "cannot be decompressed (more than 1000 bytes when decompressed)" in faults[0]
    path = mcap(tmp_path, chunk(b"", packed, "zstd", size=MAX_BYTES + 1), chunk(good, good, ""))
    seen, faults = read(path)
    assert numbers(seen) == [3]
    assert f"a chunk of {MAX_BYTES + 1} bytes; at most {MAX_BYTES} are read" in faults[0]


def test_a_file_of_more_messages_than_its_size_can_hold_is_read_up_to_a_number(tmp_path: Path):
    inner = records(*[message(7)] * 20_000)
    packed = zstd.compress(inner)
    path = mcap(tmp_path, *[chunk(inner, packed, "zstd")] * 9)
    seen, faults = read(path)
    size = path.stat().st_size
    assert size < MESSAGES_AT_FIRST // 2
    assert len(seen) <= MESSAGES_AT_FIRST + size < len(seen) + 20
    (said,) = faults
    most = MESSAGES_AT_FIRST + size
    assert f"more than {most} messages in {size} bytes: what comes before was read" in said
    whole = tmp_path / "made.mcap.zstd"
    whole.write_bytes(zstd.compress(MAGIC + records(HEADER, SCHEMA, CHANNEL) + inner * 9))
    seen, faults = read(whole)
    most = MESSAGES_AT_FIRST + whole.stat().st_size
    assert len(seen) <= most < len(seen) + 20
    assert f"more than {most} messages in" in faults[0]


def test_pages_of_an_sqlite_file_that_point_at_one_another_make_no_endless_table(tmp_path: Path):
    folder = bags.write(tmp_path / "bag", bags.levels(3000), StoragePlugin.SQLITE3)
    (path,) = folder.glob("*.db3")
    data = bytearray(path.read_bytes())
    page = 4096
    rng = random.Random(5)
    insides = [at for at in range(page, len(data), page) if data[at] in (2, 5)]
    assert insides
    for at in insides:  # each child of an inner page is an inner page of the same kind
        same = [other // page + 1 for other in insides if data[other] == data[at]]
        cells = int.from_bytes(data[at + 3 : at + 5], "big")
        places = [int.from_bytes(data[at + 12 + 2 * n :][:2], "big") + at for n in range(cells)]
        for place in [*places, at + 8]:
            data[place : place + 4] = struct.pack(">I", rng.choice(same))
    path.write_bytes(data)
    seen, faults = read(path)
    assert len(seen) <= MESSAGES_AT_FIRST + len(data)
    assert faults


def test_columns_that_are_computed_are_no_messages(tmp_path: Path):
    import sqlite3

    path = tmp_path / "computed.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        connection.execute(
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, "
            "data GENERATED ALWAYS AS (zeroblob(200000000)))"
        )
        connection.execute("INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/Int32', 'cdr')")
        connection.executemany(
            "INSERT INTO messages (topic_id, timestamp) VALUES (1, ?)", ((n,) for n in range(100))
        )
    connection.close()
    seen, faults = read(path)
    assert not seen
    assert "no rosbag2 one" in faults[0]


def test_a_record_that_claims_to_be_huge_is_not_waited_for(tmp_path: Path):
    path = mcap(tmp_path, message(1))
    data = MAGIC + records(HEADER, SCHEMA, CHANNEL, message(1)) + struct.pack("<BQ", 5, 2**60)
    path.write_bytes(data)
    seen, faults = read(path)
    assert numbers(seen) == [1]
    assert f"a record of {2**60} bytes" in faults[0]


def test_a_bomb_in_a_message_is_said_as_one_that_cannot_be_read(tmp_path: Path):
    with pytest.raises(TooLargeError):
        unzstd(zstd.compress(bytes(1000)), 999)
    assert unzstd(zstd.compress(bytes(1000)), 1000) == bytes(1000)


def test_a_message_of_a_channel_that_is_not_declared_is_left_out(tmp_path: Path):
    stray = (5, struct.pack("<HIQQ", 9, 1, 1, 1) + b"\0\1\0\0" + bytes(4))
    seen, faults = read(mcap(tmp_path, stray, message(2)))
    assert numbers(seen) == [2]
    assert "channel 9, which is not declared" in faults[0]


def of_type(tmp_path: Path, definition: str, data: bytes = bytes(2000)) -> tuple[Path, str]:
    """A recording of a message whose type is ``definition``, and what is said of it."""
    path = tmp_path / "typed.mcap"
    schema = struct.pack("<H", 1) + text("demo/msg/A0") + text("ros2msg") + text(definition)
    stored = struct.pack("<HIQQ", 1, 1, 1, 1) + b"\0\1\0\0" + data
    path.write_bytes(MAGIC + records(HEADER, (3, schema), CHANNEL, (5, stored), *END))
    seen, faults = read(path)
    assert not seen
    (said,) = faults
    return path, said


def nested(depth: int, fields: str, innermost: str) -> str:
    """``depth`` types, each of which has ``fields``, where ``{}`` is the next type."""
    sections = [fields.format(f"demo/A{level + 1}") for level in range(depth)]
    headed = [f"MSG: demo/A{level}\n{body}" for level, body in enumerate([*sections, innermost])]
    return sections[0] + "".join(bags.RULE + part for part in headed[1:])


def test_a_type_that_doubles_at_each_level_is_refused_instead_of_built(tmp_path: Path):
    _, said = of_type(tmp_path, nested(25, "{0} a\n{0} b\n", "int32 x\n"))
    assert "has more than 10000 fields, with its parts'" in said


def test_arrays_of_what_takes_no_bytes_are_refused_instead_of_read(tmp_path: Path):
    _, said = of_type(tmp_path, nested(4, "{}[1000] a\n", "int32[0] x\n"))
    assert said == "/level is not read: arrays of no elements are not supported"


def texts(values: dict[str, str]) -> bytes:
    pairs = b"".join(text(name) + text(value) for name, value in values.items())
    return struct.pack("<I", len(pairs)) + pairs


@pytest.mark.parametrize("digits", [19, 30, 400, 4000, 5000])
def test_an_event_of_no_time_that_there_is_is_left_out(tmp_path: Path, digits: int):
    number, path = "9" * digits, tmp_path / "own.mcap"
    events = [
        '{"entry": "began", "received_ns": 1000, "node": "r", "whole": false}',
        f'{{"entry": "began", "received_ns": {number}, "node": "r", "whole": false}}',
        f'{{"entry": "node", "received_ns": 2000, "node": "A", "up": true, "since_ns": {number}}}',
        f'{{"entry": "ended", "received_ns": -{number}}}',
        '{"entry": "ended", "received_ns": 3000}',
    ]
    schema = (
        struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text("string data")
    )
    channel = struct.pack("<HH", 1, 1) + text(EVENT_TOPIC) + text("cdr") + texts({FORM: Form.EVENT})
    stored = [
        struct.pack("<HIQQ", 1, 0, 1, 1) + b"\0\1\0\0" + text(f"{event}\0") for event in events
    ]
    metadata = (0x0C, text(FORMAT_NAME) + texts({"version": FORMAT_VERSION}))
    messages = [(5, message) for message in stored]
    path.write_bytes(MAGIC + records(HEADER, metadata, (3, schema), (4, channel), *messages, *END))
    seen, faults = read(path)
    assert [getattr(entry, "received_ns", 0) for entry in seen] == [
        1000,
        1,
        3000,
    ]  # it begins again
    assert any("could not decode 3 messages on /moon/recording" in said for said in faults)


def test_numbers_of_thousands_of_digits_in_a_definition_are_said(tmp_path: Path):
    for definition in (f"int32[{'9' * 5000}] a\n", f"int32 A={'9' * 5000}\nint32 a\n"):
        _, said = of_type(tmp_path, definition)
        assert "its definition cannot be read: Exceeds the limit" in said


def test_blank_lines_and_comments_of_a_definition_cost_nothing(tmp_path: Path):
    path, said = of_type(tmp_path, "\n" * 500_000 + "# a\n" * 100_000 + "int32 a\n")
    assert said == "could not decode 1 message on /level: it should end at byte 8, and has 2004"
    assert path.stat().st_size < MAX_TEXT


def test_definitions_are_parsed_up_to_a_total_and_each_once(tmp_path: Path):
    from moon.recording.definitions import MAX_ALL, MAX_SECTION, Definitions, UnknownTypeError

    definitions = Definitions()
    long = f"int32 a{' ' * 1_000}\n" * 100
    for _ in range(2 * MAX_ALL // len(long)):
        definitions.add("demo/msg/A", "ros2msg", long)
    definitions.add("demo/msg/B", "ros2msg", "int32 a\n")
    assert [name for name, _ in definitions.structure("demo/msg/B").fields] == ["a"]
    definitions.add("demo/msg/C", "ros2idl", f"module demo {{{' ' * (MAX_SECTION // 30)}}};")
    with pytest.raises(UnknownTypeError, match="its definition is too long"):
        definitions.structure("demo/msg/C")
    wrong = "%" * (MAX_SECTION - 10)
    for number in range(MAX_ALL // len(wrong) + 1):
        definitions.add(f"demo/msg/D{number}", "ros2msg", wrong)
    with pytest.raises(UnknownTypeError, match="too long in all"):
        definitions.structure(f"demo/msg/D{number}")


def test_files_that_are_no_recording_are_refused_with_what_they_are(tmp_path: Path):
    for name, content, said in (
        ("a.mcap", b"", "is empty (0 bytes)"),
        ("b.mcap", MAGIC[:3], "ends within the first bytes of an MCAP file"),
        ("c.db3", b"SQLite", "ends within the first bytes of an SQLite file"),
        ("d.bag", b"#ROSBAG V2.0\n", "a bag of ROS 1"),
        ("e.mcap", b"\x7fELF" + bytes(100), "is no recording (begins with b'\\x7fELF"),
        (
            "g.mcap.lz4",
            lz4.frame.compress(MAGIC),
            "is compressed by lz4; unpack it with `lz4 -d g.mcap.lz4`",
        ),
        ("f.zstd", b"\x28\xb5\x2f\xfd" + b"\xff" * 40, "compression is damaged"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(RecordingError) as caught:
            open_recording(path)
        assert said in str(caught.value)
        assert str(path) in str(caught.value)


def test_a_pipe_is_refused_instead_of_waited_for(tmp_path: Path):
    os.mkfifo(tmp_path / "run.mcap")
    with pytest.raises(RecordingError, match="may never end"):
        open_recording(tmp_path / "run.mcap")


def test_what_is_not_there_and_folders_without_a_bag_are_refused(tmp_path: Path):
    with pytest.raises(RecordingError, match="No such file"):
        open_recording(tmp_path / "nothing")
    with pytest.raises(RecordingError, match="a folder that is no recording"):
        open_recording(tmp_path)


def test_metadata_that_name_a_file_elsewhere_are_not_followed(tmp_path: Path):
    folder = bags.write(tmp_path / "bag", bags.levels(2))
    secret = bags.write(tmp_path / "secret", bags.levels(9))
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  relative_file_paths: ['../secret/secret.mcap', 'bag.mcap']\n"
    )
    seen, faults = read(folder)
    assert len(seen) == 2
    assert faults == [f"{folder / 'secret.mcap'}: is named in metadata.yaml, and is not there"]
    assert secret.exists()


@pytest.mark.parametrize(
    "content", [b"\xff\xfe", b"- 1", b"a: &a [*a]", b"{" * 2000, b"a: !!python/object:x"]
)
def test_metadata_that_cannot_be_read_are_said_and_the_files_are_read(
    tmp_path: Path, content: bytes
):
    folder = bags.write(tmp_path / "bag", bags.levels(2))
    (folder / "metadata.yaml").write_bytes(content)
    seen, faults = read(folder)
    assert len(seen) == 2
    assert str(folder / "metadata.yaml") in faults[0]


def test_an_sqlite_file_of_something_else_is_said(tmp_path: Path):
    import sqlite3

    path = tmp_path / "other.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE a (b)")
    connection.close()
    assert read(path) == (
        [],
        [f"{path}: it is an SQLite file, but no rosbag2 one: no topics and messages"],
    )


def test_a_view_that_never_ends_is_not_taken_for_a_table(tmp_path: Path):
    import sqlite3

    path = tmp_path / "view.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE topics (id, name, type, serialization_format)")
        connection.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(id, topic_id, timestamp, data) AS "
            "(SELECT 1, 1, 1, x'00' UNION ALL SELECT id + 1, 1, 1, x'00' FROM n) SELECT * FROM n"
        )
    connection.close()
    seen, faults = read(path)
    assert not seen
    assert "no rosbag2 one" in faults[0]


def test_an_attachment_larger_than_any_message_is_passed_over(tmp_path: Path):
    import io

    class Endless(io.RawIOBase):
        """Zeros for an attachment that nobody wants to keep on a disk."""

        def __init__(self, head: bytes, zeros: int, tail: bytes) -> None:
            self.parts = [head, zeros, tail]

        def read(self, count: int = -1) -> bytes:
            for index, part in enumerate(self.parts):
                if isinstance(part, int) and part:
                    taken = min(part, count)
                    self.parts[index] = part - taken
                    return bytes(taken)
                if isinstance(part, bytes) and part:
                    self.parts[index] = part[count:]
                    return part[:count]
            return b""

    size = MAX_BYTES * 2
    head = MAGIC + records(HEADER, SCHEMA, CHANNEL) + struct.pack("<BQ", 9, size)
    file = McapFile(Endless(head, size, records(message(5), *END)), "it")
    assert [item.sequence for item in file.messages(lambda channel: True)] == [5]
    assert file.faults == []


def test_of_a_compressed_file_that_is_cut_off_all_whole_blocks_are_read(tmp_path: Path):
    data = random.Random(3).randbytes(600_000)
    path = tmp_path / "a.zstd"
    for parts in ([data], [data[:1000], data[1000:]]):
        packed = b"".join(zstd.compress(part) for part in parts)
        path.write_bytes(packed)
        with Unpacked(path) as opened:
            assert opened.read() == data
            assert opened.fault == ""
        path.write_bytes(packed[:400_000])
        with Unpacked(path) as opened:
            assert data.startswith(made := opened.read())
            assert len(made) > 200_000
            assert opened.fault == "the compressed file ends before its end"


CASES_OF_EVERY_FORM = 60


def test_whatever_is_damaged_in_whatever_form_a_check_ends_with_a_result_or_a_refusal(
    tmp_path: Path,
):
    checks = Checks(tmp_path, models=False)
    for seed in range(CASES_OF_EVERY_FORM):
        checks.check(seed)
