"""What is not known never becomes a verdict that another completion would contradict."""

from __future__ import annotations

import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from moon.properties.formula import Formula, text
from moon.properties.monitor import PropertyMonitor, PropertySet, TimeOrderError
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.differential import random_formula
from tests.properties.direct import holds
from tests.properties.runs import seen


def some_formula(choice: random.Random):
    source = random_formula(choice, choice.randint(1, 3), longest=4)
    source = source.replace("{n > 2}", "{p}").replace("{n <= 1}", "not {q}")
    return parse_formula(source, ticks_per_unit=1)


def agrees(status: Status, value: bool) -> bool:
    return status is Status.INCONCLUSIVE or (status is Status.TRUE) == value


@given(seed=st.integers(0, 2**40))
@settings(max_examples=250, deadline=None)
def test_a_conclusive_verdict_holds_for_every_completion_of_unknown_values(seed):
    choice = random.Random(seed)
    formula = some_formula(choice)
    length = choice.randint(1, 12)
    trace = [{name: choice.random() < 0.5 for name in "pqr"} for _ in range(length)]
    hidden = [{name: choice.random() < 0.2 for name in "pqr"} for _ in range(length)]
    monitor = PropertyMonitor(formula)
    statuses = []
    for t, values in enumerate(trace):
        shown = {name: "?" if hidden[t][name] else value for name, value in values.items()}
        statuses.append(monitor.observe(seen(t, **shown)).status)
    for _ in range(8):
        other = [
            {
                name: choice.random() < 0.5 if hidden[t][name] else value
                for name, value in values.items()
            }
            for t, values in enumerate(trace)
        ]
        for t, status in enumerate(statuses):
            assert agrees(status, holds(formula, other, t)), f"{text(formula, 1)} at {t}"


def port(name: str, event: bool = False) -> Port:
    return Port(name, f"/{name}", path=() if event else ("value",), event=event)


def seeds(*known: int):
    """Random seeds, and those that once failed."""

    def add(test):
        for seed in known:
            test = example(seed=seed)(test)
        return given(seed=st.integers(0, 2**40))(settings(max_examples=250, deadline=None)(test))

    return add


@seeds(105829, 900000558, 900002762, 900012476, 900004813, 900001443, 900032728)
def test_a_loss_never_makes_a_verdict_that_the_lost_messages_contradict(seed):
    choice = random.Random(seed)
    formula = some_formula(choice)
    look_at_a_loss(choice, formula, frozenset())


@seeds(1005187, 1005028, 1004426)
def test_nor_does_a_loss_of_events(seed):
    choice = random.Random(seed)
    formula = some_formula(choice)
    look_at_a_loss(choice, formula, frozenset(choice.sample("pqr", choice.randint(1, 3))))


def look_at_a_loss(choice: random.Random, formula: Formula, events: frozenset[str]) -> None:
    """One loss, reported at its end, in a trace of one message per tick."""
    names = [choice.choice("pqr") for _ in range(choice.randint(3, 24))]
    changes = [(t, name, choice.random() < 0.5) for t, name in enumerate(["p", "q", "r", *names])]
    lost = choice.choice("pqr")
    first = choice.randrange(3, len(changes))
    after = choice.randrange(first, len(changes) + 1)
    values = dict.fromkeys("pqr", False)
    trace = []
    for _, name, value in changes:
        values = {**values, **dict.fromkeys(events, False), name: value or name in events}
        trace.append(values)
    ports = tuple(
        port(name, True)
        if name in events
        else Port(name, f"/{name}", path=("value",), initial=False)
        for name in "pqr"
    )
    monitor = PropertyMonitor(Property("x", formula, ports))
    for t, name, value in changes:
        if t == after:
            monitor.lose(f"/{lost}", first, after)
        if name == lost and first <= t < after:
            continue
        monitor.observe(seen(t, f"/{name}", value=value))
        verdict = monitor.advance(t)  # a name that the formula does not use tells no time
        if t >= after or t < first:
            expected = holds(formula, trace, t)
            assert agrees(verdict.status, expected), f"{text(formula, 1)} at {t}"


def test_nan_makes_a_verdict_inconclusive_not_false():
    monitor = PropertyMonitor("historically {level > 30}")
    assert monitor.observe(seen(1, level=80)).status is Status.TRUE
    verdict = monitor.observe(seen(2, level=float("nan")))
    assert verdict.status is Status.INCONCLUSIVE
    assert verdict.reason == "`level > 30` is not known: the value is NaN"


@pytest.mark.parametrize("value", ["35", None, [35], {"x": 35}, True])
def test_a_value_of_another_type_is_unknown_not_converted(value):
    monitor = PropertyMonitor("{level > 30}")
    monitor.observe(seen(1, level=80))
    assert monitor.observe(seen(2, level=value)).status is Status.INCONCLUSIVE


