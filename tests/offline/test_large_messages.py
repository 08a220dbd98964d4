"""What a message of megabytes costs where a property reads little of it."""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from moon.monitor.reading import no_system
from moon.monitor.subject import Subject, read_subject
from moon.offline.engine import EmptyRecordingError, check_recording
from moon.offline.result import CheckResult
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Began, Ended
from moon.recording.writer import RecordingWriter
from tests.offline.logs import NS, T0, Stored, write_mcap
from tests.recording.bags import foreign
from transports.interface import Observation, ObservationKind

HEADER = b"\0\1\0\0"
POINT = "=" * 80 + "\nMSG: my_pkg/msg/Point\nfloat64 x\nfloat64 y\n"
INT8 = "int32 number\nint8[] data\nint32 after\n"
COUNT = 400_000


def _numbers(code: str) -> Callable[[int], bytes]:
    """A message of `COUNT` scalars between two whole numbers."""

    def made(number: int) -> bytes:
        head = struct.pack("<iI", number, COUNT)
        size = struct.calcsize(code)
        body = struct.pack(f"<{COUNT}{code}", *(n % 100 for n in range(COUNT)))
        filled = head + b"\0" * (-len(head) % size) + body
        return HEADER + filled + b"\0" * (-len(filled) % 4) + struct.pack("<i", -number)

    return made


def _fixed(number: int) -> bytes:
    return HEADER + struct.pack("<i", number) + b"\7" * COUNT + struct.pack("<i", -number)


