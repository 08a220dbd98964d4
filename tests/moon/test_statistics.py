"""Rates that follow what happens now, latencies of the last calls."""

from __future__ import annotations

import pytest

from moon.tap.statistics import Row, Statistics, table
from moon.tap.stream import Line

S = 10**9


def message(received_ns: int, channel="/t") -> Line:
    return Line(0, "message", channel, "node", received_ns=received_ns)


def rate_of(statistics: Statistics, now_ns: int) -> float | None:
    return statistics.rows(now_ns)[0].rate_hz


def test_requests_and_round_trips_are_counted() -> None:
    statistics = Statistics()
    for call in range(3):
        statistics.add(Line(0, "request", "/s", "c", call=call, received_ns=call * S))
        statistics.add(Line(0, "response", "/s", "n", call=call, round_trip_us=200.0 + call))
    statistics.add(Line(0, "response", "/s", "", round_trip_us=5e6, error="timeout: late"))
    assert statistics.rows(2 * S) == [Row("/s", 3, 1.0, 201.0, 202.0, 1)]
    assert table(statistics.rows(2 * S)) == [
        "channel  count  rate [1/s]  p50 [µs]  p99 [µs]  failed",
        "/s           3         1.0       201       202       1",
    ]


def test_a_rate_is_that_of_the_last_ten_seconds() -> None:
    statistics = Statistics()
    for place in range(200):
        statistics.add(message(100 * S + place * S // 10))
    assert rate_of(statistics, 120 * S) == pytest.approx(10.0, rel=0.15)


def test_a_channel_that_falls_silent_loses_its_rate() -> None:
    statistics = Statistics()
    for place in range(5_000):
        statistics.add(message(100 * S + place * S // 1000))
    rates = [rate_of(statistics, (105 + later) * S) for later in (0, 3, 6, 9, 15)]
    assert rates == sorted(rates, reverse=True)
    assert rates[0] == pytest.approx(1000, rel=0.01)
    assert rates[-1] == 0.0


def test_a_single_message_has_no_rate() -> None:
    statistics = Statistics()
    statistics.add(message(0))
    assert rate_of(statistics, S) is None


def test_a_fast_channel_takes_no_more_memory_than_a_slow_one() -> None:
    statistics = Statistics()
    for place in range(100_000):
        statistics.add(message(place * S // 1000))
    assert len(statistics._channels["/t"]._seconds) <= 10


def test_a_service_of_an_action_is_a_row_named_after_its_part() -> None:
    statistics = Statistics()
    statistics.add(message(0, "/go/_action/feedback"))
    statistics.add(Line(0, "request", "/go/_action/send_goal", "c"))
    assert [row.channel for row in statistics.rows(S)] == ["/go (feedback)", "/go (goal)"]
