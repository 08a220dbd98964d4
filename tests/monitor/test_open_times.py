"""Of which properties the times are open, by the clocks of the nodes that send to them."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.monitor.open_times import OpenTimes
from moon.oracle.bounds import HOSTS_DIFFER_NS
from moon.properties.files import load_properties
from moon.properties.property import Property
from transports.interface import HERE, Observation, ObservationKind

MS = 1_000_000
START = 10**18
FILE = """\
ports:
  cause: {topic: /cause}
  effect: {topic: /effect}
properties:
  - {id: order, pattern: precedence, cause: cause, effect: effect}
  - {id: timed, pattern: response, request: cause, response: effect, within: 50 ms}
"""
BOTH = ("order", "timed")


@pytest.fixture(scope="module")
def items(tmp_path_factory: pytest.TempPathFactory) -> tuple[Property, ...]:
    file: Path = tmp_path_factory.mktemp("open") / "properties.yaml"
    file.write_text(FILE)
    return tuple(load_properties(file))


@pytest.fixture
def times(items: tuple[Property, ...]) -> OpenTimes:
    made = OpenTimes(items)
    made.restart()
    made.start(START, HOSTS_DIFFER_NS)
    return made


def opened(times: OpenTimes) -> dict[str, int]:
    return {name: orders.open_ns for name, orders in sorted(times.orders.items())}


@pytest.mark.parametrize(
    ("clocks", "expected"),
    [
        ((), {}),
        ((HERE,), {}),
        ((HERE, HERE), {}),
        (("there",), {"timed": 0}),
        (("there", "there"), {"timed": 0}),
        (("",), {"timed": 0}),
        (("", ""), dict.fromkeys(BOTH, HOSTS_DIFFER_NS)),
        ((HERE, "there"), dict.fromkeys(BOTH, HOSTS_DIFFER_NS)),
        ((HERE, ""), dict.fromkeys(BOTH, HOSTS_DIFFER_NS)),
        (("there", "elsewhere"), dict.fromkeys(BOTH, HOSTS_DIFFER_NS)),
    ],
)
def test_nodes_of_one_host_are_in_order(
    times: OpenTimes, clocks: tuple[str, ...], expected: dict[str, int]
) -> None:
    for number, clock in enumerate(clocks):
        times.meet(f"N{number}", clock, BOTH)
    assert opened(times) == expected


def test_whoever_was_not_found_may_be_anywhere(times: OpenTimes) -> None:
    times.meet("N", HERE, BOTH)
    times.meet("", "", ("order",))
    assert opened(times) == {"order": HOSTS_DIFFER_NS}


def test_a_clock_may_be_known_later(times: OpenTimes) -> None:
    times.meet("A", HERE, BOTH)
    times.meet("B", "", BOTH)
    assert set(times.orders) == set(BOTH)
    times.meet("B", HERE, ())
    assert not times.orders


def test_a_node_may_move_to_another_host(times: OpenTimes) -> None:
    times.meet("A", HERE, BOTH)
    times.meet("A", "there", BOTH)
    times.meet("A", HERE, BOTH)
    assert opened(times) == dict.fromkeys(BOTH, HOSTS_DIFFER_NS)


def test_only_what_a_node_sends_to_is_open(times: OpenTimes) -> None:
    times.meet("A", HERE, BOTH)
    times.meet("B", "there", ("order",))
    assert opened(times) == {"order": HOSTS_DIFFER_NS}


def sent(channel: str, at_ms: int) -> Observation:
    stamp = START + at_ms * MS
    return Observation(
        stamp_ns=stamp,
        received_ns=stamp,
        channel=channel,
        kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Empty",
        data={},
        source="A",
    )


def test_what_was_observed_first_counts_whenever_hosts_are_known(times: OpenTimes) -> None:
    times.observe(sent("/effect", 5))
    times.advance(START + 1 * MS, True)
    times.meet("A", HERE, BOTH)
    times.meet("B", "there", BOTH)
    times.advance(START + 100 * MS, False)
    assert times.orders["order"].times == 1


def test_what_is_observed_and_not_known_yet_may_have_been_anything(times: OpenTimes) -> None:
    times.advance(START + 1 * MS, False)
    times.observe(sent("/cause", 5))
    times.meet("A", HERE, BOTH)
    times.meet("B", "there", BOTH)
    times.observe(sent("/effect", 60))
    times.advance(START + 200 * MS, False)
    assert times.orders["order"].times == 0
    assert times.orders["timed"].times == 0


def test_what_comes_after_all_up_to_then_was_handed_on_may_have_been_anything(
    times: OpenTimes,
) -> None:
    times.meet("A", HERE, BOTH)
    times.meet("B", "there", BOTH)
    times.observe(sent("/cause", 5))
    times.advance(START + 100 * MS, False)
    assert times.orders["timed"].times == 1
    times.observe(sent("/effect", 40))
    times.advance(START + 200 * MS, False)
    assert times.orders["timed"].times == 0


def test_what_was_observed_before_hosts_are_known_may_have_been_anything(times: OpenTimes) -> None:
    times.advance(START + 1 * MS, False)
    times.observe(sent("/effect", 5))
    times.advance(START + 10 * MS, False)
    times.meet("A", HERE, BOTH)
    times.meet("B", "there", BOTH)
    times.observe(sent("/effect", 40))
    times.advance(START + 100 * MS, False)
    assert times.orders["order"].times == 0  # the cause may have been before
    times.observe(sent("/cause", 200))
    times.advance(START + 300 * MS, False)
    assert times.orders["timed"].times == 1
