"""Who speaks in another's name makes nobody *violated*: it is a finding about who may send where."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from tests.keys import impostor
from tests.keys.impostor import Imposture
from tests.keys.test_secure_runs import init
from tests.monitor.processes import WAIT_S, Monitor, Process, free_endpoint

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
TOUR = ROOT / "examples" / "lab_tour" / "system.xml"


class Speaker:
    """``impostor.py`` as a process."""

    def __init__(self, imposture: Imposture) -> None:
        self.process = subprocess.Popen(
            [sys.executable, impostor.__file__, msgspec.json.encode(imposture).decode()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        self._watchdog = threading.Timer(WAIT_S, self.process.kill)
        self._watchdog.start()

    def until_said(self) -> None:
        """Wait until it has said some hundreds of things."""
        assert self.process.stdout is not None
        assert json.loads(self.process.stdout.readline()) == {"ready": True}
        assert json.loads(self.process.stdout.readline()) == {"said": 500}

    def close(self) -> None:
        self._watchdog.cancel()
        with self.process:
            assert self.process.stdin is not None
            self.process.stdin.close()


@contextlib.contextmanager
def tour(*options: object) -> Iterator[tuple[Monitor, Process]]:
    """The lab tour, and a monitor that listened before it came."""
    with contextlib.ExitStack() as stack:
        monitor = stack.enter_context(contextlib.closing(Monitor(TOUR, *options)))
        monitor.until_listening()
        run = stack.enter_context(
            contextlib.closing(Process("m2c", "run", TOUR, *options, "--rate", 10))
        )
        run.until(lambda: sum(line.startswith("tick ") for line in run.out) > 3)
        yield monitor, run


def ticks(run: Process) -> int:
    return sum(line.startswith("tick ") for line in run.out)


def goes_on(run: Process, beyond: int) -> None:
    """Wait until it has made more ticks than these."""
    run.until(lambda: ticks(run) > beyond)


def test_who_has_a_certificate_accuses_nobody_in_another_name(tmp_path: Path) -> None:
    keys = init(tmp_path / "keys", TOUR)
    endpoint = free_endpoint().replace("tcp/", "tls/")
    with tour("--secure", keys, "--endpoint", endpoint) as (monitor, run):
        for name in ("BatteryComponent", "NavigationComponent", "AlarmSkill"):
            imposture = Imposture(folder=str(keys), name=name, endpoint=endpoint, system=str(TOUR))
            with contextlib.closing(Speaker(imposture)) as speaker:
                speaker.until_said()
                goes_on(run, ticks(run) + 20)
            assert monitor.violated == set(), (name, monitor.said)
            if name == "BatteryComponent":
                assert "in the name of AlarmSkill, which may not send there" in monitor.said
        assert run.end(signal.SIGINT) == 0, run.said
        assert monitor.end(signal.SIGINT) in (0, 1), monitor.said
        assert monitor.violated == set(), monitor.said
        assert "Ghost" not in monitor.said


def test_without_certificates_a_name_that_may_not_send_there_is_no_evidence(tmp_path: Path) -> None:
    """The impostor stamps as the session of the node that it names: only the models tell."""
    endpoint = free_endpoint()
    with tour("--endpoint", endpoint) as (monitor, run):
        imposture = Imposture(
            folder="", name="", endpoint=endpoint, system=str(TOUR), only=("misname",)
        )
        with contextlib.closing(Speaker(imposture)) as speaker:
            speaker.until_said()
            goes_on(run, ticks(run) + 20)
        assert run.end(signal.SIGINT) == 0, run.said
        assert monitor.end(signal.SIGINT) in (0, 1), monitor.said
        assert monitor.violated == set(), monitor.said
        assert "which by its model does not send there: another's" in monitor.said
        for name in ("AlarmSkill", "GoToPoiSkill", "BatteryComponent"):  # which take none of it
            assert "inconclusive" not in monitor.of(name), monitor.said
