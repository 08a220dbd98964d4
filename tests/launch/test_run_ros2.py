"""``m2c run --transport ros2`` of a first system: nobody has built an interface package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.check.test_ticks import findings
from tests.transports.ros2_network import own_domain


@pytest.mark.ros2
@pytest.mark.slow
@pytest.mark.timeout(400)
def test_ticks_need_no_package_that_somebody_built(tmp_path: Path) -> None:
    assert findings(tmp_path) == []
    command = [sys.executable, "-m", "m2c.cli", "run", "--transport", "ros2", "--ticks", "2"]
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    with own_domain():
        environment["ROS_DOMAIN_ID"] = os.environ["ROS_DOMAIN_ID"]
        for build in (True, False):
            done = subprocess.run(
                [*command, str(tmp_path / "system.xml")],
                env=environment, capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stdout + done.stderr
            assert "all nodes have ended" in done.stdout
            assert "taken as FAILURE" not in done.stdout
            stamps = {
                path.stat().st_mtime_ns for path in tmp_path.glob("cache/m2c/*/content.sha256")
            }
            assert len(stamps) == 1
            if build:
                before = stamps
    assert stamps == before
