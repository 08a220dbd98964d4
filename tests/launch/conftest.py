"""Fixtures of the tests of ``m2c run``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.launch.system import LISTENER, TALKER, Run, System


@pytest.fixture
def system(tmp_path: Path) -> System:
    return System(tmp_path / "lab")


@pytest.fixture
def talk(tmp_path: Path) -> Path:
    """A node that publishes ten times a second, and one that logs what it gets, best effort; no policy."""
    (tmp_path / "Talker.scxml").write_text(TALKER)
    (tmp_path / "Listener.scxml").write_text(LISTENER)
    path = tmp_path / "system.xml"
    path.write_text(
        '<roaml><node_models><input type="ros-scxml" src="Talker.scxml"/>'
        '<input type="ros-scxml" src="Listener.scxml"/></node_models>'
        '<qos><topic name="/t" reliability="best_effort"/></qos></roaml>'
    )
    return path


@pytest.fixture(autouse=True)
def _nothing_is_left_running() -> Iterator[None]:
    yield
    while Run.started:
        run = Run.started.pop()
        if run.process.poll() is None:
            run.process.terminate()
            run.end()
