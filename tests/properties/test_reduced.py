"""Formulas written with fewer operators: they mean the same, and unknown values bound them."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moon.properties.formula import (
    Formula,
    Historically,
    Implies,
    Or,
    Rise,
    operands,
    reduced,
    text,
)
from moon.properties.monitor import PropertyMonitor
from moon.properties.property import Status
from moon.properties.syntax import MAX_DEPTH, parse_formula
from tests.properties.differential import random_formula
from tests.properties.direct import holds
from tests.properties.runs import seen

NAMES = ("p", "q", "r", "n > 2", "n <= 1")


def drawn(seed: int) -> tuple[random.Random, Formula, list[dict[str, bool]]]:
    choice = random.Random(seed)
    source = random_formula(choice, choice.randint(1, 3), 4, edges=True)
    trace = [{name: choice.random() < 0.5 for name in NAMES} for _ in range(10)]
    return choice, parse_formula(source, ticks_per_unit=1), trace


def parts(formula: Formula) -> list[Formula]:
    return [formula, *(part for item in operands(formula) for part in parts(item))]


@given(seed=st.integers(0, 2**40))
@settings(max_examples=200, deadline=None)
def test_a_reduced_formula_has_six_kinds_of_parts_and_means_the_same(seed):
    _, formula, trace = drawn(seed)
    found = reduced(formula)
    assert not any(isinstance(part, Or | Implies | Historically | Rise) for part in parts(found))
    for t in range(len(trace)):
        assert holds(found, trace, t) == holds(formula, trace, t), f"{text(formula, 1)} at {t}"


@given(seed=st.integers(0, 2**40))
@settings(max_examples=200, deadline=None)
def test_a_formula_by_polarity_is_bounded_by_the_best_and_the_worst_of_what_is_unknown(seed):
    choice, formula, trace = drawn(seed)
    split = reduced(formula, by_polarity=True)
    best: list[dict[str, bool]] = []
    worst: list[dict[str, bool]] = []
    for values in trace:
        best.append({})
        worst.append({})
        for name, value in values.items():
            helps, harms = (True, False) if choice.random() < 0.3 else (value, value)
            best[-1] |= {f"+{name}": helps, f"-{name}": harms}
            worst[-1] |= {f"+{name}": harms, f"-{name}": helps}
    for t in range(len(trace)):
        value = holds(formula, trace, t)
        assert holds(split, worst, t) <= value <= holds(split, best, t), (
            f"{text(formula, 1)} at {t}"
        )


def test_what_is_shared_stays_shared():
    formula = parse_formula("{p}")
    for _ in range(60):  # written as a tree, it would never end
        formula = Or((Rise(formula), Implies(formula, formula)))
    reduced(formula)
    reduced(formula, by_polarity=True)


@pytest.mark.parametrize(
    "source",
    [
        "historically once " * (MAX_DEPTH // 2 - 1) + "{p}",
        "({p} and (true -> " * (MAX_DEPTH // 5 - 1) + "{p}" + "))" * (MAX_DEPTH // 5 - 1),
        "({q} or ({p} and " * (MAX_DEPTH // 4 - 1) + "{p}" + "))" * (MAX_DEPTH // 4 - 1),
    ],
)
def test_the_violation_of_a_formula_as_deep_as_the_reader_takes_is_explained(source):
    verdict = PropertyMonitor(source).observe(seen(0, p=False, q=False))
    assert verdict.status is Status.FALSE
    assert verdict.witness is not None
    assert ("p", False) in {(fact.predicate, fact.value) for fact in verdict.witness.facts}
