"""Where a recording has times of reception only, what is violated is so in every order that the bound allows."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from moon.properties.property import Property
from moon.properties.syntax import parse_formula
from tests.offline.logs import FOREIGN, T0, Form, Line, check, foreign_mcap, json_lines
from tests.properties.test_any_order import (
    BEGIN,
    FORMULAS,
    PORTS,
    loose,
    orders,
    random_messages,
    times_false,
)

PRECEDENCE = "  - {id: P, pattern: precedence, cause: go, effect: alarm}\n"
ONE_CHANNEL = "  - {id: L, pattern: absence, of: {falls: level > 0}}\n"
WHY = "perhaps not as it happened, which is known to 200 ms"


def run(alarm_s: float, go_s: float) -> list[Line]:
    """A level every half second, one alarm, and what has to come before it."""
    lines = [Line(n * 0.5, 1) for n in range(8)]
    lines += [Line(alarm_s, 1, "/alarm"), Line(go_s, 1, "/go")]
    return sorted(lines, key=lambda line: line.at_s)


def by_reception(form: Form) -> tuple[str, ...]:
    return ("--time", "log") if form is foreign_mcap else ()


@pytest.mark.parametrize("form", FOREIGN)
def test_what_another_order_explains_is_not_violated(tmp_path: Path, form: Form):
    file = form(tmp_path, run(1.0, 1.1))
    said = check(tmp_path, file, PRECEDENCE, *by_reception(form))
    assert (said.code, said.verdicts) == (0, {"P": "inconclusive"}), said.out
    assert WHY in said.out
    assert check(tmp_path, file, PRECEDENCE, "--strict", *by_reception(form)).code == 1


@pytest.mark.parametrize("form", FOREIGN)
@pytest.mark.parametrize(("alarm_s", "go_s"), [(1.0, 1.3), (1.0, 9.0)])
def test_what_no_order_explains_is_violated(
    tmp_path: Path, form: Form, alarm_s: float, go_s: float
):
    said = check(tmp_path, form(tmp_path, run(alarm_s, go_s)), PRECEDENCE, *by_reception(form))
    assert (said.code, said.verdicts) == (1, {"P": "violated"}), said.out


def test_stamps_tell_the_order(tmp_path: Path):
    lines = [Line(it.at_s, it.data, it.topic, it.at_s - 0.001) for it in run(1.0, 1.1)]
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PRECEDENCE)
    assert said.verdicts == {"P": "violated"}, said.out


@pytest.mark.parametrize(
    ("apart_s", "ahead_s", "options", "verdict"),
    [
        (0.03, 0.0, (), "violated"),
        (0.03, 0.0, ("--clock-skew", "0.05"), "inconclusive"),
        (0.005, 0.0, (), "inconclusive"),  # so much clocks of hosts differ
        (0.03, 0.08, (), "inconclusive"),
        (
            0.03,
            -0.08,
            (),
            "inconclusive",
        ),  # of one message nothing shows that it was late on its way
        (0.15, 0.08, (), "violated"),
    ],
)
def test_stamps_of_clocks_that_seem_to_differ_tell_the_order_that_far(
    tmp_path: Path, apart_s: float, ahead_s: float, options: tuple[str, ...], verdict: str
):
    """By stamps the alarm is first, by so much; the other topic is of a clock that is ahead, by its lags."""
    lines = [Line(n * 0.5, 1, published_s=n * 0.5 - 0.001) for n in range(8)]
    lines += [Line(1.2, 1, "/alarm", 1.199)]
    lines += [Line(1.2 + apart_s - ahead_s, 1, "/go", 1.199 + apart_s)]
    lines.sort(key=lambda line: line.at_s)
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PRECEDENCE, *options)
    assert said.time.startswith("publish_time"), said.time
    assert said.verdicts == {"P": verdict}, said.out


@pytest.mark.parametrize(("behind_s", "verdict"), [(0.005, "violated"), (0.08, "inconclusive")])
def test_a_clock_that_is_behind_for_a_second_may_have_been_behind(
    tmp_path: Path, behind_s: float, verdict: str
):
    """All that it stamps is recorded so much later; by stamps the alarm is 30 ms before what it has to follow."""
    lines = [Line(n * 0.3, 1, published_s=n * 0.3 - 0.001) for n in range(10)]
    alarms = [1.2 + n * 0.3 for n in range(6)]
    lines += [Line(at_s + behind_s, 1, "/alarm", at_s) for at_s in alarms]
    lines += [Line(1.231, 1, "/go", 1.23)]
    lines.sort(key=lambda line: line.at_s)
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PRECEDENCE)
    assert said.verdicts == {"P": verdict}, said.out


@pytest.mark.parametrize(("late", "verdict"), [(4, "violated"), (10, "inconclusive")])
def test_one_message_that_is_late_was_late_on_its_way_if_others_before_and_after_were_not(
    tmp_path: Path, late: int, verdict: str
):
    """A level; by stamps the alarm is 30 ms before what it has to follow."""
    lines = [Line(n * 0.3 + 0.08 * (n == late), 1, published_s=n * 0.3 - 0.001) for n in range(11)]
    lines += [Line(1.2, 1, "/alarm", 1.199), Line(1.23, 1, "/go", 1.229)]
    lines.sort(key=lambda line: line.at_s)
    said = check(tmp_path, foreign_mcap(tmp_path, lines), PRECEDENCE + ONE_CHANNEL)
    assert said.verdicts["P"] == verdict, said.out


LATE = "  - {id: R, pattern: response, request: go, response: alarm, within: 500 ms}\n"


@pytest.mark.parametrize("form", FOREIGN)
@pytest.mark.parametrize(("after_s", "verdict"), [(0.65, "inconclusive"), (0.75, "violated")])
def test_how_long_something_took_is_known_to_the_latency_bound(
    tmp_path: Path, form: Form, after_s: float, verdict: str
):
    """Of one channel, too: what was late by less may have been late because of the network."""
    file = form(tmp_path, run(alarm_s=1.2 + after_s, go_s=1.2))
    assert check(tmp_path, file, LATE, *by_reception(form)).verdicts == {"R": verdict}


def test_how_long_a_channel_was_silent_is_known_to_the_latency_bound(tmp_path: Path):
    often = "  - {id: R, pattern: recurrence, of: lv, within: 500 ms}\n"
    lines = [Line(n * 0.6, 1) for n in range(5)]
    assert check(tmp_path, json_lines(tmp_path, lines), often).verdicts == {"R": "inconclusive"}
    lines.append(Line(3.2, 1))
    assert check(tmp_path, json_lines(tmp_path, lines), often).verdicts == {"R": "violated"}


def test_the_latency_bound_says_how_far_the_order_is_open(tmp_path: Path):
    file = json_lines(tmp_path, run(1.0, 1.1))
    said = check(tmp_path, file, PRECEDENCE, "--latency-bound", "0.05")
    assert said.verdicts == {"P": "violated"}, said.out


def test_in_one_second_of_a_log_anything_may_have_been_first(tmp_path: Path):
    never = "  - {id: N, formula: 'historically(not ({alarm} and once{go}))'}\n"
    for lines in (run(1.0, 1.0), run(1.0, 1.0)[::-1]):
        lines.sort(key=lambda line: line.at_s)
        said = check(tmp_path, json_lines(tmp_path, lines), PRECEDENCE + never)
        assert "violated" not in said.verdicts.values(), said.out


def test_one_channel_is_in_order(tmp_path: Path):
    lines = [Line(1.0, 1), Line(1.01, 0), Line(1.02, 1), Line(2.0, 1, "/go")]
    said = check(tmp_path, json_lines(tmp_path, lines), ONE_CHANNEL)
    assert said.verdicts == {"L": "violated"}, said.out


def test_what_was_violated_in_one_order_may_be_violated_in_all_later(tmp_path: Path):
    later = (
        "  - {id: B, pattern: bounded_existence, of: alarm, at_most: 1, between: [go, level > 5]}\n"
    )
    lines = [Line(0.0, 0), Line(1.0, 1, "/go"), Line(1.5, 1, "/alarm"), Line(2.0, 1, "/alarm")]
    said = check(tmp_path, json_lines(tmp_path, [*lines, Line(2.1, 9), Line(4, 9)]), later)
    assert said.verdicts == {"B": "inconclusive"}, said.out
    said = check(tmp_path, json_lines(tmp_path, [*lines, Line(2.3, 9), Line(4, 9)]), later)
    assert said.verdicts == {"B": "violated"}, said.out


def test_random_recordings_are_violated_where_all_their_orders_are(tmp_path: Path):
    text = (
        "ports:\n  p: {topic: /p}\n  q: {topic: /q}\n  s: {topic: /s, field: data}\nproperties:\n"
    )
    for number, formula in enumerate(FORMULAS):
        text += f"  - {{id: F{number}, formula: '{formula}'}}\n"
    properties = [Property("x", parse_formula(formula), PORTS) for formula in FORMULAS]
    wrong, missed, found = [], [], 0
    for seed in range(25):
        messages = random_messages(random.Random(seed))
        begin, end = messages[0].stamp_ns - 100, messages[-1].stamp_ns
        lines = [Line((it.stamp_ns - BEGIN) / 1e9, it.data["v"], it.channel) for it in messages]
        assert [line.log_ns - T0 + BEGIN for line in lines] == [it.stamp_ns for it in messages]
        declared = [Line(9.0, 0, channel) for channel in ("/p", "/q", "/s")]
        run = foreign_mcap(tmp_path, [*lines, *declared])
        options = ("--time", "log", "--latency-bound", "0.1", "--to", str(lines[-1].at_s + 1e-9))
        said = check(tmp_path, run, text, *options).verdicts
        for number, item in enumerate(properties):
            each = [times_false(loose(item), order, begin, end) for order in orders(messages)]
            is_violated = said[f"F{number}"] == "violated"
            found += is_violated
            if is_violated != (min(each) > 0):
                (wrong if is_violated else missed).append((seed, item.formula))
    assert (wrong, missed, found > 10) == ([], [], True)
