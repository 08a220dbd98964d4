"""What properties hold back lies in order of stamps, however it came."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from moon.feed.held import Held
from tests.properties.runs import seen
from transports.interface import Observation


@given(st.lists(st.integers(0, 9)), st.integers(-1, 10))
def test_as_a_stable_sort_has_it(stamps: list[int], until: int) -> None:
    given_ones = [seen(stamp, v=place) for place, stamp in enumerate(stamps)]
    held: Held[Observation] = Held()
    for one in given_ones:
        held.add(one)
    expected = sorted(given_ones, key=lambda one: one.stamp_ns)
    assert held.observations == expected
    assert held.stamps == sorted(stamps)
    taken = held.take(held.count(until))
    assert taken == [one for one in expected if one.stamp_ns <= until]
    assert held.observations == [one for one in expected if one.stamp_ns > until]
    assert held.stamps == [one.stamp_ns for one in held.observations]
    held.clear()
    assert not held.observations
    assert held.count(10) == 0
