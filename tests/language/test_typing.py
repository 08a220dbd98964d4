"""The types of expressions: what each form has, what goes where, and what is said otherwise."""

from __future__ import annotations

import pytest

from m2c.language.datatypes import (
    ANY,
    BOOL,
    FLOAT64,
    INT64,
    NULL,
    NUMBER,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
    describe,
)
from m2c.language.expressions import Expression, PortInput
from m2c.language.parsing import parse_expression
from m2c.language.typing import Scope, assignable, check_expression, constant_value, type_of
from m2c.model import DiagnosticLog, Position
from m2c.suggestions import nearest

INT8, UINT8, FLOAT32 = Primitive("int8"), Primitive("uint8"), Primitive("float32")
POINT = Structure("g/msg/Point", (("x", FLOAT64), ("y", FLOAT64)), (), (("LIMIT", "int8", 5),))
PATH = Structure("g/msg/Path", (("points", Array(POINT)), ("name", STRING)))
SCOPE = Scope(
    variables={
        "n": INT8,
        "u": UINT8,
        "f": FLOAT32,
        "d": NUMBER,
        "s": STRING,
        "b": BOOL,
        "a": Array(INT8),
        "three": Array(INT8, 3, True),
        "p": POINT,
        "path": PATH,
        "any": ANY,
    },
    event={"data": POINT, "goal_id": INT64},
    ports={"poi": INT8},
)


def parsed(text: str) -> Expression:
    log = DiagnosticLog()
    expression = parse_expression(text, Position("m", 1, 1), "log", log)
    assert expression is not None, log.diagnostics
    return expression


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("1", INT64),
        ("1.0", INT64),  # a number is a number: 1.0 is whole
        ("1.5", FLOAT64),
        ("'x'", STRING),
        ("true", BOOL),
        ("null", NULL),
        ("undefined", NULL),
        ("n", INT8),
        ("n + u", INT64),
        ("n + 1", INT64),
        ("n + f", FLOAT64),
        ("n + d", NUMBER),
        ("n / 2", FLOAT64),
        ("n ** 2", FLOAT64),
        ("n % 2", INT64),
        ("-n", INT8),
        ("+n", INT8),
        ("!n", BOOL),
        ("typeof n", STRING),
        ("n < f", BOOL),
        ("s + n", STRING),
        ("n + s", STRING),
        ("s + b", STRING),
        ("any + 1", ANY),
        ("any - 1", NUMBER),
        ("n || u", INT64),
        ("n && n", INT8),
        ("n && s", ANY),
        ("b ? n : u", INT64),
        ("b ? n : s", ANY),
        ("a", Array(INT8)),
        ("a[0]", INT8),
        ("a.length", INT64),
        ("s.length", INT64),
        ("s[0]", STRING),
        ("p.x", FLOAT64),
        ("p.LIMIT", INT8),
        ("path.points[0].x", FLOAT64),
        ("_msg.x", FLOAT64),
        ("_action.goal_id", INT64),
        ("any.x.y", ANY),
        ("Math.floor(f)", INT64),
        ("Math.max(n, u)", INT64),
        ("Math.max(n, f)", FLOAT64),
        ("Math.abs(n)", INT64),
        ("Math.sqrt(n)", FLOAT64),
        ("Math.PI", FLOAT64),
        ("[1, 2]", Array(INT64)),
        ("[1, 2.5]", Array(FLOAT64)),
        ("[1, 'x']", Array(ANY)),
        ("[]", Array(ANY)),
        ("({x: 1})", Structure("", (("x", INT64),))),
    ],
)
def test_every_form_has_its_type(text: str, kind: DataType) -> None:
    assert type_of(parsed(text), SCOPE) == kind
    log = DiagnosticLog()
    assert check_expression(parsed(text), SCOPE, None, "log", log) == kind
    assert log.diagnostics == []


