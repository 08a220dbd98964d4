"""What a value becomes in a typed place, and that no operator raises anything but ExecutionError."""

from __future__ import annotations

import ctypes
import math
import struct
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m2c.language import ecmascript
from m2c.language.conversion import (
    MAX_DEPTH,
    MAX_LENGTH,
    ExecutionError,
    to_double,
    to_message,
    to_untyped,
)
from m2c.language.datatypes import (
    ANY,
    BOOL,
    INTEGER_RANGES,
    NUMBER,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
)
from m2c.language.durations import seconds
from m2c.language.operators import OPERATORS, UNARY_OPERATORS
from m2c.language.values import convert, zero
from m2c.runtime.messages import message_class

INNER = Structure("t/msg/Inner", (("n", Primitive("int8")), ("f", Primitive("float32"))))
OUTER = Structure(
    "t/msg/Outer",
    (
        ("inner", INNER),
        ("many", Array(Primitive("uint8"), 3)),
        ("words", Array(STRING)),
        ("u", Primitive("uint64")),
        ("b", BOOL),
        ("inners", Array(INNER)),
    ),
)
NASTY: list[Any] = [
    *(None, True, False, 0, -0.0, 1, -1, 0.5, math.nan, math.inf, -math.inf, 5e-324, 1.7e308),
    *(2**31, 2**53, 2**53 + 1, 2**63, -(2**63), 2**64 - 1, 10**400, -(10**400)),
    *("", "a", "12", "0x", "-0", "1e999", "9" * 5000, "0x" + "f" * 5000, "\ud83d", " \ufeff7 "),
    *([], [1], [[]], [None], ["1"], [[[7]]], {}, {"n": 1}, message_class(INNER)()),
]
KINDS: list[DataType] = [
    *(Primitive(name) for name in INTEGER_RANGES),
    *(BOOL, STRING, NUMBER, ANY, Primitive("float32"), Primitive("float64"), INNER, OUTER),
    *(Structure("", ()), Array(Primitive("int8")), Array(STRING, 1), Array(NUMBER, 2, True)),
]
C_TYPES = {name: getattr(ctypes, f"c_{name}") for name in INTEGER_RANGES if name.startswith(("int", "u"))}  # fmt: skip


@pytest.mark.parametrize("name", C_TYPES)
@given(
    number=st.one_of(st.integers(-(2**70), 2**70), st.floats(allow_nan=False, allow_infinity=False))
)
def test_a_whole_number_wraps_as_it_does_in_c(name: str, number: float) -> None:
    whole = int(number)
    assert convert(whole, Primitive(name)) == C_TYPES[name](whole).value
    assert convert(float(whole), Primitive(name)) == C_TYPES[name](int(float(whole))).value


@pytest.mark.parametrize("kind", [Primitive("byte"), Primitive("char")], ids=lambda kind: kind.name)
def test_a_byte_and_a_char_hold_eight_bits(kind: Primitive) -> None:
    assert [convert(value, kind) for value in (255, 256, -1)] == [255, 0, 255]


@pytest.mark.parametrize(
    "value", [None, 0.5, math.nan, math.inf, -math.inf, "1", True, [], [1], {}], ids=repr
)
def test_what_is_no_whole_number_does_not_go_into_an_integer(value: Any) -> None:
    with pytest.raises(ExecutionError, match="where int32 is declared"):
        convert(value, Primitive("int32"))


@given(number=st.floats(allow_nan=False))
def test_a_float32_holds_what_c_s_float_does(number: float) -> None:
    try:
        wanted = struct.unpack("<f", struct.pack("<f", number))[0]
    except OverflowError:
        wanted = math.copysign(math.inf, number)
    assert convert(number, Primitive("float32")) == wanted


@pytest.mark.parametrize(
    ("value", "kind", "result"),
    [
        (3, Primitive("float64"), 3.0),
        (10**400, Primitive("float64"), math.inf),
        (1e39, Primitive("float32"), math.inf),
        (-(10**400), Primitive("float32"), -math.inf),
        (-0.0, Primitive("int8"), 0),
        ([300, 1.0], Array(Primitive("uint8")), [44, 1]),
        ({"n": 200}, INNER, {"n": -56, "f": 0.0}),
        ({"f": 0.1}, INNER, {"n": 0, "f": 0.10000000149011612}),
        (7, NUMBER, 7),
        ([1, [2]], ANY, [1, [2]]),
        (None, ANY, None),
    ],
    ids=repr,
)
def test_what_fits_becomes_a_value_of_the_type(value: Any, kind: DataType, result: Any) -> None:
    found = convert(value, kind)
    assert repr(found) == repr(result)


@pytest.mark.parametrize(
    ("value", "kind", "message"),
    [
        (None, STRING, "undefined where string is declared"),
        (1, BOOL, "1 where bool is declared"),
        ("x" * 99, BOOL, f"'{'x' * 37}...' where bool is declared"),
        ("1", Primitive("float64"), "'1' where float64 is declared"),
        (True, Primitive("float32"), "true where float32 is declared"),
        (None, NUMBER, "undefined where number is declared"),
        (5, Array(BOOL), "5 where an array is declared"),
        ([1, 2], Array(NUMBER, 1), "2 elements where at most 1 fit"),
        ([1, 2], Array(NUMBER, 3, True), "2 elements where 3 fit"),
        ([1, "x"], Array(NUMBER), "'x' where number is declared"),
        ([], INNER, "an array of 0 where t/msg/Inner is declared"),
        ({"m": 1}, INNER, "t/msg/Inner has no field `m`"),
        ({}, STRING, "an object where string is declared"),
        ("x" * (MAX_LENGTH + 1), STRING, f"a string of {MAX_LENGTH + 1} characters where {MAX_LENGTH} fit"),
    ],
    ids=lambda item: "" if isinstance(item, str) else repr(item),
)  # fmt: skip
def test_what_does_not_fit_is_said(value: Any, kind: DataType, message: str) -> None:
    with pytest.raises(ExecutionError) as caught:
        convert(value, kind)
    assert str(caught.value) == message


