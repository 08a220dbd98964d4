"""A chunk of a bag that is damaged is no silence: what happened meanwhile is not known."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer

from moon.recording.mcap_file import MAGIC
from tests.offline.logs import Line, check, stored

PROPERTIES = """\
  - {id: R, pattern: recurrence, of: lv, within: 1500 ms}
  - {id: P, pattern: response, request: go, response: alarm, within: 500 ms}
  - {id: A, pattern: absence, of: level >= 9}
  - {id: G, pattern: recurrence, of: go, within: 15 s}
"""
_FRAME = struct.Struct("<BQ")
_CHUNK = 6


def bag(path: Path, damaged: int | None) -> Path:
    """Seconds of a level that is 9 once, each in a chunk, with what is asked and answered in the fifth and sixth."""
    lines = [Line(n, 9 if n == 8 else 1, published_s=n - 0.001) for n in range(12)]
    lines += [Line(4.9, 1, "/go", 4.899), Line(5.1, 1, "/alarm", 5.099)]
    with path.open("wb") as opened:
        writer = Writer(opened, chunk_size=1, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="another")
        channels: dict[str, int] = {}
        for item in sorted(stored(lines), key=lambda item: item.log_ns):
            if item.topic not in channels:
                schema = writer.register_schema(item.type_name, item.encoding, item.schema.encode())
                channels[item.topic] = writer.register_channel(item.topic, "cdr", schema)
            writer.add_message(channels[item.topic], item.log_ns, item.data, item.publish_ns)
        writer.finish()
    content = bytearray(path.read_bytes())
    place, number = len(MAGIC), 0
    while damaged is not None:
        opcode, length = _FRAME.unpack_from(content, place)
        place += _FRAME.size + length
        if opcode == _CHUNK:
            if number == damaged:
                content[place - 1] ^= 0xFF
                path.write_bytes(content)
                return path
            number += 1
    return path


def test_a_whole_bag_is_judged(tmp_path: Path):
    said = check(tmp_path, bag(tmp_path / "run.mcap", None), PROPERTIES)
    assert said.verdicts == {
        "R": "conforming",
        "P": "conforming",
        "A": "violated",
        "G": "conforming",
    }, said.out


@pytest.mark.parametrize("options", [(), ("--time", "log"), ("--time", "publish")])
@pytest.mark.parametrize("damaged", [2, 6, 7])
def test_a_damaged_chunk_is_no_silence(tmp_path: Path, damaged: int, options: tuple[str, ...]):
    said = check(tmp_path, bag(tmp_path / "run.mcap", damaged), PROPERTIES, *options)
    assert "a chunk whose checksum is wrong" in said.out
    assert said.verdicts["R"] != "violated", said.out
    assert said.verdicts["P"] != "violated", said.out
    assert said.verdicts["A"] == "violated", said.out
