"""The paper's table III again: what a tick takes, by who monitors and how.

``python -m examples.overhead.table3 [--transport zenoh|ros2] [--rounds N] …`` measures and prints it.

Two sets of the same nodes run all the time: in one the skills and the policy call each other, in the
other they call the monitored names, which nobody serves but the man in the middle. Monitors come and go
in rounds; everything else stays as it is.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from examples.overhead import accounts, sample
from examples.overhead.children import ChildError
from examples.overhead.load import ROOT, Order
from examples.overhead.observers import (
    CONFIGURATIONS,
    Configuration,
    Heard,
    Observation,
    deaf,
    observed,
)
from examples.overhead.plant import Plant, generate, middleware
from examples.overhead.schedule import rounds, same_rounds

SERIES = ("BatteryLevel", "IsPoiDone1", "SetPoi1", "Alarm", ROOT)
"""The rows of the paper's table, in its order."""

PAPER: dict[str, dict[str, int]] = {
    "BatteryLevel": {"none": 3_877, "properties": 4_103, "models": 56_943, "both": 65_670},
    "IsPoiDone1": {"none": 6_906, "properties": 7_030, "models": 314_621, "both": 327_816},
    "SetPoi1": {"none": 6_094, "properties": 7_663, "models": 308_686, "both": 333_764},
    "Alarm": {"none": 4_699, "properties": 8_151, "models": 284_138, "both": 298_117},
    ROOT: {"none": 29_904, "properties": 37_036, "models": 810_121, "both": 864_467},
}
"""Its table III: average tick times in µs, conf 1 to 4, on the authors' machine with ROS 2 and C++."""


CORE = ("none", "control", "both")
"""What there are targets for, and what it is compared with."""


class Plan(msgspec.Struct, frozen=True):
    """How much is measured.

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


class Block(msgspec.Struct, frozen=True):
    """One configuration measured without a break at one rate.

    Attributes:
        micros: per row of the table, how long each tick took; failed ones are among them.
        failures: per row, how many ticks failed.
        reasons: why, the first few, or why the block does not count as monitored.
        processor: processor time of the monitors, in seconds a second.
        busy: how much of the machine was busy, 0 to 1.
        ticks_per_s: ticks of the tree that were made in a second.
    """

    transport: str
    rate_hz: float
    configuration: str
    round: int
    micros: dict[str, list[float]]
    failures: dict[str, int]
    reasons: tuple[str, ...]
    processor: float
    busy: float
    ticks_per_s: float


class Attachment(msgspec.Struct, frozen=True):
    """One configuration's turn in a round: what its monitors did, "" in ``deaf`` if it was their work."""

    transport: str
    configuration: str
    round: int
    heard: Heard
    deaf: str


class Measured(msgspec.Struct, frozen=True):
    """Everything that was measured."""

    blocks: tuple[Block, ...]
    attachments: tuple[Attachment, ...]


class Cell(msgspec.Struct, frozen=True):
    """One figure of the table.

    Attributes:
        micros: how long ticks took.
        ratio: to no monitor, in the same rounds at the same rate.
        failures: ticks that failed, of ``micros.count``.
        processor: of the monitors, in seconds a second, mean of the blocks.
    """

    transport: str
    rate_hz: float
    configuration: str
    series: str
    micros: sample.Distribution
    ratio: sample.Estimate
    failures: int
    processor: float


SETTLE_HZ = 10.0

Say = Callable[[str], None]


def measure(
    transport: str,
    plan: Plan,
    say: Say,
    configurations: Sequence[Configuration] = CONFIGURATIONS,
) -> Measured:
    """Run all rounds of ``plan`` on one transport.

    Args:
        transport: ``zenoh`` or ``ros2``.
        plan: how much.
        say: told what is going on.
        configurations: "none" must be among them.

    Raises:
        MiddlewareMissingError: ROS 2 is not installed.
        ChildError: the nodes do not come up.
    """
    blocks: list[Block] = []
    attachments: list[Attachment] = []
    with contextlib.ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="overhead-")))
        plants: dict[bool, Plant] = {}
        for middle in sorted({c.observation.is_in_the_middle for c in configurations}):
            where = stack.enter_context(middleware(transport))
            folder = generate(scratch / ("middle" if middle else "direct"), middle)
            say(f"{transport}: starting {'the nodes again, rerouted' if middle else 'the nodes'}")
            plants[middle] = stack.enter_context(Plant(where, folder, middle))
        if plan.run_in and False in plants:
            say(f"{transport}: {plan.run_in} ticks that do not count: everything is cold at first")
            plants[False].run(Order(plan.run_in, 0.0, 0, rest=True))
        for number, configuration in rounds(configurations, plan.rounds, plan.seed):
            if not plan.has_turn(configuration, number):
                continue
            say(f"{transport}: round {number + 1} of {plan.rounds}, {configuration.label}")
            plant = plants[configuration.observation.is_in_the_middle]
            turn: list[Block] = []
            heard = Heard()
            try:
                with observed(configuration, plant) as observers:
                    _settle(plant, plan.settle)
                    for rate_hz in sorted(plan.ticks, key=_pace):
                        turn.append(
                            _block(
                                plant, observers.processor_s, configuration, number, rate_hz, plan
                            )
                        )
                blocks += turn
                heard = observers.heard
                ticks = plan.settle + sum(plan.ticks.values()) + plan.warm_up * len(plan.ticks)
                why = deaf(configuration, heard, ticks)
            except ChildError as error:  # one turn less is better than none of the others
                why = f"not measured: {error}"
            if why:
                say(f"{transport}: {configuration.label}: {why}")
            attachments.append(Attachment(transport, configuration.name, number, heard, why))
    return Measured(tuple(blocks), tuple(attachments))


