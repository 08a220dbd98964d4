"""Recordings whose times cannot be right: that is said, and no verdict rests on them."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from msgspec.structs import replace

from tests.offline.logs import (
    FOREIGN,
    NS,
    T0,
    Form,
    Line,
    check,
    foreign_mcap,
    json_lines,
    killed,
    ours,
    rows,
    sqlite_bag,
    stored,
    write_mcap,
)

PROPERTIES = """\
  - {id: A, pattern: absence, of: level >= 9}
  - {id: R, pattern: recurrence, of: lv, within: 1500 ms}
"""
ANEW = "its clock was set back once: what comes after that is judged anew"


@pytest.mark.parametrize("form", FOREIGN)
@pytest.mark.parametrize("by_s", [1.5, 5, 100, 3600])
def test_after_a_clock_that_was_set_back_nothing_is_dropped(
    tmp_path: Path, form: Form, by_s: float
):
    lines = [Line(4000 + n, 1) for n in range(5)]
    back = [Line(4005 - by_s + n, 9 if n == 0 else 1) for n in range(5)]
    said = check(tmp_path, form(tmp_path, lines + back), PROPERTIES)
    assert (said.code, said.verdicts) == (1, {"A": "violated", "R": "conforming"}), said.out
    assert ANEW in said.limits


@pytest.mark.parametrize("form", FOREIGN)
@pytest.mark.parametrize("last_s", [0, 0.001, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("by_s", [0.3, 2, 3600])
def test_what_happened_just_before_a_clock_was_set_back_is_judged(
    tmp_path: Path, form: Form, last_s: float, by_s: float
):
    first = [Line(4000 + n, 1) for n in range(5)] + [Line(4004.5, 9), Line(4004.5 + last_s, 1)]
    lines = first[: 7 if last_s else 6]
    back = [Line(lines[-1].at_s - by_s + n, 1) for n in range(3)]
    said = check(tmp_path, form(tmp_path, lines + back), PROPERTIES)
    assert (said.code, said.verdicts) == (1, {"A": "violated", "R": "conforming"}), said.out


def test_a_recording_whose_clock_was_set_back_is_as_long_as_both_its_parts(tmp_path: Path):
    lines = [Line(100, 1), Line(101, 1), Line(40, 1), Line(42, 1)]
    said = check(tmp_path, json_lines(tmp_path, lines), PROPERTIES)
    assert ", 3.0 s" in said.out.splitlines()[0]


@pytest.mark.parametrize("form", FOREIGN)
def test_no_time_passes_after_a_clock_was_set_back_but_what_was_recorded(
    tmp_path: Path, form: Form
):
    lines = [Line(100 + n, 1) for n in range(5)] + [Line(50, 1), Line(50.1, 1)]
    said = check(tmp_path, form(tmp_path, lines), PROPERTIES)
    assert (said.code, said.verdicts) == (0, {"A": "conforming", "R": "conforming"}), said.out


def two_runs(lines: list[Line], other: list[Line]) -> list[Line]:
    """Of one and the other in turns."""
    return [line for pair in zip(lines, other, strict=True) for line in pair]


ORDERLY = [Line(n, 1) for n in range(12)]
MIXED = {
    "shuffled": random.Random(1).sample(ORDERLY, len(ORDERLY)),
    "reversed": ORDERLY[::-1],
    "two runs in turns": two_runs(ORDERLY, [Line(900 + n, 1) for n in range(12)]),
    "three runs behind one another": [*ORDERLY, *ORDERLY, *ORDERLY],
}


@pytest.mark.parametrize("form", FOREIGN)
@pytest.mark.parametrize("name", MIXED)
def test_entries_in_no_order_of_time_are_not_judged(tmp_path: Path, form: Form, name: str):
    said = check(tmp_path, form(tmp_path, MIXED[name]), PROPERTIES)
    assert said.code == 2, said.out
    (line,) = said.out.splitlines()
    assert "its entries are in no order of time" in line


def test_topics_one_behind_the_other_are_not_judged(tmp_path: Path):
    lines = [*(Line(n, 1) for n in range(9)), *(Line(n, 1, "/go") for n in range(9))]
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PROPERTIES)
    assert said.code == 2
    assert "its entries are in no order of time" in said.out


@pytest.mark.parametrize("first", [foreign_mcap, ours, killed])
@pytest.mark.parametrize("second", [foreign_mcap, ours])
def test_two_files_in_one_are_not_judged(tmp_path: Path, first: Form, second: Form):
    (tmp_path / "one").mkdir()
    (tmp_path / "other").mkdir()
    one = first(tmp_path / "one", [Line(0, 1), Line(1, 1)])
    other = second(tmp_path / "other", [Line(60, 1), Line(61, 9)])
    both = tmp_path / "both.mcap"
    both.write_bytes(one.read_bytes() + other.read_bytes())
    said = check(tmp_path, both, PROPERTIES)
    assert said.code == 2, said.out
    assert "it holds two runs" in said.out


def test_a_recording_of_moon_with_two_ends_is_not_judged(tmp_path: Path):
    from m2c.model.interfaces import InterfaceLibrary
    from moon.recording.definitions import Definitions
    from moon.recording.entries import Began, Ended
    from moon.recording.writer import RecordingWriter
    from tests.offline.logs import observed

    path = tmp_path / "merged.mcap"
    writer = RecordingWriter(path, Definitions(InterfaceLibrary()))
    for start_s in (0, 60):
        line = Line(start_s, 1)
        for entry in (Began(line.log_ns, "r", "zenoh"), observed(line), Ended(line.log_ns + NS)):
            writer.add(entry)
    writer.close()
    said = check(tmp_path, path, PROPERTIES)
    assert said.code == 2, said.out
    assert "it holds two runs" in said.out


END = 2**63 - 1


def nonsense(folder: Path, form: Form, log_ns: int, publish_ns: int | None = None) -> Path:
    """A recording in which all have these stamps; in a bag ``publish_ns``, too."""
    lines = [Line(n, 9) for n in range(5)]
    if form is foreign_mcap:
        return write_mcap(
            folder / "run.mcap",
            [
                replace(
                    item,
                    log_ns=log_ns % 2**64,
                    publish_ns=(log_ns if publish_ns is None else publish_ns) % 2**64,
                )
                for item in stored(lines)
            ],
        )
    if form is sqlite_bag:
        path = sqlite_bag(folder, lines)
        with rows(path) as connection:
            connection.execute("UPDATE messages SET timestamp = ?", (log_ns,))
        return path
    return json_lines(folder, [Line((log_ns - T0) / NS, 9) for _ in lines])


@pytest.mark.parametrize("form", FOREIGN)
@pytest.mark.parametrize("stamp_ns", [0, 7 * NS, T0, END, END - 10**9, -5])
def test_stamps_that_are_nonsense_are_said_to_be_and_nothing_is_judged(
    tmp_path: Path, form: Form, stamp_ns: int
):
    said = check(tmp_path, nonsense(tmp_path, form, stamp_ns), PROPERTIES)
    assert said.code == 2, said.out
    if not (form is json_lines and (stamp_ns < 0 or stamp_ns > END - 2 * 10**9)):
        (line,) = said.out.splitlines()
        assert " are nonsense: " in line


@pytest.mark.parametrize("stamp_ns", [0, END])
def test_nonsense_on_one_side_leaves_the_other(tmp_path: Path, stamp_ns: int):
    items = stored([Line(n, 9 if n == 3 else 1) for n in range(8)])
    for name, fields in (("log", "log_ns"), ("publish", "publish_ns")):
        if (name, stamp_ns) == ("publish", 0):
            continue  # it is not set
        run = write_mcap(
            tmp_path / f"{name}.mcap", [replace(item, **{fields: stamp_ns}) for item in items]
        )
        said = check(tmp_path, run, PROPERTIES)
        assert said.verdicts == {"A": "violated", "R": "conforming"}, (name, said.out)
        other = "publish_time" if name == "log" else "log_time"
        assert said.time.startswith(other), said.time


def test_one_stamp_that_is_nonsense_is_as_a_message_that_was_not_received(tmp_path: Path):
    items = stored([Line(n, 9 if n == 3 else 1) for n in range(8)])
    items[3] = replace(items[3], log_ns=END, publish_ns=END)
    said = check(tmp_path, write_mcap(tmp_path / "run.mcap", items), PROPERTIES)
    assert said.code == 0, said.out
    assert said.verdicts["R"] in ("conforming", "inconclusive")
    assert any("1 entry with a time that makes no sense" in limit for limit in said.limits)
