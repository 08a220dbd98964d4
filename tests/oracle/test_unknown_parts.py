"""What a step may do when nothing is known of the data: all that generated code can have done."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from m2c.language.conversion import to_float32
from m2c.language.datatypes import FLOAT64, Primitive
from m2c.model.machine import EventKind
from moon.oracle.program import MachineProgram
from moon.oracle.unknowns import Unknown, anything, is_unknown, tolerant, unknown_of
from tests.oracle.machines import library, read

MODEL = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe" initial="s">
  <datamodel>
    <data id="n" type="int32" expr="0"/>
    <data id="x" type="float64" expr="0.5"/>
    <data id="items" type="int32[]" expr="[1]"/>
    <data id="few" type="int32[&lt;=2]" expr="[1]"/>
    <data id="points" type="geometry_msgs/Point[]" expr="[]"/>
    <data id="point" type="geometry_msgs/Point"/>
  </datamodel>
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <state id="s">
    <ros_topic_callback name="in">
      {content}
      <ros_topic_publish name="out"><field name="data" expr="n"/></ros_topic_publish>
      <assign location="n" expr="_msg.data"/>
      <assign location="x" expr="_msg.data"/>
      <assign location="items" expr="[n]"/>
      <assign location="few" expr="[n]"/>
      <assign location="points" expr="[]"/>
      <assign location="point.x" expr="_msg.data"/>
    </ros_topic_callback>
  </state>
</scxml>
"""

SHOWN = """<if cond="points[0].x &gt; 1"><log label="seen"/></if>"""
"""What makes a difference to ``points``."""


def outcomes(content: str) -> set[int]:
    """How many messages the step may send that begins with ``content``."""
    program = MachineProgram(read(MODEL.format(content=content)), library())
    event = (EventKind.MESSAGE, "in")
    found: Any = program.take(0, program.unknown_data(), event, {"data": 1}, {})
    return {len(step.outputs) for _, step in found}


@pytest.mark.parametrize(
    "content",
    [
        """<log label="far" expr="'' + points[9].x"/>""",
        """<if cond="points[n].x &gt; 1"><log label="seen"/></if>""",
        """<assign location="items[items.length - 1]" expr="2"/>""",
        """<assign location="items.length" expr="n"/>""",
        """<assign location="items" expr="[1]"/><assign location="items.length" expr="n"/>""",
        """<assign location="few[few.length]" expr="2"/>""",
        """<assign location="few[n]" expr="2"/>""",
        """<assign location="points[0].x" expr="2"/>""",
    ],
)
def test_a_part_that_may_not_be_there_may_fail(content: str) -> None:
    expected = {1} if content.startswith("<if") else {0, 1}  # what a condition fails ends no block
    assert outcomes(content) == expected


@pytest.mark.parametrize(
    "content",
    [
        """<assign location="items[items.length]" expr="2"/>""",
        """<assign location="items[3]" expr="2"/>""",
        """<assign location="few[1]" expr="2"/>""",
        """<assign location="point.x" expr="2"/>""",
        """<log label="near" expr="point.x"/>""",
        """<log label="count" expr="points.length"/>""",
    ],
)
def test_a_part_that_is_always_there_does_not_fail(content: str) -> None:
    assert outcomes(content) == {1}


@pytest.mark.parametrize(
    ("cond", "expected"),
    [
        ("typeof n == 'number'", {2}),
        ("typeof x == 'number'", {2}),
        ("typeof items == 'number'", {1, 2}),
        ("typeof n == 'string'", {1}),
    ],
)
def test_a_value_that_is_not_known_has_its_type(cond: str, expected: set[int]) -> None:
    send = '<ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish>'
    assert expected <= outcomes(f'<if cond="{cond}">{send}</if>')


@pytest.mark.parametrize(
    "content",
    [
        """<assign location="points[n].x" expr="2"/>""",
        """<assign location="points[n]" expr="points[0]"/>""",
    ],
)
def test_once_an_unknown_part_is_assigned_nothing_is_known_of_the_whole(content: str) -> None:
    kept = MODEL.replace("""<assign location="points" expr="[]"/>""", "")
    program = MachineProgram(read(kept.format(content=f"{content}{SHOWN}")), library())
    data = list(program.unknown_data())
    place = program.names.index("points")
    data[place] = [{"x": x, "y": 0.0, "z": 0.0} for x in (1.0, 2.0)]
    found: Any = program.take(0, tuple(data), (EventKind.MESSAGE, "in"), {"data": 1}, {})
    assert {is_unknown(step.data[place]) for _, step in found if step.outputs} == {True}


def test_a_part_that_stays_as_it_was_is_the_same_unknown_value() -> None:
    unknown = anything()
    assert copy.deepcopy([{"x": unknown}, 1]) == [{"x": unknown}, 1]


def test_what_was_published_is_not_the_value_that_was_rounded_for_it() -> None:
    """What is learnt of the message tells nothing of the number that is kept."""
    unknown = anything()
    assert tolerant(Primitive("float32"), to_float32)(unknown) is not unknown
    assert tolerant(FLOAT64, float)(unknown) is unknown


def test_a_condition_that_fails_fails_again_while_nothing_changes() -> None:
    """Each failure is an event after which all are tested anew: they come to the same as before."""
    program = MachineProgram(read(WAITS), library())
    found: Any = program.take(0, program.unknown_data(), (EventKind.MESSAGE, "in"), {"data": 1}, {})
    ended = {(step.state, len(step.outputs)) for _, step in found}
    assert ended == {(0, 1), (1, 1), (2, 1)}


WAITS = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe" initial="s">
  <datamodel><data id="points" type="geometry_msgs/Point[]" expr="[]"/></datamodel>
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <state id="s">
    <transition cond="points[0].x &gt; 3" target="first"/>
    <transition cond="points[1].x &gt; 3" target="second"/>
    <ros_topic_callback name="in">
      <ros_topic_publish name="out"><field name="data" expr="_msg.data"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
  <state id="first"/>
  <state id="second">
    <ros_topic_callback name="in"><assign location="points" expr="[]"/></ros_topic_callback>
  </state>
</scxml>
"""


def test_a_range_that_is_all_of_64_bits_is_shown_as_a_question_mark() -> None:
    assert [repr(unknown_of(Primitive(name))) for name in ("int64", "uint64", "int32", "int8")] == [
        "?", "?", "-2147483648…2147483647", "-128…127",
    ]  # fmt: skip
    assert repr(Unknown(-(2**31), 4, integer=True)) == "-2147483648…4"
