"""The first field in which a message differs from what was expected."""

from __future__ import annotations

from typing import Any

import pytest

from m2c.language.datatypes import FLOAT64, INT32, STRING, Array, DataType, Structure
from moon.oracle.differing import first_difference
from moon.oracle.unknowns import Unknown, anything
from moon.verdict import Cause, Difference, Explanation, Outcome, Verdict, violation_of
from moon.wording import number_text, value_text

POINT = Structure("t/Point", (("x", FLOAT64), ("name", STRING)))
SHAPE = Structure(
    "t/Shape", (("id", INT32), ("at", POINT), ("points", Array(POINT)), ("rest", Array(INT32)))
)


def point(x: Any = 0.0, name: str = "") -> dict[str, Any]:
    return {"x": x, "name": name}


def shape(**fields: Any) -> dict[str, Any]:
    return {"id": 0, "at": point(), "points": [point(), point(1.0)], "rest": [], **fields}


LONG = "a" * 300


@pytest.mark.parametrize(
    ("expected", "observed", "difference"),
    [
        (shape(id=1), shape(id=2), Difference("id", "1", "2")),
        (shape(at=point(1.5)), shape(at=point(2.5)), Difference("at.x", "1.5", "2.5")),
        (shape(points=[point(), point(3.0)]), shape(), Difference("points[1].x", "3", "1")),
        (shape(points=[point()]), shape(), Difference("points.length", "1", "2")),
        (shape(id=1, rest=[2]), shape(id=3, rest=[4]), Difference("id", "1", "3")),
        (shape(at=point(name=f"{LONG}b")), shape(at=point(name=f"{LONG}c")),
         Difference("at.name", "'…aaaaaaaaaaaab'", "'…aaaaaaaaaaaac'")),
        (shape(id=Unknown(-(2**31), 2**31 - 1, integer=True)), shape(id=True),
         Difference("id", "-2147483648…2147483647", "true")),
        (shape(at=point(anything()), id=1), shape(at=point(9.0)), Difference("id", "1", "0")),
        (shape(), shape(), None),
    ],
)  # fmt: skip
def test_the_first_field_that_differs_is_found(
    expected: Any, observed: Any, difference: Difference | None
) -> None:
    assert first_difference(expected, observed, SHAPE) == difference


@pytest.mark.parametrize(
    ("value", "kind", "difference"),
    [(5, INT32, None), (None, None, None), ("x", STRING, None)],
)
def test_what_is_no_message_has_no_field_that_differs(
    value: Any, kind: DataType | None, difference: None
) -> None:
    assert first_difference(value, 6, kind) is difference


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (-2147483648.0, "-2147483648"),
        (9007199254740992.0, "9007199254740992"),
        (1e300, "1e+300"),
        (0.1, "0.1"),
        (1 / 3, "0.3333333333333333"),
        (-0.0, "-0"),
    ],
)
def test_numbers_have_all_their_digits(value: float, text: str) -> None:
    assert number_text(value) == text
    assert value_text({"x": value}) == f"{{x: {text}}}"


def test_an_unknown_number_is_shown_with_whole_ends() -> None:
    assert repr(Unknown(-(2**31), 2**31 - 1, integer=True)) == "-2147483648…2147483647"
    assert repr(Unknown(0.5)) == "0.5…inf"


# --- repetitions ----------------------------------------------------------------------------------


def verdict(
    observed: str = "message on /out {data: 1}",
    cause: Cause = Cause.UNEXPECTED,
    channel: str = "/out",
    place: str = "M.scxml:5:3",
    path: str = "data",
) -> Verdict:
    difference = Difference(path, "0", "1")
    why = Explanation(("x",), observed, (), (), (place,), channel, (difference,))
    return violation_of("M", "M", 7, why, cause)


def test_verdicts_that_differ_in_values_repeat_one_another() -> None:
    assert verdict().pattern == verdict("message on /out {data: 2}").pattern


@pytest.mark.parametrize(
    "other",
    [
        verdict(cause=Cause.UNRESPONSIVE),
        verdict(channel="/other"),
        verdict(place="M.scxml:9:3"),
        verdict(path="header.frame_id"),
    ],
)
def test_verdicts_of_other_causes_channels_places_or_fields_do_not(other: Verdict) -> None:
    assert verdict().pattern != other.pattern


def test_the_reason_is_a_sentence_and_the_cause_says_what_it_is() -> None:
    silent = verdict("nothing", Cause.UNRESPONSIVE)
    assert silent.outcome is Outcome.VIOLATED
    assert silent.reason == "unresponsive: expected x, observed nothing"
    assert silent.is_silence
    assert not verdict().is_silence