@pytest.mark.parametrize(
    ("text", "expected", "message"),
    [
        ("m", None, "1:1: error: <log>: `m` is not declared; known: a, any, b, d, f and 6 more [undeclared-variable]"),
        ("pth", None, "1:1: error: <log>: `pth` is not declared; did you mean path? [undeclared-variable]"),
        ("p.z", None, "1:1: error: <log>: g/msg/Point has no field `z`; known: x, y [unknown-field]"),
        ("path.nam", None, "1:1: error: <log>: g/msg/Path has no field `nam`; did you mean name? [unknown-field]"),
        ("n.x", None, "1:1: error: <log>: a value of type int8 has no `x` [unknown-field]"),
        ("[1].size", None, "1:1: error: <log>: a value of type int64[] has no `size`; it has `length` [unknown-field]"),
        ("'a'.len", None, "1:1: error: <log>: a value of type string has no `len`; it has `length` [unknown-field]"),
        ("_action.thread_id", None, "1:1: error: <log>: `_action.thread_id` is not available here; available: the message's fields, goal_id [event-data-not-available]"),
        ("n[0]", None, "1:1: error: <log>: a value of type int8 has no elements [type-mismatch]"),
        ("a['x']", None, "1:1: error: <log>: an index of type string [type-mismatch]"),
        ("-s", None, "1:1: error: <log>: `-` applied to string [type-mismatch]"),
        ("n == s", None, "1:1: error: <log>: `==` between int8 and string; both sides must have one type [type-mismatch]"),
        ("p < p == n", None, "1:1: error: <log>: `==` between bool and int8; both sides must have one type [type-mismatch]"),
        ("null < n", None, "1:1: error: <log>: `<` between null and int8; both sides must have one type [type-mismatch]"),
        ("s - 1", None, "1:1: error: <log>: `-` between string and int64; both sides must have one type [type-mismatch]"),
        ("s + a", None, "1:1: error: <log>: `+` between string and int8[]; both sides must have one type [type-mismatch]"),
        ("b + n", None, "1:1: error: <log>: `+` between bool and int8; both sides must have one type [type-mismatch]"),
        ("Math.floor(s)", None, "1:12: error: <log>: Math.floor of a value of type string [type-mismatch]"),
        ("128", INT8, "1:1: error: <log>: 128 does not fit int8; int8 holds -128 to 127 [out-of-range]"),
        ("-1", UINT8, "1:1: error: <log>: -1 does not fit uint8; uint8 holds 0 to 255 [out-of-range]"),
        ("f", INT8, "1:1: error: <log>: a value of type float32 where int8 is declared; use Math.floor, Math.round or Math.trunc to make it whole [type-mismatch]"),
        ("n / 2", INT8, "1:1: error: <log>: a value of type float64 where int8 is declared; use Math.floor, Math.round or Math.trunc to make it whole [type-mismatch]"),
        ("s", BOOL, "1:1: error: <log>: a value of type string where bool is declared; a value of type bool is needed [type-mismatch]"),
        ("n", BOOL, "1:1: error: <log>: a value of type int8 where bool is declared; a value of type bool is needed [type-mismatch]"),
        ("null", INT8, "1:1: error: <log>: a value of type null where int8 is declared; a value of type int8 is needed [type-mismatch]"),
        ("path", POINT, "1:1: error: <log>: a value of type g/msg/Path where g/msg/Point is declared; a value of type g/msg/Point is needed [type-mismatch]"),
        ("[1, 'x']", Array(INT8), "1:5: error: <log>: a value of type string where int8 is declared; a value of type int8 is needed [type-mismatch]"),
        ("[1, 300]", Array(INT8), "1:5: error: <log>: 300 does not fit int8; int8 holds -128 to 127 [out-of-range]"),
        ("[1, 2, 3, 4]", Array(INT8, 3), "1:1: error: <log>: 4 elements, at most 3 fit [out-of-range]"),
        ("({x: 's'})", POINT, "1:6: error: <log>: a value of type string where float64 is declared; a value of type float64 is needed [type-mismatch]"),
        ("({z: 1})", POINT, "1:2: error: <log>: g/msg/Point has no field `z`; known: x, y [unknown-field]"),
        ("b ? 300 : 1", INT8, "1:5: error: <log>: 300 does not fit int8; int8 holds -128 to 127 [out-of-range]"),
        ("100 + 100", INT8, "1:1: error: <log>: 200 does not fit int8; int8 holds -128 to 127 [out-of-range]"),
        ("5 % 0", INT8, "1:1: error: <log>: this is NaN; int8 holds -128 to 127 [out-of-range]"),
        ("Math.floor(1 / 0)", INT8, "1:1: error: <log>: this is Infinity; int8 holds -128 to 127 [out-of-range]"),
        ("b ? undefined : n", INT8, "1:5: error: <log>: a value of type null where int8 is declared; a value of type int8 is needed [type-mismatch]"),
        ("s || n", INT8, "1:1: error: <log>: a value of type string where int8 is declared; a value of type int8 is needed [type-mismatch]"),
        ("n && b", BOOL, "1:1: error: <log>: a value of type int8 where bool is declared; a value of type bool is needed [type-mismatch]"),
        ("null || n", INT8, None),
        ("three[3]", None, "1:7: error: <log>: an array of 3 has no element 3; elements are numbered from 0 [out-of-range]"),
        ("a[-1]", None, "1:3: error: <log>: an array has no element -1; elements are numbered from 0 [out-of-range]"),
        ("a[0.5]", None, "1:3: error: <log>: an array has no element 0.5; elements are numbered from 0 [out-of-range]"),
        ("a[1000]", None, None),
        ("[1, 2]", Array(INT8, 3, True), "1:1: error: <log>: 2 elements, 3 are needed; give all of them, or none: `[]` is an array of zeros [out-of-range]"),
        ("[]", Array(INT8, 3, True), None),
        ("Array.from({length: 3}, () => 'x')", Array(INT8), "1:31: error: <log>: a value of type string where int8 is declared; a value of type int8 is needed [type-mismatch]"),
        ("Array.from({length: 4}, () => 1)", Array(INT8, 3), "1:1: error: <log>: 4 elements, at most 3 fit [out-of-range]"),
        ("Array.from({length: 2}, () => 1)", Array(INT8, 3, True), "1:1: error: <log>: 2 elements, 3 are needed; give all of them, or none: `[]` is an array of zeros [out-of-range]"),
        ("Array.from({length: -1}, () => 1)", Array(INT8, 3, True), "1:1: error: <log>: 0 elements, 3 are needed; give all of them, or none: `[]` is an array of zeros [out-of-range]"),
        ("Array.from({length: 3}, (_, i) => i * 2)", Array(INT8, 3, True), None),
        ("Array.from({length: n}, (_, i) => i * 2)", Array(INT8, 3, True), None),
        ("Array.from({length: 1000001}, () => 1)", None, "1:21: error: <log>: 1000001 elements, at most 1000000 fit [out-of-range]"),
        ("Array.from({length: 1 / 0}, () => 1)", None, "1:21: error: <log>: Infinity elements, at most 1000000 fit [out-of-range]"),
        ("Array.from({length: 2000}, () => Array.from({length: 2}, () => n))", None, "1:21: error: <log>: 2000 elements, at most 1000 fit; so many where one Array.from is in another [out-of-range]"),
        ("Array.from({length: s}, () => 1)", None, "1:21: error: <log>: a length of type string; the length of an array is a number [type-mismatch]"),
        ("Array.from({length: 2}, () => ({x: 's'}))", Array(POINT), "1:36: error: <log>: a value of type string where float64 is declared; a value of type float64 is needed [type-mismatch]"),
        ("Array.from({length: 2}, () => q)", None, "1:31: error: <log>: `q` is not declared; known: a, any, b, d, f and 6 more [undeclared-variable]"),
        ("three", Array(INT8, 4, True), "1:1: error: <log>: a value of type int8[3] where int8[4] is declared; a value of type int8[4] is needed [type-mismatch]"),
        ("three", Array(INT8, 2), "1:1: error: <log>: a value of type int8[3] where int8[<=2] is declared; a value of type int8[<=2] is needed [type-mismatch]"),
        ("a", Array(INT8, 4, True), None),
    ],
)  # fmt: skip
def test_a_fault_is_named_with_its_place(
    text: str, expected: DataType | None, message: str | None
) -> None:
    log = DiagnosticLog()
    check_expression(parsed(text), SCOPE, expected, "log", log)
    assert [str(found) for found in log.diagnostics] == ([f"m:{message}"] if message else [])


