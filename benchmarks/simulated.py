"""How fast virtual time passes: simulated seconds per second, for the whole lab tour.

By processor time: untapped, tapped, and monitored by its models and properties; and two runs side by side.
Nodes and policy are the generated code; the tree is ticked five times a simulated second.
"""

from __future__ import annotations

import functools
import gc
import multiprocessing
import time
from collections.abc import Callable

import m2c
import moon
from benchmarks.page import Row, beside, command
from benchmarks.processes import ROOT
from benchmarks.sampling import distribution, measured
from m2c.model import DiagnosticLog, load
from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEM = ROOT / "examples/lab_tour/system.xml"
PROPERTIES = SYSTEM.with_name("properties.yaml")
CONDITIONS = Conditions(delay_s=(0.0, 0.002))
BESIDE = 2
"""So many runs side by side."""

Listens = Callable[[SimulatedWorld], object]


def tour(program: Program, seconds: float, listens: Listens) -> list[float]:
    """Simulated seconds per second of processor time."""
    world = SimulatedWorld(1, CONDITIONS)
    listens(world)
    run = SimulatedRun(program, world)
    began = time.process_time()
    run.run(seconds)
    taken = time.process_time() - began
    world.close()
    return [seconds / taken]


def nobody(world: SimulatedWorld) -> None:
    """Nobody listens."""


def tap(world: SimulatedWorld) -> None:
    """A tap that counts what it receives."""
    counted = [0]

    def count(_: object) -> None:
        counted[0] += 1

    SimulatedTransport(world, "listener").tap([], count)


class Monitors:
    """A monitor of the models and properties of the lab tour, which finds nothing wrong."""

    def __init__(self) -> None:
        self._system = m2c.read_system(SYSTEM)
        self._properties = moon.PropertySet.from_files(PROPERTIES, system=self._system)

    def __call__(self, world: SimulatedWorld) -> None:
        """Listen to all of ``world``."""
        monitor = moon.Monitor(
            world.connect("monitor"), self._system, self._properties, on_verdict=_conforming
        )
        monitor.start()
        world.run_for(0.01)
        gc.collect()
        gc.freeze()  # as `moon monitor` does


def _conforming(verdict: moon.Verdict) -> None:
    assert verdict.outcome is not moon.Outcome.VIOLATED, verdict


def _program() -> Program:
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    return compile_system(system)


_kept: list[Program] = []
"""The program of a process for runs side by side."""


def _begin() -> None:
    _kept.append(_program())
    tour(_kept[0], 1.0, nobody)


def _run(seconds: float) -> float:
    return tour(_kept[0], seconds, nobody)[0]


def together(count: int, seconds: float) -> list[float]:
    """Simulated seconds per second, summed over ``count`` runs at once in processes of their own."""
    with multiprocessing.get_context("spawn").Pool(count, _begin) as pool:
        pool.map(_run, [1.0] * count, chunksize=1)  # all have begun
        return [sum(pool.map(_run, [seconds] * count, chunksize=1))]


def rows(seconds: float = 100.0, rounds: int = 5) -> list[Row]:
    """What is shown; ``seconds`` of the tour, in each round."""
    run = functools.partial(tour, _program(), seconds)
    listening: dict[str, Listens] = {"untapped": nobody, "tapped": tap, "monitored": Monitors()}
    taken = measured(
        {name: functools.partial(run, listens) for name, listens in listening.items()}, rounds
    )
    long = functools.partial(together, seconds=10 * seconds)
    side = measured({count: functools.partial(long, count) for count in (1, BESIDE)}, rounds)
    unit, untapped = "simulated s/s", taken["untapped"]
    return [
        Row("lab tour", distribution(untapped).p50.value, unit, least=2000.0),
        beside("the same tapped", unit, taken["tapped"], "untapped", untapped),
        beside(
            "the same monitored",
            unit,
            taken["monitored"],
            "untapped",
            untapped,
            least=800.0,
            is_of_value=True,
        ),
        beside("two runs side by side", unit, side[BESIDE], "one", side[1], least=1.8),
    ]


if __name__ == "__main__":
    command(rows)
