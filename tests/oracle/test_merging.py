"""Where there are too many possibilities, several are followed as one: that invents no fault, and finds faults."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest

from m2c.language.datatypes import INT64, Structure
from m2c.model.machine import EventKind, OutputKind
from moon.oracle.bounds import Bounds
from moon.oracle.confirmation import Losses
from moon.oracle.merging import is_exact, joined, place_of
from moon.oracle.oracle import Oracle
from moon.oracle.program import MachineProgram
from moon.oracle.shared import Shared
from moon.oracle.state import Goal, Hypothesis, PendingTimer, QueuedEvent
from moon.oracle.unknowns import Unknown, agree, covers
from moon.verdict import Outcome
from tests.oracle.agreement import answer
from tests.oracle.machines import library, read
from tests.oracle.strategies import case
from transports.actions.rules import Phase
from transports.interface import Observation, ObservationKind

MS = 1_000_000
CASES = 150
ANYTHING = Unknown(anything=True)


@pytest.mark.parametrize("hypotheses", [1, 2, 4])
def test_what_conforms_is_never_violated_however_few_hypotheses_are_followed(
    hypotheses: int,
) -> None:
    for seed in range(CASES):
        found = case(Random(seed))
        for ordered in (False, True):
            given = answer(found, ordered, hypotheses)
            assert not (given.conforms and given.outcome is Outcome.VIOLATED), (
                f"seed {seed}: {given}"
            )


BUSY = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Probe" initial="a">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_time_rate name="beat" rate_hz="4"/>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <state id="a">
    <ros_rate_callback name="beat" target="b">
      <assign location="n" expr="(n + 1) % 7"/><send event="later" delay="400ms"/>
    </ros_rate_callback>
    <transition event="later" target="b"><send event="later" delay="300ms"/></transition>
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="n"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
  <state id="b">
    <ros_rate_callback name="beat"><send event="later" delay="400ms"/></ros_rate_callback>
    <transition event="later" target="a"/>
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="n"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""
"""A machine that sends itself more and more, unobserved."""


def asked(oracle: Oracle, number: int, stamp_ns: int, value: int | None) -> None:
    """The machine takes a request and, if there is a ``value``, answers it."""
    kinds = [ObservationKind.REQUEST_RECEIVED]
    if value is not None:
        kinds.append(ObservationKind.RESPONSE_SENT)
    for place, kind in enumerate(kinds):
        data = {"value": value} if place else {"value": 0}
        stamp = stamp_ns + place
        oracle.feed(
            Observation(
                stamp_ns=stamp,
                received_ns=stamp,
                channel="/Probe/ask",
                kind=kind,
                type_name="probe_interfaces/srv/Ask",
                data=data,
                source="Probe",
                client="client",
                call=number,
            )
        )


def followed(last: int | None, synchronised: bool = True) -> Oracle:
    """An oracle of few hypotheses that saw the machine answer five times in ten seconds, ``last`` the last."""
    bounds = Bounds(hypotheses=24)
    losses = Losses(possible=False)
    oracle = Oracle(
        read(BUSY),
        library(),
        bounds=bounds,
        shared=Shared(losses=losses),
        synchronised=synchronised,
    )
    if synchronised:
        oracle.start(0, whole=True)
    else:
        oracle.listen(0)
    for number in range(5):
        asked(oracle, number, (number + 1) * 2000 * MS, 3 if number < 4 else last)
    oracle.advance(14_000 * MS)
    return oracle


@pytest.mark.parametrize("synchronised", [True, False])
def test_a_machine_with_more_possibilities_than_are_followed_is_judged(synchronised: bool) -> None:
    oracle = followed(6, synchronised)
    assert oracle.outcome is Outcome.CONFORMING
    assert oracle.judge.hypotheses


@pytest.mark.parametrize("synchronised", [True, False])
def test_it_is_violated_where_it_does_not_answer(synchronised: bool) -> None:
    assert followed(None, synchronised).outcome is Outcome.VIOLATED


def test_what_is_followed_as_one_is_looked_at_once_in_a_latency_bound_however_often_time_is_told() -> (
    None
):
    oracle = followed(6)
    search, latency_ns = oracle.judge.search, oracle.bounds.latency
    known = oracle.judge.hypotheses or []
    looks = []
    for elapsed in range(10, 2_000, 10):
        looked = search.passed(known, (14_000 + elapsed) * MS)
        if looked is not known:
            looks.append(elapsed)
        known = looked
    assert 2 <= len(looks) <= 2_000 * MS // latency_ns
    assert known


OPEN = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Probe" initial="s">
  <datamodel>
    <data id="points" type="geometry_msgs/Point[]" expr="[]"/>
    <data id="count" type="int32" expr="0"/>
    <data id="on" type="bool" expr="true"/>
  </datamodel>
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <state id="s">
    <ros_topic_callback name="in">
      <assign location="count" expr="0"/>
      <raise event="again"/>
    </ros_topic_callback>
    <transition event="again" cond="count &lt; 100 &amp;&amp; points[0].x &lt; 1 &amp;&amp; on">
      <assign location="count" expr="count + 1"/>
      <raise event="again"/>
    </transition>
    <ros_topic_callback name="in"><assign location="points" expr="[]"/></ros_topic_callback>
  </state>
</scxml>"""


