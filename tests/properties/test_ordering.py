"""Observations whose order nobody knows: a verdict is one that every order agrees on."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moon.properties.monitor import PropertySet, TimeOrderError
from moon.properties.ordering import OrderedProperties, _clusters
from moon.properties.property import REQUESTS, Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.differential import random_formula
from tests.properties.runs import seen
from transports.interface import Observation, ObservationKind

PORTS = tuple(Port(name, f"/{name}", path=("v",), initial=False) for name in "pqr")
REACH = 2


def by(source: str, observation: Observation, stamp: int | None = None) -> Observation:
    fields = {name: getattr(observation, name) for name in observation.__struct_fields__}
    fields["source"] = source
    if stamp is not None:
        fields["stamp_ns"] = stamp
    return Observation(**fields)


def allowed(order, original) -> bool:
    place = {id(item): index for index, item in enumerate(order)}
    return all(
        place[id(first)] < place[id(second)]
        for first, second in itertools.combinations(original, 2)
        if first.source == second.source or second.stamp_ns - first.stamp_ns > REACH
    )


def every_verdict(
    item: Property, observations: list[Observation], until: int
) -> tuple[set[Status], set[bool]]:
    """All orders, tried one by one on fresh monitors: the verdicts at the end, and whether the
    property was false at any moment.
    """
    channels = PropertySet([item]).channels()
    observations = [seen for seen in observations if seen.channel in channels]
    choices = [
        [order for order in itertools.permutations(cluster) if allowed(order, cluster)]
        for cluster in _clusters(observations, REACH)
    ]
    found, broken = set(), set()
    for orders in itertools.product(*choices):
        monitors = PropertySet([item])
        changes = []
        for order in orders:
            stamps = sorted(observation.stamp_ns for observation in order)
            for stamp, observation in zip(stamps, order, strict=True):
                changes += monitors.observe(by(observation.source, observation, stamp))
        changes += monitors.advance(until)
        found.add(monitors.verdicts()["f"].status)
        broken.add(any(verdict.status is Status.FALSE for _, verdict in changes))
    return found, broken


@given(seed=st.integers(0, 2**40))
@settings(max_examples=200, deadline=None)
def test_a_verdict_is_given_exactly_where_every_order_agrees(seed):
    choice = random.Random(seed)
    source = random_formula(choice, choice.randint(1, 3), longest=4)
    source = source.replace("{n > 2}", "{p}").replace("{n <= 1}", "not {q}")
    item = Property("f", parse_formula(source, ticks_per_unit=1), PORTS)
    stamp, observations = 0, []
    for _ in range(choice.randint(1, 6)):
        stamp += choice.choice([0, 1, 2, 5, 9])
        name = choice.choice("pqr")
        observation = seen(stamp, f"/{name}", v=choice.random() < 0.5)
        observations.append(by(choice.choice("ab"), observation))
    ordered = OrderedProperties([item], latency_ns=10, uncertainty_ns=REACH)
    delays = {source: choice.randint(0, 8) for source in "ab"}  # each source's own order is kept
    arrivals = sorted(observations, key=lambda item: item.stamp_ns + delays[item.source])
    for observation in arrivals:
        ordered.observe(observation)
    end = stamp + 20
    said = {verdict.status for _, verdict in ordered.advance(end + 10 + REACH)}
    expected, broken = every_verdict(item, observations, end)
    verdict = ordered.verdicts()["f"].status
    assert verdict is (expected.pop() if len(expected) == 1 else Status.INCONCLUSIVE)
    if Status.FALSE in said:
        assert broken == {True}, "false in no more than some of the orders"
    elif True in broken:
        assert Status.INCONCLUSIVE in said, "false in some orders, and nothing said"


def test_what_is_false_for_an_instant_only_is_said():
    item = Property("f", parse_formula("{alarm} -> once{low}"), (ALARM, LOW))
    ordered = OrderedProperties([item], latency_ns=100)
    ordered.observe(by("skill", seen(50, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT)))
    said = [(verdict.status, verdict.since_ns) for _, verdict in ordered.advance(1000)]
    assert said == [(Status.FALSE, 50), (Status.TRUE, 51)]


ALARM = Port("alarm", "/Alarm/tick", REQUESTS, event=True)
LOW = Port("low", "/low", path=("v",), initial=False)
PRECEDENCE = Property("f", parse_formula("historically({alarm} -> once{low})"), (ALARM, LOW))


def feed(uncertainty: int, gap: int) -> OrderedProperties:
    ordered = OrderedProperties([PRECEDENCE], latency_ns=100, uncertainty_ns=uncertainty)
    ordered.observe(by("skill", seen(50, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT)))
    ordered.observe(by("battery", seen(50 - gap, "/low", v=True)))
    ordered.advance(1000)
    return ordered


def test_a_cause_that_may_have_come_after_its_effect_leaves_the_verdict_open():
    verdict = feed(uncertainty=5, gap=3).verdicts()["f"]
    assert verdict.status is Status.INCONCLUSIVE
    assert verdict.reason == "observations may have happened in another order"


def test_a_cause_that_came_clearly_before_settles_it_although_it_arrived_later():
    assert feed(uncertainty=5, gap=6).verdicts()["f"].status is Status.TRUE


def test_with_one_clock_the_stamps_decide():
    assert feed(uncertainty=0, gap=1).verdicts()["f"].status is Status.TRUE


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
