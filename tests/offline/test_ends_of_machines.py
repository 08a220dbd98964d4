"""What a machine does last before a recording ends is judged, whatever recorded it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace
from rosbags.rosbag2 import StoragePlugin

from moon.monitor.subject import Subject, read_subject
from moon.offline.engine import check_recording
from moon.offline.result import CheckResult
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Began, Ended, Entry, NodeChange
from moon.recording.writer import RecordingWriter
from moon.tap.selection import matches
from tests.recording import bags
from tests.replay.worlds import LAB_TOUR, lab_tour, tour
from transports.interface import Observation, ObservationKind

pytestmark = pytest.mark.slow

SKILL, TICK = "BatteryLevelSkill", "/BatteryLevelSkill/tick"
S = 10**9


@functools.cache
def nominal() -> tuple[Observation, ...]:
    """Ten seconds of the lab tour."""
    return tuple(tour(10.0).observations)


def until_an_answer(is_numbered: bool, is_right: bool) -> list[Observation]:
    """The tour until its skill answers."""
    seen = [item if is_numbered else replace(item, order=-1) for item in nominal()]
    place = next(
        number
        for number, item in enumerate(seen)
        if (item.channel, item.kind) == (TICK, ObservationKind.RESPONSE_SENT)
        and item.stamp_ns > seen[0].stamp_ns + 7 * S
    )
    last = seen[place]
    if not is_right:
        last = replace(last, data={"status": 1, "is_ok": True})
    return [*(item for item in seen[:place] if item.stamp_ns < last.stamp_ns), last]


def ours(
    folder: Path, seen: Sequence[Observation], ends: bool = True, globs: tuple[str, ...] = ()
) -> Path:
    path = folder / "run.mcap"
    writer = RecordingWriter(path, Definitions(lab_tour()[0].library))
    start_ns = seen[0].stamp_ns - S
    entries: list[Entry] = [Began(start_ns, "r", "simulated", globs=globs)]
    nodes = sorted({item.source for item in seen})
    entries += [NodeChange(start_ns + 1000, name, True, start_ns + 500) for name in nodes]
    entries += seen
    if ends:
        entries.append(Ended(seen[-1].received_ns))
    for entry in entries:
        writer.add(entry)
    writer.close()
    return path


def killed(folder: Path, seen: Sequence[Observation]) -> Path:
    return ours(folder, seen, ends=False)


def foreign_mcap(folder: Path, seen: Sequence[Observation]) -> Path:
    return bags.foreign(ours(folder, seen), folder / "bag")


def sqlite(folder: Path, seen: Sequence[Observation]) -> Path:
    return bags.foreign(ours(folder, seen), folder / "bag", StoragePlugin.SQLITE3)


Form = Callable[[Path, Sequence[Observation]], Path]
FORMS: tuple[Form, ...] = (ours, killed, foreign_mcap, sqlite)


def checked(path: Path) -> CheckResult:
    subject = Subject((LAB_TOUR,), (), (), (), (), Bounds())
    return check_recording(path, subject, read_subject(subject))


def violated(result: CheckResult) -> set[str]:
    return {item.machine for item in result.machines if item.violations}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("is_numbered", [True, False])
def test_a_wrong_answer_that_comes_last_is_found(tmp_path: Path, form: Form, is_numbered: bool):
    result = checked(form(tmp_path, until_an_answer(is_numbered, False)))
    assert violated(result) == {SKILL}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("is_numbered", [True, False])
def test_a_right_answer_that_comes_last_is_none(tmp_path: Path, form: Form, is_numbered: bool):
    result = checked(form(tmp_path, until_an_answer(is_numbered, True)))
    assert violated(result) == set()
    assert SKILL in {item.machine for item in result.machines if item.verdict == "conforming"}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("cut_s", [7.1, 7.9, 8.05, 8.3, 9.6])
@pytest.mark.parametrize("is_numbered", [True, False])
def test_wherever_a_good_run_is_cut_off_nobody_is_accused(
    tmp_path: Path, form: Form, cut_s: float, is_numbered: bool
):
    seen = [item if is_numbered else replace(item, order=-1) for item in nominal()]
    cut_ns = seen[0].stamp_ns + round(cut_s * S)
    assert violated(checked(form(tmp_path, [i for i in seen if i.received_ns <= cut_ns]))) == set()


@pytest.mark.parametrize("is_numbered", [True, False])
def test_of_whom_moon_was_not_to_record_all_nothing_is_concluded(tmp_path: Path, is_numbered: bool):
    globs = (TICK, "/BatteryComponent/**")
    seen = [
        item
        for item in until_an_answer(is_numbered, False)
        if any(matches(item.channel, glob) for glob in globs)
    ]
    result = checked(ours(tmp_path, seen, globs=globs))
    assert violated(result) == {SKILL}
    assert "WaitSkill" not in {item.machine for item in result.machines}
    limits = [limit for limit in result.recording.limits if limit.startswith("WaitSkill ")]
    assert limits == ["WaitSkill is not judged: /WaitSkill/tick was not recorded"]
    assert "/WaitSkill/tick" in result.recording.unrecorded
