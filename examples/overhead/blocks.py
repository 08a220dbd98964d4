"""What was measured, block by block, and the figures that are made of it."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterable, Sequence

import msgspec

from benchmarks import sampling
from benchmarks.ticking import WHOLE
from examples.overhead.observers import CONFIGURATIONS

TABLE3, COST = "table3", "cost"
GROWTH = ("taps", "skills", "rate", "payload")
EXPERIMENTS = (TABLE3, *GROWTH, COST)
NOBODY = "none"
"""The configuration that the others are compared with."""
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
        experiment: one of ``EXPERIMENTS``.
        rate_hz: ticks a second; 0: saturation.
        x: how many taps or skills, or bytes of an answer; 0 in other experiments.
        configuration: who watches; ``NOBODY``: what the others are compared with.
        values: by series, what each tick took in µs (failed ones are among them); of ``COST`` one value
            of each account.
        failures: by series, ticks that failed; of WHOLE those before the block, too.
        reasons: why they failed, the first few.
        processor: processor time of who watches, in seconds a second.
        busy: how much of the machine was busy, 0 to 1.
        lag_ms, lag_p99_ms: from an event to the slowest watcher; None if not known.
        deaf: why it does not count as monitored; "" if it does.
    """

    experiment: str
    transport: str
    rate_hz: float
    x: float
    configuration: str
    round: int
    values: dict[str, list[float]]
    failures: dict[str, int]
    reasons: tuple[str, ...] = ()
    processor: float = 0.0
    busy: float = 0.0
    ticks_per_s: float = 0.0
    lag_ms: float | None = None
    lag_p99_ms: float | None = None
    deaf: str = ""

    @property
    def place(self) -> tuple[str, str, float, float, str]:
        """What all rounds of a figure have in common."""
        return self.experiment, self.transport, self.rate_hz, self.x, self.configuration


class Cell(msgspec.Struct, frozen=True):
    """One figure: one series of all blocks of one place, whose fields are as those of :class:`Block`.

    Attributes:
        found: of its values.
        alone: the median of nobody watching, in the same rounds.
        ratio: to that; None where a value is not positive.
        failures: ticks that failed, of ``found.count``.
        processor, busy: means of the blocks.
        ticks_per_s, lag_ms, lag_p99_ms: medians of the blocks.
        deaf: blocks that do not count as monitored.
    """

    experiment: str
    transport: str
    rate_hz: float
    x: float
    configuration: str
    series: str
    found: sampling.Distribution
    alone: float
    ratio: sampling.Estimate | None
    rounds: int
    failures: int
    processor: float
    busy: float
    ticks_per_s: float
    lag_ms: float | None
    lag_p99_ms: float | None
    deaf: int

    @property
    def line(self) -> tuple[str, str, float]:
        """What all points of one growth have in common; the rate is no part of it where it grows."""
        return self.experiment, self.transport, -1.0 if self.experiment == "rate" else self.rate_hz


_ORDER = {item.name: place for place, item in enumerate(CONFIGURATIONS)}


def _order(place: tuple[str, str, float, float, str]) -> tuple[object, ...]:
    """Experiments, transports, rates with saturation last, points, configurations."""
    experiment, transport, rate_hz, x, name = place
    rate = rate_hz or float("inf")
    return EXPERIMENTS.index(experiment), transport != "zenoh", rate, x, _ORDER.get(name, 99), name


def cells(blocks: Sequence[Block]) -> list[Cell]:
    """All figures, of what was measured in the same rounds as nobody watching."""
    by_place: dict[tuple[str, str, float, float, str], dict[int, Block]] = defaultdict(dict)
    for block in blocks:
        by_place[block.place][block.round] = block
    found = []
    for place in sorted(by_place, key=_order):
        experiment, transport, rate_hz, x, _ = place
        # no taps at all is what any number of taps is compared with
        nobody = (experiment, transport, rate_hz, 0.0 if experiment == "taps" else x, NOBODY)
        bases = by_place.get(nobody, {})
        own = [by_place[place][number] for number in sorted(by_place[place])]
        pairs = [(block, bases[block.round]) for block in own if block.round in bases]
        if pairs:
            found += [_cell(own, pairs, series) for series in own[0].values]
    return found


def _cell(own: Sequence[Block], pairs: Sequence[tuple[Block, Block]], series: str) -> Cell:
    values = [block.values[series] for block, _ in pairs]
    others = [base.values[series] for _, base in pairs]
    is_positive = all(value > 0 for part in (*values, *others) for value in part)
    return Cell(
        *own[0].place,
        series,
        sampling.distribution([block.values[series] for block in own]),
        statistics.median(statistics.median(part) for part in others),
        sampling.ratio(values, others) if is_positive else None,
        len(own),
        sum(block.failures.get(series, 0) for block in own),
        statistics.fmean(block.processor for block in own),
        statistics.fmean(block.busy for block in own),
        statistics.median(block.ticks_per_s for block in own),
        _median_of_known(block.lag_ms for block in own),
        _median_of_known(block.lag_p99_ms for block in own),
        sum(bool(block.deaf) for block in own),
    )


def _median_of_known(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.median(known) if known else None


class Target(msgspec.Struct, frozen=True):
    """What passive monitoring of everything may cost whole ticks, as a ratio, and what it costs."""

    transport: str
    rate_hz: float
    most: float
    found: sampling.Estimate
    is_met: bool


MOST = {("zenoh", False): 1.05, ("zenoh", True): 1.35, ("ros2", False): 1.10, ("ros2", True): 1.5}
"""By transport and whether the load is saturated."""


def targets(found: Sequence[Cell]) -> list[Target]:
    """Those that can be looked up in ``found``."""
    made = []
    for cell in found:
        place = cell.experiment, cell.configuration, cell.series
        if place == (TABLE3, "both", WHOLE) and cell.ratio is not None:
            most = MOST[cell.transport, not cell.rate_hz]
            is_met = cell.ratio.value <= most
            made.append(Target(cell.transport, cell.rate_hz, most, cell.ratio, is_met))
    return made


def lines(found: Sequence[Cell]) -> list[list[Cell]]:
    """The points of each growth, what grows ascending; without those of nobody, but for no taps."""
    by_line: dict[tuple[str, str, float], list[Cell]] = defaultdict(list)
    for cell in found:
        if cell.experiment in GROWTH and (
            cell.configuration != NOBODY or cell.experiment == "taps"
        ):
            by_line[cell.line].append(cell)
    return list(by_line.values())


DEAR = 1.25
"""A cost of a quarter, beyond doubt, is where it begins to matter."""
LATE_MS = 100.0
"""Half of the monitor's latency bound."""
FULL = 0.9


def knee(line: Sequence[Cell]) -> tuple[Cell, str] | None:
    """The first point of ``line`` at which the cost or the lag matters, and what was short there.

    It matters where the whole interval of the ratio is above 1.25, or the lag's 99th percentile above
    half of the monitor's latency bound.
    """
    for point in line:
        lag_ms = point.lag_p99_ms or point.lag_ms or 0.0
        if lag_ms > LATE_MS:
            return point, f"the watcher is {lag_ms:.0f} ms behind; {_limit(point)}"
        if point.ratio is not None and point.ratio.low > DEAR:
            return point, f"a tick costs {point.ratio.value:.2f} times; {_limit(point)}"
    return None


def _limit(point: Cell) -> str:
    if point.busy >= FULL:
        return f"the machine is full ({point.busy:.0%} busy)"
    if point.processor >= FULL:
        return f"the watchers use {point.processor:.1f} cores"
    return f"neither the machine ({point.busy:.0%} busy) nor a watcher is full"
