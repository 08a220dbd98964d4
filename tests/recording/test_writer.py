"""What is recorded is what is read: by us to the bit, by ROS 2's tools as they expect it."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from msgspec.structs import replace
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from m2c.diagnostics import DiagnosticLog
from m2c.language.datatypes import INTEGER_RANGES
from m2c.model.interfaces import InterfaceLibrary
from moon.recording.contents import Contents
from moon.recording.definitions import Definitions
from moon.recording.entries import (
    Began,
    Ended,
    Entry,
    Missed,
    NodeChange,
    Pulse,
    ReportedVerdict,
    Turn,
)
from moon.recording.format import lives_of
from moon.recording.mcap_writing import Compression, McapWriter
from moon.recording.numbers import MAX_PLACES, Numbers
from moon.recording.reader import open_recording
from moon.recording.writer import RecordingWriter, Split
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from transports.interface import Observation, ObservationKind

T0 = 1_700_000_000_000_000_000
MS = 1_000_000
TYPES = {
    "demo/msg/Level.msg": "int32 data\n",
    "demo/msg/All.msg": "bool b\nint8 i\nuint64 u\nfloat32 f\nfloat64 d\nstring s\nLevel one\n"
    "Level[] many\nint16[3] three\nfloat64[<=4] few\nstring[] words\nbool[] flags\n",
    "demo/srv/Add.srv": "int64 a\nint8 b\n---\nfloat64 sum\nint8 c\n",
    "demo/action/Go.action": "int32 poi\n---\nbool reached\n---\nfloat32 left\n",
}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> InterfaceLibrary:
    folder = tmp_path_factory.mktemp("interfaces")
    for name, text in TYPES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    log = DiagnosticLog()
    made = InterfaceLibrary.load([folder], log)
    made.message("demo/msg/All")
    assert not log.diagnostics
    return made


_NUMBER = object()


def message(
    data: Any = _NUMBER, number: int = 0, channel: str = "/level", **fields: Any
) -> Observation:
    values = {
        "stamp_ns": T0 + number * MS,
        "received_ns": T0 + number * MS + 70_000,
        "channel": channel,
        "kind": ObservationKind.MESSAGE,
        "type_name": "demo/msg/Level",
        "data": {"data": number} if data is _NUMBER else data,
        "source": "Sensor",
        "sequence": number,
        "order": number,
    }
    return Observation(**{**values, **fields})


def call(number: int = 0, **fields: Any) -> list[Observation]:
    """A call of ``/add``: all four events."""
    client, server = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
    kinds = [client, server, ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED]
    found = []
    for place, kind in enumerate(kinds):
        asks = place < 2
        found.append(
            message(
                {"a": number, "b": -1} if asks else {"sum": 0.1, "c": 7},
                number * 4 + place,
                "/add",
                kind=kind,
                type_name=f"demo/srv/Add_{'Request' if asks else 'Response'}",
                source="Client" if place in (0, 3) else "Server",
                sequence=number * 2 + place // 2,
                order=-1,
                client="Client",
                call=number,
                **fields,
            )
        )
    return found


def write(
    path: Path, entries: list[Entry], library: InterfaceLibrary, **options: Any
) -> RecordingWriter:
    writer = RecordingWriter(path, Definitions(library), **options)
    for entry in entries:
        writer.add(entry)
    writer.close()
    return writer


def read(path: Path) -> list[Entry]:
    recording = open_recording(path)
    entries = list(recording.entries())
    assert [fault for fault in recording.faults() if "cut off" not in fault] == []
    return entries


def same(one: list[Entry], other: list[Entry]) -> bool:
    """Equal, to the types and the order of fields; NaN is NaN."""
    return [repr(entry) for entry in one] == [repr(entry) for entry in other]


EVERYTHING: list[Entry] = [
    Began(T0, "monitor_1", "zenoh", paced=True, clock="here"),
    NodeChange(T0, "Sensor", True, T0 - 5, clock="ab" * 16),
    Pulse(T0, Turn.TIMER, 123_456_789_012),
    Pulse(T0, Turn.POSTED, 123_456_789_013),
    *(message(number=number) for number in range(5)),
    *call(0),
    NodeChange(T0 + 5, "Sensor", True, T0 + 4, reported=False),
    *call(1),
    Missed(T0 + 30 * MS, "missed 3 messages on /level from Sensor"),
    Missed(T0 + 30 * MS, "messages on /level may be dropped", "/level", "Level"),
    Missed(T0 + 30 * MS, "Level has its time from /clock", "", "Level"),
    ReportedVerdict(T0 + 31 * MS, Verdict("Sensor", "Sensor", Outcome.CONFORMING, T0)),
    ReportedVerdict(
        T0 + 31 * MS,
        Verdict(
            "P1",
            "P1",
            Outcome.VIOLATED,
            T0,
            "why “so”",
            Explanation(("a", "b"), "c", ("s",), (Evidence(T0, "e"),), ("f:1:2",)),
            "property",
        ),
    ),
    NodeChange(T0 + 32 * MS, "Sensor", False),
    Ended(T0 + 33 * MS),
]


@pytest.mark.parametrize("compression", list(Compression))
def test_everything_is_read_as_it_was_written(
    compression: Compression, library: InterfaceLibrary, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    writer = write(path, EVERYTHING, library, compression=compression)
    assert writer.whole == 0
    assert same(read(path), EVERYTHING)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(EVERYTHING)
        assert len(list(reader.iter_messages())) == len(EVERYTHING)
        assert reader.get_header().profile == "ros2"


def test_messages_taken_are_kept_whole_and_read_as_they_were_heard(
    library: InterfaceLibrary, tmp_path: Path
) -> None:
    entries: list[Entry] = []
    for number in range(5):
        sent = message(number=number)
        taken = message(
            None,
            number,
            kind=ObservationKind.MESSAGE_TAKEN,
            source="Judge",
            client="Sensor",
            call=number,
        )
        entries += [sent, taken]
    path = tmp_path / "run.mcap"
    writer = write(path, entries, library)
    assert (writer.whole, writer.observations) == (5, 10)
    assert same(read(path), entries)
    contents = Contents()
    for entry in entries:
        assert isinstance(entry, Observation)
        contents.note(entry)
    assert contents.count == 10
    assert contents.channels["/level"].count == 5
    assert contents.limits() == []


def _values(kind: str) -> st.SearchStrategy[Any]:
    if kind in INTEGER_RANGES:
        least, most = INTEGER_RANGES[kind]
        return st.integers(least - 1, most + 1)
    return {
        "bool": st.booleans(),
        "float32": st.floats(width=32) | st.floats() | st.integers(-3, 3),
        "float64": st.floats() | st.integers(-3, 3),
        "string": st.text(max_size=9),
    }[kind]


LEVELS = st.fixed_dictionaries({"data": _values("int32")})
ALL = st.fixed_dictionaries(
    {
        "b": _values("bool") | st.integers(0, 1),
        "i": _values("int8"),
        "u": _values("uint64"),
        "f": _values("float32"),
        "d": _values("float64"),
        "s": _values("string") | st.none(),
        "one": LEVELS,
        "many": st.lists(LEVELS, max_size=3),
        "three": st.lists(_values("int16"), min_size=2, max_size=4),
        "few": st.lists(_values("float64"), max_size=5),
        "words": st.lists(_values("string"), max_size=3),
        "flags": st.lists(st.booleans(), max_size=3),
    }
)
DATA = st.one_of(
    ALL,
    ALL.map(lambda data: dict(reversed(data.items()))),
    ALL.map(lambda data: {**data, "more": 1}),
    ALL.map(lambda data: {name: value for name, value in data.items() if name != "d"}),
    st.none(),
    st.integers(-1, 1),
    st.just({}),
)
OBSERVATIONS = st.builds(
    lambda data, fields: message(
        **{"channel": "/all", "type_name": "demo/msg/All", **fields, "data": data}
    ),
    DATA,
    st.fixed_dictionaries(
        {},
        optional={
            "stamp_ns": st.integers(-(2**63), 2**63 - 1),
            "received_ns": st.integers(-1, 2**63 - 1),
            "sequence": st.integers(-1, 2**40) | st.integers(0, 70_000),
            "order": st.integers(-1, 2**40) | st.integers(0, 70_000),
            "source": st.sampled_from(["", "Sensor", "a/ñ"]),
            "type_name": st.sampled_from(["", "demo/msg/All", "demo/msg/Nothing", "x"]),
            "channel": st.sampled_from(["/all", "/x/_service_event", ""]),
            "error": st.sampled_from(["", "timeout: 5 s"]),
        },
    ),
)


@settings(max_examples=60, deadline=None)
@given(entries=st.lists(OBSERVATIONS, min_size=1, max_size=6))
def test_whatever_is_heard_is_read_to_the_bit(
    entries: list[Entry], library: InterfaceLibrary, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("any") / "run.mcap"
    write(path, entries, library)
    assert same(read(path), entries)


def test_rosbags_reads_the_same_messages(library: InterfaceLibrary, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    exact = {
        "b": True,
        "i": -8,
        "u": 2**64 - 1,
        "f": 0.5,
        "d": math.pi,
        "s": "ü",
        "one": {"data": 1},
        "many": [{"data": 2}, {"data": 3}],
        "three": [1, -2, 3],
        "few": [0.25],
        "words": ["a", ""],
        "flags": [True, False],
    }
    feedback = {"goal_id": {"uuid": list(range(16))}, "feedback": {"left": 2.5}}
    entries = [
        Began(T0),
        message(exact, 0, "/all", type_name="demo/msg/All"),
        message(feedback, 1, "/go/_action/feedback", type_name="demo/action/Go_FeedbackMessage"),
        *call(3),
    ]
    write(path, entries, library)
    store = get_typestore(Stores.EMPTY)
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        assert reader.message_count == len(entries)
        for connection, stamp, raw in reader.messages():
            # rosbags takes every type in a ros2msg definition for one of messages or actions
            name = connection.msgtype.replace("/srv/", "/srv/msg/")
            if name not in store.types:
                types = get_types_from_msg(connection.msgdef.data, connection.msgtype)
                store.register({k: v for k, v in types.items() if k not in store.types})
            made = store.deserialize_cdr(raw, name)
            found.setdefault(connection.topic, []).append(made)
            assert stamp == next(
                entry.received_ns for entry in entries if entry.received_ns == stamp
            )
    (seen,) = found["/all"]
    assert (seen.b, seen.i, seen.u, seen.f, seen.d, seen.s) == (
        *(True, -8, 2**64 - 1, 0.5, math.pi, "ü"),
    )
    assert [item.data for item in seen.many] == [2, 3]
    assert list(seen.three) == [1, -2, 3]
    assert (list(seen.few), seen.words, list(seen.flags)) == ([0.25], ["a", ""], [True, False])
    (seen,) = found["/go/_action/feedback"]
    assert list(seen.goal_id.uuid) == list(range(16))
    assert seen.feedback.left == 2.5
    events = found["/add/_service_event"]
    assert [event.info.event_type for event in events] == [0, 1, 2, 3]
    assert {event.info.sequence_number for event in events} == {3}
    assert len({bytes(event.info.client_gid) for event in events}) == 1
    assert [len(event.request) for event in events] == [1, 1, 0, 0]
    assert (events[0].request[0].a, events[0].request[0].b) == (3, -1)
    assert (events[3].response[0].sum, events[3].response[0].c) == (0.1, 7)
    stamps = [event.info.stamp.sec * 10**9 + event.info.stamp.nanosec for event in events]
    assert stamps == [entry.stamp_ns for entry in call(3)]


def test_other_tools_are_shown_the_nearest_of_what_has_no_exact_form(
    library: InterfaceLibrary, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    inexact = message({"data": 5.0, "more": "x"})
    unfit = message({"data": "five"}, 1)
    writer = write(path, [inexact, unfit], library)
    assert writer.whole == 2
    assert same(read(path), [inexact, unfit])
    with AnyReader([path]) as reader:
        shown = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic == "/level"
        ]
    assert [item.data for item in shown] == [5]


def test_a_type_that_is_not_known_is_named_and_kept(
    library: InterfaceLibrary, tmp_path: Path
) -> None:
    entry = message({"x": [1, None, {"y": b"z"}]}, type_name="other/msg/Thing")
    writer = write(tmp_path / "run.mcap", [entry], library)
    assert same(read(tmp_path / "run.mcap"), [entry])
    (sentence,) = writer.unknown_types()
    assert "other/msg/Thing" in sentence


def test_numbers_beyond_16_bits_restarts_and_gaps_are_kept(
    library: InterfaceLibrary, tmp_path: Path
) -> None:
    numbers = [*range(65_530, 65_545), 65_600, 98_000, 200_000, 0, 1, 1, 2, 2**33, 3]
    entries = [
        message(number=place, sequence=number, order=max(0, number - 3))
        for place, number in enumerate(numbers)
    ]
    writer = write(tmp_path / "run.mcap", entries, library)
    assert same(read(tmp_path / "run.mcap"), entries)
    assert writer.whole < 8  # the first, and what jumps


def test_a_recording_tells_the_lives_of_a_node_apart(
    library: InterfaceLibrary, tmp_path: Path
) -> None:
    lives = (0, 1, 2**63 - 1)
    entries: list[Entry] = [
        replace(seen, life=life, client_life=0 if seen.client == "" else life + 1 & 2**63 - 1)
        for life in lives
        for seen in (message(number=0, sequence=0), message(number=1, sequence=1), *call(life & 7))
    ]
    writer = write(tmp_path / "run.mcap", entries, library)
    assert same(read(tmp_path / "run.mcap"), entries)
    assert writer.whole < writer.observations / 2


@pytest.mark.parametrize("text", ["", "-1", "x", "²", "9" * 5_000])
def test_a_life_that_is_no_number_is_not_known(text: str) -> None:
    assert lives_of({"moon.life": text, "moon.client_life": "7"}) == (0, 7)


def test_the_numbers_of_more_sources_than_are_kept_are_read_the_same() -> None:
    one, other = Numbers(), Numbers()
    for number in range(MAX_PLACES + 3):
        seen = message(number=number, source=f"n{number}", sequence=7, order=9)
        bits = one.pack(seen)
        assert other.unpacker(seen.source, seen.channel, True)(bits) == (7, 9)


@pytest.mark.parametrize(
    "split", [Split(seconds=10.0), Split(size=20_000)], ids=["duration", "size"]
)
def test_a_split_recording_is_a_folder_of_files_that_is_read_as_one(
    split: Split, library: InterfaceLibrary, tmp_path: Path
) -> None:
    path = tmp_path / "run"
    entries = [Began(T0), *(message(number=30 * number) for number in range(1500))]
    writer = RecordingWriter(path, Definitions(library), Compression.NONE, split)
    for number, entry in enumerate(entries):
        writer.add(entry)
        if number % 20 == 0:
            writer.flush()
    writer.close()
    files = sorted(path.glob("run_*.mcap"))
    assert len(files) > 1
    assert same(read(path), entries)
    with AnyReader([path]) as reader:
        assert reader.message_count == len(entries)
        assert reader.duration == entries[-1].received_ns - T0 + 1


def test_what_waits_for_a_slow_disk_counts_for_the_size_of_a_file(
    library: InterfaceLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = threading.Event()
    write_chunk, close = McapWriter._write_chunk, McapWriter.close

    def slow(self: McapWriter, chunk: Any) -> None:
        free.wait(60)
        write_chunk(self, chunk)

    def closing(self: McapWriter) -> None:
        free.set()
        close(self)

    monkeypatch.setattr(McapWriter, "_write_chunk", slow)
    monkeypatch.setattr(McapWriter, "close", closing)
    path = tmp_path / "run"
    writer = RecordingWriter(path, Definitions(library), Compression.NONE, Split(size=20_000))
    for number in range(1500):
        writer.add(message(number=number))
        if number % 20 == 0:
            writer.flush()
    assert len(list(path.glob("run_*.mcap"))) > 1
    writer.close()
    assert all(file.stat().st_size < 60_000 for file in path.glob("run_*.mcap"))


def test_a_recording_is_not_written_over(library: InterfaceLibrary, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("precious")
    with pytest.raises(FileExistsError):
        RecordingWriter(path, Definitions(library))
    assert path.read_text() == "precious"


RECORDER = """
    import sys, time
    from pathlib import Path
    from moon.recording.definitions import Definitions
    from moon.recording.writer import RecordingWriter
    from tests.recording.test_writer import message

    writer = RecordingWriter(Path(sys.argv[1]), Definitions(None))
    number, flushed = 0, time.monotonic()
    while True:
        writer.add(message(number=number, received_ns=time.time_ns()))
        number += 1
        if time.monotonic() - flushed > 0.5:
            writer.flush()
            flushed = time.monotonic()
            print(number, flush=True)
"""


def test_after_sigkill_all_but_the_last_second_is_there(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(RECORDER), str(path)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    ) as process:
        assert process.stdout is not None
        flushed = [int(process.stdout.readline()) for _ in range(3)]
        os.kill(process.pid, signal.SIGKILL)
    recording = open_recording(path)
    entries = [entry for entry in recording.entries() if isinstance(entry, Observation)]
    assert [entry.sequence for entry in entries] == list(range(len(entries)))
    # what was handed over at the last but one look, half a second before, is written by the last
    assert len(entries) >= flushed[-2]
    assert any("cut off" in fault or "ends" in fault for fault in recording.faults())


def test_a_disk_that_fills_up_is_an_error_and_not_silence(
    library: InterfaceLibrary, tmp_path: Path
) -> None:
    writer = RecordingWriter(tmp_path / "run.mcap", Definitions(library), Compression.NONE)
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, writer._file._file.fileno())
    os.close(full)
    writer.add(message())
    with pytest.raises(OSError, match="No space left"):
        writer.close()
