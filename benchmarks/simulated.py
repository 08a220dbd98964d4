"""How fast virtual time passes: simulated seconds per second, for the whole lab tour.

Usage: ``python -m benchmarks.simulated [--seconds S]``. Nodes and policy are the generated code; the
tree is ticked five times a simulated second. Beside it, the same without a policy, and bare messages.
"""

from __future__ import annotations

import argparse
import time

from benchmarks.page import Row, publish
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=300.0)
    seconds = parser.parse_args().seconds
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    program = compile_system(system)
    rows: list[Row] = []
    for name, tapped in (("untapped", False), ("tapped", True)):
        world = SimulatedWorld(1, Conditions(delay_s=(0.0, 0.002)))
        heard: list[object] = []
        if tapped:
            SimulatedTransport(world, "listener").tap([], heard.append)
        run = SimulatedRun(program, world)
        began = time.process_time()
        run.run(seconds)
        spent = time.process_time() - began
        base = rows[0].value if rows else None
        rows.append(
            Row(
                f"lab tour, {name}",
                seconds / spent,
                "simulated s/s",
                "untapped" if rows else "",
                base,
                None if base is None else seconds / spent / base,
            )
        )
    bare = messages(100_000)
    publish([*rows, Row("bare messages", bare, "messages/s")])


if __name__ == "__main__":
    main()
