"""The systems of ``examples/`` that tests run: read and compiled once."""

from __future__ import annotations

import functools
from pathlib import Path

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.simulation.program import Program, compile_system

EXAMPLES = Path(__file__).parents[1] / "examples"
LAB_TOUR, CHARGING_STATION, SORTING_CELL = "lab_tour", "charging_station", "sorting_cell"
NAVIGATION = "navigation"
SYSTEMS = (LAB_TOUR, CHARGING_STATION, SORTING_CELL, NAVIGATION)
"""Folders of ``examples/`` that have a ``system.xml``."""


@functools.cache
def read(name: str) -> System:
    """The models of the example ``name``."""
    log = DiagnosticLog()
    system = load([EXAMPLES / name / "system.xml"], log)
    assert system is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    return system


@functools.cache
def compiled(name: str) -> tuple[System, Program]:
    """The models of the example ``name``, and its imported code."""
    return read(name), compile_system(read(name))
