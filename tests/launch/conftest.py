"""Fixtures of the tests of ``m2c run``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.launch.system import Run, System


@pytest.fixture
def system(tmp_path: Path) -> System:
    return System(tmp_path / "lab")


@pytest.fixture(autouse=True)
def _nothing_is_left_running() -> Iterator[None]:
    yield
    while Run.started:
        run = Run.started.pop()
        if run.process.poll() is None:
            run.process.terminate()
            run.end()
