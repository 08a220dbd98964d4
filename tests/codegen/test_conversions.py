"""Conversions in generated code: where they are written, and that nothing is written where they are not needed."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from m2c.codegen.expressions import ExpressionCompiler
from m2c.codegen.source import quoted
from m2c.language.datatypes import (
    ANY,
    BOOL,
    FLOAT64,
    INT64,
    NUMBER,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
)
from m2c.language.expressions import ObjectLiteral, PortInput
from m2c.language.parsing import parse_expression
from m2c.language.typing import Scope
from m2c.model import DiagnosticLog, Position
from tests.codegen.harness import Generated

INT32, UINT8, FLOAT32 = Primitive("int32"), Primitive("uint8"), Primitive("float32")
POINT = Structure("g/msg/Point", (("n", INT32), ("f", FLOAT32)))
SCOPE = Scope(
    {
        **{"n": INT32, "u": UINT8, "big": INT64, "f": FLOAT32, "d": FLOAT64, "x": NUMBER, "s": STRING},
        **{"b": BOOL, "a": Array(INT32), "three": Array(INT32, 3, True), "few": Array(UINT8, 2)},
        **{"p": POINT, "points": Array(POINT), "any": ANY},
    },
    {"data": POINT},
    {"poi": INT32},
)  # fmt: skip


def compiled(text: str, target: DataType | None) -> tuple[str, bool]:
    """The source of ``text`` in a place of type ``target``, and whether it may fail."""
    log = DiagnosticLog()
    node = parse_expression(text, Position("m", 1, 1), "log", log)
    assert node is not None, log.diagnostics
    compiler = ExpressionCompiler(
        SCOPE, {name: name for name in SCOPE.variables}, {"g/msg/Point": "Point"}, "msg"
    )
    return compiler.value(node, target), compiler.may_fail


@pytest.mark.parametrize(
    ("text", "target", "source"),
    [
        ("n", INT32, "self.n"),
        ("u", INT32, "self.u"),
        ("u + 1", INT32, "self.u + 1"),
        ("(u + 1) % 3", UINT8, "(self.u + 1) % 3"),
        ("three[1]", INT32, "self.three[1]"),
        ("5", INT32, "5"),
        ("b ? 1 : 2", INT32, "1 if self.b else 2"),
        ("5", FLOAT64, "5.0"),
        ("d * 2", FLOAT64, "self.d * 2"),
        ("0.5", FLOAT32, "0.5"),
        ("f", FLOAT32, "self.f"),
        ("s + 'x'", STRING, 'self.s + "x"'),
        ("n > 3", BOOL, "self.n > 3"),
        ("x", NUMBER, "self.x"),
        ("_msg.n", INT32, "msg.n"),
        ("[1, u]", Array(INT32), "[1, self.u]"),
        ("[]", Array(INT32, 3, True), "[0] * 3"),
        ("a", Array(INT32), "copy.deepcopy(self.a)"),
        ("p", POINT, "copy.deepcopy(self.p)"),
        ("({n: 1})", POINT, "Point(n=1)"),
        ("a", ANY, "copy.deepcopy(self.a)"),
        ("a.length", None, "len(self.a)"),
        ("big > n + 1", None, "self.big > self.n + 1"),
    ],
)
def test_where_the_types_settle_it_plain_python_is_written(
    text: str, target: DataType | None, source: str
) -> None:
    assert compiled(text, target) == (source, False)


@pytest.mark.parametrize(
    ("text", "target", "source"),
    [
        ("n + 1", INT32, "ecmascript.to_int32(self.n + 1)"),
        ("n * 3", INT32, "ecmascript.to_int32(self.n * 3)"),
        ("n * n", INT32, "ecmascript.to_int32(ecmascript.multiply(self.n, self.n))"),
        ("big + 1", INT64, "ecmascript.to_int64(ecmascript.add(self.big, 1))"),
        ("n", UINT8, "ecmascript.to_uint8(self.n)"),
        ("n", Primitive("byte"), "ecmascript.to_uint8(self.n)"),
        ("(n + 1) % 3", INT32, "ecmascript.to_int32(ecmascript.remainder(self.n + 1, 3))"),
        ("-n", INT32, "ecmascript.to_int32(ecmascript.negate(self.n))"),
        ("b ? n + 1 : 0", INT32, "ecmascript.to_int32(self.n + 1) if self.b else 0"),
        ("n", FLOAT64, "float(self.n)"),
        ("x", FLOAT64, "ecmascript.to_float64(self.x)"),
        ("0.1", FLOAT32, "ecmascript.to_float32(0.1)"),
        ("d", FLOAT32, "ecmascript.to_float32(self.d)"),
        ("[n + 1]", Array(INT32), "[ecmascript.to_int32(self.n + 1)]"),
        ("few", Array(Primitive("int8")), "ecmascript.to_array(self.few, ecmascript.to_int8)"),
        ("({n: n + 1})", POINT, "Point(n=ecmascript.to_int32(self.n + 1))"),
        ("a[0] > 1", None, "ecmascript.less(1, ecmascript.element(self.a, 0))"),
    ],
)
def test_what_may_wrap_is_converted_without_a_guard_against_failing(
    text: str, target: DataType | None, source: str
) -> None:
    assert compiled(text, target) == (source, False)


@pytest.mark.parametrize(
    ("text", "target", "source"),
    [
        ("a[0]", INT32, "ecmascript.to_int32(ecmascript.element(self.a, 0))"),
        ("x", INT32, "ecmascript.to_int32(self.x)"),
        ("any", STRING, "ecmascript.to_text(self.any)"),
        ("any", BOOL, "ecmascript.to_flag(self.any)"),
        ("any", NUMBER, "ecmascript.to_untyped_number(self.any)"),
        ("any", ANY, "ecmascript.to_untyped(self.any)"),
        ("s + s", STRING, "ecmascript.to_text(self.s + self.s)"),
        ("a", Array(INT32, 3), "ecmascript.to_array(self.a, ecmascript.to_int32, 3)"),
        ("a", Array(INT32, 3, True), "ecmascript.to_array(self.a, ecmascript.to_int32, 3, 3)"),
        ("points[0]", POINT, "ecmascript.to_message(ecmascript.element(self.points, 0), Point)"),
        ("any", Array(POINT), "ecmascript.to_array(self.any, lambda item: ecmascript.to_message(item, Point))"),
        ("any.x", None, 'ecmascript.member(self.any, "x")'),
    ],
)  # fmt: skip
def test_what_may_fail_is_said_to(text: str, target: DataType | None, source: str) -> None:
    assert compiled(text, target) == (source, True)


def test_keys_of_ports_and_objects_are_quoted() -> None:
    compiler = ExpressionCompiler(SCOPE, {}, {})
    key = '"] + evil() + ["\\'
    for text in (
        compiler.value(PortInput(key=key)),
        compiler.value(ObjectLiteral(entries=((key, PortInput(key=key)),))),
    ):
        found = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant)]
        assert {node.value for node in found} == {key}
        assert "evil" not in {
            node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)
        }


@given(text=st.text(st.characters(exclude_categories=[]), max_size=20))
def test_a_quoted_text_is_a_literal_of_it_on_one_line(text: str) -> None:
    literal = quoted(text)
    assert ast.literal_eval(literal) == text
    assert len(literal.splitlines()) == 1
    assert literal.isprintable()


HEAD = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="M">"""


