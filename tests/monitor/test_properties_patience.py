"""How long a monitor waits for what may still be on its way."""

from __future__ import annotations

from moon.monitor.patience import LEAST_NS, MARGIN, WINDOW_NS, Patience
from tests.monitor.hand_driven import MS, START, S

LATENCY = 200 * MS


def test_before_anything_was_heard_it_is_the_latency_bound() -> None:
    assert Patience(LATENCY).wait_ns == LATENCY


def test_it_is_a_multiple_of_the_longest_lag_between_its_least_and_the_bound() -> None:
    patience = Patience(LATENCY)
    for lag, expected in ((2 * MS, LEAST_NS), (40 * MS, MARGIN * 40 * MS), (150 * MS, LATENCY)):
        patience.heard(lag, START)
        patience.heard(MS, START)
        assert patience.wait_ns == expected


def test_a_bound_below_the_least_is_kept() -> None:
    patience = Patience(10 * MS)
    patience.heard(MS, START)
    assert patience.wait_ns == 10 * MS


def test_a_lag_is_forgotten_after_two_windows_in_which_something_was_heard() -> None:
    patience = Patience(LATENCY)
    patience.heard(MS, START)
    patience.heard(60 * MS, START + S)
    patience.heard(MS, START + S + WINDOW_NS)
    assert patience.wait_ns == MARGIN * 60 * MS
    patience.heard(MS, START + 2 * S + 2 * WINDOW_NS)
    assert patience.wait_ns == LEAST_NS


def test_silence_forgets_nothing() -> None:
    patience = Patience(LATENCY)
    patience.heard(60 * MS, START)
    for _ in range(100):
        patience.held_up(0)
    assert patience.wait_ns == MARGIN * 60 * MS


def test_its_own_delay_counts_as_a_lag() -> None:
    patience = Patience(LATENCY)
    patience.heard(MS, START)
    patience.held_up(2 * MS)
    assert patience.wait_ns == LEAST_NS
    patience.held_up(50 * MS)
    assert patience.wait_ns == MARGIN * 50 * MS


def test_after_a_loss_it_is_the_latency_bound_for_a_while() -> None:
    patience = Patience(LATENCY)
    patience.heard(MS, START)
    patience.distrust()
    assert patience.wait_ns == LATENCY
    patience.heard(MS, START + S + WINDOW_NS)
    assert patience.wait_ns == LATENCY
    patience.heard(MS, START + 2 * S + 2 * WINDOW_NS)
    assert patience.wait_ns == LEAST_NS
