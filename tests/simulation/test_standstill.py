"""A policy that stands still in virtual time ticks once it goes on, as a process does that was stopped."""

from __future__ import annotations

from pathlib import Path

from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.reading import read_checked
from transports.interface import Observation
from transports.simulated import Conditions, Pause, SimulatedWorld
from transports.simulated.world import START_NS

LAB_TOUR = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
SECOND = 1_000_000_000


def test_no_tick_begins_while_the_policy_stands_still() -> None:
    heard: list[Observation] = []
    world = SimulatedWorld(1, Conditions(pauses=(Pause("policy", 1.0, 0.7),)))
    world.witness(heard.append)
    SimulatedRun(compile_system(read_checked([LAB_TOUR])), world).run(3.0)
    world.close()
    at_s = [(one.stamp_ns - START_NS) / SECOND for one in heard if one.source == "policy"]
    assert not [at for at in at_s if 1.0 < at < 1.7]
    assert [at for at in at_s if 0.7 < at <= 1.0]
    assert [at for at in at_s if 1.7 <= at < 1.8]
