"""Observations that arrive late count in the order of their stamps."""

from __future__ import annotations

import msgspec
import pytest

from moon.properties.monitor import TimeOrderError
from moon.properties.ordering import OrderedProperties
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.runs import seen
from transports.interface import REQUESTS, Observation, ObservationKind


def by(source: str, observation: Observation) -> Observation:
    return msgspec.structs.replace(observation, source=source)


def test_what_is_false_for_an_instant_only_is_said():
    item = Property("f", parse_formula("{alarm} -> once{low}"), (ALARM, LOW))
    ordered = OrderedProperties([item], latency_ns=100)
    ordered.observe(by("skill", seen(50, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT)))
    said = [(verdict.status, verdict.since_ns) for _, verdict in ordered.advance(1000)]
    assert said == [(Status.FALSE, 50), (Status.TRUE, 51)]


ALARM = Port("alarm", "/Alarm/tick", REQUESTS, event=True)
LOW = Port("low", "/low", path=("v",), initial=False)
PRECEDENCE = Property("f", parse_formula("historically({alarm} -> once{low})"), (ALARM, LOW))


def test_a_cause_that_came_before_settles_it_although_it_arrived_later():
    ordered = OrderedProperties([PRECEDENCE], latency_ns=100)
    ordered.observe(by("skill", seen(50, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT)))
    ordered.observe(by("battery", seen(49, "/low", v=True)))
    ordered.advance(1000)
    assert ordered.verdicts()["f"].status is Status.TRUE


def test_an_observation_later_than_the_latency_bound_is_refused():
    ordered = OrderedProperties([PRECEDENCE], latency_ns=100)
    ordered.advance(1000)
    with pytest.raises(TimeOrderError, match="too late at 900 ns"):
        ordered.observe(seen(900, "/low", v=True))


def test_a_deadline_is_reported_when_nothing_older_can_come():
    item = Property(
        "f", parse_formula("historically(not((not {alarm}) since[100ns:] {low}))"), (ALARM, LOW)
    )
    ordered = OrderedProperties([item], latency_ns=30)
    ordered.advance(30)
    ordered.observe(seen(50, "/low", v=True))
    assert ordered.next_deadline() == 80
    assert ordered.advance(80)[0:1] in ([], [("f", ordered.verdicts()["f"])])
    assert ordered.next_deadline() == 180
    ordered.advance(179)
    assert ordered.verdicts()["f"].status is Status.TRUE
    ((name, verdict),) = ordered.advance(180)
    assert (name, verdict.status, verdict.since_ns) == ("f", Status.FALSE, 150)
