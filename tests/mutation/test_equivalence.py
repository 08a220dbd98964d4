"""A mutant that is said to be equivalent is, and the lab tour has few of them."""

from __future__ import annotations

from random import Random

import pytest

from tests import systems
from tests.mutation import equivalence, mutants
from tests.mutation.equivalence import FEWER
from tests.mutation.test_operators import GATE, read
from tests.oracle import machines
from tests.oracle.reference import conforms
from tests.oracle.steps import EndlessLoopError
from tests.oracle.traces import DEADLINE_NS, LATENCY_NS, TOLERANCE_NS, conforming

pytestmark = pytest.mark.slow


def test_the_equivalent_mutants_of_the_lab_tour_are_known() -> None:
    found = {
        f"{machine.name}: {mutant.description.partition(': ')[2]}"
        for machine in systems.read(systems.LAB_TOUR).nodes
        for mutant in mutants(machine)
        if equivalence(machine, mutant.machine)
    }
    assert found == {
        "GoToPoiSkill: the assignment to `remaining` dropped",
        "GoToPoiSkill: transition of `canceling` on goal_accepted go_to_poi dropped",
        "GoToPoiSkill: transition of `driving` on feedback go_to_poi dropped",
        "NavigationComponent: the assignments to `goal` and `poi` swapped",
    }


def test_the_argument_names_only_what_it_rests_on() -> None:
    machine = read(GATE)
    said = {mutant.description: equivalence(machine, mutant.machine) for mutant in mutants(machine)}
    assert {text: why for text, why in said.items() if why} == {
        "gate.scxml:12: the assignments to `seen` and `last` swapped": "the same machine: "
        "assignments that do not concern each other may come in either order",
        "gate.scxml:13: the assignment to `last` dropped": "the same machine: a variable that "
        "nothing reads does not matter",
    }


def test_a_machine_that_never_draws_one_of_its_outcomes_does_what_it_may() -> None:
    machine = systems.read(systems.SORTING_CELL).node("Gripper")
    assert machine is not None
    found = {
        mutant.description.partition(": ")[2]
        for mutant in mutants(machine)
        if equivalence(machine, mutant.machine) == FEWER
    }
    drawn = "transition of `closing` on after closing#0 leads to"
    assert found == {
        f"{drawn} `slipped` instead of `holding`",
        f"{drawn} `holding` instead of `slipped`",
    }


@pytest.mark.parametrize("first", range(0, 20, 10))
def test_what_an_equivalent_mutant_does_conforms_to_the_original(first: int) -> None:
    count = 0
    for seed in range(first, first + 10):
        draw = Random(seed)
        machine = machines.read(machines.model(draw))
        for mutant in mutants(machine):
            if not equivalence(machine, mutant.machine):
                continue
            for _ in range(3):
                try:
                    trace = conforming(mutant.machine, draw)
                except EndlessLoopError:
                    continue
                count += 1
                assert conforms(
                    machine,
                    trace.observations,
                    LATENCY_NS,
                    DEADLINE_NS,
                    trace.end_ns,
                    tolerance_ns=TOLERANCE_NS,
                ), mutant.description
    assert count > 5
