"""The further examples as processes: nodes and policy conform on Zenoh and on ROS 2."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path

import pytest

import m2c
from m2c.rosidl.build import build_interfaces, build_once
from tests.launch.system import M2C
from tests.monitor.processes import Monitor, Process, free_endpoint
from tests.systems import CHARGING_STATION, EXAMPLES, NAVIGATION, SORTING_CELL
from tests.transports.ros2_network import have_ticks, own_domain

BUILT = EXAMPLES.parent / "build"
"""Where `make interfaces` puts them, below a folder for each."""
TICKS = 36
"""Seven seconds of a real run: the charging station's supply has tripped by then."""
MACHINES = {CHARGING_STATION: 8, SORTING_CELL: 4, NAVIGATION: 5}
"""With the policy."""
JOINED = {CHARGING_STATION: 5, SORTING_CELL: 3, NAVIGATION: 3}
"""So many are soon found to conform by who joins in the middle: what repairs is silent for long, and the
policy of the charging station counts attempts."""
UNCERTAIN = {CHARGING_STATION: 2, SORTING_CELL: 1, NAVIGATION: 1}
"""So many may have become uncertain on a busy machine."""

each_example = pytest.mark.parametrize("name", MACHINES)


def conforming(said: str, of: int) -> int:
    """How many of the machines conform by the last lines of a monitor; nothing is violated."""
    found = re.search(rf"0 violations in .* {of} machines: ([^;]+);", said)
    assert found is not None, said[-3000:]
    return sum(map(int, re.findall(r"(\d) conforming", found[1])))


@pytest.mark.slow
@pytest.mark.zenoh
@each_example
def test_on_zenoh_nodes_and_policy_conform(name: str) -> None:
    system = EXAMPLES / name / "system.xml"
    command = [str(M2C), "run", str(system), "--ticks", str(TICKS), "--quiet", "--monitor"]
    done = subprocess.run(
        [*command, "--endpoint", free_endpoint()],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    assert conforming(done.stdout, MACHINES[name]) >= MACHINES[name] - UNCERTAIN[name]


def environment_of(name: str, scratch: Path) -> dict[str, str]:
    """That of the example's processes on ROS 2, with its types built."""
    system = EXAMPLES / name / "system.xml"
    if name == SORTING_CELL:  # events alone: m2c writes their types
        m2c.generate(m2c.read_system(system), scratch)
        return build_once(scratch / "plain_events").environment()
    built = BUILT / f"{name}_interfaces"
    return build_interfaces([system.parent / "interfaces"], built).environment()


@pytest.mark.slow
@pytest.mark.ros2
@pytest.mark.timeout(400)
@each_example
def test_on_ros_2_a_monitor_that_joins_finds_that_nodes_conform(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It joins because on a busy machine a tap on ROS 2 may not receive how a node begins."""
    have_ticks(monkeypatch)
    environment = environment_of(name, tmp_path)
    with own_domain():
        on_ros2 = [str(EXAMPLES / name / "system.xml"), "--transport", "ros2"]
        running = Process("m2c", "run", *on_ros2, "--ticks", 500, "--quiet", env=environment)
        try:
            running.until(lambda: any("ticking" in line for line in running.out))
            monitor = Monitor(*on_ros2, env=environment)
            try:
                monitor.until(lambda: len(conformed(monitor)) >= JOINED[name])
                assert monitor.end(signal.SIGINT) == 0, monitor.said[-3000:]
            finally:
                monitor.close()
        finally:
            running.close()
    assert {verdict["outcome"] for verdict in monitor.verdicts} <= {"conforming", "inconclusive"}


def conformed(monitor: Monitor) -> set[str]:
    """The machines that were found to conform, at whatever time."""
    return {item["machine"] for item in monitor.verdicts if item["outcome"] == "conforming"}
