"""How fast virtual time passes: simulated seconds per second, for the whole lab tour, untapped and tapped.

Nodes and policy are the generated code; the tree is ticked five times a simulated second.
"""

from __future__ import annotations

import functools
import time

from benchmarks.page import Row, beside, command
from benchmarks.processes import ROOT
from benchmarks.sampling import measured
from m2c.model import DiagnosticLog, load
from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEM = ROOT / "examples/lab_tour/system.xml"


def tour(program: Program, seconds: float, tapped: bool) -> list[float]:
    """Simulated seconds per second."""
    world = SimulatedWorld(1, Conditions(delay_s=(0.0, 0.002)))
    heard: list[object] = []
    if tapped:
        SimulatedTransport(world, "listener").tap([], heard.append)
    run = SimulatedRun(program, world)
    began = time.process_time()
    run.run(seconds)
    return [seconds / (time.process_time() - began)]


def rows(seconds: float = 100.0, rounds: int = 5) -> list[Row]:
    """What is shown; ``seconds`` of the tour, in each round."""
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    run = functools.partial(tour, compile_system(system), seconds)
    taken = measured({tapped: functools.partial(run, tapped) for tapped in (False, True)}, rounds)
    return [beside("lab tour, tapped", "simulated s/s", taken[True], "untapped", taken[False])]


if __name__ == "__main__":
    command(rows)