@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_a_converted_value_shares_nothing_with_its_source(kind: DataType) -> None:
    source = zero(kind)
    made = convert(source, kind)
    assert made == source
    if isinstance(source, list | dict):
        assert made is not source


def test_what_is_nested_without_end_is_refused_where_it_grows() -> None:
    nested: Any = 1
    for _ in range(MAX_DEPTH):
        nested = [nested]
    assert to_untyped(nested) == nested
    with pytest.raises(ExecutionError):
        to_untyped([nested])
    doubled = [[0] * (MAX_LENGTH // 2)] * 3
    with pytest.raises(ExecutionError):
        to_untyped(doubled)


def test_a_message_is_copied_and_an_object_becomes_one() -> None:
    outer = message_class(OUTER)
    inner = message_class(INNER)
    source = outer(inners=[inner(n=3)])
    made = to_message(source, outer)
    assert made == source
    assert made.inners[0] is not source.inners[0]
    given_fields = {"u": -1, "many": [256], "inner": {"n": 129}, "inners": [{"n": 1}], "b": True}
    found = msgspec.to_builtins(to_message(given_fields, outer))
    assert found["u"] == 2**64 - 1
    assert (found["many"], found["inner"]["n"], found["inners"][0]["n"]) == ([0], -127, 1)


@pytest.mark.parametrize(
    "value", [None, 1, [], {"v": 1}, {"b": 1}, {"many": [1, 2, 3, 4]}, {"words": [1]}], ids=repr
)
def test_what_is_no_such_message_is_refused(value: Any) -> None:
    with pytest.raises(ExecutionError):
        to_message(value, message_class(OUTER))


@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_a_conversion_gives_a_value_or_an_execution_error(kind: DataType) -> None:
    for value in NASTY:
        try:
            convert(value, kind)
        except ExecutionError:
            continue


@settings(max_examples=1500, deadline=None)
@given(
    operator=st.sampled_from([*OPERATORS, *UNARY_OPERATORS, *(f"Math.{name}" for name in ecmascript.MATH)]),
    values=st.tuples(st.sampled_from(NASTY), st.sampled_from(NASTY)),
)  # fmt: skip
def test_no_operator_raises_whatever_its_operands(operator: str, values: tuple[Any, Any]) -> None:
    if operator in OPERATORS:
        found = OPERATORS[operator](*values)
    elif operator in UNARY_OPERATORS:
        found = UNARY_OPERATORS[operator](values[0])
    else:
        many = operator.removeprefix("Math.") in ("atan2", "hypot", "max", "min", "pow")
        found = ecmascript.MATH[operator.removeprefix("Math.")](*values[: 2 if many else 1])
    assert isinstance(ecmascript.to_string(found), str)


ACCESS: list[Callable[[Any, Any], object]] = [
    ecmascript.element,
    lambda value, index: ecmascript.member(value, ecmascript.to_string(index)[:40]),
    lambda value, index: ecmascript.set_element(list(value) if isinstance(value, list) else None, index, 1),
    lambda _, index: ecmascript.set_member([1, 2], "length", index),
]  # fmt: skip


@pytest.mark.parametrize("value", NASTY, ids=lambda value: repr(value)[:20])
@pytest.mark.parametrize("access", ACCESS)
def test_access_to_parts_raises_nothing_but_an_execution_error(
    value: Any, access: Callable[[Any, Any], object]
) -> None:
    for index in NASTY:
        try:
            access(value, index)
        except ExecutionError:
            continue


@pytest.mark.parametrize("name", ["__class__", "__struct_fields__", "real", "keys", "append"])
def test_python_s_own_attributes_are_no_members(name: str) -> None:
    for value in (1, 0.5, "a", [], {}, message_class(INNER)()):
        assert ecmascript.member(value, name) is None
        assert ecmascript.element(value, name) is None
    with pytest.raises(ExecutionError):
        ecmascript.set_member(message_class(INNER)(), name, 1)


def test_holes_of_an_array_are_values_of_their_own() -> None:
    inner = message_class(INNER)
    values: list[Any] = []
    ecmascript.set_element(values, 2, inner(n=1), fill=inner())
    ecmascript.set_member(values, "length", 4, inner())
    values[0].n = 9
    assert [value.n for value in values] == [9, 0, 1, 0]


def test_an_array_does_not_leave_its_bounds() -> None:
    values = [1, 2, 3]
    for change in (
        lambda: ecmascript.set_element(values, 3, 4, fill=0, most=3),
        lambda: ecmascript.set_member(values, "length", 4, 0, 3),
        lambda: ecmascript.set_member(values, "length", 2, 0, 3, 3),
        lambda: ecmascript.set_member(values, "length", 1.5, 0),
    ):
        with pytest.raises(ExecutionError):
            change()
    assert values == [1, 2, 3]


def test_a_64_bit_number_is_copied_and_compared_exactly_and_computed_as_a_double() -> None:
    exact = 2**53 + 1
    assert convert(exact, Primitive("int64")) == exact
    assert not ecmascript.equals(exact, 2**53)
    assert ecmascript.add(exact, 0) == 2**53
    assert to_double(10**400) == math.inf


@pytest.mark.parametrize(
    "value", [math.nan, math.inf, 1e300, 10**400, "soon", None, True, "9" * 400 + "d"]
)
def test_a_delay_that_no_timer_can_wait_is_an_execution_error(value: Any) -> None:
    with pytest.raises(ExecutionError, match="is not a time"):
        seconds(value)
