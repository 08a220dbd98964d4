"""Every mutant of the lab tour is a machine that checks and compiles."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from m2c.check import check_system
from m2c.codegen.package import node_package
from m2c.model import DiagnosticLog, Severity, System, load
from m2c.model.machine import Machine
from tests.mutation import OPERATORS, mutants
from tests.mutation.shape import Shapes

SYSTEM = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"


def _system() -> System:
    log = DiagnosticLog()
    system = load([SYSTEM], log)
    assert system is not None
    assert not log.has_errors
    return system


LAB_TOUR = _system()


@pytest.mark.parametrize("machine", LAB_TOUR.nodes, ids=lambda machine: machine.name)
def test_mutants_pass_the_check_and_their_code_compiles(machine: Machine) -> None:
    count = 0
    for mutant in mutants(machine):
        others = tuple(node for node in LAB_TOUR.nodes if node.name != machine.name)
        log = DiagnosticLog()
        check_system(replace(LAB_TOUR, nodes=(*others, mutant.machine)), log)
        # a status that is none is found before anything runs; monitors find it all the same
        found = [item for item in log.diagnostics if item.rule != "bad-status"]
        errors = [str(item) for item in found if item.severity is Severity.ERROR]
        assert not errors, (mutant.description, errors)
        for path, text in node_package(mutant.machine, LAB_TOUR.library, "mutant").items():
            if path.endswith(".py"):
                compile(text, f"{mutant.description} {path}", "exec")
        count += 1
    assert count >= 5


@pytest.mark.parametrize("machine", LAB_TOUR.nodes, ids=lambda machine: machine.name)
def test_mutants_differ_from_the_original_and_from_each_other(machine: Machine) -> None:
    shapes = Shapes()
    found = [shapes.of(mutant.machine) for mutant in mutants(machine)]
    assert shapes.of(machine) not in found
    assert len(set(found)) == len(found)


def test_mutants_come_in_the_same_order_every_time() -> None:
    machine = LAB_TOUR.nodes[2]
    assert list(mutants(machine)) == list(mutants(_system().nodes[2]))


def test_every_operator_finds_something_in_the_lab_tour() -> None:
    used = {mutant.operator for machine in LAB_TOUR.nodes for mutant in mutants(machine)}
    assert used == set(OPERATORS)


def test_a_mutant_says_where_the_change_is() -> None:
    machine = LAB_TOUR.node("BatteryLevelSkill")
    assert machine is not None
    lines = Path(machine.position.file).read_text().splitlines()
    for mutant in mutants(machine):
        place, _, what = mutant.description.partition(": ")
        file, _, line = place.rpartition(":")
        assert file == machine.position.file
        assert what
        if mutant.operator == "dropped output":
            assert "send_response" in lines[int(line) - 1]
