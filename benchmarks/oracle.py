"""What the oracle of models costs: the lab tour's traffic, recorded once, judged again and again.

* speed: observations per second of processor time, one core, all seventeen machines; p50 and p99;
* hypotheses: how many are followed at once;
* fleet: the same for many tours side by side (names and channels prefixed), and memory per machine.
"""

from __future__ import annotations

import gc
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence

from msgspec.structs import replace

from benchmarks.page import Row, beside, command
from benchmarks.processes import ROOT
from benchmarks.sampling import quantile
from m2c.launch.in_process import Program, SimulatedRun, compile_system
from m2c.model import DiagnosticLog, load
from m2c.model.machine import Machine
from m2c.model.system import System
from moon.monitor.models import ModelMonitor
from transports.interface import Observation
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEM = ROOT / "examples/lab_tour/system.xml"
CONDITIONS = Conditions(delay_s=(0.0, 0.002), tap_delay_s=(0.0, 0.002))
PERIOD_NS = 10_000_000
"""Time passes for the oracles this often, as in `moon monitor`."""
FLEET_OBSERVATIONS = 120_000
"""Judged for each size of fleet, in all."""
BATCH = 60_000
"""Copies that are made at once, outside the time measured."""


# -- traffic --------------------------------------------------------------------------------------


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


def monitor_of(machines: Sequence[Machine], system: System, began_ns: int) -> ModelMonitor:
    """All oracles, synchronised with nodes that start at ``began_ns``."""
    monitor = ModelMonitor(machines, system.library)
    for oracle in monitor.oracles.values():
        oracle.start(began_ns)
    return monitor


def judge(
    monitor: ModelMonitor, observations: Sequence[Observation], advanced_ns: int = 0
) -> tuple[float, int]:
    """Processor seconds taken, and when time last passed; every verdict is a mistake.

    What was made before is kept out of the garbage collector's way, as ``moon monitor`` does it.
    """
    gc.freeze()
    feed = monitor.feed
    began = time.process_time()
    for observation in observations:
        if observation.received_ns >= advanced_ns + PERIOD_NS:
            advanced_ns = observation.received_ns
            assert not monitor.advance(advanced_ns)
        assert not feed(observation)
    return time.process_time() - began, advanced_ns


# -- a fleet --------------------------------------------------------------------------------------


def prefixed(machine: Machine, number: int) -> Machine:
    """The machine of tour ``number``: its name and its channels have a prefix."""
    interfaces = tuple(
        replace(item, channel=f"/r{number}{item.channel}")
        if item.channel and item.channel.startswith("/")
        else item
        for item in machine.interfaces
    )
    return replace(machine, name=f"r{number}_{machine.name}", interfaces=interfaces)


def copy_of(seen: Observation, number: int) -> Observation:
    """The same thing, in tour ``number``."""
    return replace(
        seen,
        channel=f"/r{number}{seen.channel}",
        source=f"r{number}_{seen.source}",
        client=f"r{number}_{seen.client}" if seen.client else "",
    )


def batches(observations: Sequence[Observation], tours: int) -> Iterator[list[Observation]]:
    """What ``tours`` tours do at once, a part at a time."""
    size = max(1, BATCH // tours)
    for first in range(0, len(observations), size):
        part = observations[first : first + size]
        yield [copy_of(seen, number) for seen in part for number in range(tours)]


def fleet_speed(
    system: System, observations: Sequence[Observation], began_ns: int, tours: int
) -> float:
    """Observations per second of a fleet."""
    machines = [prefixed(item, number) for number in range(tours) for item in system.nodes]
    monitor = monitor_of(machines, system, began_ns)
    part = observations[: max(1000, FLEET_OBSERVATIONS // tours)]
    count, seconds, advanced_ns = 0, 0.0, 0
    for batch in batches(part, tours):
        taken, advanced_ns = judge(monitor, batch, advanced_ns)
        seconds += taken
        count += len(batch)
    return count / seconds


def memory_per_machine(
    system: System, observations: Sequence[Observation], began_ns: int, tours: int
) -> float:
    """KB that each machine of a running fleet holds, models included."""
    gc.collect()
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    machines = [prefixed(item, number) for number in range(tours) for item in system.nodes]
    monitor = monitor_of(machines, system, began_ns)
    for batch in batches(observations[:3000], tours):
        judge(monitor, batch)
    del batch, machines
    gc.collect()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return (after - before) / 1024 / len(monitor.oracles)


# -- figures --------------------------------------------------------------------------------------


def single_costs(
    system: System, observations: Sequence[Observation], began_ns: int
) -> tuple[float, float]:
    """What one observation costs, µs of processor time: p50 and p99."""
    monitor = monitor_of(system.nodes, system, began_ns)
    gc.freeze()
    clock, advanced_ns = time.thread_time_ns, 0
    fed: list[float] = []
    for seen in observations:
        if seen.received_ns >= advanced_ns + PERIOD_NS:
            advanced_ns = seen.received_ns
            monitor.advance(advanced_ns)
        began = clock()
        monitor.feed(seen)
        fed.append((clock() - began) / 1000)
    return quantile(fed, 0.5), quantile(fed, 0.99)


def most_hypotheses(system: System, observations: Sequence[Observation], began_ns: int) -> int:
    """The largest set of any oracle after any observation."""
    monitor = monitor_of(system.nodes, system, began_ns)
    most = 0
    for seen in observations:
        monitor.feed(seen)
        most = max(most, *(len(oracle.hypotheses) for oracle in monitor.oracles.values()))
    return most


def rows(seconds: float = 120.0, tours: int = 59) -> list[Row]:
    """What is shown.

    Args:
        seconds: of the recorded tour.
        tours: of the largest fleet (59: 1,003 machines).
    """
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    heard: list[Observation] = []
    began_ns = tour(compile_system(system), seconds, heard.append)
    print(f"lab tour, {seconds:g} s: {len(heard)} observations, {len(system.nodes)} machines")
    runs = [judge(monitor_of(system.nodes, system, began_ns), heard)[0] for _ in range(3)]
    p50, p99 = single_costs(system, heard, began_ns)
    one, all_tours = (1e6 / fleet_speed(system, heard, began_ns, size) for size in (1, tours))
    count = len(system.nodes)
    per_machine = memory_per_machine(system, heard, began_ns, min(tours, 10))
    among = f"an observation among {tours * count:,} machines"
    return [
        Row(f"{count} machines", len(heard) / min(runs), "observations/s", least=100_000.0),
        Row("one observation, p50", p50, "µs"),
        Row("one observation, p99", p99, "µs", most=40.0),
        Row("hypotheses at once", most_hypotheses(system, heard, began_ns), "", most=16.0),
        Row("memory of a machine", per_machine, "KB", most=100.0),
        beside(among, "µs", [[all_tours]], f"among {count}", [[one]]),
    ]


if __name__ == "__main__":
    command(rows)
