"""How all of this is measured: in rounds; medians, ratios, and bootstrap intervals that mean what they say.

A *round* has each configuration once, in random order, so that what slows the machine down for a while
hits all of them alike. Ratios are of the same round.

Ticks that follow one another are alike (the same processes, the same mood of the machine), so single
ticks are not independent. A *block* is what was measured without a break. The bootstrap draws rounds, and
in each drawn block its ticks (Davison & Hinkley, Bootstrap Methods and their Application, 1997, section
3.8: nonparametric two-stage sampling).

Of few rounds a bootstrap's percentiles are too narrow: those that it draws differ less than others would,
measured another time. They are taken further out (:func:`tail`).
"""

from __future__ import annotations

import itertools
import math
import random
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeVar

import msgspec

RESAMPLES = 1000
COVERAGE = 0.95
"""Of every interval."""
SEED = 1
"""Of the bootstrap: the same samples give the same intervals."""

Block = Sequence[float]
Item = TypeVar("Item")
Key = TypeVar("Key")


def rounds(items: Sequence[Item], count: int, seed: int) -> Iterator[tuple[int, Item]]:
    """``items`` in ``count`` rounds, shuffled anew in each, with the number of the round."""
    draw = random.Random(seed)
    for number in range(count):
        for item in draw.sample(list(items), len(items)):
            yield number, item


def measured(
    turns: Mapping[Key, Callable[[], Item]], count: int, seed: int = 1
) -> dict[Key, list[Item]]:
    """What each of ``turns`` gave, in each of ``count`` rounds."""
    found: dict[Key, list[Item]] = {name: [] for name in turns}
    for _, name in rounds(list(turns), count, seed):
        found[name].append(turns[name]())
    return found


class Estimate(msgspec.Struct, frozen=True):
    """A figure and its interval of 95 %."""

    value: float
    low: float
    high: float

    def shown(self, spec: str) -> str:
        """As ``1.05 (1.01–1.09)``; ``spec`` formats each number."""
        if self.low == self.high:  # of a single value
            return f"{self.value:{spec}}"
        return f"{self.value:{spec}} ({self.low:{spec}}–{self.high:{spec}})"


class Distribution(msgspec.Struct, frozen=True):
    """What is said of one series of measurements, all in the unit of the samples.

    Attributes:
        p50: the median of the blocks' medians, with its interval.
        p99: of all values together.
        worst: the largest value.
        count: how many values.
    """

    p50: Estimate
    p99: float
    worst: float
    count: int


def quantile(values: Sequence[float], part: float) -> float:
    """The value that ``part`` of all values do not exceed (nearest rank); 0 of none."""
    ordered = sorted(values)
    return ordered[min(int(len(ordered) * part), len(ordered) - 1)] if ordered else 0.0


def distribution(blocks: Sequence[Block]) -> Distribution:
    """What is said of ``blocks``, one or more, none of them empty."""
    everything = [value for block in blocks for value in block]
    return Distribution(
        _bootstrap(statistics.median, blocks),
        quantile(everything, 0.99),
        max(everything),
        len(everything),
    )


def ratio(blocks: Sequence[Block], others: Sequence[Block]) -> Estimate:
    """How many times ``others`` their round's ``blocks`` are: the middle of the rounds' ratios of medians.

    Block ``i`` of both is of round ``i``: what slows the machine down for a while slows both.

    Raises:
        ValueError: not the same number of blocks.
    """
    if len(blocks) != len(others):
        raise ValueError(f"{len(blocks)} blocks against {len(others)}: they come in pairs")
    return _bootstrap(middle_ratio, blocks, others)


def middle_ratio(values: Sequence[float], others: Sequence[float]) -> float:
    """What is in the middle of the ratios of pairs of positive numbers.

    A median of few jumps, a mean follows a single one that is wrong. The median of the means of all
    pairs of them (geometric ones here, as these are ratios) does neither, and is nearly as precise as
    the mean (Hodges & Lehmann, Estimates of Location Based on Rank Tests, 1963).
    """
    ratios = [a / b for a, b in zip(values, others, strict=True)]
    pairs = itertools.combinations_with_replacement(ratios, 2)
    return statistics.median(math.sqrt(a * b) for a, b in pairs)


def _bootstrap(figure: Callable[..., float], *series: Sequence[Block]) -> Estimate:
    """``figure`` of the medians of each series' blocks, and its interval; series are of the same rounds."""
    draw = random.Random(SEED)
    ordered = [[sorted(block) for block in blocks] for blocks in series]
    value = figure(*([statistics.median(block) for block in blocks] for blocks in ordered))
    count = len(ordered[0])
    drawn = []
    for _ in range(RESAMPLES):
        rounds = draw.choices(range(count), k=count)
        medians = ([resampled_median(draw, blocks[n]) for n in rounds] for blocks in ordered)
        drawn.append(figure(*medians))
    drawn.sort()
    left_out = round(RESAMPLES * tail(count))
    return Estimate(value, drawn[left_out], drawn[-1 - left_out])


def tail(rounds: int) -> float:
    """Which part of what the bootstrap drew lies beyond each end of an interval.

    The expanded percentile interval (Hesterberg, What Teachers Should Know About the Bootstrap, The American
    Statistician 69, 2015): as wide as Student's t is against the normal distribution, and as
    n is against n - 1 in a variance. One round says nothing of what differs between rounds: its ends
    are of its ticks alone.

    Args:
        rounds: how many were measured.
    """
    normal = statistics.NormalDist()
    outside = (1 - COVERAGE) / 2
    if rounds < 2:
        return outside
    return normal.cdf(-math.sqrt(rounds / (rounds - 1)) * _students_t(1 - outside, rounds - 1))


def _students_t(part: float, freedom: int) -> float:
    """Student's t that ``part`` of the distribution does not exceed, to three terms.

    Abramowitz & Stegun, Handbook of Mathematical Functions, 1964, 26.7.5. Half a percent too small for 4
    degrees of freedom, and much too small for 1; the interval is from the least to the largest by then.
    """
    z = statistics.NormalDist().inv_cdf(part)
    first = (z**3 + z) / 4
    second = (5 * z**5 + 16 * z**3 + 3 * z) / 96
    third = (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384
    return z + first / freedom + second / freedom**2 + third / freedom**3


def resampled_median(draw: random.Random, ordered: Sequence[float]) -> float:
    """The median of a bootstrap sample of ``ordered``, without making one.

    A bootstrap sample is n uniform draws of places; the k-th smallest of n uniform numbers is
    distributed as Beta(k, n + 1 - k) (David & Nagaraja, Order Statistics, 2003, section 2.1), and the
    median is the k-th with k = (n + 1) / 2. For an even n that lies between the two middle ones.
    """
    middle = (len(ordered) + 1) / 2
    return ordered[int(len(ordered) * draw.betavariate(middle, middle))]
