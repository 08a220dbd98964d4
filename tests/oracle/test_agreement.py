"""The oracle says what the reference says; `python -m tests.oracle.agreement` asks for longer."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings

from tests.oracle.agreement import answer, excused
from tests.oracle.strategies import Case, case, cases


@pytest.mark.parametrize("first", range(0, 1500, 250))
def test_the_oracle_agrees_with_the_reference_on_random_cases(first: int) -> None:
    said: Counter[bool] = Counter()
    for seed in range(first, first + 250):
        found = case(Random(seed))
        both = answer(found)
        assert both.same or excused(found, both), f"seed {seed}: {both}\n{found}"
        said[both.conforms] += 1
    assert said[True] > 50
    assert said[False] > 30


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(cases())
def test_the_oracle_agrees_with_the_reference_on_cases_that_shrink(found: Case) -> None:
    both = answer(found)
    assert both.same or excused(found, both), f"{both}\n{found}"
