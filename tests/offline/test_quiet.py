"""Silences of a recording without turns: time passes through them step by step, but not for ever."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from moon.feed.clock import NS
from moon.recording.entries import Began, Entry
from moon.sources.played import QUIET_AT_FIRST_NS, QUIET_PER_ENTRY_NS, Player
from tests.offline.test_same_verdicts import checked
from transports.interface import Observation, ObservationKind

STEP_S = 1.0
T0 = 1_700_000_000 * NS


def message(stamp_ns: int) -> Observation:
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel="/level",
        kind=ObservationKind.MESSAGE,
        type_name="",
        data=None,
        source="",
    )


class Turns:
    """A watch that does nothing but have the time looked at every second."""

    def __init__(self, first: Entry) -> None:
        self.player = Player(0)
        self.instants: list[int] = []
        self.player.start(first, self._plan)

    def _plan(self) -> None:
        self.player.after(STEP_S, self._turn)

    def _turn(self) -> None:
        self.instants.append(self.player.now_ns())
        self._plan()


def test_an_hour_of_silence_is_passed_through_step_by_step() -> None:
    turns = Turns(Began(T0))
    turns.player.play(message(T0 + QUIET_AT_FIRST_NS))
    assert turns.instants == [T0 + n * NS for n in range(1, 3601)]
    assert turns.player.limits() == []


@pytest.mark.parametrize("gap_s", [599, 3599, 90_000, 10**9])
def test_what_stamps_far_apart_cost_is_bounded_by_how_many_there_are(gap_s: int) -> None:
    turns, count = Turns(Began(T0)), 200
    for number in range(count):
        turns.player.play(message(T0 + (number % 2) * gap_s * NS))
    most_ns = QUIET_AT_FIRST_NS + count * QUIET_PER_ENTRY_NS
    assert len(turns.instants) <= most_ns // NS + 2 * count
    (said,) = turns.player.limits()
    assert said.startswith("nothing was recorded for too long, ")
    assert said.endswith(" times: taken for a clock that was set, and not for silence")


def test_a_long_recording_with_little_in_it_is_passed_through_to_its_end() -> None:
    turns = Turns(Began(T0))
    for number in range(1, 20_000):  # two days and more
        turns.player.play(message(T0 + number * QUIET_PER_ENTRY_NS))
    assert len(turns.instants) == 19_999 * QUIET_PER_ENTRY_NS // NS
    assert turns.player.limits() == []


def test_a_log_whose_stamps_jump_by_days_is_checked_and_says_what_they_were_taken_for(
    tmp_path: Path,
) -> None:
    path = tmp_path / "log.txt"
    lines = [{"topic": "/level", "time": 1000 + n * 86_000, "data": n} for n in range(20)]
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    result = checked(path)
    assert result.violations == 0
    assert any("nothing was recorded for too long, 19 times" in s for s in result.recording.limits)
