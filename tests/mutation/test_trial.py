"""Trials of mutants: what is found, what is equivalent, and that the original is left in peace."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.machine import Machine
from m2c.simulation.program import Program, compile_node
from tests.mutation import equivalence, mutants
from tests.mutation.by_hand import BY_HAND, HOLES
from tests.mutation.report import Found, Result, document, summary
from tests.mutation.test_operators import NESTED
from tests.mutation.trial import SCENES, Scene, trial
from tests.mutation.waiting import without_unawaited_responses
from tests.oracle.tour import lab_tour
from tests.systems import CHARGING_STATION, SYSTEMS, compiled, read

pytestmark = pytest.mark.slow


def _machine(name: str) -> Machine:
    machine = lab_tour()[0].node(name)
    assert machine is not None
    return machine


def _mutant(name: str, what: str) -> Machine:
    (found,) = [item for item in mutants(_machine(name)) if item.description.endswith(what)]
    return found.machine


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(
    ("example", "machine"),
    [
        pytest.param(name, machine, id=machine.name)
        for name in SYSTEMS
        for machine in read(name).nodes
    ],
)
def test_a_machine_as_it_should_be_is_not_blamed(
    example: str, machine: Machine, scene: Scene
) -> None:
    system, program = compiled(example)
    found = trial(system, program, machine, program.nodes[machine.name], scene, 25.0, 5)
    assert found.verdict is None
    assert found.inconclusive == 0
    assert found.said


@pytest.mark.parametrize(
    ("name", "what", "scene"),
    [
        ("BatteryLevelSkill", "condition negated", Scene.SYSTEM),
        ("WaitSkill", "`RUNNING` became `3`", Scene.SYSTEM),
        ("SchedulerComponent", "the assignment to `current` dropped", Scene.SYSTEM),
        ("GoToPoiSkill", "`arrived` on request /GoToPoiSkill/halt dropped", Scene.ALONE),
        ("SetPoi2Skill", "`setting` on call_error /SchedulerComponent/SetPoi dropped", Scene.ALONE),
    ],
)
def test_a_mutant_is_killed(name: str, what: str, scene: Scene) -> None:
    system, program = lab_tour()
    machine = _machine(name)
    known = [item for item in mutants(machine) if item.description.endswith(what)]
    assert known, "no such mutant"
    node = compile_node(known[0].machine, system)
    found = trial(system, program, machine, node, scene, 60.0, 2)
    assert found.verdict is not None
    assert found.verdict.machine == name
    assert found.after_s < 60.0


def test_two_timers_that_ring_as_a_machine_changes_its_state_ring_in_either_order() -> None:
    system, program = compiled(CHARGING_STATION)
    courier = system.node("Courier")
    assert courier is not None
    found = trial(system, program, courier, program.nodes["Courier"], Scene.ALONE, 100.0, 2)
    assert found.verdict is None


def test_what_waits_for_its_turn_is_not_put_off_by_a_timer_that_rings_again_and_again() -> None:
    system, program = compiled(CHARGING_STATION)
    forklift = system.node("Forklift")
    assert forklift is not None
    what = "transition of `asking` on goal_rejected charge dropped"
    (mutant,) = [item for item in mutants(forklift) if item.description.endswith(what)]
    node = compile_node(mutant.machine, system)
    found = trial(system, program, forklift, node, Scene.SYSTEM, 20.0, 1)
    assert found.verdict is not None
    assert "expected goal sent" in found.verdict.reason


def test_a_second_response_to_one_request_is_not_sent() -> None:
    machine = _machine("WaitSkill")
    doubled = _mutant("WaitSkill", "13: response /WaitSkill/tick sent twice")
    assert not equivalence(machine, doubled)
    assert equivalence(machine, without_unawaited_responses(doubled))


def test_a_second_response_where_another_request_may_wait_is_sent() -> None:
    machine = _machine("GoToPoiSkill")
    busy = _mutant("GoToPoiSkill", "46: response /GoToPoiSkill/tick sent twice")
    stripped = without_unawaited_responses(busy)
    assert stripped == busy
    assert not equivalence(machine, stripped)


@pytest.mark.parametrize("name", [machine.name for machine in lab_tour()[0].nodes])
def test_every_response_of_the_lab_tour_finds_a_request(name: str) -> None:
    assert without_unawaited_responses(_machine(name)) == _machine(name)


def test_every_argument_by_hand_is_about_a_mutant() -> None:
    named = {
        f"{place.rpartition('/')[2]}: {what}"
        for name in SYSTEMS
        for machine in read(name).nodes
        for place, _, what in (item.description.partition(": ") for item in mutants(machine))
    }
    assert set(BY_HAND) <= named
    assert [part for part in HOLES if not any(part in what for what in named)] == []


def test_the_page_counts_what_was_found_and_lists_who_survived() -> None:
    def result(number: int, found: Found, reason: str = "") -> Result:
        return Result(
            system="lab_tour",
            machine="M",
            number=number,
            operator="" if number < 0 else "dropped output",
            description=f"M.scxml:{number}: output dropped",
            found=found,
            scene="" if found is not Found.KILLED else SCENES[0],
            reason=reason,
        )

    results = [result(-1, Found.NOMINAL), result(1, Found.KILLED), result(2, Found.KILLED)]
    results += [result(3, Found.SURVIVED, "nobody saw it"), result(4, Found.EQUIVALENT, "the same")]
    assert "66.67% of the non-equivalent killed" in summary(results)
    page = document("lab_tour", results)
    assert "| dropped output | 4 | 2 | 1 | 0 | 1 |" in page
    assert "* M.scxml:3: output dropped (dropped output): nobody saw it" in page
    assert "| M | 4 | 2 | 1 | 0 | 1 | no alarm |" in page


@pytest.mark.parametrize("what", ["`on` on message /in dropped", "condition negated", "sent twice"])
def test_a_mutant_of_a_compound_state_is_killed(what: str, tmp_path: Path) -> None:
    (tmp_path / "Drive.scxml").write_text(NESTED)
    system = load([tmp_path], DiagnosticLog())
    assert system is not None
    (machine,) = system.nodes
    program = Program({machine.name: compile_node(machine, system)}, {}, None)
    original = program.nodes[machine.name]
    nominal = trial(system, program, machine, original, Scene.ALONE, 20.0, 2)
    assert nominal.verdict is None
    assert nominal.said
    (mutant,) = [item.machine for item in mutants(machine) if item.description.endswith(what)]
    found = trial(system, program, machine, compile_node(mutant, system), Scene.ALONE, 60.0, 2)
    assert found.verdict is not None