def _pace(rate_hz: float) -> float:
    """Saturation comes last: for seconds after it a monitor works off what properties' windows have of it."""
    return rate_hz or float("inf")


def _settle(plant: Plant, ticks: int) -> None:
    """Tick until all is warm and known.

    Raises:
        ChildError: ticks fail already.
    """
    taken = plant.run(Order(ticks, SETTLE_HZ, 0))
    if any(taken.failures.values()):
        raise ChildError(f"ticks failed before anything was measured: {taken.reasons[:3]}")


def _block(
    plant: Plant,
    processor_s: Callable[[], float],
    configuration: Configuration,
    number: int,
    rate_hz: float,
    plan: Plan,
) -> Block:
    used, (busy, all_of_it) = processor_s(), accounts.machine_s()
    taken = plant.run(Order(plan.ticks[rate_hz], rate_hz, plan.warm_up))
    used_after, (busy_after, all_after) = processor_s(), accounts.machine_s()
    reasons = list(taken.reasons)
    if taken.warm_up_failures:
        reasons.append(f"{taken.warm_up_failures} ticks of the warm-up failed")
    return Block(
        plant.where.transport,
        rate_hz,
        configuration.name,
        number,
        taken.micros,
        taken.failures,
        tuple(reasons),
        (used_after - used) / taken.seconds,
        (busy_after - busy) / max(all_after - all_of_it, 1e-9),
        len(taken.micros.get(ROOT, ())) / taken.seconds,
    )


def cells(measured: Measured) -> list[Cell]:
    """The table's figures, in the order of transports, rates, configurations, rows."""
    found = []
    places = dict.fromkeys((b.transport, b.rate_hz, b.configuration) for b in measured.blocks)
    order = [configuration.name for configuration in CONFIGURATIONS]
    for transport, rate_hz, name in sorted(
        places, key=lambda p: (p[0] != "zenoh", p[1] == 0, p[1], order.index(p[2]))
    ):
        own = _blocks_of(measured, transport, rate_hz, name)
        pairs = same_rounds(own, _blocks_of(measured, transport, rate_hz, "none"))
        for series in SERIES if pairs else ():
            found.append(
                Cell(
                    transport,
                    rate_hz,
                    name,
                    series,
                    sample.distribution([block.micros[series] for block in own]),
                    sample.ratio(
                        [block.micros[series] for block, _ in pairs],
                        [block.micros[series] for _, block in pairs],
                    ),
                    sum(block.failures[series] for block in own),
                    sum(block.processor for block in own) / len(own),
                )
            )
    return found


def _blocks_of(measured: Measured, transport: str, rate_hz: float, name: str) -> list[Block]:
    """In the order of the rounds."""
    found = [
        block
        for block in measured.blocks
        if (block.transport, block.rate_hz, block.configuration) == (transport, rate_hz, name)
    ]
    return sorted(found, key=lambda block: block.round)


class Target(msgspec.Struct, frozen=True):
    """What passive monitoring of everything may cost ROOT, as a ratio, and what it costs."""

    transport: str
    rate_hz: float
    most: float
    found: sample.Estimate

    @property
    def is_met(self) -> bool:
        """Whether the ratio is within what is allowed."""
        return self.found.value <= self.most


MOST = {("zenoh", False): 1.05, ("zenoh", True): 1.35, ("ros2", False): 1.10, ("ros2", True): 1.5}
"""By transport and whether the load is saturated."""


def targets(found: Sequence[Cell]) -> list[Target]:
    """Those that can be looked up in ``found``."""
    return [
        Target(cell.transport, cell.rate_hz, MOST[cell.transport, cell.rate_hz == 0], cell.ratio)
        for cell in found
        if cell.configuration == "both" and cell.series == ROOT
    ]


def passive_only() -> list[Configuration]:
    """The configurations in which nobody stands in the middle."""
    return [c for c in CONFIGURATIONS if not c.observation.is_in_the_middle]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    from examples.overhead.tables import beside_the_paper, details, print_table

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--transport", choices=("zenoh", "ros2"), default="zenoh")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--ticks", type=int, default=50, help="in each block")
    parser.add_argument("--rate", type=float, action="append", help="ticks a second; 0: saturation")
    parser.add_argument("--seed", type=int, default=3)
    chosen = parser.parse_args(arguments)
    plan = Plan(
        chosen.rounds, dict.fromkeys(chosen.rate or [10.0, 0.0], chosen.ticks), seed=chosen.seed
    )
    measured = measure(chosen.transport, plan, lambda text: print(text, file=sys.stderr))
    found = cells(measured)
    for table in (*beside_the_paper(found), *details(measured, found)):
        print_table(table)
    return 0


__all__ = ["Observation", "Plan", "cells", "measure"]

if __name__ == "__main__":
    sys.exit(main())