@pytest.mark.parametrize(
    ("value", "target", "fits"),
    [
        (INT8, INT64, True),
        (INT64, INT8, True),  # the range of values is not known, only that they are whole
        (NUMBER, INT8, True),
        (FLOAT64, INT8, False),
        (INT8, FLOAT32, True),
        (BOOL, INT8, False),
        (INT8, BOOL, False),
        (STRING, STRING, True),
        (ANY, INT8, True),
        (INT8, ANY, True),
        (NULL, STRING, False),
        (Array(INT8), Array(INT64), True),
        (Array(STRING), Array(INT64), False),
        (Array(ANY), Array(POINT), True),
        (INT8, Array(INT8), False),
        (POINT, POINT, True),
        (PATH, POINT, False),
        (Structure("", (("x", INT64),)), POINT, True),
        (Structure("", (("z", INT64),)), POINT, False),
        (Structure("", (("x", STRING),)), POINT, False),
        (INT8, POINT, False),
    ],
    ids=lambda item: describe(item) if not isinstance(item, bool) else str(item),
)
def test_what_may_be_stored_where(value: DataType, target: DataType, fits: bool) -> None:
    assert assignable(value, target) is fits


def test_a_port_must_be_declared() -> None:
    log = DiagnosticLog()
    port = PortInput(key="pio", position=Position("m", 1, 1))
    assert check_expression(port, SCOPE, None, "data", log) == ANY
    assert [str(found) for found in log.diagnostics] == [
        "m:1:1: error: <data>: port `pio` is not declared; did you mean poi? [undeclared-port]"
    ]
    assert type_of(PortInput(key="poi"), SCOPE) == INT8


@pytest.mark.parametrize(
    ("text", "value"), [("5", 5), ("-5", -5), ("0.5", 0.5), ("true", None), ("n", None), ("1 + 1", None)]
)  # fmt: skip
def test_a_constant_is_a_literal_with_a_sign_or_not(text: str, value: float | None) -> None:
    assert constant_value(parsed(text)) == value


def test_a_hint_names_the_nearest_or_lists_five_nearest_first() -> None:
    assert nearest("levle", ["level", "other"]) == "did you mean level?"
    assert nearest("xyz", ["b", "a"]) == "known: a, b"
    assert nearest("xyz", []) == ""
    many = [f"name{i:02}" for i in range(30)]
    assert nearest("q", many) == f"known: {', '.join(many[:5])} and 25 more"
    assert nearest("q17", many) == "known: name17, name01, name07, name10, name11 and 25 more"