def _points(number: int) -> bytes:
    points = struct.pack("<dd", 1.5, 2.5) * (COUNT // 8)
    return HEADER + struct.pack("<iI", number, COUNT // 8) + points + struct.pack("<i", -number)


def _texts(number: int) -> bytes:
    texts = (struct.pack("<I", 4) + b"abc\0") * (COUNT // 8)
    return HEADER + struct.pack("<iI", number, COUNT // 8) + texts + struct.pack("<i", -number)


KINDS = {
    "bytes": (_numbers("B"), INT8.replace("int8", "uint8")),
    "int8": (_numbers("b"), INT8),
    "bool": (_numbers("?"), INT8.replace("int8", "bool")),
    "int64": (_numbers("q"), INT8.replace("int8", "int64")),
    "float32": (_numbers("f"), INT8.replace("int8", "float32")),
    "an array": (_fixed, INT8.replace("int8[]", f"uint8[{COUNT}]")),
    "structures": (_points, INT8.replace("int8[]", "Point[]") + POINT),
    "strings": (_texts, INT8.replace("int8", "string")),
}


def _bag(folder: Path, made: Callable[[int], bytes], schema: str, count: int = 1) -> Path:
    at = [T0 + n * NS // 10 for n in range(count)]
    messages = [
        Stored("/big", at_ns, at_ns, made(n + 3), "my_pkg/msg/Big", schema)
        for n, at_ns in enumerate(at)
    ]
    return write_mcap(folder / "run.mcap", messages)


def _check(folder: Path, run: Path, properties: str, ports: str = "") -> CheckResult:
    file = folder / "properties.yaml"
    ports = ports or "{number: {topic: /big, field: number}, after: {topic: /big, field: after}}"
    file.write_text(f"ports: {ports}\nproperties:\n{properties}")
    subject = Subject((), (file,), (), (), (), Bounds())
    return check_recording(run, subject, read_subject(subject))


def _peak(run: Callable[[], object]) -> int:
    """The bytes that Python held at most while ``run`` ran."""
    tracemalloc.start()
    try:
        run()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("kind", KINDS)
def test_what_nobody_reads_of_a_message_costs_little_more_than_its_bytes(tmp_path: Path, kind: str):
    made, schema = KINDS[kind]
    run = _bag(tmp_path, made, schema)
    text = "  - {id: A, pattern: absence, of: number > 9}\n"
    _check(tmp_path, run, text)  # loads what is loaded late
    size = len(made(3))
    peak = _peak(lambda: _check(tmp_path, run, text))
    assert peak < 5 * size + 300_000, f"{peak / size:.1f} times its bytes"


def test_messages_that_are_held_until_they_are_in_order_cost_no_more(tmp_path: Path):
    made, schema = KINDS["int8"]
    run = _bag(tmp_path, made, schema, count=10)
    text = "  - {id: A, pattern: absence, of: number > 99}\n"
    _check(tmp_path, run, text)
    assert _peak(lambda: _check(tmp_path, run, text)) < 16 * len(made(3))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("ports", "of", "is_violated"),
    [
        ("", "number == 3 && after == -3", True),
        ("", "after == -4", False),
        ("{m: {topic: /big, keep: true}}", "m.number == 3", True),
        ("{m: {topic: /big, keep: true}}", "m.data.length > 40000 && m.after < 0", True),
        ("{data: {topic: /big, field: data}}", "data.length < 40000", False),
        ("{seen: {topic: /big, when: data.data.length > 40000}}", "seen", True),
        ("{seen: {topic: /big, when: data.data.length == 0}}", "seen", False),
    ],
)
def test_what_is_read_is_as_it_was_written(
    tmp_path: Path, kind: str, ports: str, of: str, is_violated: bool
):
    run = _bag(tmp_path, *KINDS[kind])
    result = _check(tmp_path, run, f'  - {{id: A, pattern: absence, of: "{of}"}}\n', ports)
    assert result.violations == is_violated, result.machines
    assert result.recording.faults == ()


def test_elements_that_are_read_are_as_they_were_written(tmp_path: Path):
    run = _bag(tmp_path, *KINDS["structures"])
    ports = "{points: {topic: /big, field: data}}"
    text = '  - {id: A, pattern: absence, of: "points[30000].x == 1.5 && points.length == 50000"}\n'
    assert _check(tmp_path, run, text, ports).violations
    run = _bag(tmp_path, *KINDS["int8"])
    ports = "{bytes: {topic: /big, field: data}}"
    assert _check(
        tmp_path, run, '  - {id: A, pattern: absence, of: "bytes[399999] == 99"}\n', ports
    ).violations


def test_evidence_shows_the_beginning_of_what_nobody_reads(tmp_path: Path):
    run = _bag(tmp_path, *KINDS["int64"])
    (violated,) = _check(tmp_path, run, "  - {id: A, pattern: absence, of: number > 1}\n").violated
    assert violated.verdict.explanation is not None
    text = " ".join(item.text for item in violated.verdict.explanation.evidence)
    assert "number: 3 in {number: 3, data: [0, 1, 2, 3, 4, 5" in text
    assert text.endswith("…")


def test_what_nobody_reads_is_looked_at_all_the_same(tmp_path: Path):
    def cut_off(number: int) -> bytes:
        return KINDS["strings"][0](number)[:-20]

    run = _bag(tmp_path, cut_off, KINDS["strings"][1])
    with pytest.raises(EmptyRecordingError, match="could not decode 1 message on /big"):
        _check(tmp_path, run, "  - {id: A, pattern: absence, of: number > 1}\n")


def _seen(kind: ObservationKind, type_name: str, data: Any) -> Observation:
    return Observation(
        stamp_ns=T0,
        received_ns=T0,
        channel="/big",
        kind=kind,
        type_name=type_name,
        data=data,
        source="node",
        client="client",
        call=1,
    )


ITEMS = [number % 100 for number in range(COUNT)]
TOPIC = _seen(
    ObservationKind.MESSAGE,
    "std_msgs/msg/Int8MultiArray",
    {"layout": {"dim": [], "data_offset": 3}, "data": ITEMS},
)
CALL = _seen(
    ObservationKind.REQUEST_RECEIVED,
    "my_pkg/srv/Keep_Request",
    {"number": 3, "data": ITEMS},
)


@pytest.mark.parametrize("form", ["of moon", "a bag"])
@pytest.mark.parametrize(
    ("seen", "port", "of"),
    [
        (TOPIC, "topic: /big, field: layout.data_offset", "port > 1"),
        (CALL, "service: /big, on: request, keep: true", "port.number > 1"),
    ],
)
def test_a_recording_of_moon_and_calls_are_read_so_too(
    tmp_path: Path, form: str, seen: Observation, port: str, of: str
):
    package = tmp_path / "my_pkg" / "srv"
    package.mkdir(parents=True)
    (package / "Keep.srv").write_text("int32 number\nint8[] data\n---\n")
    path = tmp_path / "own.mcap"
    writer = RecordingWriter(path, Definitions(no_system((tmp_path,)).library))
    for entry in (Began(T0, "recorder", "zenoh"), seen, Ended(T0 + NS)):
        writer.add(entry)
    writer.close()
    if form == "a bag":
        path = foreign(path, tmp_path / "bag")
    text = f'  - {{id: A, pattern: absence, of: "{of}"}}\n'
    assert _check(tmp_path, path, text, f"{{port: {{{port}}}}}").violations
    peak = _peak(lambda: _check(tmp_path, path, text, f"{{port: {{{port}}}}}"))
    assert peak < 8 * COUNT, f"{peak / COUNT:.1f} times its bytes"
