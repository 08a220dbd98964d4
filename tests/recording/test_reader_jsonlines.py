"""Logs of MOON and ROSMonitoring; the shapes are those that their generators write."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.recording.contents import is_clock
from moon.recording.jsonlines import MAX_LINE
from moon.recording.reader import open_recording
from moon.recording.stored import zstd
from transports.interface import Observation, ObservationKind

MOON = """\
{"data": 30, "topic": "/BatteryComponent/level", "time": 1700000012.0, "verdict": "currently_true"}
{"request": {}, "service": "/BatteryLevelSkill/tick", "time": 1700000012.0}
{"service": "/BatteryLevelSkill/tick", "time": 1700000012.0, "response": {"status": 0, "is_ok": true}}
"""
ROSMONITORING = """\
{"topic":"turtle1/cmd_vel","time":1.0,"linear":{"x":1.0},"angular":{"z":0.0}}
{"service":"turtle1/teleport_absolute","time":2.5,"request":{"x":5.5,"y":5.5,"theta":0.0}}
{"topic":"chatter","t":3,"data":"hello"}
{"topic":"scan","time":4.0,"range":NaN}
"""


def read(tmp_path: Path, content: str | bytes) -> tuple[list[Observation], list[str]]:
    path = tmp_path / "log.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    recording = open_recording(path)
    seen = list(recording.entries())
    return seen, [said.replace(str(path), "LOG") for said in recording.faults()]


def test_a_log_of_moon_is_read_in_the_order_of_its_lines(tmp_path: Path):
    seen, faults = read(tmp_path, MOON)
    assert faults == []
    assert [(item.channel, item.kind, item.data) for item in seen] == [
        ("/BatteryComponent/level", ObservationKind.MESSAGE, {"data": 30}),
        ("/BatteryLevelSkill/tick", ObservationKind.REQUEST_RECEIVED, {}),
        ("/BatteryLevelSkill/tick", ObservationKind.RESPONSE_SENT, {"status": 0, "is_ok": True}),
    ]
    assert {item.stamp_ns for item in seen} == {1_700_000_012_000_000_000}


def test_a_log_of_rosmonitoring_may_lack_slashes_and_hold_nan(tmp_path: Path):
    seen, faults = read(tmp_path, ROSMONITORING)
    assert faults == []
    assert [(item.channel, item.stamp_ns) for item in seen] == [
        ("/turtle1/cmd_vel", 10**9),
        ("/turtle1/teleport_absolute", 2_500_000_000),
        ("/chatter", 3 * 10**9),
        ("/scan", 4 * 10**9),
    ]
    assert seen[0].data == {"linear": {"x": 1.0}, "angular": {"z": 0.0}}
    assert seen[3].data["range"] != seen[3].data["range"]


def test_lines_that_say_nothing_are_named_and_the_others_are_read(tmp_path: Path):
    seen, faults = read(
        tmp_path,
        '{"topic": "a", "time": 1}\n'
        "\n"
        "[1]\n"
        '{"topic": "a"}\n'
        '{"topic": "a", "time": true}\n'
        '{"topic": "a", "time": -1}\n'
        '{"time": 1}\n'
        '{"service": "s", "time": 1}\n'
        '{"topic": \n'
        '{"topic": "b", "time": 2}\n'
        '{"topic": "c", "ti',
    )
    assert [item.channel for item in seen] == ["/a", "/b"]
    assert [said.split(": ", 1)[0] for said in faults] == [
        f"LOG:{n}" for n in (3, 4, 5, 6, 7, 8, 9, 11)
    ]
    assert faults[0] == "LOG:3: expected an object with `topic` or `service`, got `[1]`"
    assert faults[1] == "LOG:4: expected `time` in seconds"
    assert faults[5] == "LOG:8: a line of a service has `request` or `response`"
    assert faults[-1].startswith("LOG:11: the last line is cut off")


def test_of_many_bad_lines_the_first_are_named_and_the_rest_are_counted(tmp_path: Path):
    _, faults = read(tmp_path, '{"topic": "a", "time": 1}\n' + "x\n" * 5000)
    assert len(faults) == 21
    assert faults[-1] == "LOG: 4980 more lines cannot be read"


def test_a_line_without_end_is_not_held(tmp_path: Path):
    line = b'{"topic": "a", "time": 1, "data": "' + b"x" * (2 * MAX_LINE) + b'"}\n'
    seen, faults = read(tmp_path, line + b'{"topic": "b", "time": 1}\n')
    assert [item.channel for item in seen] == ["/b"]
    assert faults == [f"LOG:1: it has more than {MAX_LINE} bytes"]


def test_nesting_without_end_is_a_line_that_cannot_be_read(tmp_path: Path):
    seen, faults = read(tmp_path, '{"topic": "a", "time": 1, "data": ' + "[" * 200_000 + "\n")
    assert not seen
    assert len(faults) == 1


def test_numbers_of_any_length_end_no_reading(tmp_path: Path):
    long = "9" * 5000
    seen, faults = read(
        tmp_path,
        f'{{"topic": "a", "time": 1, "data": {long}}}\n'
        f'{{"topic": "b", "time": {long}, "data": 1}}\n'
        f'{{"topic": "c", "time": {long[:4000]}, "data": 1}}\n'
        f'{{"topic": "d", "time": 1e400, "data": 1}}\n'
        f'{{"topic": "e", "time": 1, "data": {long}.5}}\n'
        '{"topic": "f", "time": 1}\n',
    )
    assert [item.channel for item in seen] == ["/e", "/f"]
    assert faults == [
        "LOG:1: Integer value out of range - at `$[...]`",
        "LOG:2: Integer value out of range - at `$[...]`",
        f"LOG:3: a time of {long[:40]} s",
        "LOG:4: a time of Infinity s",
    ]


def test_a_log_cut_anywhere_gives_its_whole_lines(tmp_path: Path):
    whole, _ = read(tmp_path, MOON)
    for end in range(1, len(MOON)):
        seen, faults = read(tmp_path, MOON[:end])
        assert seen == whole[: len(seen)]
        lines = MOON[:end].count("\n") + (MOON[end - 1] == "}" and MOON[end] == "\n")
        assert len(seen) == lines
        assert bool(faults) == (MOON[end - 1] not in "\n" and MOON[end] != "\n")


def test_a_compressed_log_is_read_too(tmp_path: Path):
    seen, faults = read(tmp_path, zstd.compress(MOON.encode()))
    assert (len(seen), faults) == (3, [])


def test_what_a_log_cannot_tell_is_said(tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text(MOON)
    recording = open_recording(path)
    list(recording.entries())
    said = "\n".join(recording.limits())
    assert "a log of JSON lines has no types" in said
    assert "who served /BatteryLevelSkill/tick is not recorded" in said


@pytest.mark.parametrize(
    ("channel", "type_name", "is_one"),
    [
        ("/clock", "", True),
        ("/clock", "rosgraph_msgs/msg/Clock", True),
        ("/simulation/clock", "rosgraph_msgs/msg/Clock", True),
        ("/clock", "builtin_interfaces/msg/Time", False),
        ("/time", "", False),
    ],
)
def test_a_clock_is_known_by_its_type_or_where_there_is_none_by_its_name(
    channel: str, type_name: str, is_one: bool
) -> None:
    assert is_clock(channel, type_name) is is_one
