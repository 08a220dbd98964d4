"""Recordings of a level, of a switch and of calls, written by hand in every form that is read."""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
from click.testing import CliRunner
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin

from m2c.model.interfaces import InterfaceLibrary
from moon.cli import main
from moon.recording.definitions import Definitions
from moon.recording.entries import Began, Ended, Entry
from moon.recording.writer import RecordingWriter
from tests.recording import bags
from transports.interface import Observation, ObservationKind

NS = 10**9
T0 = 1_700_000_000 * NS
LEVEL = "/level"


class Line(msgspec.Struct, frozen=True):
    """A message: when it was recorded (s after ``T0``), where, with which number, and when it was published."""

    at_s: float
    data: int
    topic: str = LEVEL
    published_s: float | None = None

    @property
    def log_ns(self) -> int:
        return T0 + round(self.at_s * NS)

    @property
    def publish_ns(self) -> int:
        return T0 + round((self.at_s if self.published_s is None else self.published_s) * NS)


def cdr(data: int) -> bytes:
    """A std_msgs/msg/Int32."""
    return b"\0\1\0\0" + struct.pack("<i", data)


class Stored(msgspec.Struct, frozen=True):
    """One message of a bag as it is in the file."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes
    type_name: str = "std_msgs/msg/Int32"
    schema: str = "int32 data\n"
    encoding: str = "ros2msg"


def stored(lines: Sequence[Line]) -> list[Stored]:
    return [Stored(line.topic, line.log_ns, line.publish_ns, cdr(line.data)) for line in lines]


def write_mcap(path: Path, messages: Sequence[Stored]) -> Path:
    """An MCAP file with ``messages`` in that order, as another tool writes it."""
    with path.open("wb") as opened:
        writer = Writer(opened)
        writer.start(profile="ros2", library="another")
        channels: dict[str, int] = {}
        for number, item in enumerate(messages):
            if item.topic not in channels:
                schema = writer.register_schema(item.type_name, item.encoding, item.schema.encode())
                channels[item.topic] = writer.register_channel(item.topic, "cdr", schema)
            writer.add_message(
                channels[item.topic], item.log_ns, item.data, item.publish_ns, number
            )
        writer.finish()
    return path


def foreign_mcap(folder: Path, lines: Sequence[Line]) -> Path:
    return write_mcap(folder / "foreign.mcap", stored(lines))


def sqlite_bag(folder: Path, lines: Sequence[Line]) -> Path:
    messages = [
        bags.Stored(
            line.topic,
            "std_msgs/msg/Int32",
            line.log_ns,
            bags.new("std_msgs/msg/Int32", line.data),
            bags.INT32,
        )
        for line in lines
    ]
    return bags.write(folder / "bag", messages, StoragePlugin.SQLITE3)


def json_lines(folder: Path, lines: Sequence[Line]) -> Path:
    path = folder / "log.jsonl"
    path.write_text(
        "".join(
            json.dumps({"topic": line.topic, "time": line.log_ns / NS, "data": line.data}) + "\n"
            for line in lines
        )
    )
    return path


def observed(line: Line) -> Observation:
    return Observation(
        stamp_ns=line.publish_ns,
        received_ns=line.log_ns,
        channel=line.topic,
        kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Int32",
        data={"data": line.data},
        source="node",
    )


def write_ours(
    path: Path, lines: Sequence[Line], ends: bool = True, globs: tuple[str, ...] = ()
) -> Path:
    """What ``moon record`` writes of these; with ``ends`` false, one that was killed."""
    writer = RecordingWriter(path, Definitions(InterfaceLibrary()))
    began: list[Entry] = [Began(lines[0].log_ns, "recorder", "zenoh", globs=globs)]
    for entry in [*began, *map(observed, lines)]:
        writer.add(entry)
    if ends:
        writer.add(Ended(lines[-1].log_ns))
    writer.close()
    return path


def ours(folder: Path, lines: Sequence[Line]) -> Path:
    return write_ours(folder / "ours.mcap", lines)


def killed(folder: Path, lines: Sequence[Line]) -> Path:
    return write_ours(folder / "killed.mcap", lines, ends=False)


Form = Callable[[Path, Sequence[Line]], Path]
FORMS: tuple[Form, ...] = (foreign_mcap, sqlite_bag, json_lines, ours, killed)
FOREIGN: tuple[Form, ...] = (foreign_mcap, sqlite_bag, json_lines)


PORTS = """\
ports:
  level: {topic: /level, field: data}
  lv: {topic: /level}
  go: {topic: /go}
  alarm: {topic: /alarm}
properties:
"""


class Said(msgspec.Struct, frozen=True):
    """What ``moon check`` says: its exit code, all its output, and the verdict of each property."""

    code: int
    out: str
    verdicts: dict[str, str]
    limits: list[str]
    time: str


def check(folder: Path, run: Path, properties: str, *options: str) -> Said:
    """``moon check`` of ``run`` against ``properties``, lines of a property file."""
    file = folder / "properties.yaml"
    text = properties if properties.startswith("ports:") else PORTS + properties
    file.write_text(text)
    arguments = ["check", str(run), "--properties", str(file), *options]
    result = CliRunner().invoke(main, arguments)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    as_json = CliRunner().invoke(main, [*arguments, "--json"])
    events = [json.loads(line) for line in as_json.stdout.splitlines() if line.startswith("{")]
    facts = events[0] if events else {}
    machines = events[-1]["machines"] if events else []
    return Said(
        result.exit_code,
        result.output,
        {item["machine"]: item["verdict"] for item in machines},
        list(facts.get("limits", [])),
        facts.get("time", ""),
    )


def rows(bag: Path) -> sqlite3.Connection:
    """The SQLite file of ``bag``, to be changed."""
    (file,) = bag.glob("*.db3")
    return sqlite3.connect(file)
