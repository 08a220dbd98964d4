"""The lab tour in virtual time, received once, and then replayed around one of its nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

from m2c.diagnostics import DiagnosticLog
from m2c.model import load
from m2c.model.system import System
from m2c.runtime.binding import NodeSettings
from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from moon.recording.contents import Contents
from moon.recording.definitions import Definitions
from moon.recording.offers import Offer
from transports.interface import Observation
from transports.simulated import SimulatedTransport, SimulatedWorld

LAB_TOUR = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"


@cache
def lab_tour() -> tuple[System, Program]:
    """The system, and its nodes' code."""
    system = load([LAB_TOUR], DiagnosticLog())
    assert system is not None
    return system, compile_system(system)


class Received:
    """What ``open_recording`` gives, of observations that are at hand."""

    def __init__(self, observations: Iterable[Observation]) -> None:
        self.observations = list(observations)
        self.contents = Contents()
        self._definitions = Definitions(lab_tour()[0].library)

    def entries(
        self, wanted: Callable[[str], bool] = lambda channel: True
    ) -> Iterator[Observation]:
        for seen in self.observations:
            if wanted(seen.channel):
                self.contents.note(seen)
                yield seen

    def structure(self, type_name: str) -> Any:
        return self._definitions.structure(type_name)

    def offer(self, topic: str) -> Offer:
        return Offer()

    def faults(self) -> list[str]:
        return []


def tour(seconds: float, seed: int = 3) -> Received:
    """Everything that a tap hears of a nominal tour."""
    world, received = SimulatedWorld(seed), []
    SimulatedTransport(world, "tap").tap([], received.append)
    SimulatedRun(lab_tour()[1], world).run(seconds)
    return Received(received)


def live(world: SimulatedWorld, *names: str) -> list[Observation]:
    """Nodes of the tour in ``world``, and what a tap hears there from now on."""
    received: list[Observation] = []
    SimulatedTransport(world, "tap").tap([], received.append)
    for name in names:
        transport = SimulatedTransport(world, name)
        node = lab_tour()[1].nodes[name](transport, NodeSettings())
        transport.post(node.start)
        transport.post(transport.announce)
    world.run_for(1.0)
    return received


def of(received: Iterable[Observation], node: str) -> list[tuple[str, str, Any]]:
    """What ``node`` got and gave."""
    return [(seen.channel, seen.kind, seen.data) for seen in received if seen.source == node]
