"""No mistake of a beginner ends in a traceback: the check says what is wrong, or the system runs right."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.codegen.package import system_files
from m2c.model import DiagnosticLog, Severity, System
from m2c.model.naming import Naming
from m2c.policy.runner import TreeTick
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from tests.beginner.tank import FILES, SYSTEM
from tests.beginner.variants import RUNS, VARIANTS, Row
from transports.registry import name_rules
from transports.simulated import SimulatedWorld

pytestmark = pytest.mark.slow

SECONDS = 4.0
"""Of virtual time: the tank is full after one."""


def write(folder: Path, row: Row | None = None) -> Path:
    """The system's files in ``folder``, with the edit of ``row``; the system file's path."""
    for name, text in FILES.items():
        content: str | bytes | None = text
        if row is not None and name == row[1]:
            _, _, old, content, _ = row
            if old is not None:
                assert text.count(old) == 1, "the edit is not clear"
                assert isinstance(content, str)
                content = text.replace(old, content)
        if content is not None:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content.encode() if isinstance(content, str) else content)
    return folder / SYSTEM


def run(system: System) -> list[TreeTick]:
    """Generate ``system`` and run it; what its tree did."""
    assert system_files(system)
    world = SimulatedWorld(1)
    try:
        running = SimulatedRun(compile_system(system), world)
        running.run(SECONDS)
        return running.ticks
    finally:
        world.close()


def is_full(ticks: list[TreeTick]) -> bool:
    return [leaf.status for leaf in ticks[-1].leaves] == ["SUCCESS"]


def said_of(log: DiagnosticLog, folder: Path) -> list[str]:
    """What is wrong; an older spelling is not."""
    wrong = [item for item in log.diagnostics if item.severity is not Severity.NOTE]
    return [str(item).replace(f"{folder}/", "") for item in wrong]


def test_the_system_that_is_edited_works(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    log = DiagnosticLog()
    system = read_and_check([write(tmp_path)], [], log, naming=Naming(name_rules(), chosen=True))
    assert said_of(log, tmp_path) == []
    assert system is not None
    assert is_full(run(system))
    assert not [item for item in caplog.records if item.levelno >= logging.WARNING]


@pytest.mark.parametrize("name", VARIANTS)
def test_a_mistake_is_named_where_it_is_or_does_no_harm(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    row = VARIANTS[name]
    expected = row[-1]
    log = DiagnosticLog()
    path = write(tmp_path, row)
    system = read_and_check([path], [], log, naming=Naming(name_rules()))
    said = said_of(log, tmp_path)
    if expected == RUNS:
        assert said == []
        assert system is not None
        assert is_full(run(system))
        assert not [item for item in caplog.records if item.levelno >= logging.ERROR]
    elif expected.startswith("later "):
        assert said == []
        assert system is not None
        run(system)
        assert expected.removeprefix("later ") in caplog.text
    else:
        severity = Severity.WARNING if expected.startswith("warning ") else Severity.ERROR
        rule, place, text = expected.removeprefix("warning ").split(" ", 2)
        assert ":0:0" not in place
        assert any(
            line.startswith(f"{place}: {severity}: ")
            and text in line
            and line.endswith(f"[{rule}]")
            for line in said
        ), said
        assert log.has_errors is (severity is Severity.ERROR)
        if not log.has_errors:
            assert system is not None
            run(system)
