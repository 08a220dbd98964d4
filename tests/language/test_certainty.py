"""What is certain of values before they are computed: it is so, and it is enough to write plain Python."""

from __future__ import annotations

import math
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m2c.language.certainty import Certain, Certainty, Fit
from m2c.language.conversion import ExecutionError
from m2c.language.datatypes import (
    ANY,
    BOOL,
    FLOAT64,
    INT64,
    INTEGER_RANGES,
    NULL,
    NUMBER,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
    describe,
)
from m2c.language.evaluate import evaluate
from m2c.language.expressions import Expression, PortInput
from m2c.language.parsing import parse_expression
from m2c.language.typing import Scope
from m2c.language.values import convert
from m2c.model import DiagnosticLog, Position
from tests.codegen.limits import Writer
from tests.drawn import examples

INT8, INT32, UINT8 = Primitive("int8"), Primitive("int32"), Primitive("uint8")
FLOAT32 = Primitive("float32")
POINT = Structure("g/msg/Point", (("n", INT8), ("f", FLOAT32)), (), (("LIMIT", "int8", 5),))
SCOPE = Scope(
    variables={
        "n": INT8,
        "i": INT32,
        "u": UINT8,
        "big": INT64,
        "f": FLOAT32,
        "d": FLOAT64,
        "x": NUMBER,
        "s": STRING,
        "b": BOOL,
        "a": Array(INT8),
        "few": Array(INT8, 3),
        "three": Array(INT8, 3, True),
        "p": POINT,
        "points": Array(POINT),
        "any": ANY,
        "o": Structure("", (("x", INT64),)),
    },
    event={"data": POINT, "goal_id": INT64},
    ports={"poi": INT8, "label": STRING, "speed": FLOAT64},
)


def parsed(text: str) -> Expression:
    log = DiagnosticLog()
    expression = parse_expression(text, Position("m", 1, 1), "log", log)
    assert expression is not None, log.diagnostics
    return expression


def whole(low: float, high: float, kind: DataType = INT64) -> Certain:
    return Certain(kind, low, high, True)


@pytest.mark.parametrize(
    ("text", "certain"),
    [
        ("5", whole(5, 5)),
        ("n", whole(-128, 127)),
        ("n + 1", whole(-127, 128)),
        ("n * u", whole(-128 * 255, 127 * 255, NUMBER)),  # -1 * 0 is -0, which is no int
        ("u * u", whole(0, 255 * 255)),
        ("n * 3", whole(-384, 381)),
        ("big + 1", whole(-(2**63) + 1, 2**63, NUMBER)),  # beyond 2**53 it is a double's sum
        ("(i * 3) * i", whole(3 * -(2**31) * (2**31 - 1), 3 * 2**62, NUMBER)),
        ("u % 7", whole(0, 6)),
        ("n % 7", whole(-6, 6, NUMBER)),
        ("(n + 1) % 3", whole(-2, 2, NUMBER)),
        ("n % u", Certain(NUMBER)),  # u may be 0
        ("n / 2", Certain(FLOAT64, -64.0, 63.5)),
        ("n / u", Certain(FLOAT64)),
        ("n ** 2", Certain(FLOAT64)),
        ("-n", whole(-127, 128, NUMBER)),
        ("-(u + 1)", whole(-256, -1)),
        ("f", Certain(FLOAT32)),
        ("f + n", Certain(FLOAT64)),
        ("x + 1", Certain(NUMBER)),
        ("1e308 * 10", Certain(FLOAT64)),
        ("0.5", Certain(FLOAT64, 0.5, 0.5)),
        ("Infinity", Certain(FLOAT64)),
        ("Math.random()", Certain(FLOAT64, 0.0, 1.0)),
        ("Math.floor(Math.random() * 10)", whole(0, 10, NUMBER)),
        ("Math.floor(f)", Certain(NUMBER)),
        ("Math.max(n, u)", whole(0, 255)),
        ("Math.abs(n)", whole(0, 128)),
        ("Math.sign(n)", whole(-1, 1)),
        ("Math.sqrt(n)", Certain(FLOAT64)),
        ("b ? n : 200", whole(-128, 200)),
        ("b ? n : s", Certain()),
        ("n || u", whole(-128, 255)),
        ("b ? 1 : 0.5", Certain(NUMBER, 0.5, 1)),
        ("s", Certain(STRING)),
        ("s + 1", Certain(STRING)),
        ("s + s", Certain(STRING, grows=True)),
        ("s.length", whole(0, 2**32)),
        ("few.length", whole(0, 3)),
        ("three.length", whole(3, 3)),
        ("a[0]", Certain()),
        ("three[2]", whole(-128, 127)),
        ("three[n]", Certain()),
        ("three[u % 3]", whole(-128, 127)),
        ("points[0].n", Certain()),
        ("p.n", whole(-128, 127)),
        ("p.LIMIT", whole(5, 5)),
        ("_msg.f", Certain(FLOAT32)),
        ("o.x", Certain()),
        ("any + 1", Certain()),
        ("any - 1", Certain(NUMBER)),
        ("undefined", Certain(NULL)),
        ("!n", Certain(BOOL)),
        ("n < u", Certain(BOOL)),
        ("typeof any", Certain(STRING)),
    ],
)
def test_what_is_certain_of_each_form(text: str, certain: Certain) -> None:
    assert Certainty(SCOPE).of(parsed(text)) == certain


