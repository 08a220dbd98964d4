"""Turns at which nothing can have changed are passed over, and no verdict is another one for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from m2c.launch.in_process import Program
from moon.monitor import properties
from moon.monitor.properties import PropertyWatch
from moon.monitor.subject import Monitored
from moon.offline.engine import check_recording
from tests.offline.live import SUBJECT, faulty_program, live_run, monitored, program
from tests.offline.test_same_verdicts import ROUGH, UNEVEN
from transports.simulated import Conditions

ALWAYS = 1 << 61
"""Longer ago than all stamps: there is always something to do."""


def said(path: Path) -> list[bytes]:
    """What a check says, and when."""
    return [
        msgspec.json.encode(item) for item in check_recording(path, SUBJECT, monitored()).verdicts
    ]


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
    monkeypatch.setattr(properties, "LEAST_NS", -ALWAYS)
    assert said(path) == idle


def test_most_turns_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live_run(path, program(), 2, 5.0, UNEVEN)
    watches: list[PropertyWatch] = []

    class Kept(Monitored, frozen=True):
        def property_watch(self) -> PropertyWatch:
            watches.append(super().property_watch())
            return watches[-1]

    check_recording(path, SUBJECT, Kept(*msgspec.structs.astuple(monitored())))
    assert 0 < watches[0].turns < 5.0 * 100 / 2
