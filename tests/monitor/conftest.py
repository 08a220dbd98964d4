"""What the tests of monitors share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.monitor import hand_driven
from tests.monitor.hand_driven import HandDriven
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


@pytest.fixture
def relay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> HandDriven:
    """Of a machine that tells every level on."""
    model = hand_driven.LEVEL.replace(
        "<ros_topic_subscriber",
        '<ros_topic_publisher topic="/told" type="t/Level"/><ros_topic_subscriber',
    ).replace(
        "</ros_topic_callback>",
        '<ros_topic_publish name="/told"><field name="data" expr="level"/></ros_topic_publish></ros_topic_callback>',
    )
    monkeypatch.setattr(hand_driven, "LEVEL", model)
    return HandDriven(tmp_path)
