"""What goes on is never refused, wherever a healthy run is cut, and the truth is one of the hypotheses."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.oracle.program import Program
from tests.campaign.plans import read
from tests.campaign.systems import make, write
from tests.oracle.cuts import Follower, contradictions_of, run

pytestmark = pytest.mark.slow

FOUND = [
    (100145, 1, "Part0", 0, 128),  # two that differ in what a goal ended with were one
    (100111, 2, "Part0", 77, 8),  # the same, as there are too many
    (100151, 2, "Part0", 63, 8),  # feedback that was kept for its goal was forgotten
    (300004, 2, "Part1", 0, 128),  # a thread names itself as it is free, whatever its model says
    (1000308, 2, "Do0", 99, 512),  # more and more were followed: each goal may be its own or not
]
"""Seed and size of a system, a machine, after how many observations it is cut, and how many are followed."""
RANDOM = range(3)


@pytest.mark.parametrize(("seed", "size", "name", "cut", "most"), FOUND)
def test_what_was_refused_is_believed(
    seed: int, size: int, name: str, cut: int, most: int, tmp_path: Path
) -> None:
    system = read(write(make(seed, size), tmp_path))
    (machine,) = [machine for machine in system.nodes if machine.name == name]
    program = Program(machine, system.library)
    follower = Follower(machine, system, program, run(system, seed), cut, most)
    assert follower.contradiction() is None
    assert follower.checked > 5


@pytest.mark.parametrize("seed", RANDOM)
def test_a_machine_with_goals_is_believed_wherever_its_run_is_cut(
    seed: int, tmp_path: Path
) -> None:
    assert contradictions_of(seed, 1, tmp_path) == []
