"""The whole example, as its reader runs it."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog, load

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"


def demo_module() -> ModuleType:
    """The demo's script, imported."""
    spec = importlib.util.spec_from_file_location("lab_tour_demo", EXAMPLE / "demo.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


demo = demo_module()


def test_the_example_has_no_findings() -> None:
    log = DiagnosticLog()
    system = load([EXAMPLE / "system.xml"], log)
    assert system is not None
    check_system(system, log)
    assert log.diagnostics == []
    assert len(system.nodes) == 17


@pytest.mark.slow
@pytest.mark.zenoh
def test_the_demo_shows_a_complete_tour() -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLE / "demo.py")],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    summary = done.stdout.partition("Summary")[2]
    told = [summary.index(milestone.value) for milestone in demo.Milestone]
    assert max(told) == told[-1], "the tour starts anew after all the rest"
    assert "the tour was complete" in summary


def heard(channel: str, second: int, **data: Any) -> dict[str, Any]:
    """A line of the tap."""
    return {"channel": channel, "kind": "request", "stamp_ns": second * 10**9, "data": data}


def ticked(second: int, leaf: str) -> dict[str, Any]:
    """The tree's tick in which ``leaf`` acted."""
    leaves = [{"name": "BatteryLevel", "status": "FAILURE"}, {"name": leaf, "status": "RUNNING"}]
    return heard("/policy/ticks", second, leaves=leaves)


TOUR = [
    ticked(100, "GoToPoi"),
    ticked(106, "Wait"),
    heard("/BlackboardComponent/SetInt", 111, key=1, value=1),
    heard("/NotifyUserComponent/alarm", 117, data=True),
    heard("/BlackboardComponent/SetInt", 120, key=2, value=1),
    ticked(121, "Reset"),
]


def test_a_tour_with_every_milestone_before_its_reset_is_complete() -> None:
    story = demo.Story()
    for line in TOUR:
        story.hear(line)
    assert story.missing == []
    assert story.reached[demo.Milestone.RESET] == 21


@pytest.mark.parametrize("late", TOUR[1:-1])
def test_what_comes_only_after_the_reset_is_missing_from_the_tour(late: dict[str, Any]) -> None:
    story = demo.Story()
    for line in [line for line in TOUR if line is not late]:
        story.hear(line)
    story.hear({**late, "stamp_ns": 130 * 10**9})
    assert len(story.missing) == 1


def test_a_tour_that_never_starts_anew_is_not_complete() -> None:
    story = demo.Story()
    for line in TOUR[:-1]:
        story.hear(line)
    assert demo.Milestone.RESET.value in story.missing
