"""What is presumably false will be false, unless something comes late; what is certain stays as it is."""

from __future__ import annotations

import random

from hypothesis import example, given, settings
from hypothesis import strategies as st

from moon.properties.ordering import OrderedProperties
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.differential import random_formula
from tests.properties.runs import seen
from transports.interface import REQUESTS, RESPONSES, Observation, ObservationKind

LATENCY = 10
WAIT = 3
PORTS = (
    Port("p", "/p", path=("v",), initial=False),
    Port("q", "/q", path=("v",)),
    Port("r", "/r", REQUESTS, event=True),
)
KINDS = [ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED]


def some_run(choice: random.Random, latest: int) -> tuple[list[Property], list]:
    """Properties, and observations with the tick at which each is received."""
    properties = []
    for number in range(choice.randint(1, 2)):
        source = random_formula(choice, choice.randint(1, 3), longest=6)
        source = source.replace("{n > 2}", "{p}").replace("{n <= 1}", "not {q}")
        properties.append(Property(f"f{number}", parse_formula(source, ticks_per_unit=1), PORTS))
    stamp, received = LATENCY + 1, []
    for _ in range(choice.randint(1, 12)):
        stamp += choice.choice([0, 1, 2, 5, 9])
        name = choice.choice("pqr")
        value: object = choice.random() < 0.5
        if choice.random() < 0.03:
            value = "?"  # unknown: for a while nothing is presumed
        kind = choice.choice(KINDS) if name == "r" else ObservationKind.MESSAGE
        received.append((stamp + choice.randint(0, latest), seen(stamp, f"/{name}", kind, v=value)))
    return properties, received


def said(properties: list[Property], received: list, presuming: bool = True):
    """What was presumed and what was certain, as (tick, property, status, since)."""
    ordered = OrderedProperties(properties, LATENCY)
    ordered.advance(LATENCY)  # time begins at 0
    presumed, certain = [], []
    for tick in range(max((when for when, _ in received), default=0) + 30):
        for when, observation in received:
            if when == tick:
                ordered.observe(observation)
        for name, verdict in ordered.advance(tick):
            certain.append((tick, name, verdict.status, verdict.since_ns))
        if presuming:
            for name, verdict in ordered.presume(tick - WAIT):
                presumed.append((tick, name, verdict.status, verdict.since_ns))
    return presumed, certain


def known(value: Observation) -> bool:
    return value.data["v"] != "?"


@given(seed=st.integers(0, 2**40))
@settings(max_examples=300, deadline=None)
def test_every_violation_is_presumed_and_comes_true_if_nothing_is_late(seed):
    choice = random.Random(seed)
    properties, received = some_run(choice, latest=WAIT)
    received = [item for item in received if known(item[1])] or [(11, seen(11, "/p", v=True))]
    presumed, certain = said(properties, received)
    violations = [item for item in certain if item[2] is Status.FALSE]
    end = max(tick for tick, _ in received) + 30 - 1 - LATENCY
    assert {item[1:] for item in violations} <= {item[1:] for item in presumed}
    assert {item[1:] for item in presumed if item[3] <= end} == {item[1:] for item in violations}
    for tick, name, _, since in presumed:
        later = [when for when, other, _, at in violations if (other, at) == (name, since)]
        assert not later or (tick <= later[0] and tick - since <= later[0] - since)


@given(seed=st.integers(0, 2**40))
@example(seed=1_003_346)  # unknown, then false
@example(seed=1_004_655)  # values replaced at their own stamp
@settings(max_examples=300, deadline=None)
def test_what_is_certain_does_not_depend_on_what_was_presumed(seed):
    properties, received = some_run(random.Random(seed), latest=LATENCY - 1)
    presumed, certain = said(properties, received)
    assert certain == said(properties, received, presuming=False)[1]
    for tick, name, _, since in presumed:
        # as it would be if what was received by then were all that happened, in the same order
        by_then = sorted((pair for pair in received if pair[0] <= tick), key=lambda pair: pair[0])
        so_far = [(item.stamp_ns, item) for _, item in by_then]
        assert (name, Status.FALSE, since) in [
            item[1:] for item in said(properties, so_far, presuming=False)[1]
        ]


def response(bound: str) -> Property:
    ports = (
        Port("asked", "/a", REQUESTS, event=True),
        Port("answered", "/a", RESPONSES, event=True),
    )
    source = f"historically(not((not {{answered}}) since[{bound}:] {{asked}}))"
    return Property("f", parse_formula(source, ticks_per_unit=1), ports)


def test_a_deadline_shorter_than_the_latency_bound_is_presumed():
    ordered = OrderedProperties([response("5")], latency_ns=100)
    ordered.advance(101)
    ordered.observe(seen(50, "/a", ObservationKind.REQUEST_SENT))
    ((_, verdict),) = ordered.presume(55)
    assert (verdict.status, verdict.since_ns) == (Status.FALSE, 55)
    assert ordered.verdicts()["f"].status is not Status.FALSE


def test_an_answer_that_comes_late_is_seen_when_looked_at_again():
    ordered = OrderedProperties([response("5")], latency_ns=100)
    ordered.advance(101)
    ordered.observe(seen(50, "/a", ObservationKind.REQUEST_SENT))
    assert ordered.presume(60)
    ordered.observe(seen(52, "/a", ObservationKind.RESPONSE_SENT))
    assert ordered.presume(80) == []
    ordered.advance(300)
    assert ordered.verdicts()["f"].status is Status.TRUE


def test_the_end_of_a_call_that_counts_is_the_same_for_both():
    ordered = OrderedProperties([response("5")], latency_ns=100)
    ordered.advance(101)
    ordered.observe(seen(10, "/a", ObservationKind.REQUEST_RECEIVED))
    ordered.observe(seen(11, "/a", ObservationKind.RESPONSE_SENT))
    ordered.advance(140)
    ordered.observe(seen(50, "/a", ObservationKind.REQUEST_SENT))  # its other end counts
    assert ordered.presume(90) == []


def test_after_a_loss_nothing_is_presumed_until_it_does_not_matter():
    ordered = OrderedProperties([response("5")], latency_ns=100)
    ordered.advance(101)
    ordered.observe(seen(50, "/a", ObservationKind.REQUEST_SENT))
    ordered.lose("/a", 51, 52)
    assert ordered.presume(90) == []
