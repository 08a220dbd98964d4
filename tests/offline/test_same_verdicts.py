"""A recording says what the monitor said that was there: the same verdicts, byte by byte."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from m2c.json_lines import versioned_line
from moon.monitor.status import AWAY
from moon.monitor.subject import read_subject
from moon.offline.engine import check_recording
from moon.offline.result import CheckResult
from moon.recording.entries import ReportedVerdict
from moon.recording.reader import open_recording
from moon.verdict import Outcome, Verdict
from tests.offline import live as live_runs
from tests.offline.live import SUBJECT, LiveRun, faulty_program, live_run, monitored, program
from transports.simulated import Conditions, Kill, Pause, Rules

pytestmark = pytest.mark.slow

UNEVEN = Conditions(delay_s=(0.0, 0.004), tap_delay_s=(0.0, 0.006), busy_s=(0.0, 0.001))
DEAD = "BatteryLevelSkill"
ROUGH = Conditions(delay_s=(0.0, 0.004), tap_delay_s=(0.0, 0.3), tap_loss=0.01, duplication=0.02)


def lines(verdicts: Sequence[Verdict]) -> list[bytes]:
    """What ``moon monitor --log`` writes."""
    return [versioned_line(verdict) for verdict in verdicts]


def checked(path: Path) -> CheckResult:
    return check_recording(path, SUBJECT, monitored())


def assert_same(path: Path, live: Sequence[Verdict]) -> CheckResult:
    result = checked(path)
    assert lines([said.verdict for said in result.verdicts]) == lines(live)
    assert result.recording.complete, result.recording.faults
    return result


@pytest.mark.parametrize("name", ["T1", "T2", "T3", "T4", "T5", "T6"])
def test_a_fault_is_explained_by_its_recording_as_it_was_live(name: str, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live = live_run(path, faulty_program(name), 1, 25.0, UNEVEN)
    assert Outcome.VIOLATED in {verdict.outcome for verdict in live}
    result = assert_same(path, live)
    assert result.violations > 0


@pytest.mark.parametrize("seed", range(4))
def test_nominal_runs_are_as_nominal_when_they_are_checked(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live = live_run(path, program(), seed, 8.0, UNEVEN)
    assert {verdict.outcome for verdict in live} == {Outcome.CONFORMING}
    assert assert_same(path, live).violations == 0


def test_what_was_lost_late_or_doubled_is_judged_the_same(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live = live_run(path, program(), 5, 10.0, ROUGH)
    assert Outcome.INCONCLUSIVE in {verdict.outcome for verdict in live}
    result = assert_same(path, live)
    assert any(problem.startswith("missed ") for problem in result.problems)


def test_a_name_that_two_claim_for_a_while_is_judged_the_same(tmp_path: Path) -> None:
    """By ROS 2's rules a node that is killed is missed only after its lease: its next life is there before."""
    path = tmp_path / "run.mcap"
    kills = (Kill(DEAD, 3.0, 0.0),)
    conditions = Conditions(kills=kills, lease_s=2.0, rules=Rules.ROS2)
    live = live_run(path, program(), 1, 8.0, conditions)
    assert any(f"several sessions claim to be {DEAD}" in verdict.reason for verdict in live)
    assert_same(path, live)


def test_a_node_that_dies_and_a_clock_that_is_set_are_told_the_same(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    run = LiveRun(path, program(), 7, UNEVEN)
    run.run(3.0)
    run.world.crash(DEAD)
    run.run(2.0)
    run.clock_is_ahead_ns = 2_000_000_000
    run.run(1.0)
    run.clock_is_ahead_ns = 0
    run.run(2.0)
    live = run.end()
    reasons = {verdict.reason for verdict in live}
    assert any("the clock was set forward by 2.0 s" in reason for reason in reasons)
    result = assert_same(path, live)
    assert AWAY in result.machines[[item.machine for item in result.machines].index(DEAD)].states
    assert result.counts.stalls == run.watch.counts.stalls > 0


@pytest.mark.parametrize("rules", Rules)
@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_a_monitor_that_stood_still_goes_on_live_and_afterwards(
    tmp_path: Path, rules: Rules, loss: float
) -> None:
    """Where nothing is missing, it judges what has waited; else it finds all machines anew."""
    path = tmp_path / "run.mcap"
    pauses = (Pause("monitor", 2.0, 0.6),)
    live = live_run(path, program(), 7, 9.0, Conditions(rules=rules, pauses=pauses, tap_loss=loss))
    assert any("stood still" in verdict.reason for verdict in live) == (loss > 0)
    assert_same(path, live)


OWED = """\
ports:
  asked: {service: /BatteryLevelSkill/tick, on: request}
  never: {service: /BatteryLevelSkill/tick, on: response, when: data.status == 7}
properties:
  - {id: before, pattern: response, request: asked, response: never, within: 3 s}
  - {id: after, pattern: response, request: asked, response: never, within: 5 s}
"""


def test_what_a_node_that_left_owed_to_properties_is_owed_no_more_live_and_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, file = tmp_path / "run.mcap", tmp_path / "p.yaml"
    file.write_text(OWED)
    subject = msgspec.structs.replace(SUBJECT, properties=(file,))
    read = read_subject(subject)
    monkeypatch.setattr(live_runs, "monitored", lambda: read)
    run = LiveRun(path, program(), 7, UNEVEN)
    run.run(4.0)
    run.world.crash(DEAD)  # or is stopped: who listens hears the same
    run.run(4.0)
    live = run.end()
    violated = [verdict.node for verdict in live if verdict.outcome is Outcome.VIOLATED]
    assert violated == ["before"]
    result = check_recording(path, subject, read)
    assert lines([said.verdict for said in result.verdicts]) == lines(live)


@pytest.mark.parametrize("hashes", ["1", "2"])
def test_another_process_says_the_same(hashes: str, tmp_path: Path) -> None:
    path, log = tmp_path / "run.mcap", tmp_path / "log"
    live = live_run(path, program(), 6, 5.0, ROUGH)
    subprocess.run(
        [
            *(sys.executable, "-m", "moon.cli", "check", str(path), str(SUBJECT.models[0])),
            *("--properties", str(SUBJECT.properties[0]), "--log", str(log)),
        ],
        env={**os.environ, "PYTHONHASHSEED": hashes},
        check=False,
        stdout=subprocess.DEVNULL,
    )
    assert log.read_bytes().splitlines() == lines(live)


def test_the_verdicts_in_the_recording_are_those_that_were_said(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live = live_run(path, faulty_program("T3"), 1, 10.0, UNEVEN)
    stored = [
        entry.verdict
        for entry in open_recording(path).entries()
        if isinstance(entry, ReportedVerdict)
    ]
    assert stored == live
    assert checked(path).recorded


def test_another_order_or_time_would_not_be_the_same(tmp_path: Path) -> None:
    """The comparison can fail: a recording of another seed has other verdicts."""
    one, other = tmp_path / "one.mcap", tmp_path / "other.mcap"
    live = live_run(one, faulty_program("T3"), 1, 10.0, UNEVEN)
    live_run(other, faulty_program("T3"), 2, 10.0, UNEVEN)
    assert lines([said.verdict for said in checked(other).verdicts]) != lines(live)
