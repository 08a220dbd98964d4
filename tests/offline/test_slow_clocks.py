"""By how much a clock that runs too slow, or is behind, is wrong: a bag shows it by when it was recorded only."""

from __future__ import annotations

import itertools
from pathlib import Path
from random import Random

import msgspec
import pytest

from m2c.model.system import System
from moon.oracle.bounds import HOSTS_DIFFER_NS, Bounds
from moon.sources.time_choice import TimeChoice
from moon.sources.time_survey import Survey
from tests.campaign.bags import NS, START_NS, Bag, BagClock
from tests.offline.from_bags import accused_in, loaded, run_of
from transports.interface import Observation, ObservationKind

TALKER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Talker" initial="on">
<ros_time_rate name="beat" rate_hz="{0}"/>
<ros_topic_publisher topic="/told" type="std_msgs/Int32"/>
<state id="on"><ros_rate_callback name="beat">
  <ros_topic_publish name="/told"><field name="data" expr="1"/></ros_topic_publish>
</ros_rate_callback></state>
</scxml>"""
ECHO = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Echo" initial="on">
<ros_time_rate name="beat" rate_hz="{0}"/>
<ros_topic_subscriber topic="/told" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/heard" type="std_msgs/Int32"/>
<state id="on">
  <ros_rate_callback name="beat">
    <ros_topic_publish name="/heard"><field name="data" expr="2"/></ros_topic_publish>
  </ros_rate_callback>
  <ros_topic_callback name="/told">
    <ros_topic_publish name="/heard"><field name="data" expr="{1}"/></ros_topic_publish>
  </ros_topic_callback>
</state>
</scxml>"""
CLOCKS = [
    BagClock(node, ahead_s=ahead_s, drift=drift)
    for node in ("Talker", "Echo")
    for ahead_s, drift in ((-0.09, 0.0), (-0.03, 0.0), (0.0, -0.02), (0.0, -0.01), (0.05, -0.02))
]
RATES = {"both often": (4.0, 2.0), "one seldom": (0.4, 3.0), "the other": (5.0, 0.4)}
PARTS = [(0.0, 0.0), (3.0, 0.0), (4.0, 4.8)]
"""From when until when (s) recording goes on; 0: with the run."""


def written(folder: Path, rates: tuple[float, float], answer: int = 4) -> tuple[Path, ...]:
    folder.mkdir(exist_ok=True)
    (folder / "Talker.scxml").write_text(TALKER.format(rates[0]))
    (folder / "Echo.scxml").write_text(ECHO.format(rates[1], answer))
    return folder / "Talker.scxml", folder / "Echo.scxml"


Run = tuple[tuple[Path, ...], System, list[Observation]]


@pytest.fixture(scope="module", params=RATES)
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    models = written(tmp_path_factory.mktemp("run"), RATES[request.param])
    system = loaded(models)
    return models, system, run_of(system, 10.0)


@pytest.mark.parametrize("clock", CLOCKS, ids=str)
def test_nobody_is_accused_by_a_clock_that_is_slow(
    run: Run, clock: BagClock, tmp_path: Path
) -> None:
    models, system, seen = run
    for (begins_s, ends_s), seed in itertools.product(PARTS, range(2)):
        bag = Bag(seed=seed, clocks=(clock,), begins_s=begins_s, ends_s=ends_s)
        told = bag.recorded(seen)
        assert accused_in(tmp_path / "bag.mcap", bag, told, system, models) == set(), bag


def test_nobody_is_accused_by_a_clock_that_is_off_for_a_while(run: Run, tmp_path: Path) -> None:
    """It is so for a second and two messages at least, or where recording begins or ends."""
    models, system, seen = run
    chance = Random(5)
    for number in range(60):
        node, by_s = (
            chance.choice(["Talker", "Echo"]),
            chance.choice([-0.15, -0.09, -0.05, 0.04, 0.08]),
        )
        at_s, for_s = chance.uniform(0.3, 9.0), chance.uniform(1.0, 3.0)
        before_s = chance.uniform(0.05, 1.5)
        bags = (
            Bag(clocks=(BagClock(node, by_s, at_s, for_s),)),
            Bag(clocks=(BagClock(node, by_s, at_s),), ends_s=at_s + before_s),
            Bag(clocks=(BagClock(node, by_s, 0.0, at_s),), begins_s=max(at_s - before_s, 0.0)),
        )
        bag = msgspec.structs.replace(bags[number % 3], seed=number)
        told = bag.recorded(seen)
        off_from_ns = START_NS + round(at_s * NS)
        off = [
            it for it in told if it.source == node and 0 <= it.stamp_ns - off_from_ns < for_s * NS
        ]
        if told and (number % 3 or len(off) >= 2):
            assert accused_in(tmp_path / "bag.mcap", bag, told, system, models) == set(), bag


def test_who_answers_wrong_is_found_by_the_same_clocks(tmp_path: Path) -> None:
    models = written(tmp_path, RATES["both often"])
    system, bag = loaded(models), Bag(clocks=(CLOCKS[1],))
    told = bag.recorded(run_of(system, 10.0))
    expected = written(tmp_path / "expected", RATES["both often"], 5)
    assert accused_in(tmp_path / "bag.mcap", bag, told, system, expected) == {"Echo"}


def test_entries_of_a_clock_may_be_out_of_order_by_a_little() -> None:
    survey, second = Survey(TimeChoice(), None, Bounds()), 10**9
    for number in (10, 9, 12, 11, 8, 30, 29):
        stamp = 100 * second + number * 10_000_000
        survey.note(
            Observation(
                kind=ObservationKind.MESSAGE,
                channel="/told",
                type_name="std_msgs/Int32",
                data={"data": 1},
                source="Talker",
                stamp_ns=stamp,
                received_ns=stamp + 30_000_000,
            )
        )
    assert survey.apart_ns == HOSTS_DIFFER_NS
