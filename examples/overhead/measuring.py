"""Table III measured on one transport, in rounds.

Two sets of the same nodes run all the time: in one the skills and the policy call each other, in the other
they call the monitored names, which nobody serves but the man in the middle. Monitors come and go;
everything else stays as it is.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import msgspec
from msgspec.structs import replace

from benchmarks.processes import ChildError
from benchmarks.sampling import rounds
from benchmarks.ticking import WHOLE, Order
from examples.overhead.blocks import Block
from examples.overhead.observers import CONFIGURATIONS, NOBODY, Configuration, deaf, observed
from examples.overhead.plant import Plant, running

CORE = (NOBODY, "control", "both")
"""What there are targets for, and what it is compared with."""
SETTLE_HZ = 10.0

Say = Callable[[str], None]
"""Told what is going on."""


class Plan(msgspec.Struct, frozen=True):
    """How much of table III is measured.

    Attributes:
        rounds: how often each configuration has its turn.
        ticks: by rate (ticks of the tree a second; 0: saturation), how many in each block.
        names: of the configurations, ``NOBODY`` among them.
        few: how often those have it that are far from any target (``CORE`` is the others).
        settle: ticks at ten a second, not measured, once the monitors of a turn (or none) are there: who
            joins in the middle has to find every machine, and what it runs is cold.
        warm_up: ticks before each block, not measured.
        run_in: ticks once, before the first round, not measured.
        seed: of the order.
    """

    rounds: int
    ticks: dict[float, int]
    names: tuple[str, ...] = tuple(item.name for item in CONFIGURATIONS)
    few: int | None = None
    settle: int = 30
    warm_up: int = 10
    run_in: int = 200
    seed: int = 3

    def turns(self) -> Iterator[tuple[int, Configuration]]:
        """Each round's configurations, with the number of the round."""
        chosen = [item for item in CONFIGURATIONS if item.name in self.names]
        for number, item in rounds(chosen, self.rounds, self.seed):
            if self.few is None or number < self.few or item.name in CORE:
                yield number, item


def measure(transport: str, plan: Plan, say: Say) -> Iterator[Block]:
    """All rounds of ``plan``.

    A turn that cannot be measured is said and left out: that is better than none of the others.

    Raises:
        MiddlewareMissingError: ROS 2 is not installed.
        ChildError: the nodes do not come up.
    """
    turns = list(plan.turns())
    with contextlib.ExitStack() as stack:
        plants = {
            middle: stack.enter_context(running(transport, middle))
            for middle in sorted({bool(configuration.middle) for _, configuration in turns})
        }
        if plan.run_in:
            say(f"{transport}: {plan.run_in} ticks that do not count: everything is cold at first")
            plants[False].run(Order(plan.run_in, 0.0, 0, rest=True))
        for number, configuration in turns:
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
            used = observers.processor_s()
            taken = plant.run(Order(plan.ticks[rate_hz], rate_hz, plan.warm_up))
            used = observers.processor_s() - used
            failures = {**taken.failures}
            failures[WHOLE] += taken.warm_up_failures
            place = plant.where.transport, rate_hz, configuration.name, number
            turn.append(Block(*place, taken.micros, failures, used / taken.seconds))
    ticks = plan.settle + sum(plan.ticks.values()) + plan.warm_up * len(plan.ticks)
    heard = observers.heard
    why = deaf(configuration, heard, ticks)
    return [replace(item, lag_ms=heard.lag_ms, deaf=why) for item in turn]
