"""Values that cannot be where they are written: found before a machine runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.check import check_types
from m2c.model import DiagnosticLog, load

HEAD = (
    '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="M">'
)


def findings(tmp_path: Path, data: str, body: str = "") -> list[str]:
    model = tmp_path / "m.scxml"
    model.write_text(
        f"{HEAD}\n<datamodel>{data}</datamodel>\n"
        f'<bt_declare_port_in key="poi" type="int32"/><state id="a"><onentry>{body}</onentry></state></scxml>'
    )
    log = DiagnosticLog()
    system = load([model], log)
    if system is not None and not log.has_errors:
        check_types(system.nodes[0], system.library, log)
    return [f"{found.position.line}:{found.position.column} {found.message} [{found.rule}]" for found in log.diagnostics]  # fmt: skip


VARIABLES = (
    '<data id="n" type="int32"/><data id="txt" type="string"/><data id="values" type="int32[]"/>'
    '<data id="three" type="int32[3]"/><data id="b" type="bool"/>'
)


@pytest.mark.parametrize(
    ("location", "value", "message"),
    [
        ("n", "undefined", "a value of type null where int32 is declared [type-mismatch]"),
        ("n", "txt || n", "a value of type string where int32 is declared [type-mismatch]"),
        ("n", "b ? n : txt", "a value of type string where int32 is declared [type-mismatch]"),
        ("n", "2147483648", "2147483648 does not fit int32 [out-of-range]"),
        ("n", "2147483647 + 1", "2147483648 does not fit int32 [out-of-range]"),
        ("n", "three[3]", "an array of 3 has no element 3 [out-of-range]"),
        ("n", "[1, 2][2]", "an array of 2 has no element 2 [out-of-range]"),
        ("n", "Math.floor(0 / 0)", "this is NaN [out-of-range]"),
        ("n", "NaN", "this is NaN [out-of-range]"),
        ("three", "[1, 2]", "2 elements, 3 are needed [out-of-range]"),
        ("three", "[1, 2, 3, 4]", "4 elements, at most 3 fit [out-of-range]"),
        ("three[3]", "1", "an array of 3 has no element 3 [out-of-range]"),
        ("values[-1]", "1", "an array has no element -1 [out-of-range]"),
        ("txt", "null", "a value of type null where string is declared [type-mismatch]"),
        ("b", "n && b", "a value of type int32 where bool is declared [type-mismatch]"),
    ],
)
def test_a_value_that_is_never_right_is_an_error_at_its_place(
    tmp_path: Path, location: str, value: str, message: str
) -> None:
    body = f'\n<assign location="{location}" expr="{value.replace("&", "&amp;")}"/>'
    found = findings(tmp_path, VARIABLES, body)
    assert len(found) == 1, found
    place, _, said = found[0].partition(" ")
    assert said == message
    assert place.startswith("4:")


@pytest.mark.parametrize(
    "value", ["values[5]", "n * 3", "n % n", "Math.floor(n / 2)", "b ? 1 : values[0]", "txt.length"]
)
def test_a_value_that_may_be_right_is_left_to_the_run(tmp_path: Path, value: str) -> None:
    assert findings(tmp_path, VARIABLES, f'<assign location="n" expr="{value}"/>') == []


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ('<data id="a" type="int32[]" expr="[1]"/><data id="n" type="int32" expr="a[1]"/>',
         "`n` cannot begin with this: undefined where int32 is declared"),
        ('<data id="a" type="int32[]" expr="[1]"/><data id="s" type="int32[2]" expr="a"/>',
         "`s` cannot begin with this: 1 elements where 2 fit"),
        ('<data id="z" type="int32"/><data id="n" type="int32" expr="5 % z"/>',
         "`n` cannot begin with this: NaN where int32 is declared"),
        ('<data id="u" expr="[]"/><data id="n" type="int32" expr="u[0].x"/>',
         "`n` cannot begin with this: cannot read `x` of undefined"),
        ('<data id="a" type="int32[]" expr="[1]"/>'
         '<data id="n" type="int32" expr="a[Math.floor(Math.random() * 2)]"/>',
         "the initial value of `n` may be none of type int32"),
    ],
)  # fmt: skip
def test_an_initial_value_that_cannot_be_or_may_fail_is_an_error(
    tmp_path: Path, data: str, message: str
) -> None:
    found = findings(tmp_path, data)
    assert [item.partition(" ")[2] for item in found] == [f"{message} [bad-initial-value]"]


@pytest.mark.parametrize(
    "data",
    [
        '<data id="n" type="int8"><expr><bt_get_input key="poi"/></expr></data>',
        '<data id="n" type="int32" expr="Math.floor(Math.random() * 6) + 1"/>',
        '<data id="a" type="float64[36]"/><data id="b" type="int32[2]" expr="[]"/>',
        '<data id="a" type="int32[]" expr="[1]"/><data id="n" type="int32" expr="a[0] + a.length"/>',
        '<data id="low" type="int64" expr="-9223372036854775808"/>',
        '<data id="high" type="int64" expr="9223372036854775807"/>',
        '<data id="all" type="uint64" expr="18446744073709551615"/>',
        '<data id="u"/><data id="o" expr="{x: 1}"/><data id="y" expr="o.x"/>',
    ],
)
def test_an_initial_value_that_is_right_is_accepted(tmp_path: Path, data: str) -> None:
    assert findings(tmp_path, data) == []


def test_an_array_that_no_memory_holds_is_no_type(tmp_path: Path) -> None:
    (found,) = findings(tmp_path, '<data id="a" type="int32[999999999]"/>')
    assert found.endswith("unknown type `int32[999999999]` [unknown-type]")


BOUNDED = '<data id="n" type="int8" expr="0" lower_bound_incl="-3" upper_bound_incl="5"/>'


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ('<data id="n" type="int8" expr="6" upper_bound_incl="5"/>',
         "this is 6, out of the bounds of `n` [out-of-range]"),
        ('<data id="m" type="int8" expr="2"/><data id="n" type="int8" expr="m * 2" lower_bound_incl="5"/>',
         "this is 4, out of the bounds of `n` [out-of-range]"),
        ('<data id="n" type="float32" lower_bound_incl="0.5"/>',
         "this is 0, out of the bounds of `n` [out-of-range]"),
        ('<data id="n" type="int8" lower_bound_incl="5" upper_bound_incl="-3"/>',
         "no number is from 5 to -3 [out-of-range]"),
        ('<data id="s" type="string" lower_bound_incl="0"/>',
         "a bound of `s`, which is of type string [type-mismatch]"),
        ('<data id="n" type="int8" lower_bound_incl="low"/>', "`low` is not a number [type-mismatch]"),
        ('<data id="n" type="int8" lower_bound_incl="1 +"/>',
         "`1 +`: not an expression: Unexpected token ) [bad-expression]"),
    ],
)  # fmt: skip
def test_a_bound_that_cannot_be_or_is_broken_at_once_is_one_error(
    tmp_path: Path, data: str, message: str
) -> None:
    assert [item.partition(" ")[2] for item in findings(tmp_path, data)] == [message]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("6", "this is 6, out of the bounds of `n` [out-of-range]"),
        ("-4", "this is -4, out of the bounds of `n` [out-of-range]"),
        ("u % 2 + 6", "this is from 6 to 7, out of the bounds of `n` [out-of-range]"),
        ("5", ""),
        ("-3", ""),
        ("n + 1", ""),
        ("u % 2 + 5", ""),
    ],
)
def test_an_assignment_that_is_never_within_the_bounds_is_an_error(
    tmp_path: Path, value: str, message: str
) -> None:
    data = f'{BOUNDED}<data id="u" type="uint8"/>'
    found = findings(tmp_path, data, f'<assign location="n" expr="{value}"/>')
    assert [item.partition(" ")[2] for item in found] == ([message] if message else [])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("<!-- TYPE n:int8 -->\n<data id=\"n\" expr=\"7\"/>", ""),
        ("<!-- TYPE n:int8 --><data id=\"n\" expr=\"300\"/>", "300 does not fit int8 [out-of-range]"),
        ("<!-- TYPE n:int8 --><data id=\"n\" type=\"int16\" expr=\"300\"/>", ""),
        ("<!-- TYPE n:int7 --><data id=\"n\" expr=\"1\"/>", "unknown type `int7` in the comment before it [unknown-type]"),
        ("<!-- TYPE m:int8 --><data id=\"n\" expr=\"1\"/>", "the comment before it gives the type of `m` [unknown-type]"),
        ("<!-- TYPE n:int8 --><!-- the count --><data id=\"n\" expr=\"300\"/>", ""),
        ("<!-- TYPE n:int8 --><data id=\"m\" type=\"int8\"/><data id=\"n\" expr=\"300\"/>", ""),
    ],
)  # fmt: skip
def test_a_comment_directly_before_a_variable_may_give_its_type(
    tmp_path: Path, data: str, message: str
) -> None:
    found = findings(tmp_path, data)
    assert [item.partition(" ")[2] for item in found] == ([message] if message else [])


@pytest.mark.parametrize(
    ("definition", "set_field", "never_set"),
    [
        ("int8 a 3\nint8 b", "", "`b` of p/msg/A is never set"),
        ("int8 a 3\nstring b 'x'\nint8[] c [1]\nbool d false", "", ""),
        ("int8 a\nint8 b", "", "`a`, `b` of p/msg/A are never set"),
        ("int8 a\nint8 b 1", "a", ""),
        ("Whole a\nPart b\nWhole[] c", "", "`b.y`, `c` of p/msg/A are never set"),
    ],
)
def test_a_field_with_a_default_of_its_own_need_not_be_set(
    tmp_path: Path, definition: str, set_field: str, never_set: str
) -> None:
    folder = tmp_path / "interfaces" / "p" / "msg"
    folder.mkdir(parents=True)
    (folder / "A.msg").write_text(definition)
    (folder / "Whole.msg").write_text("int8 x 1\nint8 y 2\n")
    (folder / "Part.msg").write_text("int8 x 1\nint8 y\n")
    field = f'<field name="{set_field}" expr="1"/>' if set_field else ""
    (tmp_path / "m.scxml").write_text(
        f'{HEAD}<ros_topic_publisher topic="/t" type="p/A"/><state id="a"><onentry>'
        f'<ros_topic_publish name="/t">{field}</ros_topic_publish></onentry></state></scxml>'
    )
    log = DiagnosticLog()
    system = load([tmp_path / "m.scxml"], log)
    assert system is not None
    check_types(system.nodes[0], system.library, log)
    assert [found.message for found in log.diagnostics] == ([never_set] if never_set else [])
