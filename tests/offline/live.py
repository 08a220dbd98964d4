"""Runs of the lab tour in virtual time, monitored and recorded at once."""

from __future__ import annotations

import functools
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.writer import RecordingWriter
from moon.run import Run
from moon.sources.recorded import RecordedConnection, RecordedRun
from moon.sources.source import Outputs
from moon.verdict import Verdict
from tests.moving_clock import MovingClock
from transports.simulated import Conditions, SimulatedWorld

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
SUBJECT = Subject((EXAMPLE / "system.xml",), (EXAMPLE / "properties.yaml",), (), (), (), Bounds())
BEFORE_S = 0.01
"""The nodes begin to connect so long after the monitor listens."""


@functools.cache
def monitored() -> Monitored:
    """The lab tour, with its properties."""
    return read_subject(SUBJECT)


@functools.cache
def program() -> Program:
    """The code of the lab tour."""
    return compile_system(monitored().system)


@functools.cache
def faulty_program(name: str) -> Program:
    """The lab tour with one of the paper's faults, ``T1`` to ``T6``."""
    faults = str(EXAMPLE / "faults")
    before = set(sys.modules)
    sys.path.insert(0, faults)
    try:
        inject, run = importlib.import_module("inject"), importlib.import_module("simulated_run")
        chosen: Any = inject.fault(name)
        return program().replacing(chosen.node, run._faulty_node(chosen, monitored().system))
    finally:
        sys.path.remove(faults)
        for module in set(sys.modules) - before:
            if str(getattr(sys.modules[module], "__file__", "")).startswith(faults):
                del sys.modules[module]


class _Clocked(MovingClock):
    """The monitor's connection, with a clock that can be set."""

    def __init__(self, run: LiveRun) -> None:
        super().__init__(run.world, "monitor")
        self._run_of = run

    def now_ns(self) -> int:
        return super().now_ns() + self._run_of.clock_is_ahead_ns


class LiveRun:
    """A run; its recording is at ``path`` when it has ended.

    Attributes:
        world: of the run, for what a test does to it.
        verdicts: what the monitor has said.
        clock_is_ahead_ns: by how much the monitor's clock is wrong.
    """

    def __init__(
        self,
        path: Path,
        code: Program,
        seed: int,
        conditions: Conditions | None = None,
        world: Callable[[int, Conditions | None], SimulatedWorld] = SimulatedWorld,
    ) -> None:
        self.world = world(seed, conditions)
        self.verdicts: list[Verdict] = []
        self.clock_is_ahead_ns = 0
        transport = _Clocked(self)
        self._writer = RecordingWriter(path, Definitions(monitored().system.library))
        self._connection = RecordedConnection(transport, self._writer.add, "simulated")
        self._run = RecordedRun(self._connection, self._writer)
        self.watch = Run(self._connection, monitored(), Outputs([self._run, self]))
        self.watch.start()
        self.world.run_for(BEFORE_S)
        self._nodes = SimulatedRun(code, self.world)

    def take(self, verdict: Verdict) -> None:
        """The monitor says something."""
        self.verdicts.append(verdict)

    def run(self, seconds: float) -> None:
        """Let time pass; what was recorded goes to the file."""
        self._nodes.run(seconds)
        self._run.flush()

    def end(self) -> list[Verdict]:
        """End run and recording; the verdicts."""
        assert self.watch.listener is not None
        self._run.end(self.watch.listener.problems())
        self._writer.close()
        self.world.close()
        return self.verdicts


def live_run(
    path: Path, code: Program, seed: int, seconds: float, conditions: Conditions | None = None
) -> list[Verdict]:
    """What a monitor says of a run of ``seconds``, recorded at ``path``."""
    run = LiveRun(path, code, seed, conditions)
    for _ in range(4):
        run.run(seconds / 4)
    return run.end()
