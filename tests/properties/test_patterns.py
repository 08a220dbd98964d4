"""Every pattern in every scope, held to its definition quantifier by quantifier."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moon.properties.formula import Interval
from moon.properties.patterns import (
    Pattern,
    PatternName,
    Scope,
    ScopeName,
    pattern_formula,
)
from moon.properties.property import Status
from moon.properties.syntax import parse_formula
from tests.properties.direct import broken
from tests.properties.runs import run

pytestmark = pytest.mark.slow

P, S, T, Q, R = (parse_formula(f"{{{letter}}}") for letter in "pstqr")
SCOPES = {
    ScopeName.GLOBALLY: Scope(),
    ScopeName.BEFORE: Scope(ScopeName.BEFORE, end=R),
    ScopeName.AFTER: Scope(ScopeName.AFTER, begin=Q),
    ScopeName.BETWEEN: Scope(ScopeName.BETWEEN, Q, R),
    ScopeName.AFTER_UNTIL: Scope(ScopeName.AFTER_UNTIL, Q, R),
}
EVENTS = {
    PatternName.PRECEDENCE: (P, S),
    PatternName.RESPONSE: (P, S),
    PatternName.RESPONSE_CHAIN: (P, S, T),
    PatternName.PRECEDENCE_CHAIN: (S, T, P),
}

times = st.integers(0, 4)
bounds = st.builds(
    lambda low, length: Interval(low, None if length is None else low + length),
    times,
    st.none() | times,
)
ticks = st.fixed_dictionaries({letter: st.booleans() for letter in "pstqr"})
rare = st.fixed_dictionaries(
    {letter: st.sampled_from([False, False, False, True]) for letter in "pstqr"}
)
traces = st.lists(ticks, min_size=1, max_size=14) | st.lists(rare, min_size=1, max_size=22)


@pytest.mark.parametrize("scope", list(ScopeName))
@pytest.mark.parametrize("name", list(PatternName))
@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_a_pattern_is_false_exactly_when_its_definition_is_broken(name, scope, data):
    bound = data.draw(bounds)
    if name is PatternName.RECURRENCE:
        bound = Interval(0, data.draw(times))
    if name is PatternName.RESPONSE_CHAIN:
        bound = Interval(0, data.draw(st.none() | st.integers(1, 5)))
    most = data.draw(st.integers(0, 3))
    pattern = Pattern(name, EVENTS.get(name, (P,)), SCOPES[scope], bound, most)
    trace = data.draw(traces)
    needed = {"p", "s", "t", "q", "r"}
    trace = [{letter: tick[letter] for letter in needed} for tick in trace]
    verdicts = run(pattern_formula(pattern), trace, sparse=data.draw(st.booleans()))
    fault = False
    for now, verdict in enumerate(verdicts):
        fault = fault or broken(pattern, trace, now)
        assert (verdict.status is Status.FALSE) == fault, f"at tick {now}"
