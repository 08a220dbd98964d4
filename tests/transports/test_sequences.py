"""What sequence numbers tell, by the one rule that all readers of them go by."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from transports.losses import Losses
from transports.sequences import Sequel, Sequence


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
    sequence = Sequence()
    sequence.follow(5, 50)
    assert sequence.follow(number, stamp_ns) is follows


@given(st.integers(0, 99), st.integers(0, 99))
def test_nothing_is_known_to_be_missing_before_the_first(number: int, stamp_ns: int) -> None:
    sequence = Sequence()
    assert sequence.follow(number, stamp_ns) is Sequel.FIRST
    assert sequence.skipped.overdue(10**6) == []


def test_what_comes_again_is_not_what_the_next_one_follows() -> None:
    sequence = Sequence()
    told = [sequence.follow(*one) for one in ((5, 50), (3, 30), (6, 60), (0, 70), (2, 90))]
    assert told == [Sequel.FIRST, Sequel.AGAIN, Sequel.NEXT, Sequel.ANEW, Sequel.AFTER_A_GAP]


# --- in any order ---------------------------------------------------------------------------------

FAR = 5
"""A number is overtaken by so many that are behind it, at most."""


def disordered(draw: random.Random, count: int) -> list[int]:
    """The numbers from 0, some of which are lost, come twice, or are overtaken."""
    kept = [number for number in range(count) if number == 0 or draw.random() < 0.85]
    kept += [number for number in kept if draw.random() < 0.1]
    places = [(number + draw.random() * draw.choice((0, FAR)), number) for number in kept]
    return [0, *(number for _, number in sorted(places))]


@pytest.mark.parametrize("life", [0, 7])
def test_whatever_the_order_each_number_is_new_once_and_what_is_lost_is_a_gap(life: int) -> None:
    draw = random.Random(3)
    for _ in range(300):
        numbers = disordered(draw, draw.randint(2, 40))
        sequence = Sequence()
        losses = Losses()
        new = []
        for number in numbers:
            sequel = sequence.follow(number, number * 10, life)
            losses.number("/a", "A", number, number * 10, life)
            assert sequel is not Sequel.ANEW
            if sequel is not Sequel.AGAIN:
                new.append(number)
        assert sorted(new) == sorted(set(numbers))
        missing = max(numbers) + 1 - len(set(numbers))
        lost = sequence.skipped.overdue(10**6)
        assert bool(lost) == bool(missing)
        plural = "s" * (missing != 1)
        told = [f"missed {missing} message{plural} on /a from A"] if missing else []
        assert losses.sentences() == told


def test_a_number_that_comes_late_is_new_and_fills_its_gap() -> None:
    sequence = Sequence()
    told = [sequence.follow(number, number * 10) for number in (0, 3, 1, 1, 4, 2)]
    first, gap, late, again, following, last = told
    assert (first, gap) == (Sequel.FIRST, Sequel.AFTER_A_GAP)
    assert (late, last) == (Sequel.LATE, Sequel.LATE)
    assert (again, following) == (Sequel.AGAIN, Sequel.NEXT)
    assert sequence.skipped.overdue(10**6) == []


def test_what_a_life_sent_last_may_come_after_the_first_of_the_next() -> None:
    sequence = Sequence()
    for number in (0, 1, 2):
        sequence.follow(number, number, 5)
    assert sequence.follow(0, 10, 6) is Sequel.ANEW
    assert sequence.follow(3, 3, 5) is Sequel.LATE
    assert sequence.follow(3, 3, 5) is Sequel.AGAIN
    assert sequence.follow(1, 1, 5) is Sequel.AGAIN
    assert sequence.follow(1, 11, 6) is Sequel.NEXT


def test_a_next_life_is_told_by_its_life_whatever_its_clock_shows() -> None:
    sequence = Sequence()
    for number in (0, 1, 2):
        sequence.follow(number, 100 + number, 5)
    assert sequence.follow(0, 1, 6) is Sequel.ANEW
    assert sequence.follow(2, 3, 6) is Sequel.AFTER_A_GAP
