"""What a simulated run draws at random depends on its seed, and on nothing else in the process."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterable

import pytest

from m2c.model.reading import read_or_raise
from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, Kill, SimulatedWorld

DIE = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="a" datamodel="ecmascript">
  <ros_topic_publisher topic="/{name}" type="std_msgs/Float64"/>
  <ros_time_rate rate_hz="10" name="clock"/>
  <state id="a"><ros_rate_callback name="clock" target="a">
    <ros_topic_publish name="/{name}"><field name="data" expr="Math.random()"/></ros_topic_publish>
  </ros_rate_callback></state>
</scxml>
"""


@pytest.fixture(scope="module")
def dice(tmp_path_factory: pytest.TempPathFactory) -> Program:
    """Two nodes that publish a random number ten times a second each."""
    folder = tmp_path_factory.mktemp("dice")
    for name in ("one", "two"):
        (folder / f"{name}.scxml").write_text(DIE.format(name=name))
    return compile_system(read_or_raise([folder]))


class Rolls:
    """A run whose draws are kept."""

    def __init__(self, program: Program, seed: int, conditions: Conditions | None = None) -> None:
        self._world = SimulatedWorld(seed, conditions)
        self.drawn: list[tuple[str, object]] = []
        self._world.witness(self._keep)
        self._run = SimulatedRun(program, self._world)

    def _keep(self, seen: Observation) -> None:
        if seen.kind is ObservationKind.MESSAGE and seen.channel in ("/one", "/two"):
            self.drawn.append((seen.channel, seen.data["data"]))

    def go(self, seconds: float) -> None:
        self._run.run(seconds)


def alone(program: Program, seed: int) -> list[tuple[str, object]]:
    rolls = Rolls(program, seed)
    rolls.go(2.0)
    return rolls.drawn


def of(channel: str, drawn: Iterable[tuple[str, object]]) -> list[object]:
    return [value for name, value in drawn if name == channel]


def test_interleaved_runs_draw_what_each_draws_alone(dice: Program) -> None:
    first, second = Rolls(dice, 1), Rolls(dice, 2)
    for _ in range(20):
        first.go(0.1)
        second.go(0.1)
    assert first.drawn == alone(dice, 1)
    assert second.drawn == alone(dice, 2)
    assert first.drawn != second.drawn


def test_a_run_leaves_the_process_random_numbers_alone(dice: Program) -> None:
    random.seed(5)
    state = random.getstate()
    alone(dice, 1)
    assert random.getstate() == state


def test_nodes_draw_different_numbers(dice: Program) -> None:
    drawn = alone(dice, 1)
    assert len(of("/one", drawn)) == len(of("/two", drawn)) == 20
    assert not set(map(str, of("/one", drawn))) & set(map(str, of("/two", drawn)))


def test_a_node_that_is_started_again_goes_on_drawing(dice: Program) -> None:
    rolls = Rolls(dice, 1, Conditions(kills=(Kill("one", 0.55, 0.2),)))
    rolls.go(2.0)
    drawn = of("/one", rolls.drawn)
    assert all(a != b for a, b in itertools.combinations(drawn, 2))
    assert drawn == of("/one", alone(dice, 1))[: len(drawn)]
