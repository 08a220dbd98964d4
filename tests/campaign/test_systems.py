"""The systems of the campaign: the same for a seed, valid, at work, and of the whole language."""

from __future__ import annotations

import functools
from collections import Counter
from pathlib import Path

import pytest

from m2c.launch.in_process import SimulatedRun
from m2c.model.machine import CHANNEL_KINDS
from m2c.model.system import System
from tests.campaign.coverage import UNUSED, covered
from tests.campaign.differential import differences_of
from tests.campaign.plans import InvalidPlanError, Plan, compiled, read, stated
from tests.campaign.reductions import is_valid, reductions
from tests.campaign.systems import SIZES, make, write
from transports.interface import Observation
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEMS = 32
"""So many are read, compared and run."""
SECONDS = 8.0


def plan_of(seed: int) -> Plan:
    return make(seed, SIZES[seed % len(SIZES)])


@functools.cache
def plans(count: int) -> tuple[Plan, ...]:
    return tuple(map(plan_of, range(count)))


def system_of(seed: int, folder: Path) -> System:
    path = write(plan_of(seed), folder)
    system = read(path)
    assert plan_of(seed).properties == () or stated(path, system)
    return system


def activity(system: System, seed: int) -> tuple[Counter[str], int]:
    """Observations by channel, and how many ticks of the tree there were."""
    world = SimulatedWorld(seed, Conditions(delay_s=(0.0, 0.005)))
    heard: Counter[str] = Counter()

    def hear(observation: Observation) -> None:
        heard[observation.channel.partition("/_action")[0]] += 1

    SimulatedTransport(world, "listener").tap([], hear)
    run = SimulatedRun(compiled(system), world)
    run.run(SECONDS)
    world.close()
    return heard, len(run.ticks)


@pytest.mark.parametrize("seed", range(SYSTEMS))
def test_a_system_is_valid_and_its_code_does_what_the_interpreter_does(
    seed: int, tmp_path: Path
) -> None:
    system_of(seed, tmp_path / "as it is")
    found = differences_of(seed, SIZES[seed % len(SIZES)], tmp_path / "compared")
    assert not found, "\n".join(map(str, found))


def test_systems_are_at_work(tmp_path: Path) -> None:
    """Bounded work, of every machine; most channels are used in most systems."""
    used = unused = 0
    for seed in range(0, SYSTEMS, 2):
        system = system_of(seed, tmp_path / str(seed))
        heard, ticks = activity(system, seed)
        assert 1.0 < sum(heard.values()) / SECONDS < 2000.0, f"seed {seed}"
        assert ticks or system.policy is None, f"seed {seed}"
        channels = {
            item.channel
            for machine in system.nodes
            for item in machine.interfaces
            if item.kind in CHANNEL_KINDS and item.channel and not item.channel.endswith("/halt")
        }
        used += len(channels & heard.keys())
        unused += len(channels - heard.keys())
    assert used > 9 * unused


def test_the_whole_language_is_used() -> None:
    table = covered(plans(400))
    missing = [name for name, uses in table.items() if not uses and name not in UNUSED]
    assert not missing
    assert UNUSED.keys() <= table.keys()
    assert not [name for name in UNUSED if table[name]], "used after all"


def test_a_seed_gives_the_same_system_again() -> None:
    assert [plan_of(seed) for seed in range(8)] == list(plans(8))
    assert plan_of(1) != plan_of(2)


def test_reductions_are_valid_and_smaller(tmp_path: Path) -> None:
    plan = make(3, 2)
    size = _size(plan)
    smaller = [made for made, _ in zip(reductions(plan), range(40), strict=False)]
    assert len(smaller) == 40
    assert all(is_valid(made) and _size(made) < size for made in smaller)


def test_a_plan_that_m2c_check_refuses_is_not_valid(tmp_path: Path) -> None:
    plan = make(3, 2)
    broken = [item for item in plan.models if "ros_time_rate" in str(item.root)]
    path = write(plan, tmp_path)
    file = tmp_path / broken[0].file
    file.write_text(file.read_text().replace("<ros_time_rate", "<ros_time_rat"))
    with pytest.raises(InvalidPlanError, match="did you mean ros_time_rate"):
        read(path)


def _size(plan: Plan) -> int:
    elements = sum(1 for model in plan.models for _ in model.root.all())
    tree = 0 if plan.policy is None else sum(1 for _ in plan.policy.all())
    return elements + tree + len(plan.properties)
