"""The oracle's values are those of the declared types: wrapped, refused, or over-approximated where unknown."""

from __future__ import annotations

from typing import Any

import pytest

from m2c.language.datatypes import Primitive
from m2c.language.values import converter
from m2c.model import Machine
from m2c.model.machine import EventKind
from moon.oracle.program import MachineProgram
from moon.oracle.unknowns import Unknown, anything, is_whole, tolerant
from tests.oracle.machines import library, read

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="a">'
PORTS = (
    '<ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>'
    '<ros_topic_publisher topic="/out" type="std_msgs/Int32"/>'
)
OUT = '<ros_topic_publish name="/out"><field name="data" expr="{}"/></ros_topic_publish>'


def machine(data: str, body: str) -> Machine:
    return read(
        f"{HEAD}{PORTS}<datamodel>{data}</datamodel><state id='a'>"
        f"<ros_topic_callback name='/in'>{body}</ros_topic_callback></state></scxml>"
    )


def sent(model: Machine, *data: Any) -> set[tuple[Any, ...]]:
    """What the machine may publish on taking a message, if its data are ``data`` (as they begin, if none)."""
    program = MachineProgram(model, library())
    start = data or program.initial_data()
    unknown = any(isinstance(item, Unknown) for item in start)
    steps = program.take(0, start, (EventKind.MESSAGE, "/in"), {"data": 1}, {}, unknown)
    return {tuple(str(output.fields["data"]) for output in step.outputs) for _, step in steps}


def test_an_assignment_wraps() -> None:
    data = '<data id="n" type="int8" expr="127"/>'
    model = machine(data, f'<assign location="n" expr="n + _msg.data"/>{OUT.format("n")}')
    assert sent(model) == {("-128",)}


def test_a_field_wraps() -> None:
    data = '<data id="n" type="int64" expr="4294967297"/>'
    assert sent(machine(data, OUT.format("n"))) == {("1",)}


def test_what_does_not_fit_ends_the_block() -> None:
    data = '<data id="n" type="int32" expr="5"/><data id="a" type="int32[]"/>'
    model = machine(data, f'<assign location="n" expr="a[0]"/>{OUT.format("n")}')
    assert sent(model) == {()}


def test_a_failing_assignment_to_a_variable_that_nothing_shows_is_seen_all_the_same() -> None:
    data = '<data id="n" type="int32"/><data id="a" type="int32[]"/>'
    model = machine(data, f'<assign location="n" expr="a[0]"/>{OUT.format("1")}')
    assert sent(model) == {()}


def test_a_failing_log_of_a_variable_that_nothing_else_shows_is_seen_all_the_same() -> None:
    data = '<data id="u" expr="[]"/>'
    body = f'<assign location="u" expr="[1]"/><log expr="u[0].x.y"/>{OUT.format("1")}'
    assert sent(machine(data, body)) == {()}


def test_a_value_that_is_not_known_may_wrap_and_may_fail() -> None:
    data = '<data id="n" type="int8"/><data id="u" expr="[]"/>'
    model = machine(data, f'<assign location="n" expr="u[0]"/>{OUT.format("n")}')
    assert sent(model, 0, anything()) == {(), ("-128…127",)}
    model = machine(data, f'<assign location="n" expr="n + 1"/>{OUT.format("n")}')
    assert sent(model, Unknown(0, 126, integer=True), None) == {("1…127",)}
    assert sent(model, Unknown(0, 127, integer=True), None) == {("-128…127",)}
    assert sent(model, anything(), None) == {("-128…127",)}


def test_an_array_literal_for_a_fixed_length_is_zero_if_it_is_empty() -> None:
    data = '<data id="a" type="int32[3]"/>'
    assert sent(machine(data, OUT.format("a[2] + a.length"))) == {("3",)}


def test_what_holds_of_an_unknown_value_in_a_place_allows_all_that_it_can_be() -> None:
    for name, low, high in (("int8", -128, 127), ("uint16", 0, 65535)):
        kind = Primitive(name)
        made = converter(kind, tolerant)(anything())
        assert (made.low, made.high, made.integer) == (low, high, True)
        for number in (low, high, 0):
            assert made.allows(number)
    same = Unknown(1, 5, integer=True)
    assert converter(Primitive("int8"), tolerant)(same) is same
    assert is_whole(same, Primitive("int8"))
    assert not is_whole(anything(), Primitive("int8"))
    single = converter(Primitive("float32"), tolerant)(Unknown(0.1, 0.3))
    assert single.allows(0.10000000149011612)
    assert converter(Primitive("float64"), tolerant)(anything()).allows(float("nan"))


@pytest.mark.parametrize("operator", ["<", "<=", ">", ">="])
def test_a_comparison_with_an_infinity_is_no_fault_of_the_oracle(operator: str) -> None:
    data = '<data id="n" type="int8"/>'
    escaped = operator.replace("<", "&lt;")
    test = f'<if cond="n {escaped} Infinity">{OUT.format("n")}</if>'
    assert sent(machine(data, test), Unknown(0, 100, integer=True))
