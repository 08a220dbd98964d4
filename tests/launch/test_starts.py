"""Some of the nodes of ``tests.launch.starts``; a thousand of them are for ``make soak``."""

from __future__ import annotations

import os

import pytest

from tests.launch.starts import run


@pytest.mark.parametrize(
    ("transport", "nodes"),
    [
        pytest.param("zenoh", 24, marks=pytest.mark.zenoh),
        pytest.param("ros2", 9, marks=[pytest.mark.ros2, pytest.mark.slow]),
    ],
)
def test_nodes_that_are_told_to_end_at_any_moment_end_and_leave_nothing(
    transport: str, nodes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ROS_DOMAIN_ID", "AMENT_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH"):
        monkeypatch.setenv(name, os.environ.get(name, ""))  # what the run sets is undone
    assert run(transport, nodes, processes=0, seed=1) == []
