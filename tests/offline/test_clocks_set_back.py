"""A node's clock is set back while a bag is recorded: by its stamps it does things in another order than it did."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.campaign.bags import Bag, BagClock
from tests.offline.from_bags import accused_in, loaded, run_of
from tests.offline.logs import Line, check, foreign_mcap

COUNTER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Counter" initial="on">
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<ros_time_rate name="beat" rate_hz="{hz}"/>
<ros_topic_publisher topic="/even" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/odd" type="std_msgs/Int32"/>
<state id="on"><ros_rate_callback name="beat"><assign location="n" expr="n + 1"/>
  <if cond="n % 2 == 0"><ros_topic_publish name="/even"><field name="data" expr="n"/></ros_topic_publish>
  <else/><ros_topic_publish name="/odd"><field name="data" expr="{odd}"/></ros_topic_publish></if>
</ros_rate_callback></state>
</scxml>"""
FALLS = "  - {id: L, pattern: absence, of: {falls: level > 0}}\n"


def model(folder: Path, hz: float, odd: str = "n") -> tuple[Path, ...]:
    folder.mkdir(exist_ok=True)
    path = folder / "Counter.scxml"
    path.write_text(COUNTER.format(hz=hz, odd=odd))
    return (path,)


@pytest.mark.parametrize("hz", [10.0, 20.0, 50.0])
def test_nobody_is_accused_by_a_clock_that_is_set_back(tmp_path: Path, hz: float) -> None:
    models = model(tmp_path, hz)
    system = loaded(models)
    seen = run_of(system, 7.0)
    for by_s in (-0.12, -0.09, -0.05, -0.02, 0.05):
        for number in range(4):
            clock = BagClock("Counter", by_s, 3.0 + number * 0.0173, 0.0 if number % 2 else 1.5)
            bag = Bag(seed=number, clocks=(clock,))
            told = bag.recorded(seen)
            assert accused_in(tmp_path / "bag.mcap", bag, told, system, models) == set(), bag


def test_what_is_wrong_afterwards_is_found(tmp_path: Path) -> None:
    system = loaded(model(tmp_path, 20.0))
    bag = Bag(clocks=(BagClock("Counter", -0.09, 3.0),))
    told = bag.recorded(run_of(system, 9.0))
    expected = model(tmp_path / "expected", 20.0, "n &lt; 120 ? n : n + 1")
    assert accused_in(tmp_path / "bag.mcap", bag, told, system, expected) == {"Counter"}


@pytest.mark.parametrize(
    ("back_s", "falls", "verdict"),
    [
        (0.09, False, "inconclusive"),  # in which order it passed 0 is not known
        (0.09, True, "violated"),
        (0.0, False, "conforming"),
        (0.0, True, "violated"),
    ],
)
def test_a_property_is_not_violated_by_what_was_stamped_anew(
    tmp_path: Path, back_s: float, falls: bool, verdict: str
) -> None:
    """The level passes 0 when the clock is set back by ``back_s``, and comes back two seconds later or not."""
    lines = []
    for number in range(200):
        at_s = number * 0.02
        level = number - 100 if number < 180 or not falls else -1
        lines.append(Line(at_s, level, published_s=at_s - 0.001 - back_s * (number > 101)))
    said = check(tmp_path, foreign_mcap(tmp_path, lines), FALLS)
    assert said.time.startswith("publish_time"), said.time
    assert said.verdicts == {"L": verdict}, said.out
