"""Turns at which nothing can have changed are passed over, and no verdict is another one for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from m2c.simulation.program import Program
from moon.monitor.properties import PropertyWatch
from moon.monitor.subject import Monitored
from moon.offline import engine
from moon.offline.engine import check_recording
from tests.offline.live import SUBJECT, faulty_program, live_run, monitored, program
from tests.offline.test_same_verdicts import ROUGH, UNEVEN
from transports.simulated import Conditions

pytestmark = pytest.mark.slow

NEVER = 1 << 61
"""Later than all stamps."""


class Kept(Monitored, frozen=True):
    """Keeps the property watches of a check."""

    watches: list[PropertyWatch] = msgspec.field(default_factory=list)

    def property_watch(self) -> PropertyWatch:
        self.watches.append(super().property_watch())
        return self.watches[-1]


def kept() -> Kept:
    return Kept(*msgspec.structs.astuple(monitored()), watches=[])


def said(path: Path, at_every_turn: bool = False) -> list[bytes]:
    """What a check says, and when."""
    subject = kept()

    def give_it_work(_: int) -> None:
        (watch,) = subject.watches
        for channel in sorted(watch.channels):
            watch.lose(channel, NEVER, NEVER)  # nothing was lost

    progress = give_it_work if at_every_turn else None
    verdicts = check_recording(path, SUBJECT, subject, progress=progress).verdicts
    return [msgspec.json.encode(item) for item in verdicts]


@pytest.mark.parametrize(
    ("code", "conditions"),
    [(program, ROUGH), (program, UNEVEN), (lambda: faulty_program("T4"), UNEVEN)],
)
def test_a_monitor_that_does_its_work_at_every_turn_says_the_same_at_the_same_moments(
    code: Callable[[], Program],
    conditions: Conditions,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "run.mcap"
    live_run(path, code(), 11, 15.0, conditions)
    idle = said(path)
    assert idle
    monkeypatch.setattr(engine, "PROGRESS_EVERY", 1)
    assert said(path, at_every_turn=True) == idle


def test_most_turns_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live_run(path, program(), 2, 5.0, UNEVEN)
    subject = kept()
    check_recording(path, SUBJECT, subject)
    assert 0 < subject.watches[0].turns < 5.0 * 100 / 2
