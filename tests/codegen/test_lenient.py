"""Nodes of lenient models: what is written where a value becomes another, and what it becomes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from m2c.codegen.expressions import ExpressionCompiler
from m2c.language.datatypes import (
    ANY,
    BOOL,
    FLOAT64,
    NUMBER,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
)
from m2c.language.parsing import parse_expression
from m2c.language.typing import Scope
from m2c.model import DiagnosticLog, Position
from tests.codegen.harness import Generated

INT32, INT8 = Primitive("int32"), Primitive("int8")
POINT = Structure("g/msg/Point", (("n", INT32),))
SCOPE = Scope(
    {"n": INT32, "d": FLOAT64, "s": STRING, "b": BOOL, "texts": Array(STRING), "any": ANY},
    lenient=True,
)


@pytest.mark.parametrize(
    ("text", "target", "source", "fails"),
    [
        ("n", INT32, "self.n", False),
        ("n + 1", INT32, "ecmascript.to_int32(self.n + 1)", False),
        ("n", FLOAT64, "float(self.n)", False),
        ("s", INT32, "ecmascript.to_int32(ecmascript.as_whole(self.s))", False),
        ("d", INT8, "ecmascript.to_int8(ecmascript.as_whole(self.d))", False),
        ("s", FLOAT64, "ecmascript.to_float64(ecmascript.as_number(self.s))", False),
        ("s", NUMBER, "ecmascript.to_untyped_number(ecmascript.as_number(self.s))", False),
        ("n", STRING, "ecmascript.to_text(ecmascript.as_text(self.n))", False),
        ("s + s", STRING, "ecmascript.to_text(self.s + self.s)", True),
        ("s", BOOL, "ecmascript.to_flag(ecmascript.as_flag(self.s))", False),
        ("any", INT32, "ecmascript.to_int32(ecmascript.as_whole(self.any))", True),
        ("texts[0]", INT32, 'ecmascript.to_int32(ecmascript.as_whole(ecmascript.element(self.texts, 0)))', True),
        ("[n, s]", Array(INT32), "[self.n, ecmascript.to_int32(ecmascript.as_whole(self.s))]", False),
        ("({n: s})", POINT, "Point(n=ecmascript.to_int32(ecmascript.as_whole(self.s)))", False),
        (
            "any",
            Array(INT8),
            "ecmascript.to_array(self.any, lambda item: ecmascript.to_int8(ecmascript.as_whole(item)))",
            True,
        ),
        ("any", POINT, "ecmascript.to_message(self.any, Point, lenient=True)", True),
        ("s == n", BOOL, "ecmascript.equals(self.s, self.n)", False),
    ],
)  # fmt: skip
def test_a_value_is_converted_as_ecmascript_does_before_it_goes_to_its_place(
    text: str, target: DataType, source: str, fails: bool
) -> None:
    log = DiagnosticLog()
    node = parse_expression(text, Position("m", 1, 1), "log", log)
    assert node is not None, log.diagnostics
    compiler = ExpressionCompiler(
        SCOPE, {name: name for name in SCOPE.variables}, {"g/msg/Point": "Point"}, "msg"
    )
    assert (compiler.value(node, target), compiler.may_fail) == (source, fails)


MODEL = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="a">
<ros_topic_publisher topic="/out" type="g/Mixed"/>
<datamodel>
  <data id="n" type="int32" expr="'41'"/><data id="m" type="int8" expr="n + 1"/>
  <data id="s" type="string" expr="1e21"/><data id="b" type="bool" expr="''"/>
  <data id="a" type="int8[]" expr="['1', '300', -2.5, 'x', true]"/><data id="out" type="g/msg/Mixed"/>
  <data id="texts" type="string[]" expr="['7']"/><data id="free" expr="[]"/>
</datamodel>
<state id="a"><transition event="e"><assign location="{location}" expr="{text}"/></transition>
<transition event="go"><ros_topic_publish name="/out"><field name="number" expr="s"/>
<field name="text" expr="n"/><field name="flag" expr="m"/></ros_topic_publish></transition>
</state></scxml>"""
MIXED = {"g/msg/Mixed.msg": "int16 number\nstring text\nbool flag\nuint8[] bytes\n"}


def made(folder: Path, location: str, text: str) -> Generated:
    return Generated(folder, MODEL.format(location=location, text=text), MIXED, lenient=True)


def test_variables_begin_with_what_ecmascript_makes_of_them(tmp_path: Path) -> None:
    it = made(tmp_path, "n", "0").it
    assert (it.n, it.m, it.s, it.b, it.a) == (41, 42, "1e+21", False, [1, 44, -2, 0, 1])


def test_the_fields_of_a_message_are_what_ecmascript_makes_of_their_values(tmp_path: Path) -> None:
    probe = made(tmp_path, "n", "0")
    probe.it.on_event("go", None)
    ((_, message),) = probe.outputs.sent
    assert (message.number, message.text, message.flag) == (0, "41", True)  # 1e21 modulo 2**16


@pytest.mark.parametrize(
    ("location", "text", "value"),
    [
        ("n", "texts[0]", 7),
        ("n", "s", -559939584),  # 1e21 modulo 2**32
        ("n", "'-2.9' * 2", -5),
        ("n", "'x' * 2", 0),
        ("n", "s == 1e21 ? '5' : '6'", 5),
        ("s", "n / 2", "20.5"),
        ("s", "n > '5'", "true"),
        ("b", "'false'", True),
        ("b", "0 / 0", False),
        ("a[1]", "'9'", [1, 9, -2, 0, 1]),
        ("free", "['3']", ["3"]),
        ("out.bytes", "['1', 2.9]", [1, 2]),
    ],
)
def test_an_assignment_gives_what_ecmascript_says(
    tmp_path: Path, location: str, text: str, value: Any
) -> None:
    probe = made(tmp_path, location, text.replace("<", "&lt;"))
    probe.it.on_event("e", None)
    name, _, part = location.partition("[")[0].partition(".")
    found = getattr(probe.it, name)
    assert (getattr(found, part) if part else found) == value
    assert not probe.outputs.sent


@pytest.mark.parametrize("text", ["texts[1]", "free[0]", "_event.data.missing"])
def test_what_is_missing_is_an_error_of_execution_as_ever(tmp_path: Path, text: str) -> None:
    probe = made(tmp_path, "n", text)
    probe.it.on_event("e", {})
    assert probe.it.n == 41
    ((name, _, why),) = probe.outputs.sent
    assert (name, why) == ("fault", "undefined where int32 is declared")
