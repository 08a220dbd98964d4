"""Recording and monitoring at once, and recording alone: the lab tour on real Zenoh over loopback."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import pytest

from moon.recording.entries import Began, Ended, NodeChange
from moon.recording.reader import open_recording
from tests.monitor.processes import BIN, WAIT_S, Monitor, Process, router
from transports.interface import Observation

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]
EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
SYSTEM = EXAMPLE / "system.xml"
FAULTY = f"BatteryLevelSkill={EXAMPLE / 'faults' / 'T3-BatteryLevelSkill.scxml'}"


def test_a_live_run_and_its_recording_are_told_the_same(tmp_path: Path) -> None:
    run, log, again = tmp_path / "run.mcap", tmp_path / "live.jsonl", tmp_path / "again.jsonl"
    alone = tmp_path / "alone.mcap"
    with router(tmp_path) as (endpoint, peer):
        monitor = Monitor(SYSTEM, "--endpoint", endpoint, "--record", run, "--log", log)
        recorder = Process(
            *("moon", "record", "-o", alone, "--endpoint", endpoint),
            *("--interfaces", EXAMPLE / "interfaces"),
        )
        tour = None
        try:
            monitor.until_listening()
            recorder.until(lambda: any("linked to" in line for line in recorder.err))
            tour = Process("m2c", "run", SYSTEM, "--zenoh-config", peer, "--replace", FAULTY)
            monitor.until(lambda: len(monitor.of("BatteryLevelSkill")) > 1)
            assert recorder.end(signal.SIGINT) == 0, recorder.said
            assert monitor.end(signal.SIGINT) in (0, 1), monitor.said
        finally:
            for process in (tour, monitor, recorder):
                if process is not None:
                    process.close()
    subprocess.run(
        [BIN / "moon", "check", run, SYSTEM, "--log", again],
        stdout=subprocess.DEVNULL,
        check=False,
        timeout=WAIT_S,
    )
    assert log.read_bytes() == again.read_bytes()
    heard = monitor.summary["counts"]["heard"]
    done = subprocess.run(
        [BIN / "moon", "check", run, SYSTEM, "--json"],
        capture_output=True,
        check=False,
        timeout=WAIT_S,
    )
    summary = json.loads(done.stdout.splitlines()[-1])
    assert summary["counts"]["heard"] == heard > 50
    entries = list(open_recording(alone).entries())
    assert isinstance(entries[0], Began)
    assert isinstance(entries[-1], Ended)
    assert sum(isinstance(entry, Observation) for entry in entries) > 50
    ups = {entry.node for entry in entries if isinstance(entry, NodeChange) and entry.up}
    assert "BatteryLevelSkill" in ups
    assert any("recorded" in line for line in recorder.err)
