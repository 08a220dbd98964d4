"""Spans of time as people read them."""

from __future__ import annotations

import pytest

from moon.properties.describe import duration


@pytest.mark.parametrize(
    ("ticks", "text"),
    [
        (5_000_000_000, "5 s"),
        (15_159_480_680, "15.159481 s"),
        (1_000_000_001, "1 s"),
        (200_000_000, "200 ms"),
        (1_500, "1.5 us"),
        (1, "0.001 us"),
    ],
)
def test_a_span_of_time_has_the_unit_that_fits_and_no_more_digits_than_people_read(
    ticks: int, text: str
) -> None:
    assert duration(ticks) == text
