"""What the oracle of models costs: the lab tour's traffic, recorded once, judged again and again.

Observations per second of processor time on one core, with all seventeen machines; what one costs, p50 and
p99; how many hypotheses are followed at once; what a machine keeps in memory.
"""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Callable, Sequence

from benchmarks.page import Row, command
from benchmarks.processes import ROOT
from benchmarks.sampling import distribution, quantile
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from transports.interface import Observation
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEM = ROOT / "examples/lab_tour/system.xml"
CONDITIONS = Conditions(delay_s=(0.0, 0.002), tap_delay_s=(0.0, 0.002))
PERIOD_NS = 10_000_000
"""Time passes for the oracles this often, as in `moon monitor`."""
ROUNDS = 3


def tour(program: Program, seconds: float, hear: Callable[[Observation], None]) -> int:
    """Run the tour; ``hear`` gets all of it. When it began, ns."""
    world = SimulatedWorld(1, CONDITIONS)
    SimulatedTransport(world, "listener").tap([], hear)
    began_ns = world.now_ns
    run = SimulatedRun(program, world)
    for _ in range(max(1, round(seconds))):
        run.run(1.0)
        run.ticks.clear()
    world.close()
    return began_ns


def monitor_of(system: System, began_ns: int) -> ModelMonitor:
    """All oracles, synchronised with nodes that start at ``began_ns``."""
    monitor = ModelMonitor(system.nodes, system.library)
    for oracle in monitor.oracles.values():
        oracle.start(began_ns)
    return monitor


def judge(monitor: ModelMonitor, observations: Sequence[Observation]) -> float:
    """Processor seconds taken; every verdict is a mistake.

    What was made before is kept out of the garbage collector's way, as ``moon monitor`` does it.
    """
    gc.freeze()
    feed, advanced_ns = monitor.feed, 0
    began = time.process_time()
    for observation in observations:
        if observation.received_ns >= advanced_ns + PERIOD_NS:
            advanced_ns = observation.received_ns
            assert not monitor.advance(advanced_ns)
        assert not feed(observation)
    return time.process_time() - began


def memory_per_machine(system: System, observations: Sequence[Observation], began_ns: int) -> float:
    """KB that each machine of a running system holds, models included."""
    gc.collect()
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    monitor = monitor_of(system, began_ns)
    judge(monitor, observations)
    gc.collect()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return (after - before) / 1024 / len(monitor.oracles)


def single_costs(
    system: System, observations: Sequence[Observation], began_ns: int
) -> tuple[list[float], int]:
    """What each observation costs, µs of processor time; the most hypotheses of any oracle after any."""
    monitor = monitor_of(system, began_ns)
    gc.freeze()
    clock, advanced_ns, most = time.thread_time_ns, 0, 0
    fed: list[float] = []
    for seen in observations:
        if seen.received_ns >= advanced_ns + PERIOD_NS:
            advanced_ns = seen.received_ns
            monitor.advance(advanced_ns)
        began = clock()
        monitor.feed(seen)
        fed.append((clock() - began) / 1000)
        most = max(most, *(len(oracle.hypotheses) for oracle in monitor.oracles.values()))
    return fed, most


def rows(seconds: float = 120.0) -> list[Row]:
    """What is shown, of a tour of ``seconds``."""
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    heard: list[Observation] = []
    began_ns = tour(compile_system(system), seconds, heard.append)
    count = len(system.nodes)
    print(f"lab tour, {seconds:g} s: {len(heard)} observations, {count} machines")
    speeds = [[len(heard) / judge(monitor_of(system, began_ns), heard)] for _ in range(ROUNDS)]
    speed = distribution(speeds).p50.value
    costs, hypotheses = single_costs(system, heard, began_ns)
    per_machine = memory_per_machine(system, heard[:3000], began_ns)
    return [
        Row(f"{count} machines", speed, "observations/s", least=100_000.0),
        Row("one observation, p50", quantile(costs, 0.5), "µs"),
        Row("one observation, p99", quantile(costs, 0.99), "µs", most=40.0),
        Row("hypotheses at once", hypotheses, "", most=16.0),
        Row("memory of a machine", per_machine, "KB", most=100.0),
    ]


if __name__ == "__main__":
    command(rows)
