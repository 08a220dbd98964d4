"""How fast virtual time passes: simulated seconds per second, for the whole lab tour.

Nodes and policy are the generated code; the
tree is ticked five times a simulated second. Beside it, the same without a policy, and bare messages.
"""

from __future__ import annotations

import time

from benchmarks.page import Row, command, faster
from benchmarks.processes import ROOT
from m2c.launch.in_process import SimulatedRun, compile_system
from m2c.model import DiagnosticLog, load
from transports.conformance import NUMBERS, Number
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEM = ROOT / "examples/lab_tour/system.xml"


def messages(count: int) -> float:
    """Messages per second from one node to another."""
    world = SimulatedWorld()
    source, sink = SimulatedTransport(world, "source"), SimulatedTransport(world, "sink")
    heard = 0

    def hear(_: Number) -> None:
        nonlocal heard
        heard += 1

    sink.subscribe(NUMBERS, hear)
    publisher = source.publisher(NUMBERS)
    began = time.process_time()
    for value in range(count):
        publisher.publish(Number(value))
        world.run_for(0.001)
    assert heard == count
    return count / (time.process_time() - began)


def rows(seconds: float = 300.0) -> list[Row]:
    """What is shown; ``seconds`` of the tour."""
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    program = compile_system(system)
    speeds = []
    for tapped in (False, True):
        world = SimulatedWorld(1, Conditions(delay_s=(0.0, 0.002)))
        heard: list[object] = []
        if tapped:
            SimulatedTransport(world, "listener").tap([], heard.append)
        run = SimulatedRun(program, world)
        began = time.process_time()
        run.run(seconds)
        speeds.append(seconds / (time.process_time() - began))
    untapped, with_tap = speeds
    return [
        Row("lab tour, untapped", untapped, "simulated s/s"),
        faster("lab tour, tapped", with_tap, "simulated s/s", "untapped", untapped),
        Row("bare messages", messages(100_000), "messages/s"),
    ]


if __name__ == "__main__":
    command(rows)
