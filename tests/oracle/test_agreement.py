"""The oracle says what the reference says; `python -m tests.oracle.agreement` asks for longer."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import HealthCheck, given, settings

from tests.oracle.agreement import answer, disagreement
from tests.oracle.strategies import Case, case, cases

CASES = 800
"""In the suite; ``make soak`` asks 100,000."""
BLOCKS = 4


@pytest.mark.parametrize(
    "block", [0, *(pytest.param(block, marks=pytest.mark.slow) for block in range(1, BLOCKS))]
)
def test_the_oracle_agrees_with_the_reference_on_random_cases(block: int) -> None:
    size = CASES // BLOCKS
    found = [disagreement(seed) for seed in range(block * size, (block + 1) * size)]
    assert not any(found), "\n".join(filter(None, found))


def test_the_oracle_agrees_with_the_reference_on_compound_states_and_histories() -> None:
    found = [disagreement(seed, nested=True) for seed in range(40)]
    assert not any(found), "\n".join(filter(None, found))


@pytest.mark.parametrize("nested", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_oracle_agrees_with_the_reference_on_delays(nested: bool) -> None:
    found = [disagreement(seed, nested, delays=True) for seed in range(24)]
    assert not any(found), "\n".join(filter(None, found))


@pytest.mark.parametrize("seed", [30032, 209455, 577114, 3112, 9549, 20302632])
def test_cases_that_once_told_them_apart_are_agreed_on(seed: int) -> None:
    assert not disagreement(seed)


def test_the_cases_are_of_both_kinds() -> None:
    truths = [case(Random(seed)).conforms(check_calls=True) for seed in range(100)]
    assert 20 < sum(truths) < 80


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(cases())
def test_the_oracle_agrees_with_the_reference_on_cases_that_shrink(found: Case) -> None:
    both = answer(found)
    assert both.same, f"{both}\n{found}"
