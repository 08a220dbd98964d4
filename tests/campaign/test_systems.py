"""The systems of the campaign: the same for a seed, valid, at work, and of the whole language."""

from __future__ import annotations

import functools
from pathlib import Path

import msgspec
import pytest

from m2c.model.machine import CHANNEL_KINDS
from m2c.model.system import System
from m2c.simulation.run import SimulatedRun
from moon.properties import PropertySet
from tests.campaign.coverage import UNUSED, covered
from tests.campaign.differential import differences_of
from tests.campaign.plans import SYSTEM_FILE, InvalidPlanError, Plan, compiled, read, stated
from tests.campaign.promises import PATTERNS, SCOPES
from tests.campaign.reductions import is_valid, reductions
from tests.campaign.systems import SIZES, Trait, make, traits_of, write
from transports.interface import Observation
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

pytestmark = pytest.mark.slow

SYSTEMS = 16
"""So many are read, compared and run."""
SECONDS = 8.0


def plan_of(seed: int) -> Plan:
    return make(seed, SIZES[seed % len(SIZES)], traits_of(seed))


@functools.cache
def plans(count: int) -> tuple[Plan, ...]:
    return tuple(map(plan_of, range(count)))


def system_of(seed: int, folder: Path) -> System:
    path = write(plan_of(seed), folder)
    system = read(path)
    assert plan_of(seed).properties == () or stated(path, system)
    return system


def ran(system: System, seed: int) -> tuple[list[Observation], int]:
    """All that happened, in the order in which it did, and how many ticks of the tree there were."""
    world = SimulatedWorld(seed, Conditions(delay_s=(0.0, 0.005)))
    heard: list[Observation] = []
    SimulatedTransport(world, "listener").tap([], heard.append)
    run = SimulatedRun(compiled(system), world)
    run.run(SECONDS)
    world.close()
    return sorted(heard, key=lambda observation: observation.stamp_ns), len(run.ticks)


def broken(seed: int, folder: Path, system: System, heard: list[Observation]) -> list[str]:
    """The properties that hold by construction, and do not."""
    properties = PropertySet(stated(folder / SYSTEM_FILE, system))
    for observation in heard:
        properties.observe(observation)
    by_construction = [item.name for item in plan_of(seed).properties if item.holds]
    verdicts = properties.verdicts()
    return [name for name in by_construction if verdicts[name].status == "false"]


@pytest.mark.parametrize("seed", range(SYSTEMS))
def test_a_system_is_valid_and_its_code_does_what_the_interpreter_does(
    seed: int, tmp_path: Path
) -> None:
    system_of(seed, tmp_path / "as it is")
    found = differences_of(seed, SIZES[seed % len(SIZES)], tmp_path / "compared")
    assert not found, "\n".join(map(str, found))


@pytest.mark.parametrize("seed", range(100, 108))
def test_instances_do_what_the_machines_do_that_they_stand_for(seed: int, tmp_path: Path) -> None:
    size = SIZES[seed % len(SIZES)]
    systems = [
        read(write(make(seed, size, traits), tmp_path / str(len(traits))))
        for traits in ((), (Trait.INSTANCES,))
    ]
    written, instances = (ran(system, seed) for system in systems)
    assert instances == written
    assert {node.name for node in systems[0].nodes} == {node.name for node in systems[1].nodes}


def test_bound_leaves_are_valid_and_at_work(tmp_path: Path) -> None:
    kinds: set[str] = set()
    for seed in range(200, 206):
        plan = make(seed, 3, (Trait.BOUND,))
        system = read(write(plan, tmp_path / str(seed)))
        if plan.policy is None:
            continue
        heard, _ = ran(system, seed)
        asked = {item.channel.partition("/_action")[0] for item in heard if item.client == "policy"}
        for leaf in plan.leaves:
            kind = next(name for name in ("action", "service", "topic") if leaf.get(name))
            if kind == "topic" or leaf.get(kind) in asked:
                kinds.add(kind)
    assert kinds == {"action", "service", "topic"}


def test_systems_are_at_work(tmp_path: Path) -> None:
    """Bounded work; most channels are used in most systems, and what holds by construction does."""
    used = unused = 0
    for seed in range(0, SYSTEMS, 2):
        folder = tmp_path / str(seed)
        system = system_of(seed, folder)
        heard, ticks = ran(system, seed)
        assert 1.0 < len(heard) / SECONDS < 2000.0, f"seed {seed}"
        assert ticks or system.policy is None, f"seed {seed}"
        channels = {
            item.channel
            for machine in system.nodes
            for item in machine.interfaces
            if item.kind in CHANNEL_KINDS and item.channel and not item.channel.endswith("/halt")
        }
        alive = {item.channel.partition("/_action")[0] for item in heard}
        used += len(channels & alive)
        unused += len(channels - alive)
        assert not broken(seed, folder, system, heard), f"seed {seed}"
    assert used > 9 * unused


def test_the_whole_language_is_used() -> None:
    table = covered(plans(400))
    missing = [name for name, uses in table.items() if not uses and name not in UNUSED]
    assert not missing
    assert UNUSED.keys() <= table.keys()
    assert not [name for name in UNUSED if table[name]], "used after all"


def test_properties_have_every_pattern_in_every_scope() -> None:
    bodies = [item.body for plan in plans(400) for item in plan.properties]
    found = {
        (body["pattern"], next((scope for scope in SCOPES if scope in body), ""))
        for body in bodies
        if "pattern" in body
    }
    assert found == {(pattern, scope) for pattern in PATTERNS for scope in SCOPES}
    assert any("formula" in body for body in bodies)


def test_a_system_without_a_node_is_no_reduction() -> None:
    plan = make(3, 2)
    plugins = tuple(item for item in plan.models if item.is_plugin)
    assert not is_valid(msgspec.structs.replace(plan, models=plugins, properties=(), ports={}))


def test_a_seed_gives_the_same_system_again() -> None:
    assert [plan_of(seed) for seed in range(8)] == list(plans(8))
    assert plan_of(1) != plan_of(2)


def test_reductions_are_valid_and_smaller(tmp_path: Path) -> None:
    plan = make(3, 2)
    size = _size(plan)
    smaller = [made for made, _ in zip(reductions(plan), range(12), strict=False)]
    assert len(smaller) == 12
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
