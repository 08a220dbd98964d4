"""``moon replay`` and one generated skill, each a process of its own, on real Zenoh over loopback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from moon.recording.definitions import Definitions
from moon.recording.writer import RecordingWriter
from tests.monitor.processes import WAIT_S, Process, router
from tests.replay.worlds import LAB_TOUR, Heard, lab_tour, of, tour
from transports.interface import Observation
from transports.zenoh import connect

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]

SECONDS = 5.0


def recorded(path: Path) -> Heard:
    """Yesterday: a nominal tour, in a file."""
    heard = tour(SECONDS)
    writer = RecordingWriter(path, Definitions(lab_tour()[0].library))
    for seen in heard.observations:
        writer.add(seen)
    writer.close()
    return heard


class Skill(Process):
    """A generated node."""

    def __init__(self, folder: Path, package: str, endpoint: str) -> None:
        found = os.environ.get("PYTHONPATH")
        os.environ["PYTHONPATH"] = str(folder)
        try:
            super().__init__(Path(sys.executable).name, "-m", package, "--endpoint", endpoint)
        finally:
            if found is None:
                del os.environ["PYTHONPATH"]
            else:
                os.environ["PYTHONPATH"] = found


class Tap:
    """What is heard on a network, while a test runs."""

    def __init__(self, endpoint: str) -> None:
        self.heard: list[Observation] = []
        self.transport = connect("a_tap", {"endpoint": endpoint})
        self._more = threading.Condition()
        self.transport.tap([], self._hear)
        self._thread = threading.Thread(target=self.transport.spin)
        self._thread.start()

    def _hear(self, seen: Observation) -> None:
        with self._more:
            self.heard.append(seen)
            self._more.notify_all()

    def until(self, holds: Any) -> None:
        with self._more:
            assert self._more.wait_for(holds, WAIT_S)

    def close(self) -> None:
        self.transport.close()
        self._thread.join(WAIT_S)


def test_a_skill_gets_yesterdays_answers_and_gives_yesterdays(tmp_path: Path) -> None:
    name = "SetPoi1Skill"
    heard = recorded(tmp_path / "run.mcap")
    generated = tmp_path / "generated"
    command = ["m2c", "generate", "--transport", "zenoh", str(LAB_TOUR), "-o", str(generated)]
    subprocess.run(
        [sys.executable, "-m", "m2c.cli", *command[1:]],
        check=True,
        capture_output=True,
        timeout=WAIT_S,
    )
    with router(tmp_path) as (endpoint, _):
        tap = Tap(endpoint)
        skill = Skill(generated / "set_poi1_skill", "set_poi1_skill", endpoint)
        try:
            assert list(tap.transport.wait_for_nodes([name], WAIT_S)) == []
            replay = Process(
                *("moon", "replay", tmp_path / "run.mcap", "--without", name, "--rate", 2),
                *("--endpoint", endpoint),
            )
            try:
                assert replay.end() == 0, replay.said
                then = of(heard.observations, name)
                tap.until(lambda: len(of(tap.heard, name)) >= len(then))
            finally:
                replay.close()
            assert skill.end(signal.SIGTERM) == 0, skill.said
        finally:
            skill.close()
            tap.close()
    assert len(then) > 50
    assert sorted(of(tap.heard, name), key=str) == sorted(then, key=str)
    (summary,) = [line for line in replay.err if line.startswith("published")]
    calls = sum(seen[0].endswith("/tick") for seen in then) // 2
    assert f"answered {calls} requests, asked {calls}, 0 answered otherwise than then" in summary
    assert f"{name} is there itself: it is not played" in replay.err
    answers = {
        str(seen.data) for seen in tap.heard if seen.source == "SchedulerComponent" and seen.data
    }
    assert "{'is_ok': True}" in answers
