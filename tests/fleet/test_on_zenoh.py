"""``moon monitor --fleet`` and the robots of a small system, each process of its own, on real Zenoh."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from moon.fleet.choice import Shard
from tests.launch.restarts import children
from tests.monitor.processes import BIN, WAIT_S, Process, router
from tests.systems import EXAMPLES, LAB_TOUR

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]
TOUR = EXAMPLES / LAB_TOUR
SKILL = TOUR / "skills" / "BatteryLevelSkill.scxml"
POLICY = """\
<root BTCPP_format="4" main_tree_to_execute="Watch">
  <BehaviorTree ID="Watch">
    <Condition ID="ROS2Condition" name="BatteryLevel" service_name="/BatteryLevelSkill/tick"/>
  </BehaviorTree>
</root>
"""
SMALL = f"""\
<roaml>
  <parameters><bt_tick_rate value="10"/></parameters>
  <behavior_tree><input type="bt.cpp-xml" src="./policy.xml"/></behavior_tree>
  <node_models>
    <input type="node-ascxml" src="{TOUR}/components/BatteryComponent.ascxml"/>
    <input type="node-ascxml" src="{SKILL}"/>
  </node_models>
  <interfaces><input type="ros-interfaces" src="{TOUR}/interfaces"/></interfaces>
</roaml>
"""
"""Two nodes of the lab tour, and a policy that asks for the battery's level."""


class FleetMonitor(Process):
    """``moon monitor --fleet 'robots/*' --json``, listening."""

    def __init__(self, system: Path, endpoint: str, *arguments: object) -> None:
        super().__init__(
            *("moon", "monitor", system, "--json", "--fleet", "robots/*"),
            *("--endpoint", endpoint, *arguments),
        )

    def waits(self) -> None:
        self.until(lambda: any(line.startswith("no robot in robots/*") for line in self.err))

    @property
    def verdicts(self) -> list[dict[str, Any]]:
        return [found for found in map(json.loads, self.out) if found["event"] == "verdict"]

    def conforming(self, robot: str) -> set[str]:
        """The machines of ``robot`` that conform by their last verdict."""
        last = {v["machine"]: v["outcome"] for v in self.verdicts if v["robot"] == robot}
        return {machine for machine, outcome in last.items() if outcome == "conforming"}

    @property
    def robots(self) -> set[str]:
        return {verdict["robot"] for verdict in self.verdicts}

    @property
    def violated(self) -> set[tuple[str, str]]:
        return {(v["robot"], v["machine"]) for v in self.verdicts if v["outcome"] == "violated"}


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> tuple[Path, Path]:
    """The system file, and the generated system."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "policy.xml").write_text(POLICY)
    system = folder / "system.xml"
    system.write_text(SMALL)
    command = [BIN / "m2c", "generate", "--transport", "zenoh", system, "-o", folder / "generated"]
    subprocess.run(command, check=True, capture_output=True, timeout=WAIT_S)
    return system, folder / "generated"


ALL = {"BatteryComponent", "BatteryLevelSkill", "policy"}


def test_a_fault_of_one_robot_is_seen_at_that_robot_only(start, small, wrong, tmp_path) -> None:
    system, generated = small
    with router(tmp_path) as (endpoint, config):
        monitor = start(FleetMonitor, system, endpoint)
        monitor.waits()
        runs = {}
        for name, what in (
            ("r1", [generated]),
            ("r2", [system, "--replace", f"BatteryLevelSkill={wrong}"]),
            ("r3", [generated, "--restart", "on-failure"]),
        ):
            where = ("--namespace", f"robots/{name}", "--zenoh-config", config)
            runs[name] = start(Process, "m2c", "run", *what, *where)
        monitor.until(lambda: monitor.violated)
        for robot in ("robots/r1", "robots/r3"):
            monitor.until(lambda robot=robot: monitor.conforming(robot) == ALL)
        # a node of r3 is killed, and started again
        os.kill(children(runs["r3"].process.pid)["BatteryLevelSkill"], signal.SIGKILL)
        monitor.until(lambda: any("has started again" in line for line in monitor.err))
        assert runs["r1"].end(signal.SIGINT) == 0, runs["r1"].said
        monitor.until(lambda: any("2 robots: - robots/r1" in line for line in monitor.err))
        assert monitor.end(signal.SIGINT) == 1, monitor.said
    assert monitor.violated == {("robots/r2", "BatteryLevelSkill")}
    assert {line for line in monitor.err if "has started again" in line} == {
        "robots/r3: BatteryLevelSkill has started again"
    }
    summary = json.loads(monitor.out[-1])
    assert summary["robots"] == {
        "gone, conforming until it ended": 1,
        "violated": 1,
        "conforming": 1,
    }
    (troubled,) = summary["troubled"]
    assert troubled["robot"] == "robots/r2"
    assert [machine["machine"] for machine in troubled["machines"]] == ["BatteryLevelSkill"]
    assert sum("no robot" in line for line in monitor.err) == 1


def test_two_shares_take_each_robot_once(start, small, tmp_path) -> None:
    system, generated = small
    names = [f"robots/r{number}" for number in range(4)]
    expected = [{name for name in names if Shard(number, 2).takes(name)} for number in (1, 2)]
    chosen = [min(share) for share in expected]
    with router(tmp_path) as (endpoint, config):
        monitors = [
            start(FleetMonitor, system, endpoint, "--shard", f"{number}/2") for number in (1, 2)
        ]
        for monitor in monitors:
            monitor.waits()
        for name in chosen:
            where = ("--namespace", name, "--zenoh-config", config)
            start(Process, "m2c", "run", generated, *where)
        for monitor, name in zip(monitors, chosen, strict=True):
            monitor.until(lambda monitor=monitor, name=name: monitor.conforming(name) == ALL)
            assert monitor.end(signal.SIGINT) == 0, monitor.said
            assert monitor.robots == {name}
