"""A recorder that stood still has everything: nobody is blamed for what it received late."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from moon.monitor.subject import Subject, read_subject
from moon.offline.engine import check_recording
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Began, Ended, Entry, NodeChange, Pulse, Turn
from moon.recording.writer import RecordingWriter
from moon.sources.on_time import LATEST_NS, USUAL_NS, received_on_time
from tests.replay.worlds import LAB_TOUR, lab_tour, tour
from transports.interface import Observation, ObservationKind

STALLS_S = ((2.0, 2.9), (4.0, 4.7), (6.5, 8.9))
"""From when to when the recorder stood still, in seconds from the beginning."""


def recorded(path: Path, stalls: tuple[tuple[float, float], ...]) -> Path:
    observations = tour(10.0).observations
    start_ns = observations[0].stamp_ns - 10**9
    entries: list[Entry] = [Began(start_ns, "r", "simulated")]
    nodes = sorted({seen.source for seen in observations})
    entries += [NodeChange(start_ns + 1000, name, True, start_ns + 500) for name in nodes]
    for seen in observations:
        since = (seen.received_ns - observations[0].stamp_ns) / 1e9
        for begin, end in stalls:
            if begin < since < end:
                ends_ns = observations[0].stamp_ns + round(end * 1e9)
                seen = replace(seen, received_ns=ends_ns)  # noqa: PLW2901
        entries.append(replace(seen, order=-1))
    entries.append(Ended(entries[-1].received_ns))
    writer = RecordingWriter(path, Definitions(lab_tour()[0].library))
    for entry in entries:
        writer.add(entry)
    writer.close()
    return path


def verdicts(path: Path) -> dict[str, str]:
    subject = Subject((LAB_TOUR,), (), (), (), (), Bounds())
    result = check_recording(path, subject, read_subject(subject))
    return {item.machine: item.verdict for item in result.machines}


def test_a_recorder_that_stood_still_says_of_a_run_what_one_says_that_did_not(tmp_path: Path):
    calm = verdicts(recorded(tmp_path / "calm.mcap", ()))
    assert "violated" not in calm.values()
    assert calm["BatteryLevelSkill"] == "conforming"
    assert verdicts(recorded(tmp_path / "stalled.mcap", STALLS_S)) == calm


def seen(stamp_ns: int, received_ns: int, source: str = "a") -> Observation:
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=received_ns,
        channel="/a",
        kind=ObservationKind.MESSAGE,
        type_name="",
        data=stamp_ns,
        source=source,
    )


BASE = 10**18


def test_what_came_late_is_put_where_it_would_have_come():
    entries = [
        seen(BASE, BASE + 1),
        seen(BASE + 10, BASE + 10**9),
        seen(BASE + 10**9 - 5, BASE + 10**9),
        seen(BASE + 2 * 10**9, BASE + 2 * 10**9 + 7),
    ]
    found = list(received_on_time(entries))
    assert [entry.received_ns - BASE for entry in found] == [1, 10 + USUAL_NS, 10**9, 2 * 10**9 + 7]
    assert found[1].data == BASE + 10


def test_what_one_source_sent_all_the_while_tells_that_the_recorder_stood_still():
    second = 10**9
    entries = [
        seen(BASE, BASE + 1),
        *(seen(BASE + tenth * second // 10, BASE + second) for tenth in range(2, 10)),
        seen(BASE + second // 2, BASE + second, "b"),
        seen(BASE + second * 3 // 5, BASE + second + USUAL_NS * 2, "b"),  # much was to be received
    ]
    moved = list(received_on_time(entries))
    assert all(entry.received_ns - entry.stamp_ns <= USUAL_NS for entry in moved)
    sparse = [entries[0], *entries[-2:]]
    assert list(received_on_time(sparse)) == sparse


@pytest.mark.parametrize("back_ns", [100_000_000, 300_000_000, 3_000_000_000])
@pytest.mark.parametrize("period_ns", [20_000_000, 250_000_000, 2_000_000_000])
@pytest.mark.parametrize("others", [False, True])
def test_a_clock_that_was_set_back_is_no_lateness(back_ns: int, period_ns: int, others: bool):
    """The messages of one host, whose clock is set back in the middle, and perhaps of another."""
    entries, middle_ns = [], BASE + 10 * period_ns
    for number in range(20):
        real_ns = BASE + number * period_ns
        stamp_ns = real_ns if real_ns < middle_ns else max(real_ns - back_ns, middle_ns)
        entries += [seen(stamp_ns, real_ns + 100_000), seen(stamp_ns + 1, real_ns + 200_000)]
        if others:
            entries.append(seen(real_ns + 300_000, real_ns + 400_000, "b"))
    assert list(received_on_time(entries)) == entries


def test_a_clock_that_differs_is_no_lateness():
    entries = [seen(BASE - 2 * LATEST_NS, BASE), seen(BASE + 10**9, BASE + 5)]
    assert list(received_on_time(entries)) == entries


def test_a_clock_that_was_set_back_does_not_mix_before_and_after():
    entries = [seen(BASE, BASE), seen(BASE + 10, BASE + 11), seen(BASE - 10**12, BASE - 10**12 + 1)]
    assert list(received_on_time(entries)) == entries


@pytest.mark.parametrize("paced", [True, False])
def test_a_monitors_recording_is_left_as_it_is(paced: bool):
    entries: list[Entry] = [
        Began(BASE, paced=paced),
        Pulse(BASE + 1, Turn.TIMER, 1),
        seen(BASE + 2, BASE + 10**9),
        seen(BASE + 10**9 - 5, BASE + 10**9),
        Pulse(BASE + 10**9 + 1, Turn.TIMER, 1),
    ]
    assert (list(received_on_time(entries)) == entries) == paced


def test_nothing_is_nothing():
    assert list(received_on_time([])) == []
