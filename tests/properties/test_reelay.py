"""The same meaning as Reelay 25, on random formulas and traces."""

from __future__ import annotations

import random

import reelay
from hypothesis import given, settings
from hypothesis import strategies as st

from moon.properties.formula import text
from moon.properties.property import Status
from moon.properties.syntax import parse_formula
from tests.drawn import examples
from tests.properties import differential
from tests.properties.direct import holds
from tests.properties.runs import run


@given(seed=st.integers(50_000_000, 2**40), edges=st.booleans())
@settings(max_examples=examples(150, 1200), deadline=None)
def test_dense_formulas_mean_what_reelay_says(seed, edges):
    assert differential.disagreement(seed, edges=edges) is None


def boolean_trace(choice: random.Random) -> list[dict[str, bool]]:
    steps = []
    values = {name: choice.random() < 0.5 for name in "pqr"}
    for _ in range(choice.randint(1, 16)):
        values = {
            name: choice.random() < 0.5 if choice.random() < 0.4 else value
            for name, value in values.items()
        }
        steps.append(values)
    return steps


@given(seed=st.integers(0, 2**40), sparse=st.booleans())
@settings(max_examples=200, deadline=None)
def test_a_monitor_agrees_with_the_operators_definitions(seed, sparse):
    choice = random.Random(seed)
    source = differential.random_formula(choice, choice.randint(1, 3), 4, choice.random() < 0.5)
    source = source.replace("{n > 2}", "{p}").replace("{n <= 1}", "not {q}")
    formula = parse_formula(source, ticks_per_unit=1)
    trace = boolean_trace(choice)
    verdicts = run(formula, trace, sparse)
    for t, verdict in enumerate(verdicts):
        assert (verdict.status is Status.TRUE) == holds(formula, trace, t), (
            f"{text(formula, 1)} at {t}"
        )


def test_without_refinement_reelay_forgets_what_held_earlier_in_a_stretch():
    """Why the comparison gives Reelay a stamp at every tick: its own answers differ."""
    trace = [{"time": 0, "p": True, "q": True}, {"time": 1, "p": False, "q": False}]

    def changes(stamps):
        monitor = reelay.dense_timed_monitor(pattern="(once[:3]{p}) since {q}")
        return [
            change
            for step in [*trace, *({"time": t} for t in stamps)]
            for change in monitor.update(step)
        ]

    assert changes([10])[-1] == {"time": 1.0, "value": False}
    assert changes(range(2, 11))[-1] == {"time": 4.0, "value": False}
