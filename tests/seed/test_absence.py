"""Runs and recordings that conform, in which something may never have reached who is judged."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from moon.cli import main

CASES = Path(__file__).parents[3] / "shared" / "cases"
pytestmark = [
    pytest.mark.seed,
    pytest.mark.skipif(not CASES.is_dir(), reason="the cases are not beside the checkout"),
]


@pytest.mark.parametrize("latency_s", ["0.05", "0.2", "0.3", "0.5", "1"])
def test_a_message_from_before_a_ros_2_subscriber_announced_itself_accuses_nobody(
    latency_s: str,
) -> None:
    folder = CASES / "ros2_discovery"
    arguments = ["check", str(folder / "run.mcap"), str(folder / "system.xml")]
    done = CliRunner().invoke(main, [*arguments, "--latency-bound", latency_s])
    assert done.exit_code == 0, done.output
    assert "VIOLATED" not in done.output
