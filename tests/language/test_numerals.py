"""Numbers as they are written in models: decimal, of ASCII digits."""

from __future__ import annotations

import math

import pytest

from m2c.language.durations import parse_duration
from m2c.language.numerals import decimal, integer

_NONE = [
    "",
    " ",
    "1_0",
    "1__0",
    "٣",
    "٣.٥",
    "１０",
    "1 0",
    "0x10",
    "1,5",
    "1e",
    "e5",
    ".",
    "--1",
    "1.5.2",
    "½",
    "²",
]


@pytest.mark.parametrize(
    ("text", "value"),
    [("0", 0), ("-7", -7), ("+7", 7), ("007", 7), (" 5 ", 5), ("9" * 30, int("9" * 30))],
)
def test_an_integer_is_read(text: str, value: int) -> None:
    assert (integer(text), decimal(text)) == (value, float(value))


@pytest.mark.parametrize(
    ("text", "value"),
    [("1.5", 1.5), (".5", 0.5), ("5.", 5.0), ("-1e-3", -0.001), ("1E2", 100.0), ("inf", math.inf)],
)
def test_a_decimal_is_no_integer(text: str, value: float) -> None:
    assert (integer(text), decimal(text)) == (None, value)


@pytest.mark.parametrize("text", _NONE)
def test_what_only_python_takes_is_no_number(text: str) -> None:
    assert (integer(text), decimal(text)) == (None, None)


@pytest.mark.parametrize("text", _NONE)
def test_nor_is_it_a_time(text: str) -> None:
    assert parse_duration(f"{text}s") is None


def test_digits_without_end_are_no_integer() -> None:
    assert integer("9" * 100_000) is None