@pytest.mark.parametrize(
    ("text", "target", "fit"),
    [
        ("n", INT8, Fit.AS_IS),
        ("n", UINT8, Fit.CONVERTED),
        ("n + 1", INT8, Fit.CONVERTED),
        ("n + 1", INT32, Fit.AS_IS),
        ("-n", INT32, Fit.CONVERTED),
        ("f", INT32, Fit.MAY_FAIL),
        ("x", INT32, Fit.MAY_FAIL),
        ("a[0]", INT32, Fit.MAY_FAIL),
        ("n", FLOAT64, Fit.CONVERTED),
        ("f", FLOAT64, Fit.CONVERTED),
        ("d", FLOAT64, Fit.AS_IS),
        ("d", FLOAT32, Fit.CONVERTED),
        ("any", FLOAT64, Fit.MAY_FAIL),
        ("n", NUMBER, Fit.AS_IS),
        ("a[0]", NUMBER, Fit.MAY_FAIL),
        ("s", STRING, Fit.AS_IS),
        ("s + s", STRING, Fit.MAY_FAIL),
        ("s + 'x'", STRING, Fit.AS_IS),
        ("s || n", STRING, Fit.MAY_FAIL),
        ("b", BOOL, Fit.AS_IS),
        ("n", BOOL, Fit.MAY_FAIL),
        ("b ? n : a[0]", INT8, Fit.MAY_FAIL),
        ("a", Array(INT8), Fit.AS_IS),
        ("few", Array(INT8), Fit.AS_IS),
        ("three", Array(INT8, 3), Fit.AS_IS),
        ("a", Array(INT8, 3), Fit.MAY_FAIL),
        ("few", Array(INT8, 3, True), Fit.MAY_FAIL),
        ("a", Array(UINT8), Fit.CONVERTED),
        ("[n, 1]", Array(INT8), Fit.AS_IS),
        ("[n, 1]", Array(INT8, 3, True), Fit.MAY_FAIL),
        ("[]", Array(INT8, 3, True), Fit.AS_IS),
        ("p", POINT, Fit.AS_IS),
        ("points[0]", POINT, Fit.MAY_FAIL),
        ("({n: n + 1})", POINT, Fit.CONVERTED),
        ("({n: x})", POINT, Fit.MAY_FAIL),
        ("({m: 1})", POINT, Fit.MAY_FAIL),
        ("n", ANY, Fit.AS_IS),
        ("any", ANY, Fit.MAY_FAIL),
        ("p", ANY, Fit.AS_IS),
        ("o", Structure("", ()), Fit.MAY_FAIL),
    ],
    ids=lambda item: item if isinstance(item, str) else None,
)
def test_how_a_value_goes_to_a_place(text: str, target: DataType, fit: Fit) -> None:
    assert Certainty(SCOPE).fit(parsed(text), target) is fit


def test_a_port_holds_an_integer_of_any_size() -> None:
    certainty = Certainty(SCOPE)
    assert certainty.fit(PortInput(key="poi"), INT8) is Fit.CONVERTED
    assert certainty.fit(PortInput(key="label"), STRING) is Fit.AS_IS
    assert certainty.fit(PortInput(key="speed"), FLOAT64) is Fit.AS_IS
    assert certainty.fit(PortInput(key="other"), INT8) is Fit.MAY_FAIL


