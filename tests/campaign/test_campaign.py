"""Some random systems and circumstances: nothing that is said is wrong, and enough is said.

What takes hours is ``make soak``'s: ``python -m tests.campaign --seeds FROM:TO``.
"""

from __future__ import annotations

import functools

import pytest

from tests.campaign.__main__ import Summary, Tried, cases

pytestmark = pytest.mark.slow

SEEDS = (*range(8), 9)
"""Those of some seconds each."""
EACH = 3


@functools.cache
def tried(seed: int) -> tuple[Tried, ...]:
    """The trials of one random system: each is made once for all tests of this file."""
    return tuple(cases(seed, EACH))


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_that_is_said_is_wrong(seed: int) -> None:
    wrong = [
        f"{failure.fault}: {failure.about}: {failure.text}\n  again: {one.case.command()}"
        for one in tried(seed)
        for failure in one.result.failures
    ]
    assert not wrong, "\n".join(wrong)


def test_enough_is_said() -> None:
    summary = Summary()
    for seed in SEEDS:
        for one in tried(seed):
            summary.take(one)
    assert summary.judged > summary.trials
    assert not summary.is_too_silent, summary.table()
