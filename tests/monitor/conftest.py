"""What the tests of ``moon monitor`` as a process share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.monitor.processes import Process

SKILL = Path(__file__).parents[2] / "examples" / "lab_tour" / "skills" / "BatteryLevelSkill.scxml"


@pytest.fixture
def start() -> Iterator[object]:
    """Starts processes; what still runs at the end of the test is ended."""
    started: list[Process] = []

    def begin(kind, *arguments):
        process = kind(*arguments)
        started.append(process)
        return process

    yield begin
    for process in reversed(started):
        process.close()


@pytest.fixture
def wrong(tmp_path) -> Path:
    """A BatteryLevelSkill that answers the opposite."""
    model = tmp_path / "wrong.scxml"
    text = SKILL.read_text()
    assert "percentage &gt;= THRESHOLD" in text
    model.write_text(text.replace("percentage &gt;= THRESHOLD", "percentage &lt; THRESHOLD"))
    return model
