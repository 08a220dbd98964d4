"""How fast virtual time passes: simulated seconds per second, for the whole lab tour, untapped and tapped.

Nodes and policy are the generated code; the tree is ticked five times a simulated second. Beside it, bare
messages from one node to another.
"""

from __future__ import annotations

import functools
import itertools
import time

from benchmarks.page import Row, beside, command
from benchmarks.processes import ROOT
from benchmarks.sampling import measured
from m2c.launch.in_process import Program, SimulatedRun, compile_system
from m2c.model import DiagnosticLog, load
from transports.conformance import NUMBERS, Number
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEM = ROOT / "examples/lab_tour/system.xml"


def messages(count: int) -> float:
    """Messages per second from one node to another."""
    world = SimulatedWorld()
    source, sink = SimulatedTransport(world, "source"), SimulatedTransport(world, "sink")
    heard = itertools.count()
    sink.subscribe(NUMBERS, lambda _: next(heard))
    publisher = source.publisher(NUMBERS)
    began = time.process_time()
    for value in range(count):
        publisher.publish(Number(value))
        world.run_for(0.001)
    assert next(heard) == count
    return count / (time.process_time() - began)


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
    what, unit = "lab tour, tapped", "simulated s/s"
    return [
        beside(what, unit, taken[True], "untapped", taken[False]),
        Row("bare messages", messages(100_000), "messages/s"),
    ]


if __name__ == "__main__":
    command(rows)
