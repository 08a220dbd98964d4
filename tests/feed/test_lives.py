"""Which life of a node an observation is of."""

from __future__ import annotations

import pytest

from moon.feed.lives import ANOTHER, PAST, PRESENT, Lives

MS = 1_000_000


def test_the_first_that_is_received_of_a_life_may_come_when_it_is_over() -> None:
    lives = Lives()
    lives.start(100 * MS)
    assert lives.see(1, 99 * MS) == PAST
    assert lives.see(2, 101 * MS) == PRESENT
    assert lives.see(1, 98 * MS) == PAST
    assert lives.see(3, 102 * MS) == ANOTHER
    assert lives.see(2, 103 * MS) == PAST


def test_one_whose_clock_was_set_back_as_it_started_is_present_once_its_stamps_are_of_after_that() -> (
    None
):
    lives = Lives()
    lives.start(100 * MS)
    assert lives.see(1, 80 * MS) == PAST
    assert lives.see(1, 100 * MS) == PRESENT
    assert lives.see(1, 90 * MS) == PRESENT


@pytest.mark.parametrize("life", [0, 1])
def test_what_happened_before_a_node_started_is_of_an_earlier_life(life: int) -> None:
    lives = Lives()
    lives.start(100 * MS)
    assert lives.is_over(life, 99 * MS)
    assert not lives.is_over(life, 101 * MS)
