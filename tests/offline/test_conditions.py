"""Random small systems without a fault, while clocks are set and nodes are killed: nobody is accused."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import pytest

from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.subject import Subject, read_subject
from moon.oracle.bounds import Bounds
from moon.run import Run
from moon.sources.source import Outputs
from moon.verdict import Outcome, Verdict
from tests.offline import small_systems
from transports.simulated import Conditions, HostClock, Kill, SimulatedTransport, SimulatedWorld
from transports.simulated.conditions import Rules

pytestmark = pytest.mark.slow

SECONDS = 5.0
NODES = ("Probe", "Counter", "Worker", "Asker")
STEPS_S = (-1.0, -0.19, -0.15, -0.1, -0.05, -0.02, -0.01, -0.003, 0.05, 0.1, 0.3, 0.4, 1.0)


class Kept(list[Verdict]):
    def take(self, verdict: Verdict) -> None:
        self.append(verdict)


def common(draw: Random) -> dict[str, Any]:
    """Delays, and whose rules there are."""
    rules = draw.choice(list(Rules))
    return {
        "delay_s": (0.0, draw.choice((0.0005, 0.005, 0.03))),
        "tap_delay_s": (0.0, draw.choice((0.0005, 0.005, 0.03))),
        "rules": rules,
        "discovery_s": (0.0, 0.05 if rules is Rules.ROS2 else 0.0),
    }


def monitored(folder: Path, seed: int, conditions: Conditions) -> tuple[list[Verdict], list[str]]:
    """What a monitor says of the random system ``seed`` under ``conditions``: verdicts, and sentences."""
    models = small_systems.write(folder, seed)
    subject = read_subject(Subject((models,), (), (), (), (), Bounds()))
    world = SimulatedWorld(seed, conditions)
    connection, kept, said = SimulatedTransport(world, "monitor"), Kept(), list[str]()
    watch = Run(connection, subject, Outputs([kept], said.append))
    watch.start()
    world.run_for(0.3 if conditions.rules is Rules.ROS2 else small_systems.BEFORE_S)
    SimulatedRun(compile_system(subject.system), world).run(SECONDS)
    world.close()
    return kept, said


def accusations(verdicts: list[Verdict]) -> list[Verdict]:
    return [verdict for verdict in verdicts if verdict.outcome is Outcome.VIOLATED]


@pytest.mark.parametrize("step_s", STEPS_S)
@pytest.mark.parametrize("seed", range(3))
def test_nobody_is_accused_when_the_clock_is_set(step_s: float, seed: int, tmp_path: Path) -> None:
    draw = Random(f"{step_s} {seed}")
    clock = HostClock("", 0.0, ((draw.uniform(0.8, 3.0), step_s),))
    conditions = Conditions(clocks=(clock,), **common(draw))
    verdicts, said = monitored(tmp_path, draw.randrange(1000), conditions)
    assert accusations(verdicts) == []
    assert any("the clock was set" in sentence for sentence in said)


@pytest.mark.parametrize("seed", range(0, 24, 3))
def test_nobody_is_accused_when_the_clock_of_another_host_is_set(seed: int, tmp_path: Path) -> None:
    draw = Random(f"other {seed}")
    far = draw.sample(NODES, draw.randint(1, 3))
    clock = HostClock("far", 0.0, ((draw.uniform(0.8, 3.0), draw.choice(STEPS_S)),))
    hosts = dict.fromkeys(far, "far")
    conditions = Conditions(hosts=hosts, clocks=(clock,), **common(draw))
    verdicts, _ = monitored(tmp_path, draw.randrange(1000), conditions)
    assert accusations(verdicts) == []


@pytest.mark.parametrize("step_s", [-0.3, -0.15, 0.08])
def test_that_the_clock_of_another_host_was_set_is_said(step_s: float, tmp_path: Path) -> None:
    conditions = Conditions(
        hosts={"Counter": "far"},
        clocks=(HostClock("far", 0.0, ((1.5, step_s),)),),
        rules=Rules.ROS2,
        tap_delay_s=(0.0, 0.005),
    )
    verdicts, said = monitored(tmp_path, 3, conditions)
    assert accusations(verdicts) == []
    where = "forward" if step_s > 0 else "back"
    sentence = f"the clock of the host of Counter was set {where} by"
    assert [sentence in each for each in said].count(True) == 1


@pytest.mark.parametrize("seed", range(0, 20, 3))
def test_nobody_is_accused_when_nodes_are_killed_and_started_again(
    seed: int, tmp_path: Path
) -> None:
    draw = Random(f"kills {seed}")
    kills = tuple(
        Kill(draw.choice(NODES), draw.uniform(0.3, 3.0), draw.choice((0.0, 0.01, 0.1, 0.5)))
        for _ in range(draw.randint(1, 3))
    )
    conditions = Conditions(kills=kills, **common(draw))
    verdicts, _ = monitored(tmp_path, draw.randrange(1000), conditions)
    assert accusations(verdicts) == []
