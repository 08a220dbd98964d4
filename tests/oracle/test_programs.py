"""A machine's programs are made once; the difference is seen only in how long a step takes."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from moon.oracle.program import MachineProgram
from tests.oracle.tour import lab_tour

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("machine", lab_tour()[0].nodes, ids=lambda machine: machine.name)
def test_the_program_for_unknown_values_is_made_once(machine) -> None:
    program = MachineProgram(machine, lab_tour()[0].library)
    assert program._symbolic is program._symbolic


def test_nothing_that_is_compiled_needs_a_property_that_keeps_its_value(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """mypyc takes ``functools.cached_property`` for a property: it is computed each time, without a word."""
    monkeypatch.chdir(ROOT)
    monkeypatch.delenv("MOON_COMPILED", raising=False)
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    modules = runpy.run_path("setup.py")["modules"]()
    assert len(modules) > 40
    assert not [name for name in modules if "cached_property" in without_comments(name)]


def without_comments(name: str) -> str:
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    return "\n".join(line.partition("  # ")[0] for line in lines)
