"""The whole example, as its reader runs it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog, load

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"


def test_the_example_has_no_findings() -> None:
    log = DiagnosticLog()
    system = load([EXAMPLE / "system.xml"], log)
    assert system is not None
    check_system(system, log)
    assert log.diagnostics == []
    assert len(system.nodes) == 17


@pytest.mark.slow
@pytest.mark.zenoh
def test_the_demo_shows_a_complete_tour() -> None:
    done = subprocess.run(
        [sys.executable, str(EXAMPLE / "demo.py")],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    for milestone in (
        "point of interest 1 visited",
        "point of interest 2 visited",
        "the visitors fell behind",
        "the user was alarmed",
        "the tour starts anew",
        "the tour was complete",
    ):
        assert milestone in done.stdout
