"""An example in virtual time, on a slow network, and what a tap receives of it."""

from __future__ import annotations

from collections.abc import Iterator

from m2c.simulation.program import Program
from m2c.simulation.run import SimulatedRun
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SLOW = Conditions(delay_s=(100e-6, 8e-3), busy_s=(0.0, 2e-3))


def received_of(program: Program, seed: int, seconds: float) -> list[Observation]:
    """What a tap receives of so many seconds, in order of its stamps."""
    world = SimulatedWorld(seed, SLOW)
    received: list[Observation] = []
    SimulatedTransport(world, "tap").tap([], received.append)
    SimulatedRun(program, world).run(seconds)
    return sorted(received, key=lambda seen: seen.stamp_ns)


def of(received: list[Observation], channel: str, kind: ObservationKind) -> Iterator[Observation]:
    """The observations of one kind on one channel."""
    return (seen for seen in received if seen.channel == channel and seen.kind is kind)