@pytest.mark.parametrize(
    ("text", "throws"),
    [
        ("any.x", True),
        ("points[0].n", True),
        ("p.n", False),
        ("a[9]", False),
        ("any[0]", True),
        ("m", True),
        ("o.x", False),
        ("o.x.y", True),
        ("1 + any", False),
    ],
)
def test_only_access_to_parts_of_what_may_be_undefined_throws(text: str, throws: bool) -> None:
    assert Certainty(SCOPE).may_throw(parsed(text)) is throws


VALUES = Structure(
    "limits/msg/Values",
    (
        *(("b", BOOL), ("o", Primitive("byte")), ("c", Primitive("char"))),
        *((f"i{bits}", Primitive(f"int{bits}")) for bits in (8, 16, 32, 64)),
        *((f"u{bits}", Primitive(f"uint{bits}")) for bits in (8, 16, 32, 64)),
        *(("f32", FLOAT32), ("f64", FLOAT64), ("s", STRING), ("many", Array(INT32))),
        *(("few", Array(UINT8, 3)), ("three", Array(Primitive("int16"), 3, True))),
        *(("pair", Array(FLOAT32, 2, True)), ("words", Array(STRING)), ("inner", POINT)),
    ),
)


def drawn(kind: DataType, draw: Random) -> Any:
    """A value that a place of type ``kind`` can hold, as plain data."""
    match kind:
        case Primitive(name) if name in INTEGER_RANGES:
            return draw.choice([*INTEGER_RANGES[name], 0, 1])
        case Primitive("bool"):
            return draw.random() < 0.5
        case Primitive("string"):
            return draw.choice(["", "a", "7"])
        case Primitive("number"):
            return draw.choice([0, 1, -7, 0.5, math.nan, 2**64, -0.0])
        case Primitive():
            return convert(draw.choice([0.0, -0.0, 1.5, math.nan, math.inf, -1e30]), kind)
        case Structure():
            return {name: drawn(inner, draw) for name, inner in kind.fields}
        case Array(element, length, fixed):
            count = length or 0 if fixed else draw.randint(0, length or 3)
            return [drawn(element, draw) for _ in range(count)]


LIMITS = Scope({**dict(VALUES.fields), "x": NUMBER, "u": ANY}, {"data": VALUES})


@settings(max_examples=examples(600, 6000), deadline=None)
@given(draw=st.randoms(use_true_random=False))
def test_what_is_certain_is_so_whatever_the_data_are(draw: Random) -> None:
    node = parsed(
        Writer(draw)
        .expression(draw.choice(["int", "float", "text", "bool"]))
        .replace("inner.s", "s")
    )
    variables = {name: drawn(kind, draw) for name, kind in LIMITS.variables.items() if name != "u"}
    certainty = Certainty(LIMITS)
    try:
        value = evaluate(node, variables, {"data": drawn(VALUES, draw)})
    except ExecutionError:
        assert certainty.may_throw(node)
        return
    certain = certainty.of(node)
    assert holds(certain, value), (certain, value)
    for target in (INT8, INT64, FLOAT32, FLOAT64, NUMBER, STRING, BOOL, ANY):
        fit = certainty.fit(node, target)
        if fit is not Fit.MAY_FAIL:
            converted = convert(value, target)
            rounded = target == FLOAT32 and fit is Fit.AS_IS
            assert fit is Fit.CONVERTED or rounded or repr(converted) == repr(value), describe(
                target
            )


def holds(certain: Certain, value: Any) -> bool:
    """Whether ``value`` is one of those that ``certain`` allows."""
    kinds = {BOOL: bool, STRING: str, INT64: int, FLOAT64: float, FLOAT32: float, NULL: type(None)}
    if certain.kind in kinds and type(value) is not kinds[certain.kind]:
        return False
    if certain.kind == NUMBER and type(value) not in (int, float):
        return False
    if certain.bounds is None or isinstance(value, str):
        return True
    low, high = certain.bounds
    slack = 1e-9 * max(abs(low), abs(high))
    if certain.whole and not float(value).is_integer():
        return False
    return low - slack <= value <= high + slack
