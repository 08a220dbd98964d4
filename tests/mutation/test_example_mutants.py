"""The mutants of an example are machines that check and compile; ``make mutants`` compiles every one."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import pytest
from msgspec.structs import replace

from m2c.check import check_system
from m2c.codegen.package import node_texts
from m2c.model import DiagnosticLog, Severity, System, load
from m2c.model.machine import Machine
from tests.mutation import OPERATORS, mutants
from tests.mutation.shape import Shapes
from tests.systems import EXAMPLES, LAB_TOUR, SYSTEMS, read

pytestmark = pytest.mark.slow

STEP = 7
"""Each seventh one is looked at."""

MACHINES = [
    pytest.param(read(name), machine, id=machine.name)
    for name in SYSTEMS
    for machine in read(name).nodes
]


@pytest.mark.parametrize(("system", "machine"), MACHINES)
def test_mutants_pass_the_check_and_their_code_compiles(system: System, machine: Machine) -> None:
    count = 0
    for mutant in islice(mutants(machine), 0, None, STEP):
        others = tuple(node for node in system.nodes if node.name != machine.name)
        log = DiagnosticLog()
        check_system(replace(system, nodes=(*others, mutant.machine)), log)
        # some faults are found before anything runs; monitors find them all the same
        found = [
            item for item in log.diagnostics if item.rule not in ("bad-status", "out-of-range")
        ]
        errors = [str(item) for item in found if item.severity is Severity.ERROR]
        assert not errors, (mutant.description, errors)
        for path, text in node_texts(mutant.machine, system.library, "mutant").items():
            compile(text, f"{mutant.description} {path}", "exec")
        count += 1
    assert count >= 2


@pytest.mark.parametrize(("system", "machine"), MACHINES)
def test_mutants_differ_from_the_original_and_from_each_other(
    system: System, machine: Machine
) -> None:
    shapes = Shapes()
    found = [shapes.of(mutant.machine) for mutant in mutants(machine)]
    assert shapes.of(machine) not in found
    assert len(set(found)) == len(found)


def test_mutants_come_in_the_same_order_every_time() -> None:
    again = load([EXAMPLES / LAB_TOUR / "system.xml"], DiagnosticLog())
    assert again is not None
    assert list(mutants(read(LAB_TOUR).nodes[2])) == list(mutants(again.nodes[2]))


def test_every_operator_finds_something_in_the_lab_tour() -> None:
    used = {mutant.operator for machine in read(LAB_TOUR).nodes for mutant in mutants(machine)}
    assert used == set(OPERATORS)


def test_a_mutant_says_where_the_change_is() -> None:
    machine = read(LAB_TOUR).node("BatteryLevelSkill")
    assert machine is not None
    lines = Path(machine.position.file).read_text().splitlines()
    for mutant in mutants(machine):
        place, _, what = mutant.description.partition(": ")
        file, _, line = place.rpartition(":")
        assert file == machine.position.file
        assert what
        if mutant.operator == "dropped output":
            assert "send_response" in lines[int(line) - 1]
