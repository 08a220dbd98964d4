"""A run of a system, and who is accused from a bag of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import m2c
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.monitor.subject import Subject, read_subject
from moon.offline.engine import check_recording
from moon.oracle.bounds import Bounds
from moon.verdict import Outcome
from tests.campaign.bags import Bag, write_bag
from transports.interface import Observation
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld


def loaded(models: Sequence[Path]) -> System:
    """The system of ``models``."""
    log = DiagnosticLog()
    system = load(list(models), log)
    assert system is not None, log.diagnostics
    return system


def run_of(system: System, seconds: float) -> list[Observation]:
    """What a tap hears of ``system``."""
    seen: list[Observation] = []
    world = SimulatedWorld(1, Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.001)))
    SimulatedTransport(world, "recorder").tap([], seen.append)
    m2c.simulate(system, world).run(seconds)
    world.close()
    return seen


def accused_in(
    path: Path, bag: Bag, run: Sequence[Observation], system: System, expected: tuple[Path, ...]
) -> set[str]:
    """Who is violated by the models ``expected``, from the bag of ``run`` that is written to ``path``."""
    write_bag(path, bag, run, system)
    subject = Subject(expected, (), (), (), (), Bounds())
    result = check_recording(path, subject, read_subject(subject))
    said = (one.verdict for one in result.verdicts)
    return {verdict.node for verdict in said if verdict.outcome is Outcome.VIOLATED}
