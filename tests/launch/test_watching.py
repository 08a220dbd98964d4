"""What watches a run from its beginning: started before it, or by it."""

from __future__ import annotations

import contextlib
import signal
from pathlib import Path

import pytest

from tests.launch.system import LEVEL, M2C, Run, System
from tests.monitor.processes import Process, free_endpoint

pytestmark = [pytest.mark.zenoh]

ALWAYS = """
ports:
  status: {service: /LevelSkill/tick, on: response, field: status, initial: 0}
properties:
  - {id: Fine, formula: "historically {status == 0}"}
"""
"""What can be said only by who has heard the first act: before it, anything may have been."""


@pytest.fixture
def properties(tmp_path: Path) -> Path:
    path = tmp_path / "always.yaml"
    path.write_text(ALWAYS)
    return path


def of_moon(run: Run) -> list[str]:
    return [line.partition("moon | ")[2] for line in run.lines if "moon | " in line]


def test_a_monitor_that_was_there_first_hears_everything_from_its_first_act(
    system: System, properties: Path
) -> None:
    endpoint = free_endpoint()
    monitor = Process(
        *("moon", "monitor", system.path, "--properties", properties, "--endpoint", endpoint)
    )
    with contextlib.closing(monitor):
        monitor.until(lambda: "not linked to any node yet" in monitor.said)
        run = Run(system.path, "--ticks", 5, endpoint=endpoint)
        assert run.end() == 0, run.output
        assert monitor.end(signal.SIGINT) == 0, monitor.said
    assert "inconclusive" not in monitor.said, monitor.said
    assert "middle" not in monitor.said
    (fine,) = [line for line in monitor.out if line.startswith("Fine ")]
    assert "conforming" in fine


def test_a_run_has_itself_monitored_and_recorded_from_its_first_act(
    system: System, properties: Path, tmp_path: Path
) -> None:
    recording = tmp_path / "run.mcap"
    options = f"--properties '{properties}'"
    run = Run(system.path, "--ticks", 5, f"--monitor={options}", "--record", recording)
    assert run.end() == 0, run.output
    said = of_moon(run)
    assert not [line for line in said if "inconclusive" in line or "middle" in line], run.output
    assert any(line.startswith("0 violations") for line in said)
    assert any(line.startswith("Fine ") and "conforming" in line for line in said)
    check = Process("moon", "check", recording, system.path)
    with contextlib.closing(check):
        assert check.end() == 0, check.said
    assert "0 violations" in check.said


def test_a_run_is_recorded_with_its_types_without_being_monitored(
    system: System, tmp_path: Path
) -> None:
    recording = tmp_path / "run.mcap"
    run = Run(system.path, "--ticks", 5, "--record", recording)
    assert run.end() == 0, run.output
    assert recording.stat().st_size
    assert not [line for line in of_moon(run) if "unknown" in line or "note" in line], run.output
    check = Process("moon", "check", recording, system.path)
    with contextlib.closing(check):
        assert check.end() == 0, check.said
    assert "inconclusive" not in check.said, check.said


def test_a_violation_is_the_exit_code_of_the_run(system: System) -> None:
    faulty = system.folder / "faulty.scxml"
    faulty.write_text(LEVEL.replace("{status}", "1"))
    run = Run(system.path, "--replace", f"LevelSkill={faulty}", "--ticks", 5, "--monitor")
    assert run.end() == 1, run.output
    assert run.lines[-1] == "stopped after 5 ticks; all nodes have ended; moon found violations"
    stopped = Run(
        *(system.path, "--replace", f"LevelSkill={faulty}", "--monitor=--exit-on-violation")
    )
    assert stopped.end() == 1, stopped.output
    assert stopped.lines[-1] == "moon found a violation; everything was stopped"


def test_what_goes_wrong_in_the_last_instant_is_judged(system: System) -> None:
    """A verdict comes when nothing older can come any more; the run is over by then."""
    faulty = system.folder / "faulty.scxml"
    faulty.write_text(LEVEL.replace("{status}", "1"))
    run = Run(system.path, "--replace", f"LevelSkill={faulty}", "--ticks", 1, "--monitor")
    assert run.end() == 1, run.output
    assert any("LevelSkill  VIOLATED" in line for line in of_moon(run)), run.output


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--monitor=--propertis x.yaml"], "No such option '--propertis'"),
        (["--monitor='"], "error: --monitor=': No closing quotation"),
        (["--record", M2C], "is there already; a recording is not written over"),
    ],
)
def test_what_cannot_watch_is_said_before_anything_runs(
    system: System, options: list[object], said: str
) -> None:
    run = Run(system.path, *options)
    assert run.end() == 2, run.output
    assert said in run.output
    assert "up" not in run.output.split()
    assert "Traceback" not in run.output


def test_a_generated_folder_has_no_models_to_be_monitored_by(system: System) -> None:
    run = Run(system.generate(), "--monitor")
    assert run.end() == 2
    assert run.lines == [
        "error: --monitor: monitoring needs the models: give the system file as SYSTEM"
    ]


def test_the_options_of_the_monitor_may_be_forgotten(system: System) -> None:
    run = Run("--monitor", system.path, "--ticks", 2)
    assert run.end() == 0, run.output
    assert any(line.startswith("0 violations") for line in of_moon(run))
