"""What is told of losses: what is missing, and neither what came twice nor what a node numbers anew."""

from __future__ import annotations

import random

import msgspec
import pytest

from transports.interface import Observation, Topic
from transports.losses import KEPT_PLACES, Losses
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld


class Level(msgspec.Struct):
    data: int = 0


Level.__type_name__ = "std_msgs/msg/Int32"


def told(*numbered: tuple[int, int]) -> list[str]:
    """What is said after these numbers and stamps were heard of one source."""
    losses = Losses()
    for number, stamp_ns in numbered:
        losses.number("/a", "A", number, stamp_ns)
    return losses.sentences()


def test_what_is_missing_is_counted() -> None:
    assert told((5, 50), (6, 60), (9, 90)) == ["missed 2 messages on /a from A"]


@pytest.mark.parametrize(
    "numbered",
    [
        [(5, 50), (6, 60), (5, 50), (7, 70)],
        [(5, 50), (5, 50), (6, 60)],
        [(5, 50), (6, 60), (7, 70), (5, 50), (6, 60), (7, 70), (8, 80)],
        [(0, 10), (1, 20), (0, 10), (0, 10), (2, 20)],
    ],
)
def test_what_comes_twice_is_no_loss(numbered: list[tuple[int, int]]) -> None:
    assert told(*numbered) == []


def test_a_node_that_starts_again_counts_anew_and_what_it_loses_then_is_told() -> None:
    assert told((5, 50), (6, 60), (0, 70), (1, 80)) == []
    assert told((5, 50), (6, 60), (0, 70), (2, 80)) == ["missed 1 message on /a from A"]


def test_whatever_is_repeated_and_lost_the_count_is_of_what_is_missing() -> None:
    rng = random.Random(4)
    for _ in range(500):
        count = rng.randrange(1, 30)
        heard = [number for number in range(count) if not number or rng.random() < 0.8]
        told_of: list[tuple[int, int]] = []
        for number in heard:
            told_of.append((number, number * 10))
            told_of += rng.choices(told_of, k=rng.choice((0, 0, 1, 3)))
        missing = heard[-1] + 1 - len(heard)
        plural = "s" * (missing != 1)
        said = [f"missed {missing} message{plural} on /a from A"] if missing else []
        assert told(*told_of) == said


def test_sources_without_end_are_not_kept_without_end() -> None:
    losses = Losses()
    for source in range(2 * KEPT_PLACES):
        for number in (0, 2):
            losses.number("/a", f"A{source}", number, number)
    *_, last = said = losses.sentences()
    assert len(said) == KEPT_PLACES + 1
    assert last == f"missed or could not decode {KEPT_PLACES} messages of yet other sources"


def test_a_tap_on_a_link_that_brings_everything_twice_misses_nothing() -> None:
    world = SimulatedWorld(3, Conditions(duplication=0.7, tap_delay_s=(0.0, 0.05)))
    heard: list[Observation] = []
    tap = SimulatedTransport(world, "tap").tap([], heard.append)
    level = SimulatedTransport(world, "A").publisher(Topic("/level", "std_msgs/msg/Int32", Level))
    for number in range(50):
        level.publish(Level(number))
        world.run_for(0.02)
    world.run_for(1.0)
    assert len(heard) > 60
    assert not tap.problems()
