"""What the oracle of models costs: the lab tour's traffic, recorded once, judged again and again.

Usage: python -m benchmarks.oracle [--seconds S] [--tours N] [--observations N]

* speed: observations per second of processor time, one core, all seventeen machines; p50 and p99;
* hypotheses: how many are followed at once;
* fleet: the same for many tours side by side (names and channels prefixed), and memory per machine;
* memory over a long run;
* beside python-statemachine, which only steps the same inputs through the same chart.
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

from msgspec.structs import replace

from benchmarks.machine import BatteryLevelChart
from benchmarks.page import Row, publish, slower
from benchmarks.processes import ROOT, resident_mb
from m2c.launch.in_process import Program, SimulatedRun, compile_system
from m2c.model import DiagnosticLog, load
from m2c.model.machine import Machine
from m2c.model.system import System
from moon.monitor.models import ModelMonitor
from transports.interface import Observation, ObservationKind
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


class Quantiles(NamedTuple):
    """Of processor time, µs."""

    p50: float
    p99: float


def quantiles_of(taken_ns: list[int]) -> Quantiles:
    """The quantiles of single measurements."""
    taken_ns.sort()
    return Quantiles(*(taken_ns[int(len(taken_ns) * part)] / 1000 for part in (0.5, 0.99)))


def single_costs(
    system: System, observations: Sequence[Observation], began_ns: int
) -> tuple[Quantiles, Quantiles]:
    """What one observation costs, and what it costs all oracles that 10 ms have passed."""
    monitor = monitor_of(system.nodes, system, began_ns)
    gc.freeze()
    clock, advanced_ns = time.thread_time_ns, 0
    fed: list[int] = []
    advanced: list[int] = []
    for seen in observations:
        if seen.received_ns >= advanced_ns + PERIOD_NS:
            advanced_ns = seen.received_ns
            began = clock()
            monitor.advance(advanced_ns)
            advanced.append(clock() - began)
        began = clock()
        monitor.feed(seen)
        fed.append(clock() - began)
    return quantiles_of(fed), quantiles_of(advanced)


def most_hypotheses(system: System, observations: Sequence[Observation], began_ns: int) -> int:
    """The largest set of any oracle after any observation."""
    monitor = monitor_of(system.nodes, system, began_ns)
    most = 0
    for seen in observations:
        monitor.feed(seen)
        most = max(most, *(len(oracle.hypotheses) for oracle in monitor.oracles.values()))
    return most


def memory_over_time(wanted: int) -> list[tuple[int, int]]:
    """(observations judged, KB of this process) at eight moments of one long run.

    For a fresh process: what others have freed would hide what grows.
    """
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    program = compile_system(system)
    monitor: ModelMonitor | None = None
    count, advanced_ns = 0, 0
    marks: list[tuple[int, int]] = []

    def hear(seen: Observation) -> None:
        nonlocal monitor, count, advanced_ns
        if monitor is None:
            monitor = monitor_of(system.nodes, system, seen.stamp_ns - 1)
        count += 1
        if seen.received_ns >= advanced_ns + PERIOD_NS:
            advanced_ns = seen.received_ns
            monitor.advance(advanced_ns)
        monitor.feed(seen)
        if count % (wanted // 8) == 0:
            gc.collect()
            marks.append((count, int(resident_mb() * 1024)))

    # the tour makes about 190 observations a second
    tour(program, wanted / 180, hear)
    return marks


def beside_statemachine(
    system: System, observations: Sequence[Observation], began_ns: int
) -> tuple[float, float, int]:
    """Seconds that the oracle of BatteryLevelSkill takes, those of the peer, and how many inputs."""
    machine = system.node("BatteryLevelSkill")
    assert machine is not None
    channels = {item.channel for item in machine.interfaces}
    own = [seen for seen in observations if seen.channel in channels]
    ours, _ = judge(monitor_of([machine], system, began_ns), own)
    steps = [
        "level" if seen.kind is ObservationKind.MESSAGE else "tick"
        for seen in own
        if seen.kind in (ObservationKind.MESSAGE, ObservationKind.REQUEST_RECEIVED)
    ]
    chart = BatteryLevelChart()
    began = time.process_time()
    for step in steps:
        if step == "level":
            chart.send("level", data=50)
        else:
            chart.send("tick")
    return ours, time.process_time() - began, len(steps)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=120.0, help="of the recorded tour")
    parser.add_argument(
        "--tours", type=int, default=59, help="of the largest fleet (59: 1003 machines)"
    )
    parser.add_argument(
        "--observations", type=int, default=300_000, help="of the long run for memory"
    )
    arguments = parser.parse_args()

    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    program = compile_system(system)
    heard: list[Observation] = []
    began_ns = tour(program, arguments.seconds, heard.append)
    print(
        f"lab tour, {arguments.seconds:g} s: {len(heard)} observations, {len(system.nodes)} machines"
    )
    runs = [judge(monitor_of(system.nodes, system, began_ns), heard)[0] for _ in range(3)]
    speed = len(heard) / min(runs)
    fed, advanced = single_costs(system, heard, began_ns)
    most = most_hypotheses(system, heard, began_ns)
    one, all_tours = (fleet_speed(system, heard, began_ns, size) for size in (1, arguments.tours))
    size = min(arguments.tours, 10)
    per_machine = memory_per_machine(system, heard, began_ns, size)

    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as fresh:
        marks = fresh.submit(memory_over_time, arguments.observations).result()
    grown = (marks[-1][1] - marks[3][1]) * 1024 / (marks[-1][0] - marks[3][0])

    ours, theirs, steps = beside_statemachine(system, heard, began_ns)
    publish(
        [
            slower(
                "BatteryLevelSkill's oracle, an input and its answer judged",
                ours / steps * 1e6,
                "µs",
                "python-statemachine, only stepped",
                theirs / steps * 1e6,
            ),
            Row(f"{len(system.nodes)} machines", speed, "observations/s", least=100_000.0),
            Row("one observation, p50", fed.p50, "µs"),
            Row("one observation, p99", fed.p99, "µs", most=40.0),
            Row("10 ms have passed for all, p50", advanced.p50, "µs"),
            Row("hypotheses at once", most, "", most=16.0),
            Row("memory of a machine", per_machine, "KB", most=100.0),
            slower(
                f"an observation among {arguments.tours * len(system.nodes):,} machines",
                1e6 / all_tours,
                "µs",
                f"among {len(system.nodes)}",
                1e6 / one,
            ),
            Row(f"growth over {arguments.observations:,} observations", grown, "bytes each"),
        ]
    )


if __name__ == "__main__":
    main()
