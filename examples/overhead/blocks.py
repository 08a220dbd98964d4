"""What was measured, block by block, and the figures that are made of it."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Sequence

import msgspec

from benchmarks import sampling
from benchmarks.ticking import WHOLE
from examples.overhead.observers import CONFIGURATIONS, NOBODY

SERIES = ("BatteryLevel", "IsPoiDone1", "SetPoi1", "Alarm", WHOLE)
"""The rows of the paper's table, in its order."""
PAPER: dict[str, dict[str, int]] = {
    "BatteryLevel": {"none": 3_877, "properties": 4_103, "models": 56_943, "both": 65_670},
    "IsPoiDone1": {"none": 6_906, "properties": 7_030, "models": 314_621, "both": 327_816},
    "SetPoi1": {"none": 6_094, "properties": 7_663, "models": 308_686, "both": 333_764},
    "Alarm": {"none": 4_699, "properties": 8_151, "models": 284_138, "both": 298_117},
    WHOLE: {"none": 29_904, "properties": 37_036, "models": 810_121, "both": 864_467},
}
"""Its table III: average tick times in µs, conf 1 to 4, on the authors' machine with ROS 2 and C++."""


class Block(msgspec.Struct, frozen=True):
    """One configuration measured without a break.

    Attributes:
        rate_hz: ticks a second; 0: saturation.
        configuration: who watches; ``NOBODY``: what the others are compared with.
        values: by series, what each tick took in µs (failed ones are among them).
        failures: by series, ticks that failed; of ``WHOLE`` those before the block, too.
        processor: processor time of who watches, in seconds a second.
        lag_ms: from an event to the slowest watcher; None if not known.
        deaf: why it does not count as monitored; "" if it does.
    """

    transport: str
    rate_hz: float
    configuration: str
    round: int
    values: dict[str, list[float]]
    failures: dict[str, int]
    processor: float = 0.0
    lag_ms: float | None = None
    deaf: str = ""

    @property
    def place(self) -> tuple[str, float, str]:
        """What all rounds of a figure have in common."""
        return self.transport, self.rate_hz, self.configuration


class Cell(msgspec.Struct, frozen=True):
    """One figure: one series of all blocks of one place, whose fields are as those of :class:`Block`.

    Attributes:
        found: of its values.
        ratio: to nobody watching, in the same rounds.
        failures: ticks that failed, of ``found.count``.
        processor: the mean of the blocks.
        lag_ms: the median of the blocks.
        deaf: why blocks do not count as monitored, a reason for each.
    """

    transport: str
    rate_hz: float
    configuration: str
    series: str
    found: sampling.Distribution
    ratio: sampling.Estimate
    rounds: int
    failures: int
    processor: float
    lag_ms: float | None
    deaf: tuple[str, ...]


_ORDER = {item.name: number for number, item in enumerate(CONFIGURATIONS)}


def _order(place: tuple[str, float, str]) -> tuple[bool, float, int]:
    """Transports, rates with saturation last, configurations."""
    transport, rate_hz, name = place
    return transport != "zenoh", rate_hz or float("inf"), _ORDER[name]


def cells(blocks: Sequence[Block]) -> list[Cell]:
    """All figures, of what was measured in the same rounds as nobody watching."""
    by_place: dict[tuple[str, float, str], dict[int, Block]] = defaultdict(dict)
    for block in blocks:
        by_place[block.place][block.round] = block
    found = []
    for place in sorted(by_place, key=_order):
        own, bases = by_place[place], by_place.get((*place[:2], NOBODY), {})
        common = sorted(own.keys() & bases.keys())
        pairs = [(own[number], bases[number]) for number in common]
        if pairs:
            found += [_cell(list(own.values()), pairs, series) for series in pairs[0][0].values]
    return found


def _cell(own: Sequence[Block], pairs: Sequence[tuple[Block, Block]], series: str) -> Cell:
    lags = [block.lag_ms for block in own if block.lag_ms is not None]
    return Cell(
        *own[0].place,
        series,
        sampling.distribution([block.values[series] for block in own]),
        sampling.ratio(
            [block.values[series] for block, _ in pairs],
            [base.values[series] for _, base in pairs],
        ),
        len(own),
        sum(block.failures.get(series, 0) for block in own),
        statistics.fmean(block.processor for block in own),
        statistics.median(lags) if lags else None,
        tuple(block.deaf for block in own if block.deaf),
    )


MOST = {("zenoh", False): 1.05, ("zenoh", True): 1.35, ("ros2", False): 1.10, ("ros2", True): 1.5}
"""By transport and whether the load is saturated."""


def targets(found: Sequence[Cell]) -> list[tuple[Cell, float]]:
    """What passive monitoring of everything costs whole ticks, and the most that it may cost, as a ratio."""
    return [
        (cell, MOST[cell.transport, not cell.rate_hz])
        for cell in found
        if (cell.configuration, cell.series) == ("both", WHOLE)
    ]
