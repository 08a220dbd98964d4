"""The whole example, as its reader runs it."""

from __future__ import annotations

import importlib.util
import io
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
def test_the_demo_shows_in_one_screen_what_was_found_and_what_it_costs_then_a_complete_tour() -> (
    None
):
    report = demo.ROOT / demo.MADE / "report.html"
    report.unlink(missing_ok=True)
    report.parent.mkdir(parents=True, exist_ok=True)
    report.with_name("run.mcap").write_bytes(b"of a demo before")
    done = subprocess.run(
        [sys.executable, "examples/lab_tour/demo.py"],
        cwd=demo.ROOT,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    lines = done.stdout.splitlines()
    assert len(lines) <= 24
    assert lines[0] == "The paper's faults: 6 of 6 found, no false alarm"
    assert [line.split()[0] for line in lines[1:7]] == ["T1", "T2", "T3", "T4", "T5", "T6"]
    assert lines[7].startswith("What monitoring costs")
    tour = done.stdout.partition("The tour, run on Zenoh")[2]
    told = [tour.index(milestone.value) for milestone in demo.Milestone]
    assert max(told) == told[-1], "the tour starts anew after all the rest"
    assert "the tour was complete" in tour
    assert "for a browser: build/demo/report.html\n" in tour
    assert "violated" in report.read_text(encoding="utf-8")
    assert "m2c new" in tour
    assert len(done.stderr.splitlines()) == demo.STEPS, "a line a step, and no more"


@pytest.mark.parametrize("is_terminal", [False, True])
def test_progress_is_one_line_on_a_terminal_and_a_line_for_each_step_elsewhere(
    is_terminal: bool,
) -> None:
    stream = io.StringIO()
    progress = demo.Progress(stream, overwrites=is_terminal)
    progress.step("m2c check")
    progress.detail("17 models")
    progress.step("m2c run " + "x" * 500)
    progress.done()
    shown = stream.getvalue()
    if is_terminal:
        assert "\n" not in shown
        assert [len(text) < 500 for text in shown.split("\r")] == [True] * 5
        assert shown.endswith("\r\x1b[2K"), "nothing of it stays"
        assert "[1/7] m2c check: 17 models" in shown
    else:
        assert shown.splitlines() == ["[1/7] m2c check", "[2/7] m2c run " + "x" * 500]


def test_a_step_that_fails_is_shown_with_what_it_said() -> None:
    progress = demo.Progress(io.StringIO(), overwrites=False)
    with pytest.raises(demo.StepError) as caught:
        demo.run_step(progress, "m2c", "check", "no/such.xml")
    assert str(caught.value).startswith("$ m2c check no/such.xml\n")
    assert "cannot read the file" in str(caught.value)


@pytest.mark.parametrize("is_full", [False, True])
def test_what_the_tap_hears_is_shown_on_demand(is_full: bool) -> None:
    said: list[str] = []
    story = demo.Story(said.append, is_full=is_full)
    for line in TOUR:
        story.hear(line)
    assert sum("★" in line for line in said) == len(demo.Milestone)
    assert any(line.startswith("    tap  /NotifyUserComponent/alarm ") for line in said) is is_full


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
