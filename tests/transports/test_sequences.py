"""What sequence numbers tell, by the one rule that all readers of them go by."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transports.sequences import Sequel, Sequences, sequel_of

LAST = (5, 50)


@pytest.mark.parametrize(
    ("number", "stamp_ns", "follows"),
    [
        (6, 60, Sequel.NEXT),
        (6, 40, Sequel.NEXT),  # a clock that was set back
        (8, 60, Sequel.AFTER_A_GAP),
        (8, 50, Sequel.AFTER_A_GAP),
        (5, 50, Sequel.AGAIN),
        (4, 40, Sequel.AGAIN),
        (0, 50, Sequel.AGAIN),
        (0, 51, Sequel.ANEW),
        (5, 51, Sequel.ANEW),
    ],
)
def test_how_a_number_follows(number: int, stamp_ns: int, follows: Sequel) -> None:
    assert sequel_of(LAST, number, stamp_ns) is follows


@given(st.integers(0, 99), st.integers(0, 99))
def test_nothing_is_known_to_be_missing_before_the_first(number: int, stamp_ns: int) -> None:
    assert sequel_of(None, number, stamp_ns) is Sequel.FIRST


def test_what_comes_again_is_not_what_the_next_one_follows() -> None:
    numbers = Sequences(9)
    numbers.follow("a", 5, 50)
    assert numbers.follow("a", 3, 30) == (Sequel.AGAIN, (5, 50))
    assert numbers.follow("a", 6, 60) == (Sequel.NEXT, (5, 50))
    assert numbers.follow("a", 0, 70) == (Sequel.ANEW, (6, 60))
    assert numbers.follow("a", 2, 90) == (Sequel.AFTER_A_GAP, (0, 70))


def test_places_do_not_count_together() -> None:
    numbers = Sequences(9)
    numbers.follow("a", 5, 50)
    assert numbers.follow("b", 7, 70) == (Sequel.FIRST, None)
    assert numbers.follow("a", 6, 80) == (Sequel.NEXT, (5, 50))


def test_no_more_places_are_kept_than_asked_for_and_that_is_said() -> None:
    numbers = Sequences(2)
    numbers.follow("a", 0, 0)
    numbers.follow("b", 0, 1)
    assert numbers.complete
    numbers.follow("c", 0, 2)
    assert not numbers.complete
    assert list(numbers.last) == ["b", "c"]
    assert numbers.follow("a", 4, 4) == (Sequel.FIRST, None)
