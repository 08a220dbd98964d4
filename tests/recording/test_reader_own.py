"""Our own recordings are read as they were written: the same entries, in the same order."""

from __future__ import annotations

import struct
import tracemalloc
from functools import cache
from pathlib import Path

from msgspec.structs import replace

from m2c.simulation.run import SimulatedRun
from moon.recording import mcap_writing
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
from moon.recording.reader import open_recording
from moon.recording.writer import RecordingWriter, Split
from moon.verdict import Cause, Difference, Evidence, Explanation, Outcome, Verdict
from tests.replay.worlds import lab_tour
from transports.interface import Observation
from transports.simulated import SimulatedTransport, SimulatedWorld


@cache
def entries() -> tuple[Entry, ...]:
    """Some of every kind, among what is received of a tour."""
    world, received = SimulatedWorld(5), []
    SimulatedTransport(world, "tap").tap([], received.append)
    start_ns = world.now_ns
    SimulatedRun(lab_tour()[1], world).run(8.0)
    found: list[Entry] = [Began(start_ns, "moon_record_1", "simulated", True)]
    differences = (Difference("a.b[3]", "1", "2"), Difference("c", "x", "y"))
    evidence = (Evidence(4, "d"),)
    why = Explanation(("a", "b"), "c", ("idle",), evidence, ("m.scxml:1:2",), "/m", differences)
    cause = Cause.NOT_TAKEN
    verdict = Verdict("M", "M", Outcome.VIOLATED, 5, "because", why, "property", cause=cause)
    for number, seen in enumerate(map(_as_recorded, received)):
        found.append(seen)
        if number % 50 == 0:
            found.append(Pulse(seen.received_ns, list(Turn)[number // 50 % 2], number))
        if number % 200 == 0:
            found.append(NodeChange(seen.received_ns, "A", number % 400 == 0, 7, False))
            found.append(Missed(seen.received_ns, "missed 3 messages"))
            found.append(ReportedVerdict(seen.received_ns, verdict))
    found.append(Ended(received[-1].received_ns))
    return tuple(found)


def _as_recorded(seen: Observation) -> Observation:
    """Without what is the writer's to keep or not (tests of the writer look at that)."""
    return replace(seen, order=-1) if hasattr(seen, "order") else seen


def write(path: Path, split: Split | None = None) -> Path:
    writer = RecordingWriter(path, Definitions(lab_tour()[0].library), split=split)
    for entry in entries():
        writer.add(entry)
    writer.close()
    return path


def read(path: Path) -> tuple[list[Entry], list[str]]:
    recording = open_recording(path)
    assert recording.form == "moon recording"
    return list(recording.entries()), recording.faults()


def test_every_entry_is_read_as_it_was_written(tmp_path: Path):
    found, faults = read(write(tmp_path / "run.mcap"))
    assert faults == []
    assert found == list(entries())


def test_the_files_of_a_split_recording_are_read_as_one(tmp_path: Path):
    folder = write(tmp_path / "run", Split(seconds=2.0))
    assert len(list(folder.glob("*.mcap"))) > 2
    found, faults = read(folder)
    assert faults == []
    assert found == list(entries())


def test_channels_are_chosen_and_all_that_is_no_observation_is_kept(tmp_path: Path):
    recording = open_recording(write(tmp_path / "run.mcap"))
    found = list(recording.entries(lambda channel: channel == "/BatteryComponent/level"))
    assert found == [
        entry
        for entry in entries()
        if not isinstance(entry, Observation) or entry.channel == "/BatteryComponent/level"
    ]


def test_of_a_recording_that_was_cut_off_the_beginning_is_read_and_it_is_said(
    tmp_path: Path, monkeypatch
):
    monkeypatch.setattr(mcap_writing, "CHUNK_BYTES", 20_000)
    path = write(tmp_path / "run.mcap")
    data, whole = path.read_bytes(), list(entries())
    most = 0
    for end in range(200, len(data), len(data) // 25):
        path.write_bytes(data[:end])
        found, faults = read(path)
        assert found == whole[: len(found)]
        if len(found) < len(whole):
            assert any("it was cut off" in said for said in faults)
            assert any(f"{path}: byte " in said for said in faults)
        most = max(most, len(found))
    assert most > len(whole) // 2


def test_where_a_part_is_damaged_the_recorder_begins_once_more(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(mcap_writing, "CHUNK_BYTES", 20_000)
    path = write(tmp_path / "run.mcap")
    data = bytearray(path.read_bytes())
    place, chunks = 8, []
    while data[place] != 0x0F:
        opcode, length = struct.unpack_from("<BQ", data, place)
        if opcode == 6:
            chunks.append((place, length))
        place += 9 + length
    assert len(chunks) > 4
    begin, length = chunks[len(chunks) // 2]
    data[begin + 9 + length // 2] ^= 0xFF
    path.write_bytes(data)
    found, faults = read(path)
    (said,) = faults
    assert said.startswith(f"{path}: byte {begin}: a chunk")
    whole = list(entries())
    again = [number for number, entry in enumerate(found) if isinstance(entry, Began)]
    assert len(again) == 2
    middle = again[1]
    assert found[:middle] == whole[:middle]
    rest = found[middle + 1 :]
    assert rest == whole[-len(rest) :]
    assert found[middle].received_ns == rest[0].received_ns
    assert found[middle].node == "moon_record_1"


def test_a_recording_four_times_as_long_takes_no_more_memory(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(mcap_writing, "CHUNK_BYTES", 20_000)
    peaks = []
    for times in (2, 8):
        path = tmp_path / f"{times}.mcap"
        writer = RecordingWriter(path, Definitions(lab_tour()[0].library))
        for _ in range(times):
            for entry in entries():
                writer.add(entry)
        writer.close()
        recording = open_recording(path)
        tracemalloc.start()
        count = sum(1 for _ in recording.entries())
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert count == times * len(entries())
    assert peaks[1] < 1.2 * peaks[0]