def test_a_missing_field_is_unknown():
    monitor = PropertyMonitor(
        Property("x", parse_formula("{level > 30}"), (Port("level", "/b", path=("data",)),))
    )
    monitor.observe(seen(1, "/b", data=80))
    verdict = monitor.observe(seen(2, "/b", other=80))
    assert verdict.status is Status.INCONCLUSIVE
    assert "no field" in verdict.reason or "not known" in verdict.reason


def test_contents_that_are_not_known_are_unknown():
    monitor = PropertyMonitor(
        Property("x", parse_formula("{level > 30}"), (Port("level", "/b", path=("data",)),))
    )
    empty = seen(1, "/b")
    assert (
        monitor.observe(
            type(empty)(**{**{f: getattr(empty, f) for f in empty.__struct_fields__}, "data": None})
        ).status
        is Status.INCONCLUSIVE
    )


def test_three_valued_evaluation_ends_when_it_no_longer_matters():
    monitor = PropertyMonitor("historically[:5s]{level > 30}")
    second = 10**9
    monitor.observe(seen(0, level=80))
    assert monitor.observe(seen(second, level="?")).status is Status.INCONCLUSIVE
    assert monitor.observe(seen(2 * second, level=80)).status is Status.INCONCLUSIVE
    assert monitor.advance(7 * second - 1).status is Status.INCONCLUSIVE
    assert monitor.advance(7 * second).status is Status.TRUE


def test_before_its_states_are_known_a_property_says_what_it_waits_for():
    monitor = PropertyMonitor("historically({alarm} -> once{level < 30})")
    monitor.observe(seen(1, alarm=False))
    assert monitor.verdict.status is Status.INCONCLUSIVE
    assert monitor.verdict.reason == "waiting for the first observation of alarm, level"
    assert monitor.observe(seen(2, level=50)).status is Status.TRUE


def test_time_that_runs_backwards_is_refused_and_changes_nothing():
    monitor = PropertyMonitor("historically {p}")
    monitor.observe(seen(5, p=True))
    with pytest.raises(TimeOrderError, match="an observation of 4 ns is too late at 5 ns"):
        monitor.observe(seen(4, p=False))
    assert monitor.verdict.status is Status.TRUE
    with pytest.raises(TimeOrderError):
        monitor.advance(4)


def test_time_that_runs_backwards_for_one_property_changes_nothing_of_the_others():
    ports = tuple(Port(name, f"/{name}", path=("v",)) for name in "pq")
    monitors = PropertySet(
        [
            Property("f", parse_formula("historically {p}"), ports),
            Property("g", parse_formula("historically ({q} and {p})"), ports),
        ]
    )
    monitors.observe(seen(5, "/p", v=True))
    monitors.observe(seen(9, "/q", v=True))
    with pytest.raises(TimeOrderError, match="an observation of 7 ns is too late at 9 ns"):
        monitors.observe(seen(7, "/p", v=False))
    assert {verdict.status for verdict in monitors.verdicts().values()} == {Status.TRUE}


def test_time_does_not_run_backwards_before_the_beginning_either():
    ports = tuple(Port(name, f"/{name}", path=("v",)) for name in "pq")
    monitors = PropertySet([Property("f", parse_formula("{p} and {q}"), ports)])
    monitors.observe(seen(5, "/p", v=True))
    snapshot = monitors.snapshot()
    monitors.observe(seen(9, "/q", v=True))
    monitors.restore(snapshot)
    with pytest.raises(TimeOrderError, match="an observation of 4 ns is too late at 5 ns"):
        monitors.observe(seen(4, "/q", v=True))
    assert monitors.verdicts()["f"].status is Status.INCONCLUSIVE
    monitors.observe(seen(5, "/q", v=True))
    assert monitors.verdicts()["f"].status is Status.TRUE


def test_an_observation_after_its_instant_was_closed_is_refused():
    monitor = PropertyMonitor("historically {p}")
    monitor.observe(seen(5, p=True))
    monitor.advance(7)
    with pytest.raises(TimeOrderError, match="too late at 7 ns"):
        monitor.observe(seen(7, p=False))


@pytest.mark.parametrize("stamp", [1.5, float("nan"), -3, "1", None])
def test_a_stamp_that_is_no_time_is_refused(stamp):
    monitor = PropertyMonitor("historically {p}")
    with pytest.raises(TimeOrderError):
        monitor.observe(seen(stamp, p=True))
    monitor.observe(seen(5, p=True))
    with pytest.raises(TimeOrderError):
        monitor.observe(seen(stamp, p=True))


def test_observations_of_one_stamp_all_count_in_the_order_given():
    monitor = PropertyMonitor("once {p}")
    monitor.observe(seen(5, p=False))
    monitor.observe(seen(6, p=True))
    assert monitor.observe(seen(6, p=False)).status is Status.TRUE