def test_a_step_asks_each_question_about_an_unknown_value_once() -> None:
    program = MachineProgram(read(OPEN), library())
    data = tuple(
        ANYTHING if name != "count" else 0 for name in program.names
    )  # of an array nothing is known
    found = list(program.take(0, data, (EventKind.MESSAGE, "in"), {"data": 1}, {}))
    assert len(found) <= 8


@pytest.mark.parametrize(
    ("value", "other", "expected"),
    [
        (0.0, -0.0, False),
        (1, True, False),
        (1, 1.0, False),
        (Unknown(0, 9, integer=True), 3, True),
        (Unknown(0, 9, integer=True), Unknown(1, 2, integer=True), True),
        (Unknown(0, 9, integer=True), Unknown(1, 2), False),
        (Unknown(0, 9), ANYTHING, False),
        (ANYTHING, Unknown(0, 9), True),
        (ANYTHING, [ANYTHING], True),
        ([ANYTHING], [1], False),
    ],
)
def test_one_value_covers_another_only_if_it_may_be_all_that_the_other_may(
    value: object, other: object, expected: bool
) -> None:
    assert covers(value, other) is expected


def ended(label: object, queued_ns: int = 0) -> Hypothesis:
    """A machine that has ended a goal with ``label``, and has something on its queue since ``queued_ns``."""
    result = OutputKind.SUCCEED, {"label": label}
    goal = Goal("/do", True, 1, "ab", Phase.ENDED, result, seen=True)
    event = EventKind.THREAD_FREE, "/do"
    queued = QueuedEvent(0, event, None, {"thread_id": 0}, queued_ns, queued_ns)
    return Hypothesis(((0, (label,)),), goals=(goal,), queue=(queued,), vague=1)


def test_what_a_goal_ended_with_tells_hypotheses_apart_and_becomes_unknown_in_one_for_both() -> (
    None
):
    """Somebody may ask for it at any time later."""
    first, second = ended(1), ended(2)
    second.instances = first.instances
    assert first.key() != second.key()
    assert place_of(first) == place_of(second)
    both = joined(first, second, [(None,)])
    assert both is not None
    (goal,) = both.goals
    assert goal.result is not None
    for label in (1, 2):
        assert agree(goal.result[1], {"label": label}, Structure("t", (("label", INT64),)))


def test_one_for_two_has_what_is_queued_in_either_at_the_time_of_either() -> None:
    both = joined(ended(1, 5), ended(2, 9), [(None,)])
    assert both is not None
    (queued,) = both.queue
    assert (queued.low, queued.high) == (5, 9)


@pytest.mark.parametrize("is_called_so", [True, False])
def test_what_a_goal_is_called_stays_known_only_where_it_is_in_both(is_called_so: bool) -> None:
    made = []
    for is_named in (True, is_called_so):
        name, other = (Unknown(1, 9, integer=True) for _ in range(2))
        goal = Goal("/do", True, -1, "ab", Phase.RUNNING, name=name)
        data = name if is_named else other, len(made)
        made.append(Hypothesis(((0, data),), goals=(goal,), free=True, vague=1))
    both = joined(*made, [(None, None)])
    assert both is not None
    ((_, data),) = both.instances
    assert (data[0] is both.goals[0].name) is is_called_so


@pytest.mark.parametrize(
    "changes",
    [
        {"queue": (QueuedEvent(0, (EventKind.THREAD_FREE, "/do"), None, {"goal_id": ANYTHING}, 0, 0),)},
        {"timers": (PendingTimer(0, (EventKind.INTERNAL, "e"), 0, 0, data={"n": ANYTHING}),)},
    ],
)  # fmt: skip
def test_a_hypothesis_with_something_unknown_under_way_is_not_exact(changes: Any) -> None:
    known = Hypothesis(((0, (1,)),))
    assert is_exact(known)
    assert not is_exact(known.but(**changes))
