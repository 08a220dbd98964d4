"""Medians, ratios and intervals of the overhead comparison, on data whose truth is known."""

from __future__ import annotations

import random
import statistics

import pytest

from benchmarks import sampling

DRAW = random.Random(4)


def normal_blocks(rounds: int, ticks: int, middle: float = 100.0, between: float = 0.0):
    """Blocks of normal samples; ``between`` is how far apart the blocks are."""
    return [
        [DRAW.gauss(shift, 10.0) for _ in range(ticks)]
        for shift in [DRAW.gauss(middle, between) for _ in range(rounds)]
    ]


def test_a_resampled_median_is_distributed_as_that_of_a_real_bootstrap_sample() -> None:
    ordered = sorted(DRAW.gauss(0, 1) for _ in range(41))
    draw = random.Random(5)
    quick = [sampling.resampled_median(draw, ordered) for _ in range(4000)]
    slow = [statistics.median(draw.choices(ordered, k=len(ordered))) for _ in range(4000)]
    assert statistics.fmean(quick) == pytest.approx(statistics.fmean(slow), abs=0.02)
    assert statistics.stdev(quick) == pytest.approx(statistics.stdev(slow), rel=0.1)


@pytest.mark.parametrize("rounds", [6, 8])
def test_the_interval_has_the_true_median_in_nine_of_ten_cases(rounds: int) -> None:
    hits = 0
    for _ in range(40):
        found = sampling.distribution(normal_blocks(rounds, 20, between=5.0)).p50
        hits += found.low <= 100.0 <= found.high
    assert hits >= 36


@pytest.mark.parametrize(
    ("rounds", "left_out"),
    # Student's t of 0.975 from a table (5, 7, 29 degrees of freedom), times the root of n / (n - 1)
    [(6, 2.571 * 1.0954), (8, 2.365 * 1.0690), (30, 2.045 * 1.0171)],
)
def test_the_fewer_rounds_the_further_out_an_interval_ends(rounds: int, left_out: float) -> None:
    assert sampling.tail(rounds) == pytest.approx(statistics.NormalDist().cdf(-left_out), rel=0.03)


def test_an_interval_of_two_rounds_is_all_that_was_drawn() -> None:
    found = sampling.distribution([[100.0] * 5, [110.0] * 5]).p50
    assert (found.low, found.high) == (100.0, 110.0)
    assert sampling.tail(1) == pytest.approx(0.025)


def test_blocks_that_differ_make_the_interval_wider() -> None:
    alike = sampling.distribution(normal_blocks(8, 40)).p50
    apart = sampling.distribution(normal_blocks(8, 40, between=20.0)).p50
    assert apart.high - apart.low > 2 * (alike.high - alike.low)


def test_a_ratio_is_found_though_the_machine_becomes_three_times_slower() -> None:
    base, other = [], []
    for number in range(8):
        drift = 1 + number / 4
        base.append([drift * DRAW.gauss(100, 5) for _ in range(30)])
        other.append([1.5 * drift * DRAW.gauss(100, 5) for _ in range(30)])
    found = sampling.ratio(other, base)
    assert found.low < 1.5 < found.high
    assert found.high - found.low < 0.2


def test_a_ratio_is_not_moved_by_one_bad_round() -> None:
    found = sampling.middle_ratio(
        [108.0, 109.0, 110.0, 110.0, 110.0, 111.0, 112.0, 400.0], [100.0] * 8
    )
    assert 1.09 < found < 1.12


def test_a_ratio_of_few_rounds_is_nearer_the_truth_than_their_median() -> None:
    ours, medians = [], []
    for _ in range(300):
        pairs = [(DRAW.gauss(100, 10), DRAW.gauss(100, 10)) for _ in range(8)]
        ours.append(abs(sampling.middle_ratio(*zip(*pairs, strict=True)) - 1))
        medians.append(abs(statistics.median(a / b for a, b in pairs) - 1))
    assert statistics.mean(ours) < statistics.mean(medians)


def test_each_round_has_everything_once_and_not_always_in_the_same_order() -> None:
    turns = list(sampling.rounds("abcd", 6, seed=1))
    orders = [[item for number, item in turns if number == wanted] for wanted in range(6)]
    assert all(sorted(order) == list("abcd") for order in orders)
    assert len({tuple(order) for order in orders}) > 1
    assert turns == list(sampling.rounds("abcd", 6, seed=1))


def test_the_same_samples_give_the_same_interval() -> None:
    blocks = normal_blocks(3, 10)
    assert sampling.distribution(blocks) == sampling.distribution(blocks)


def test_blocks_that_are_not_pairs_have_no_ratio() -> None:
    with pytest.raises(ValueError, match="3 blocks against 2"):
        sampling.ratio(normal_blocks(3, 5), normal_blocks(2, 5))


def test_p99_worst_and_count_are_of_all_values() -> None:
    found = sampling.distribution([[float(value) for value in range(100)], [1000.0] * 100])
    assert (found.p99, found.worst, found.count) == (1000.0, 1000.0, 200)
    assert sampling.quantile([5.0, 1.0, 3.0], 0.5) == 3.0
    assert sampling.quantile([], 0.5) == 0.0
