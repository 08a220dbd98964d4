"""What happened before a property's states were known is remembered, as far as it was observed."""

from __future__ import annotations

import pytest

from moon.properties.monitor import PropertySet
from moon.properties.property import Port, Property, Status
from moon.properties.syntax import parse_formula
from tests.properties.runs import seen

PORTS = (
    Port("asked", "/ask", event=True),
    Port("stop", "/stop", event=True),
    Port("battery", "/battery", path=("data",)),
)


def _monitors(source: str, ticks: int = 1) -> PropertySet:
    return PropertySet([Property("f", parse_formula(source, ticks_per_unit=ticks), PORTS)])


PRECEDENCE = "historically ({battery <= 100} -> once {asked})"
SINCE = "historically ({battery <= 100} -> ((not {stop}) since {asked}))"
AFTER = "historically ((once {asked}) -> {battery <= 100})"
MIXED = "historically ({battery <= 10} -> once ({asked} and {battery > 50}))"


@pytest.mark.parametrize(
    ("source", "events", "battery", "expected"),
    [
        (PRECEDENCE, [], 80, Status.FALSE),
        (PRECEDENCE, ["/ask"], 80, Status.TRUE),
        (PRECEDENCE, ["/ask", "/stop", "/ask"], 80, Status.TRUE),
        (PRECEDENCE, ["/stop"], 80, Status.FALSE),
        (SINCE, ["/ask"], 80, Status.TRUE),
        (SINCE, ["/ask", "/stop"], 80, Status.FALSE),
        (SINCE, ["/ask", "/stop", "/ask"], 80, Status.TRUE),
        (AFTER, ["/ask"], 80, Status.TRUE),
        (AFTER, ["/ask"], 101, Status.FALSE),
        (AFTER, [], 101, Status.TRUE),
        (MIXED, ["/ask"], 5, Status.INCONCLUSIVE),  # nobody knows what the battery was then
        (MIXED, [], 5, Status.FALSE),
    ],
)
def test_events_before_the_states_are_known_count(
    source: str, events: list[str], battery: int, expected: Status
) -> None:
    monitors = _monitors(source)
    monitors.advance(0)
    for place, channel in enumerate(events):
        assert not monitors.observe(seen(10 * (place + 1), channel))
        assert monitors.verdicts()["f"].status is Status.INCONCLUSIVE
    monitors.observe(seen(500, "/battery", data=battery))
    monitors.advance(600)
    assert monitors.verdicts()["f"].status is expected


@pytest.mark.parametrize(
    ("source", "expected"),
    [(PRECEDENCE, Status.INCONCLUSIVE), (SINCE, Status.INCONCLUSIVE), (AFTER, Status.TRUE)],
)
@pytest.mark.parametrize("lost", [(0, 5), (20, 30), (5, 400)])
def test_a_loss_before_the_states_are_known_leaves_what_is_remembered_unknown(
    source: str, expected: Status, lost: tuple[int, int]
) -> None:
    monitors = _monitors(source)
    monitors.advance(3)
    monitors.lose("/ask", *lost)
    monitors.observe(seen(500, "/battery", data=80))
    monitors.advance(600)
    assert monitors.verdicts()["f"].status is expected


def test_what_is_known_to_have_happened_once_stays_known_whatever_is_lost() -> None:
    monitors = _monitors(PRECEDENCE)
    monitors.advance(0)
    monitors.observe(seen(10, "/ask"))
    monitors.lose("/ask", 20, 30)
    monitors.observe(seen(500, "/battery", data=80))
    monitors.advance(600)
    assert monitors.verdicts()["f"].status is Status.TRUE


def test_who_joins_late_knows_nothing_of_the_time_before() -> None:
    monitors = _monitors(PRECEDENCE)
    monitors.advance(1_000)
    monitors.lose("/ask", 0, 1_001)
    monitors.observe(seen(1_500, "/battery", data=80))
    assert monitors.verdicts()["f"].status is Status.INCONCLUSIVE


def test_a_violation_after_the_beginning_is_found_whatever_was_before() -> None:
    monitors = _monitors("historically ((once {asked}) -> {battery > 20})")
    monitors.advance(0)
    monitors.observe(seen(10, "/ask"))
    monitors.observe(seen(500, "/battery", data=80))
    assert monitors.verdicts()["f"].status is Status.TRUE
    monitors.observe(seen(600, "/battery", data=10))
    assert monitors.verdicts()["f"].status is Status.FALSE


BEFORE = "historically ({asked} -> once {battery < 30})"


def test_a_state_that_had_no_message_yet_has_not_held() -> None:
    monitors = _monitors(BEFORE)
    monitors.advance(0)
    monitors.observe(seen(10, "/ask"))
    monitors.observe(seen(500, "/battery", data=80))
    monitors.observe(seen(600, "/ask"))
    assert monitors.verdicts()["f"].status is Status.FALSE


@pytest.mark.parametrize(("start", "end"), [(0, 5), (5, 20), (20, 500), (0, 501), (499, 501)])
def test_a_state_whose_first_messages_may_have_been_missed_may_have_held(
    start: int, end: int
) -> None:
    monitors = _monitors(BEFORE)
    monitors.advance(0)
    monitors.observe(seen(10, "/ask"))
    monitors.lose("/battery", start, end)
    monitors.observe(seen(500, "/battery", data=80))
    monitors.observe(seen(600, "/ask"))
    assert monitors.verdicts()["f"].status is Status.INCONCLUSIVE


@pytest.mark.parametrize("is_lost", [False, True])
def test_what_was_false_before_is_no_rise_at_the_beginning(is_lost: bool) -> None:
    """It is asked for so long ago, and it has not been so: it does not become so as the property begins."""
    monitors = _monitors("rises (historically[1:] ((not {asked}) and {battery > 20}))", ticks=100)
    monitors.advance(0)
    monitors.observe(seen(10, "/ask"))
    if is_lost:
        monitors.lose("/ask", 300, 301)
    monitors.observe(seen(500, "/battery", data=80))
    assert monitors.verdicts()["f"].status is Status.FALSE
    monitors.advance(501)
    assert monitors.verdicts()["f"].status is Status.FALSE


@pytest.mark.parametrize(("at", "expected"), [(700, Status.FALSE), (1_100, Status.TRUE)])
def test_a_bound_of_the_start_counts_from_when_time_began(at: int, expected: Status) -> None:
    monitors = _monitors("historically ({asked} -> (once[1000:] true or {battery > 90}))")
    monitors.advance(0)
    monitors.observe(seen(500, "/battery", data=80))
    monitors.observe(seen(at, "/ask"))
    assert monitors.verdicts()["f"].status is expected


def test_a_state_may_have_had_its_first_value_since_the_start() -> None:
    monitors = _monitors(
        "historically (once ({battery > 50} and not once[301:] true) or not once[300:] true)"
    )
    monitors.advance(0)
    monitors.observe(seen(500, "/battery", data=80))
    monitors.advance(600)
    assert monitors.verdicts()["f"].status is not Status.FALSE
