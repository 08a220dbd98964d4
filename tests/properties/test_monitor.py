"""Monitoring: sets of properties, memory, both ends of a call, events."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from moon.properties.monitor import PropertyMonitor, PropertySet
from moon.properties.patterns import (
    Pattern,
    PatternError,
    PatternName,
    Scope,
    ScopeName,
    pattern_formula,
)
from moon.properties.predicates import PredicateError
from moon.properties.property import Port, Property, Status, Verdict
from moon.properties.syntax import parse_formula
from tests.properties.differential import random_formula
from tests.properties.runs import seen
from transports.interface import REQUESTS, RESPONSES, ObservationKind

SECOND = 10**9
ALARM = Port("alarm", "/Alarm/tick", REQUESTS, event=True)
LEVEL = Port("level", "/battery", path=("data",))


@given(seed=st.integers(0, 2**40))
@settings(max_examples=25, deadline=None)
def test_a_set_says_of_each_property_what_a_monitor_of_its_own_says(seed):
    for verdict, own in _verdicts_of_a_set(seed, "pqrn"):
        # what another property of its network remembers may keep one inconclusive a little longer
        assert verdict.status is own.status or verdict.status is Status.INCONCLUSIVE
        assert verdict.since_ns >= own.since_ns or verdict.status is not own.status


@given(seed=st.integers(0, 2**40))
@settings(max_examples=25, deadline=None)
@example(seed=1010)
@example(seed=1395)
def test_a_set_whose_states_come_late_contradicts_no_monitor_of_one_property(seed):
    for verdict, own in _verdicts_of_a_set(seed, ""):
        assert verdict.status is own.status or Status.INCONCLUSIVE in (verdict.status, own.status)


def _verdicts_of_a_set(seed: int, first: str) -> Iterator[tuple[Verdict, Verdict]]:
    """What a set of random properties says of each whenever time has passed, and what a monitor of its own does.

    The states ``first`` are known from the beginning.
    """
    choice = random.Random(seed)
    ports = tuple(Port(name, f"/{name}", path=("v",)) for name in "pqrn")
    properties = [
        Property(
            f"f{number}", parse_formula(random_formula(choice, choice.randint(1, 4)), 1), ports
        )
        for number in range(choice.choice([2, 5, 40]))
    ]
    together = PropertySet(properties)
    alone = [PropertyMonitor(item) for item in properties]
    t = 0
    steps = len(first) + choice.randint(1, 30)
    for place in range(steps):
        is_first = place < len(first)
        t += 0 if is_first else choice.randrange(3)
        name = first[place] if is_first else choice.choice("pqrn")
        value = choice.randrange(4) if name == "n" else choice.random() < 0.5
        observation = seen(t, f"/{name}", v=value)
        together.observe(observation)
        for monitor in alone:
            monitor.observe(observation)
        if place == steps - 1 or (not is_first and choice.random() < 0.2):
            t += choice.randrange(1, 3)
            together.advance(t)
            for monitor in alone:
                monitor.advance(t)
            own = [monitor.verdict for monitor in alone]
            yield from zip(together.verdicts().values(), own, strict=True)
            t += 1


def test_a_property_is_reported_once_when_its_verdict_changes():
    monitors = PropertySet(
        [
            Property("a", parse_formula("historically {level > 30}"), (LEVEL,)),
            Property("b", parse_formula("{level > 50}"), (LEVEL,)),
        ]
    )
    reports = [
        [
            (name, verdict.status.value)
            for name, verdict in monitors.observe(seen(t, "/battery", data=value))
        ]
        for t, value in enumerate([60, 40, 20, 40, 60])
    ]
    assert reports == [
        [("a", "true so far"), ("b", "true so far")],
        [("b", "false")],
        [("a", "false")],
        [],
        [("b", "true so far")],
    ]


def test_a_call_heard_at_both_ends_happens_once():
    at_most_once = pattern_formula(
        Pattern(PatternName.BOUNDED_EXISTENCE, (parse_formula("{alarm}"),), most=1)
    )
    monitor = PropertyMonitor(Property("x", at_most_once, (ALARM,)))
    monitor.observe(seen(1, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT))
    assert (
        monitor.observe(seen(2, "/Alarm/tick", kind=ObservationKind.REQUEST_RECEIVED)).status
        is Status.TRUE
    )
    assert (
        monitor.observe(seen(5, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT)).status
        is Status.FALSE
    )


def test_a_response_that_is_an_error_is_no_response():
    port = Port("status", "/Alarm/tick", RESPONSES, ("status",))
    monitor = PropertyMonitor(Property("x", parse_formula("{status == 0}"), (port,)))
    monitor.observe(seen(1, "/Alarm/tick", kind=ObservationKind.RESPONSE_SENT, status=0))
    failed = seen(2, "/Alarm/tick", kind=ObservationKind.RESPONSE_SENT)
    fields = {name: getattr(failed, name) for name in failed.__struct_fields__} | {
        "error": "timeout: 5 s"
    }
    assert monitor.observe(type(failed)(**fields)).status is Status.TRUE


def test_what_is_false_between_two_observations_is_said():
    source = "{alarm} -> once[:2]{level > 30}"
    monitors = PropertySet([Property("f", parse_formula(source), (ALARM, LEVEL))])
    monitors.observe(seen(0, "/battery", data=10))
    said = monitors.observe(seen(SECOND, "/Alarm/tick", ObservationKind.REQUEST_SENT))
    assert [(verdict.status, verdict.since_ns) for _, verdict in said] == [(Status.FALSE, SECOND)]
    said = monitors.observe(seen(2 * SECOND, "/battery", data=20))
    assert [(v.status, v.since_ns) for _, v in said] == [(Status.TRUE, SECOND + 1)]


def test_a_lapse_of_time_that_another_mends_is_said_though_nobody_asked_in_between():
    source = "(once[:1]{level > 30}) or (once[2:]{level > 30})"
    monitors = PropertySet([Property("f", parse_formula(source), (LEVEL,))])
    monitors.observe(seen(0, "/battery", data=40))
    monitors.observe(seen(1, "/battery", data=10))
    said = monitors.advance(10 * SECOND)
    assert [(v.status, v.since_ns) for _, v in said] == [
        (Status.FALSE, SECOND + 1),
        (Status.TRUE, 2 * SECOND),
    ]


@pytest.mark.parametrize(
    "source", ["{alarm} or not {alarm}", "{level > 3} and not {level > 3}", "{alarm} -> {alarm}"]
)
def test_what_a_formula_does_not_depend_on_may_be_observed(source):
    monitor = PropertyMonitor(Property("f", parse_formula(source), (ALARM, LEVEL)))
    monitor.observe(seen(0, "/battery", data=10))
    monitor.observe(seen(1, "/Alarm/tick", ObservationKind.REQUEST_SENT))
    monitor.observe(seen(2, "/battery", data="?"))
    expected = Status.FALSE if "and" in source else Status.TRUE
    assert monitor.verdict.status is expected


def test_an_event_holds_for_its_instant_only():
    monitor = PropertyMonitor(Property("x", parse_formula("not {alarm}"), (ALARM,)))
    assert monitor.advance(0).status is Status.TRUE
    assert (
        monitor.observe(seen(5, "/Alarm/tick", kind=ObservationKind.REQUEST_SENT)).status
        is Status.FALSE
    )
    assert monitor.next_deadline() == 6
    assert monitor.advance(6).status is Status.TRUE


def test_a_recurrence_is_missed_exactly_when_its_time_is_over():
    published = Port("published", "/battery", event=True)
    formula = pattern_formula(
        Pattern(
            PatternName.RECURRENCE,
            (parse_formula("{published}"),),
            bound=parse_formula("once[:3]{p}").interval,
        )
    )
    monitor = PropertyMonitor(Property("x", formula, (published,)))
    for second in (0, 2, 5, 8):
        assert monitor.observe(seen(second * SECOND, "/battery", data=1)).status is Status.TRUE
    deadlines = []
    while monitor.verdict.status is Status.TRUE:
        deadlines.append(monitor.next_deadline())
        monitor.advance(deadlines[-1])
    # an event holds for one tick: three seconds after it the window still sees it
    assert monitor.verdict.since_ns == 11 * SECOND + 1


def test_an_existence_with_a_time_counts_from_the_start_of_monitoring():
    formula = pattern_formula(
        Pattern(
            PatternName.EXISTENCE,
            (parse_formula("{alarm}"),),
            bound=parse_formula("once[:4]{p}").interval,
        )
    )
    monitor = PropertyMonitor(Property("x", formula, (ALARM,)))
    monitor.advance(100 * SECOND)
    assert monitor.advance(104 * SECOND - 1).status is Status.TRUE
    assert monitor.advance(104 * SECOND).status is Status.FALSE


@pytest.mark.parametrize(
    "source", ["once[:1000000]{p}", "{p} since[5:1000000]{q}", "historically[3:900000]{p}"]
)
def test_memory_holds_what_the_bounds_can_see_and_no_more(source):
    """Changes that come together faster than the bound is wide melt into one interval."""
    monitor = PropertyMonitor(source)
    for t in range(20_000):
        monitor.observe(seen(t * SECOND, p=t % 3 != 0, q=t % 7 == 0))
    variables = monitor._group._program.read().values()
    assert all(len(value) < 10 for value in variables if hasattr(value, "popleft"))


def test_memory_forgets_what_lies_beyond_the_bounds():
    monitor = PropertyMonitor("once[10:11]{p}")
    longest = 0
    for t in range(20_000):
        monitor.observe(seen(t * SECOND // 2, p=t % 10 == 0))
        variables = monitor._group._program.read().values()
        longest = max(longest, *(len(value) for value in variables if hasattr(value, "popleft")))
    assert 2 <= longest <= 5
    assert len(monitor._group._program.heap) < 20


@pytest.mark.parametrize("initial", [{}, {"initial": 5}])
def test_one_name_may_mean_two_things_in_two_properties(initial):
    here, there = (
        Port("level", channel, path=("data",), **initial) for channel in ("/here", "/there")
    )
    formula = parse_formula("{level > 1}")
    monitors = PropertySet([Property("a", formula, (here,)), Property("b", formula, (there,))])
    monitors.observe(seen(1, "/here", data=0))
    monitors.observe(seen(1, "/there", data=7))
    assert [verdict.status for verdict in monitors.verdicts().values()] == [
        Status.FALSE,
        Status.TRUE,
    ]


def test_an_event_inside_an_expression_is_refused():
    with pytest.raises(PredicateError, match="`alarm` is an event; it stands alone"):
        PropertyMonitor(Property("x", parse_formula("{alarm + 1 > level}"), (ALARM, LEVEL)))


def test_randomness_is_refused():
    with pytest.raises(PredicateError, match=r"Math.random\(\) has no place in a property"):
        PropertyMonitor("{Math.random() > 0.5}")


P, Q = parse_formula("{p}"), parse_formula("{q}")


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        (Pattern(PatternName.RESPONSE, (P,)), "response takes 2 events, not 1"),
        (Pattern(PatternName.ABSENCE, (P, Q)), "absence takes 1 events, not 2"),
        (Pattern(PatternName.RECURRENCE, (P,)), "recurrence needs a time `within`"),
        (
            Pattern(PatternName.ABSENCE, (P,), Scope(ScopeName.BEFORE)),
            "the scope before takes an end",
        ),
        (
            Pattern(PatternName.ABSENCE, (P,), Scope(ScopeName.BETWEEN, P)),
            "the scope between takes a begin and an end",
        ),
        (Pattern(PatternName.BOUNDED_EXISTENCE, (P,), most=21), "at most 0 to 20 occurrences"),
    ],
)
def test_an_incomplete_pattern_is_refused(pattern, message):
    with pytest.raises(PatternError, match=message):
        pattern_formula(pattern)