def machine(tmp_path: Path, data: str, body: str) -> Any:
    text = f"""{HEAD}<datamodel>{data}</datamodel><state id="a"><transition event="e">{body}</transition>
    </state></scxml>"""
    return Generated(tmp_path, text)


def test_assignments_never_share_arrays(tmp_path: Path) -> None:
    data = '<data id="a" expr="[1]"/><data id="b" expr="[]"/><data id="c" expr="[]"/>'
    body = """<assign location="b" expr="a"/><assign location="c" expr="[b]"/>
    <assign location="b[0]" expr="2"/>"""
    made = machine(tmp_path, data, body)
    made.it.on_event("e")
    assert (made.it.a, made.it.b, made.it.c) == ([1], [2], [[1]])


def test_an_array_of_fixed_length_begins_with_zeros_and_keeps_its_length(tmp_path: Path) -> None:
    data = '<data id="a" type="int16[3]"/><data id="n" type="int32"/>'
    body = """<assign location="a[2]" expr="70000"/><assign location="n" expr="1"/>
    <assign location="a[3]" expr="1"/><assign location="n" expr="2"/>"""
    made = machine(tmp_path, data, body)
    assert made.it.a == [0, 0, 0]
    made.it.on_event("e")
    assert (made.it.a, made.it.n) == ([0, 0, 70000 - 2**16], 1)


def test_new_elements_of_an_array_are_zero_both_ways(tmp_path: Path) -> None:
    data = '<data id="a" type="int16[]"/><data id="b" type="string[&lt;=4]"/>'
    body = '<assign location="a[2]" expr="1"/><assign location="b.length" expr="2"/>'
    made = machine(tmp_path, data, body)
    made.it.on_event("e")
    assert (made.it.a, made.it.b) == ([0, 0, 1], ["", ""])
