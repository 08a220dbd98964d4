"""What is measured, on one transport: table III, and how the cost grows. All of it in rounds.

Two sets of the same nodes run all the time for table III: in one the skills and the policy call each other,
in the other they call the monitored names, which nobody serves but the man in the middle. Monitors come
and go; everything else stays as it is.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec
from msgspec.structs import replace

from benchmarks.processes import Child, ChildError, machine_s
from benchmarks.sampling import rounds
from benchmarks.ticking import (
    CLIENT,
    SERVER,
    WHOLE,
    Order,
    at_rate,
    called,
    listeners,
    middleware,
    ordered,
)
from examples.overhead import fleet
from examples.overhead.blocks import NOBODY, TABLE3, Block
from examples.overhead.observers import CONFIGURATIONS, Configuration, deaf, observed, told
from examples.overhead.plant import Plant, running

CORE = ("none", "control", "both")
"""What there are targets for, and what it is compared with."""
SETTLE_HZ = 10.0
FLEET_RATE_HZ = 100.0
"""Ticks of all skills together: the same load however many are monitored."""
PAYLOAD_RATE_HZ = 20.0

Say = Callable[[str], None]
"""Told what is going on."""


class Plan(msgspec.Struct, frozen=True):
    """How much of table III is measured.

    Attributes:
        rounds: how often each configuration has its turn.
        few: how often those have it that are far from any target (``CORE`` is the others).
        ticks: by rate (ticks of the tree a second; 0: saturation), how many in each block.
        settle: ticks at ten a second, not measured, once the monitors of a turn (or none) are there: who
            joins in the middle has to find every machine, and what it runs is cold.
        warm_up: ticks before each block, not measured.
        run_in: ticks once, before the first round, not measured.
        seed: of the order.
    """

    rounds: int
    ticks: dict[float, int]
    settle: int = 30
    warm_up: int = 10
    run_in: int = 200
    seed: int = 3
    few: int | None = None

    def has_turn(self, configuration: Configuration, number: int) -> bool:
        """Whether ``configuration`` is measured in round ``number``."""
        return self.few is None or number < self.few or configuration.name in CORE


class GrowthPlan(msgspec.Struct, frozen=True):
    """How much of a growth is measured.

    Attributes:
        rounds: how often each point is measured.
        taps, skills, rates, sizes: the points (rates in ticks/s, 0 is saturation; sizes in bytes).
        ticks: in each block, at most.
        seconds: a block at a slow rate is over after so long.
    """

    rounds: int = 4
    taps: tuple[int, ...] = (0, 1, 2, 4, 8)
    skills: tuple[int, ...] = (1, 10, 50, 100, 200)
    rates: tuple[float, ...] = (3, 10, 30, 100, 0)
    sizes: tuple[int, ...] = (16, 256, 4_096, 65_536, 1_048_576)
    ticks: int = 60
    seconds: float = 3.0
    seed: int = 5

    def block(self, rate_hz: float) -> int:
        """How many ticks a block at this rate has."""
        return self.ticks if not rate_hz else max(5, min(self.ticks, int(rate_hz * self.seconds)))


QUICK_GROWTH = GrowthPlan(rounds=1, taps=(0, 1, 4), ticks=20, seconds=1.0)


def block_of(
    place: tuple[str, str, float, float, str],
    number: int,
    watchers: Sequence[Child],
    ticking: Child,
    order: Order,
) -> Block:
    """One block.

    Args:
        place: :attr:`Block.place`.
        number: of the round.
        watchers: whose processor time counts.
        ticking: who makes the ticks.
        order: how many of them, at which rate.
    """
    used, (busy, all_of_it) = [child.processor_s() for child in watchers], machine_s()
    taken = ordered(ticking, order)
    used_after, (busy_after, all_after) = [child.processor_s() for child in watchers], machine_s()
    failures = {**taken.failures}
    failures[WHOLE] = failures.get(WHOLE, 0) + taken.warm_up_failures
    # growth is that of whole ticks
    values = taken.micros if place[0] == TABLE3 else {WHOLE: taken.micros[WHOLE]}
    return Block(
        *place,
        number,
        values,
        failures,
        tuple(taken.reasons),
        (sum(used_after) - sum(used)) / taken.seconds,
        (busy_after - busy) / max(all_after - all_of_it, 1e-9),
        len(taken.micros.get(WHOLE, ())) / taken.seconds,
    )


def measure_table3(
    transport: str,
    plan: Plan,
    say: Say,
    configurations: Sequence[Configuration] = CONFIGURATIONS,
) -> Iterator[Block]:
    """All rounds of ``plan``; ``NOBODY`` must be among the configurations.

    A turn that cannot be measured is said and left out: that is better than none of the others.

    Raises:
        MiddlewareMissingError: ROS 2 is not installed.
        ChildError: the nodes do not come up.
    """
    with contextlib.ExitStack() as stack:
        plants = {
            middle: stack.enter_context(running(transport, middle))
            for middle in sorted({bool(c.middle) for c in configurations})
        }
        if plan.run_in and False in plants:
            say(f"{transport}: {plan.run_in} ticks that do not count: everything is cold at first")
            plants[False].run(Order(plan.run_in, 0.0, 0, rest=True))
        for number, configuration in rounds(configurations, plan.rounds, plan.seed):
            if plan.has_turn(configuration, number):
                say(f"{transport}: round {number + 1} of {plan.rounds}, {configuration.label}")
                plant = plants[bool(configuration.middle)]
                try:
                    turn = _turn(plant, plan, configuration, number)
                except ChildError as error:
                    say(f"{transport}: {configuration.label}: not measured: {error}")
                    continue
                if turn[0].deaf:
                    say(f"{transport}: {configuration.label}: {turn[0].deaf}")
                yield from turn


def _turn(plant: Plant, plan: Plan, configuration: Configuration, number: int) -> list[Block]:
    """One configuration's blocks of a round, the fastest rate last.

    For seconds after saturation a monitor works off what properties' windows have of it.
    """
    turn = []
    with observed(configuration, plant) as observers:
        settled = plant.run(Order(plan.settle, SETTLE_HZ, 0))
        if any(settled.failures.values()):
            raise ChildError(f"ticks failed before anything was measured: {settled.reasons[:3]}")
        for rate_hz in sorted(plan.ticks, key=lambda rate: rate or float("inf")):
            order = Order(plan.ticks[rate_hz], rate_hz, plan.warm_up)
            place = (TABLE3, plant.where.transport, rate_hz, 0.0, configuration.name)
            turn.append(block_of(place, number, observers.processes, plant.load, order))
    ticks = plan.settle + sum(plan.ticks.values()) + plan.warm_up * len(plan.ticks)
    heard = observers.heard
    why = deaf(configuration, heard, ticks)
    return [replace(item, lag_ms=heard.lag_ms, deaf=why) for item in turn]


def measure_taps(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Block]:
    """ROOT against the number of taps, each a process that decodes everything it hears."""
    with running(transport) as plant:
        names = [*plant.names, "policy"]
        for number, count in rounds(plan.taps, plan.rounds, plan.seed):
            say(f"{transport}: round {number + 1} of {plan.rounds}, {count} taps")
            with contextlib.ExitStack() as stack:
                taps = listeners(stack, plant.where, names, count)
                for rate_hz in (10.0, 0.0):
                    order = Order(plan.block(rate_hz), rate_hz)
                    place = ("taps", transport, rate_hz, count, "tap" if count else NOBODY)
                    yield _tapped(place, number, taps, plant.load, order)
                plant.rest()


def measure_rates(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Block]:
    """ROOT against the rate of the tree, unmonitored and with everything monitored passively."""
    chosen = [item for item in CONFIGURATIONS if item.name in (NOBODY, "both")]
    with running(transport) as plant:
        turns = [(rate_hz, item) for rate_hz in plan.rates for item in chosen]
        for number, (rate_hz, configuration) in rounds(turns, plan.rounds, plan.seed):
            say(f"{transport}: round {number + 1} of {plan.rounds}, {at_rate(rate_hz)}")
            order = Order(plan.block(rate_hz), rate_hz, 3 if 0 < rate_hz < 5 else 5)
            place = ("rate", transport, rate_hz, 0.0, configuration.name)
            with observed(configuration, plant) as observers:
                block = block_of(place, number, observers.processes, plant.load, order)
            heard = observers.heard
            yield replace(block, lag_ms=heard.lag_ms, deaf=deaf(configuration, heard, order.ticks))


def measure_skills(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Block]:
    """One tick against the number of skills that ``moon monitor`` has models of; on Zenoh."""
    for count in plan.skills:
        with contextlib.ExitStack() as stack:
            scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fleet-")))
            say(f"{transport}: starting {count} skills")
            folder, clients, load = fleet.start(stack, scratch, count)
            for number, watched in rounds((False, True), plan.rounds, plan.seed):
                say(f"{transport}: round {number + 1} of {plan.rounds}, {count} skills")
                order = Order(plan.ticks, FLEET_RATE_HZ, max(10, count))
                place = ("skills", transport, FLEET_RATE_HZ, count, "models" if watched else NOBODY)
                watchers = [fleet.monitor(folder, clients, count)] if watched else []
                block = block_of(place, number, watchers, load, order)
                lags = [told(watcher.stop()).lag_ms for watcher in watchers]
                yield replace(block, lag_ms=lags[0] if lags else None)


def measure_payloads(transport: str, plan: GrowthPlan, say: Say) -> Iterator[Block]:
    """One call against the size of its answer, untapped and tapped."""
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(middleware(transport))
        caller = called(stack, where, plan.sizes)
        turns = [(size, count) for size in plan.sizes for count in (0, 1)]
        for number, (size, count) in rounds(turns, plan.rounds, plan.seed):
            say(f"{transport}: round {number + 1} of {plan.rounds}, {size} bytes")
            order = Order(plan.block(PAYLOAD_RATE_HZ), PAYLOAD_RATE_HZ, size=size)
            place = ("payload", transport, PAYLOAD_RATE_HZ, size, "tap" if count else NOBODY)
            with contextlib.ExitStack() as turn:
                taps = listeners(turn, where, [SERVER, CLIENT], count)
                yield _tapped(place, number, taps, caller, order)


MEASURES: dict[str, Callable[[str, GrowthPlan, Say], Iterator[Block]]] = {
    "taps": measure_taps,
    "skills": measure_skills,
    "rate": measure_rates,
    "payload": measure_payloads,
}


def _tapped(
    place: tuple[str, str, float, float, str],
    number: int,
    taps: Sequence[Child],
    ticking: Child,
    order: Order,
) -> Block:
    """A block and how late its taps heard of it: the slowest one's lag."""
    for tap in taps:
        tap.ask({})  # what it heard before
    block = block_of(place, number, taps, ticking, order)
    reports = [tap.ask({}) for tap in taps]
    return replace(
        block,
        lag_ms=max((report["lag_p50_ms"] for report in reports), default=None),
        lag_p99_ms=max((report["lag_p99_ms"] for report in reports), default=None),
        deaf="" if all(report["heard"] for report in reports) else "a tap heard nothing",
    )
