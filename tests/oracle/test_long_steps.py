"""What a long step comes to is remembered: it is what taking it again gives, of other unknown values."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from m2c.model.machine import EventKind
from moon.oracle import program as programs
from moon.oracle.program import MachineProgram
from moon.oracle.steps import Delayed, Output, Step
from moon.oracle.unknowns import Unknown, anything, frozen, unknowns_in
from tests.oracle.machines import library, read

MODEL = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Chain" initial="s">
  <datamodel>
    <data id="n" type="int32" expr="0"/>
    <data id="x" type="float64" expr="0.5"/>
    <data id="items" type="int32[]" expr="[1]"/>
    <data id="count" type="int32" expr="0"/>
  </datamodel>
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Float64"/>
  <ros_time_rate name="beat" rate_hz="1"/>
  <state id="s">
    <ros_topic_callback name="in"><assign location="count" expr="60"/><raise event="again"/></ros_topic_callback>
    <ros_rate_callback name="beat"><assign location="count" expr="60"/><raise event="again"/></ros_rate_callback>
    <transition event="again" cond="count &gt; 0">
      <assign location="count" expr="count - 1"/>
      <assign location="n" expr="(n + items.length) % 7"/>
      <raise event="again"/>
    </transition>
    <transition event="again">
      <if cond="n &lt; 3"><assign location="x" expr="{drawn}"/></if>
      <ros_topic_publish name="out"><field name="data" expr="1 / x"/></ros_topic_publish>
      <send event="later" delay="1s"/>
      <assign location="items" expr="[n, 2]"/>
    </transition>
  </state>
</scxml>
"""
PROGRAMS = {
    drawn: MachineProgram(read(MODEL.format(drawn=drawn)), library())
    for drawn in ("x + n", "Math.random() * n")
}
"""One that only calculates, and one that draws: both of them remember."""
EVENTS = ((EventKind.TIMER, "beat"), (EventKind.MESSAGE, "in"))
UNKNOWN = st.builds(Unknown, st.just(0), st.integers(0, 3), st.just(True))
NUMBERS = st.one_of(st.integers(0, 3), UNKNOWN)
FLOATS = st.one_of(st.sampled_from([0.0, -0.0, 1.0, float("nan")]), st.builds(anything))


def made(found: list[tuple[bool, Step]]) -> Any:
    """All that is taken from the outcomes of a step, as something that can be compared."""
    return [frozen((taken, *held(step)), {}) for taken, step in found]


def held(step: Step) -> list[Any]:
    """What ``step`` changed and sent."""
    sent = [[item.fields, item.goal, item.thread] for item in step.outputs]
    later = [item.id if isinstance(item, Delayed) else item for item in step.scheduled]
    assert not any(isinstance(item, Output) for item in later)
    return [step.state, step.data, sent, later]


@pytest.mark.parametrize("drawn", PROGRAMS)
@given(st.tuples(NUMBERS, FLOATS, st.lists(NUMBERS, max_size=2)), st.sampled_from(EVENTS))
def test_a_long_step_comes_to_the_same_again(
    drawn: str, values: tuple[Any, Any, list[Any]], event: tuple[EventKind, str]
) -> None:
    program = PROGRAMS[drawn]
    data = (*values, 0)
    message = {"data": 1} if event[0] is EventKind.MESSAGE else None
    known: dict[int, Unknown] = {}
    unknowns_in((data, message), known)
    symbolic = bool(known) or program.draws
    again = list(program.take(0, data, event, message, {}, symbolic))
    twice = list(program.take(0, data, event, message, {}, symbolic))
    afresh = list(program._outcomes(0, data, message, {}, event, symbolic))
    assert max(step.length for _, step in afresh) > programs.LONG_STEP
    assert repr(made(again)) == repr(made(twice)) == repr(made(afresh))  # a NaN is not itself
    own: list[dict[int, Unknown]] = [{}, {}]
    for found, unknown in zip((again, twice), own, strict=True):
        unknowns_in([held(step) for _, step in found], unknown)
    assert own[0].keys() & own[1].keys() <= known.keys()
