"""A witness is enough: whatever else had been observed, with its facts the property is false."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moon.monitor.property_verdicts import verdict_on
from moon.properties.formula import text
from moon.properties.monitor import PropertyMonitor, PropertySet
from moon.properties.network import build_network
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.differential import random_formula
from tests.properties.direct import holds
from tests.properties.runs import run, seen
from transports.interface import REQUESTS, Observation, ObservationKind

SECOND = 10**9


def explained(seed: int):
    choice = random.Random(seed)
    source = random_formula(choice, choice.randint(1, 3), 4, choice.random() < 0.5)
    source = source.replace("{n > 2}", "{p}").replace("{n <= 1}", "not {q}")
    formula = parse_formula(source, ticks_per_unit=1)
    trace = [{name: choice.random() < 0.5 for name in "pqr"} for _ in range(choice.randint(1, 12))]
    return choice, formula, trace, run(formula, trace)


@given(seed=st.integers(0, 2**40))
@settings(max_examples=300, deadline=None)
def test_every_trace_with_the_facts_of_a_witness_is_false_too(seed):
    choice, formula, trace, verdicts = explained(seed)
    for t, verdict in enumerate(verdicts):
        if verdict.status is not Status.FALSE or verdict.since_ns != t:
            continue
        witness = verdict.witness
        assert witness is not None
        assert witness.complete
        for _ in range(6):
            other = [{name: choice.random() < 0.5 for name in "pqr"} for _ in trace]
            for fact in witness.facts:
                for tick in range(fact.start_ns, fact.end_ns + 1):
                    other[tick][fact.predicate] = fact.value
            assert not holds(formula, other, t), f"{text(formula, 1)} at {t}: {witness.facts}"


@given(seed=st.integers(0, 2**40))
@settings(max_examples=200, deadline=None)
def test_no_fact_of_a_witness_can_be_left_out(seed):
    _, formula, _, verdicts = explained(seed)
    if any(node.kind == "constant" for node in build_network([formula]).nodes):
        return  # a part such as `{p} -> {p}`, which the monitor knows to be true whatever p is
    for t, verdict in enumerate(verdicts):
        if verdict.status is not Status.FALSE or verdict.since_ns != t:
            continue

        def said(facts, t=t):
            monitor = PropertyMonitor(formula)
            for tick in range(t + 1):
                values = dict.fromkeys("pqr", "?")  # not known
                for fact in facts:
                    if fact.start_ns <= tick <= fact.end_ns:
                        values[fact.predicate] = fact.value
                monitor.observe(seen(tick, **values))
            return monitor.verdict.status

        facts = verdict.witness.facts
        if said(facts) is not Status.FALSE:
            continue  # it takes a distinction of cases: `{p} and not {p}`
        for fact in facts:
            rest = [other for other in facts if other is not fact]
            assert said(rest) is Status.INCONCLUSIVE, f"{text(formula, 1)} at {t}: {fact}"


def test_one_reason_is_given_where_one_is_enough():
    formula = parse_formula("(not {q}) -> ({r} since[1:2] (not {q}))", ticks_per_unit=1)
    (verdict,) = run(formula, [{"p": True, "q": False, "r": False}])
    assert [(fact.predicate, fact.value) for fact in verdict.witness.facts] == [("q", False)]


@given(seed=st.integers(0, 2**40))
@settings(max_examples=150, deadline=None)
def test_the_facts_of_a_witness_are_what_was_observed(seed):
    _, _, trace, verdicts = explained(seed)
    for verdict in verdicts:
        for fact in verdict.witness.facts if verdict.witness is not None else ():
            for tick in range(fact.start_ns, fact.end_ns + 1):
                assert trace[tick][fact.predicate] is fact.value
            if fact.observation is not None:
                assert fact.observation.stamp_ns <= fact.start_ns
                assert fact.observation.data[fact.predicate] is fact.value


ALARM = (
    Port("level", "/battery", path=("data",)),
    Port("alarm", "/Alarm/tick", REQUESTS, event=True),
)


def test_a_response_that_never_comes_is_false_at_its_deadline_and_names_the_request():
    formula = parse_formula(
        "historically(not((not {alarm}) since[5:] ({level < 30} and not {alarm})))"
    )
    monitor = PropertyMonitor(Property("P2", formula, ALARM))
    monitor.observe(seen(0, "/battery", data=80))
    low = seen(10 * SECOND, "/battery", data=29)
    monitor.observe(low)
    assert monitor.next_deadline() == 15 * SECOND
    assert monitor.advance(15 * SECOND - 1).status is Status.TRUE
    verdict = monitor.advance(15 * SECOND)
    assert verdict.status is Status.FALSE
    assert verdict.final
    assert verdict.since_ns == 15 * SECOND
    facts = {(fact.predicate, fact.value): fact for fact in verdict.witness.facts}
    assert facts["level < 30", True].observation is low
    assert facts["level < 30", True].end_ns == 10 * SECOND
    assert (facts["alarm", False].start_ns, facts["alarm", False].end_ns) == (
        10 * SECOND,
        15 * SECOND,
    )


def test_a_response_at_its_very_deadline_is_in_time():
    formula = parse_formula(
        "historically(not((not {alarm}) since[5:] ({level < 30} and not {alarm})))"
    )
    monitor = PropertyMonitor(Property("P2", formula, ALARM))
    monitor.observe(seen(0, "/battery", data=29))
    verdict = monitor.observe(seen(5 * SECOND, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT))
    assert verdict.status is Status.TRUE


def test_the_witness_of_an_absence_is_the_one_event():
    formula = parse_formula("historically({alarm} -> once{level < 30})")
    monitor = PropertyMonitor(Property("P1", formula, ALARM))
    for t in range(5):
        monitor.observe(seen(t * SECOND, "/battery", data=80 - t))
    alarm = seen(5 * SECOND, "/Alarm/tick", kind=ObservationKind.REQUEST_RECEIVED)
    verdict = monitor.observe(alarm)
    assert [
        (fact.predicate, fact.value, fact.observation)
        for fact in verdict.witness.facts
        if fact.value
    ] == [("alarm", True, alarm)]


def test_a_witness_whose_beginning_is_forgotten_says_so():
    monitor = PropertyMonitor("{q} or not once({r} and {u})")
    monitor.observe(seen(0, q=True, r=True, u=True))
    monitor.observe(seen(1, u=False))
    for t in range(2, 4000):
        monitor.observe(seen(t, r=t % 2 == 1))
    verdict = monitor.observe(seen(4000, q=False))
    assert verdict.status is Status.FALSE
    assert not verdict.witness.complete
    assert {fact.predicate for fact in verdict.witness.facts} == {"q", "r", "u"}


def test_a_value_that_is_replaced_at_its_own_stamp_does_not_antedate_a_violation():
    """It was true in between because of that value, of which the remembered signal shows nothing."""
    formula = parse_formula("(historically[3:4]{p}) -> (historically {p})", ticks_per_unit=1)
    monitor = PropertyMonitor(formula)
    for t, value in ((0, False), (2, True), (20, False), (20, True)):
        monitor.observe(seen(t, p=value))
    assert monitor.next_deadline() == 23
    assert monitor.advance(23).status is Status.TRUE
    verdict = monitor.advance(30)
    assert (verdict.status, verdict.since_ns) == (Status.FALSE, 25)


def test_the_first_observation_of_all_is_named_if_it_is_the_reason():
    low = seen(5, "/battery", data=20)
    monitor = PropertyMonitor(Property("f", parse_formula("historically{level > 30}"), (ALARM[0],)))
    (fact,) = monitor.observe(low).witness.facts
    assert (fact.predicate, fact.value, fact.observation) == ("level > 30", False, low)


LEVEL = (
    Port("level", "/battery", path=("data",)),
    Port("docked", "/docked", event=True),
)


@pytest.mark.parametrize("asked", ["{level < 30}", "rises {level < 30}"])
def test_a_witness_names_what_made_it_so_and_not_what_was_heard_last(asked):
    source = f"historically(not((not {{docked}}) since[5:] ({asked} and not {{docked}})))"
    monitor = PropertyMonitor(Property("P", parse_formula(source), LEVEL))
    for second, level in ((8, 31), (9, 30), (10, 29), (11, 28), (12, 27), (13, 26)):
        monitor.observe(seen(second * SECOND, "/battery", data=level))
    verdict = monitor.advance(20 * SECOND)
    assert (verdict.status, verdict.since_ns) == (Status.FALSE, 15 * SECOND)
    facts = [fact for fact in verdict.witness.facts if fact.predicate == "level < 30"]
    assert [fact.observation.data for fact in facts if fact.value] == [{"data": 29}]
    assert verdict.witness.at_ns == 15 * SECOND


@pytest.mark.parametrize("unknown", [False, True])
def test_what_is_reported_of_a_violation_has_the_time_and_value_of_what_made_it_so(unknown):
    """It docks at 12 s, and is owed anew as the level is low still: that is so since 10 s.

    The three-valued evaluation remembers also what is said again.
    """
    source = "historically(not((not {docked}) since[5:] ({level < 30} and not {docked})))"
    source += " and {other > 1}" if unknown else ""
    other = Port("other", "/other", path=("data",), initial="not a number")
    item = Property("P", parse_formula(source), (*LEVEL, other))
    monitor = PropertyMonitor(item)
    monitor.observe(seen(8 * SECOND, "/battery", data=31))
    for second, level in ((10, 29), (11, 28)):
        monitor.observe(seen(second * SECOND, "/battery", data=level))
    monitor.observe(seen(12 * SECOND, "/docked"))
    monitor.observe(seen(13 * SECOND, "/battery", data=27))
    said = verdict_on(item, monitor.advance(20 * SECOND))
    assert said.stamp_ns == 17 * SECOND + 1
    assert [(item.stamp_ns, item.text) for item in said.explanation.evidence[-2:]] == [
        (10 * SECOND, "level < 30 for 2 s: message on /battery of robot {data: 29}"),
        (12 * SECOND + 1, "not (docked) for 5 s"),
    ]


@pytest.mark.parametrize(
    ("length", "begins"), [(3, "{stamp: 1, pose:"), (300, "pose.x: 9 in {stamp: 1")]
)
def test_the_fields_that_a_property_is_about_come_first_in_a_message_that_is_too_long(
    length: int, begins: str
) -> None:
    data = {"stamp": 1, "name": "n" * length, "pose": {"y": 0, "x": 9}}
    if length == 3:
        data = {"stamp": 1, "pose": {"y": 0, "x": 9}}
    ports = (Port("x", "/at", path=("pose", "x")), Port("stamp", "/at", path=("stamp",)))
    item = Property("low", parse_formula("historically{x < 5}"), ports)
    monitor = PropertySet([item])
    monitor.observe(Observation(
        stamp_ns=5, received_ns=5, channel="/at", kind=ObservationKind.MESSAGE, type_name="", data=data,
        source="robot",
    ))  # fmt: skip
    said = verdict_on(item, monitor.verdicts()["low"])
    assert said.explanation is not None
    (evidence,) = said.explanation.evidence
    assert evidence.text.startswith(f"not (x < 5): message on /at of robot {begins}")
