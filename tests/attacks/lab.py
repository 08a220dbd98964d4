"""A lab tour under attack: every process of it, the monitor and the recorder beside it, and what must hold."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.attacks.strangers import SYSTEM
from tests.monitor.processes import BIN, WAIT_S, Monitor, Process, free_endpoint

ROOT = Path(__file__).parents[2]
RATE_HZ = 10
"""Ticks a second: twice the tour's."""
MOST_MB = 1000
"""What a process of ours may take; alone they take 50 to 90. Beside it there may be what waits in a queue (64 MB, as
it came), what Zenoh holds at that moment, and one message of 30 MB as it is decoded and written: ten times as much in
Python. Measured: 630 MB in the worst of six rounds of the soak."""
DEADLINE_S = 10.0
"""A flood that takes all processors can keep a node from its work for longer than the usual second: saying so would be
no false verdict, and is not what is tested here."""
TICKS_GO_ON_S = 30.0
"""How long the tour may be held up."""


class LabError(AssertionError):
    """Something that must hold does not."""


class Lab:
    """The tour, a monitor and a recorder, on an endpoint of their own.

    Args:
        folder: where the generated tour and the recording are written.
        ticks: the tour ends by itself after so many; None: it is ended.
    """

    def __init__(self, folder: Path, ticks: int | None = None) -> None:
        self.endpoint = free_endpoint()
        labs = len(list(folder.glob("tour*.mcap")))  # what one that has fallen recorded stays
        self.recording = folder / f"tour{labs}.mcap"
        self._processes: list[Process] = []
        self._peaks_mb: dict[str, float] = {}
        tour = folder / "generated"
        if not tour.exists():
            generated = [str(BIN / "m2c"), "generate", "--transport", "zenoh", str(SYSTEM)]
            subprocess.run(
                [*generated, "-o", str(tour)], check=True, capture_output=True, timeout=WAIT_S
            )
        try:
            self._begin(tour, () if ticks is None else ("--ticks", ticks))
        except AssertionError:  # nobody else knows of what was started
            self.close()
            raise

    def _begin(self, tour: Path, ended: Sequence[object]) -> None:
        self.run = self._start(
            Process, "m2c", "run", tour, "--endpoint", self.endpoint, "--rate", RATE_HZ, *ended
        )
        self.run.until(lambda: self.ticks)
        self.monitor: Monitor = self._start(
            Monitor, SYSTEM, "--endpoint", self.endpoint, "--deadline", DEADLINE_S
        )
        self.monitor.until_listening()
        self.recorder = self._start(
            Process, "moon", "record", "-o", self.recording, "--endpoint", self.endpoint
        )
        self._nodes = children(self.run.process.pid)
        self.monitor.until(lambda: self.monitor.of("BatteryLevelSkill")[-1:] == ["conforming"])

    def _start(self, kind: Any, *arguments: object, **options: Any) -> Any:
        process = kind(*arguments, **options)
        self._processes.append(process)
        return process

    @property
    def stands(self) -> bool:
        """Whether all still run."""
        return all(
            process.process.poll() is None for process in (self.run, self.monitor, self.recorder)
        ) and self._nodes == children(self.run.process.pid)

    @property
    def ticks(self) -> int:
        """Ticks that the policy has made."""
        return sum(line.startswith("tick ") for line in self.run.out)

    def attack(self, names: Sequence[str], seed: int, seconds: float) -> None:
        """Have strangers attack, all at once, and look whether all that must hold does.

        Args:
            names: of attacks.
            seed: of what they do.
            seconds: how long they go on.

        Raises:
            LabError: it does not.
        """
        before = self.ticks
        strangers = [self._stranger(name, seed, seconds) for name in names]
        try:
            for name, stranger in zip(names, strangers, strict=True):
                if name == "deaf_reader":
                    stranger.until(lambda stranger=stranger: "attacking" in stranger.out)
                    stranger.send(signal.SIGSTOP)
            self._watch(seconds)
        finally:
            for stranger in strangers:
                stranger.process.kill()
                stranger.close()
                self._processes.remove(stranger)
        self.look(f"{', '.join(names)} (seed {seed})")
        self.goes_on(before)

    def _stranger(self, name: str, seed: int, seconds: float) -> Process:
        command = ("-m", "tests.attacks.strangers", name, self.endpoint)
        options = ("--seed", seed, "--seconds", seconds)
        env = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        }
        return self._start(Process, sys.executable, *command, *options, env=env)

    def _watch(self, seconds: float) -> None:
        """Note what our processes take at most, while strangers are at work."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            time.sleep(min(0.2, max(end_s - time.monotonic(), 0)))
            for name, pid in self._ours():
                self._peaks_mb[name] = max(self._peaks_mb.get(name, 0.0), peak_mb(pid))

    def _ours(self) -> list[tuple[str, int]]:
        return [
            ("m2c run", self.run.process.pid),
            ("moon monitor", self.monitor.process.pid),
            ("moon record", self.recorder.process.pid),
            *((f"process {pid} of the tour", pid) for pid in self._nodes),
        ]

    def look(self, what: str) -> None:
        """All live, take no more memory than they may, and nobody is accused; else LabError."""
        for name, process in (
            ("m2c run", self.run),
            ("moon monitor", self.monitor),
            ("moon record", self.recorder),
        ):
            if process.process.poll() is not None:
                raise LabError(f"{what}: {name} has ended:\n{tail(process)}")
        gone = set(self._nodes) - set(children(self.run.process.pid))
        if gone:
            raise LabError(
                f"{what}: {len(gone)} processes of the tour have ended:\n{tail(self.run)}"
            )
        for name, most in self._peaks_mb.items():
            if most > MOST_MB:
                raise LabError(f"{what}: {name} took {most:.0f} MB")
        if self.monitor.violated:
            found = [v for v in self.monitor.verdicts if v["outcome"] == "violated"]
            raise LabError(f"{what}: a false verdict: {json.dumps(found[0], indent=1)}")
        for process in (self.run, self.monitor, self.recorder):
            if any(line.startswith("Traceback") for line in process.err + process.out):
                raise LabError(f"{what}: a traceback:\n{tail(process)}")

    def goes_on(self, since: int) -> None:
        """The tour ticks on; else LabError."""
        try:
            self.run.until(lambda: self.ticks > since + 1, TICKS_GO_ON_S)
        except AssertionError as error:
            raise LabError(f"the tour stands still at tick {since}") from error

    @property
    def peaks(self) -> dict[str, float]:
        """The most that each of our processes took, MB."""
        return self._peaks_mb

    def end(self, number: signal.Signals | None = signal.SIGINT) -> None:
        """The tour ends (by itself: None), then those that listen; LabError unless all end as they should."""
        code = self.run.end(number)
        if code != 0:
            raise LabError(f"m2c run ended with {code}:\n{tail(self.run)}")
        for name, process in (("moon monitor", self.monitor), ("moon record", self.recorder)):
            code = process.end(signal.SIGINT)
            if code != 0:
                raise LabError(f"{name} ended with {code}:\n{tail(process)}")

    def close(self) -> None:
        """End whatever still runs."""
        for process in reversed(self._processes):
            process.close()


def children(pid: int) -> list[int]:
    """The processes that ``pid`` has started."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def peak_mb(pid: int) -> float:
    """The most that a process has taken so far (VmHWM)."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0  # it has ended, which is said elsewhere
    return next((int(line.split()[1]) / 1000 for line in lines if line.startswith("VmHWM")), 0.0)


def tail(process: Process) -> str:
    """The last that it said."""
    return "\n".join([*process.out[-5:], *process.err[-20:]])
