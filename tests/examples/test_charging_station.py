"""The charging station: what happens in virtual time, and that it conforms as processes."""

from __future__ import annotations

import re
import signal
import subprocess
from collections.abc import Iterator

import pytest

from m2c.check import check_system
from m2c.launch.in_process import SimulatedRun
from m2c.model import DiagnosticLog, load
from m2c.rosidl.build import build_interfaces
from tests.launch.system import M2C
from tests.monitor.processes import Monitor, Process, free_endpoint
from tests.systems import CHARGING_STATION, EXAMPLES, compiled
from tests.transports.ros2_network import own_domain
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

EXAMPLE = EXAMPLES / CHARGING_STATION
ROOT = EXAMPLES.parent
SECONDS = 40.0
"""Two lives of the supply: it is repaired after 15 s to 20 s."""
SLOW = Conditions(delay_s=(100e-6, 8e-3), busy_s=(0.0, 2e-3))
ACTION = "/ChargingStation/Charge/_action"
BUILT = ("build", "charging_station_interfaces")
"""Where `make interfaces` puts them."""
TICKS = 36
"""Seven seconds of a real run: the supply has tripped by then."""
ENOUGH = 5
"""Of seven nodes: one that repairs is silent for long. The policy counts attempts, so it is never found in
the middle of a run."""


def heard_in(seed: int) -> list[Observation]:
    """What a tap hears, in order of its stamps."""
    world = SimulatedWorld(seed, SLOW)
    heard: list[Observation] = []
    SimulatedTransport(world, "tap").tap([], heard.append)
    SimulatedRun(compiled(CHARGING_STATION)[1], world).run(SECONDS)
    return sorted(heard, key=lambda seen: seen.stamp_ns)


def of(heard: list[Observation], channel: str, kind: ObservationKind) -> Iterator[Observation]:
    """The observations of one kind on one channel."""
    return (seen for seen in heard if seen.channel == channel and seen.kind is kind)


def test_the_example_has_no_findings() -> None:
    log = DiagnosticLog()
    system = load([EXAMPLE / "system.xml"], log)
    assert system is not None
    check_system(system, log)
    assert log.diagnostics == []
    assert len(system.nodes) == 7


@pytest.mark.parametrize("seed", range(6))
def test_goals_are_accepted_rejected_and_end_in_every_way(seed: int) -> None:
    heard = heard_in(seed)
    sent = ObservationKind.RESPONSE_SENT
    assert {seen.data["accepted"] for seen in of(heard, f"{ACTION}/send_goal", sent)} == {
        True,
        False,
    }
    results = list(of(heard, f"{ACTION}/get_result", sent))
    reasons = {(seen.data["status"], seen.data["result"]["reason"]) for seen in results}
    assert {(4, ""), (5, "canceled")} < reasons
    aborted = {reason for status, reason in reasons if status == 6}
    assert aborted
    assert aborted <= {"tripped", "broken"}
    feedback = of(heard, f"{ACTION}/feedback", ObservationKind.MESSAGE)
    assert any(seen.data["feedback"]["level"] > 50 for seen in feedback)


@pytest.mark.parametrize("seed", range(6))
def test_both_bays_are_taken_at_once_and_never_more(seed: int) -> None:
    load = of(heard_in(seed), "/ChargingStation/load", ObservationKind.MESSAGE)
    assert {seen.data["data"] for seen in load} == {0, 1, 2}


@pytest.mark.parametrize("seed", range(6))
def test_a_supply_that_fails_is_reset_and_after_the_third_failure_repaired(seed: int) -> None:
    heard = heard_in(seed)
    sent = ObservationKind.RESPONSE_SENT
    resets = [seen.data["reason"] for seen in of(heard, "/PowerSupply/Reset", sent)]
    assert {"", "too hot", "broken"} == set(resets)
    repairs = list(of(heard, "/PowerSupply/Repair", sent))
    assert repairs
    assert all(seen.data["is_ok"] for seen in repairs)
    states = [
        seen.data["state"] for seen in of(heard, "/PowerSupply/status", ObservationKind.MESSAGE)
    ]
    life = [state for state, before in zip(states, ["", *states], strict=False) if state != before]
    assert life[:7] == ["on", "tripped", "on", "tripped", "on", "broken", "on"]
    before = resets.index("broken")
    assert resets[before : before + 3] == ["broken"] * 3, "the policy gives up after three attempts"


def conforming(said: str) -> int:
    """How many machines conform by the last lines of a monitor; nothing is violated."""
    found = re.search(r"0 violations in .* 8 machines: (\d) conforming", said)
    assert found is not None, said[-3000:]
    return int(found[1])


@pytest.mark.slow
@pytest.mark.zenoh
def test_on_zenoh_nodes_and_policy_conform() -> None:
    command = [str(M2C), "run", str(EXAMPLE / "system.xml"), "--ticks", str(TICKS), "--quiet"]
    done = subprocess.run(
        [*command, "--monitor", "--endpoint", free_endpoint()],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    assert conforming(done.stdout) >= 6  # on a busy machine, one or two may have become uncertain


@pytest.mark.slow
@pytest.mark.ros2
@pytest.mark.timeout(400)
def test_on_ros_2_a_monitor_that_joins_finds_that_nodes_conform() -> None:
    """It joins because on a busy machine a tap on ROS 2 may not receive how a node begins."""
    install = build_interfaces([EXAMPLE / "interfaces"], ROOT.joinpath(*BUILT))
    with own_domain():
        environment = install.environment()
        on_ros2 = [str(EXAMPLE / "system.xml"), "--transport", "ros2"]
        running = Process("m2c", "run", *on_ros2, "--ticks", 500, "--quiet", env=environment)
        try:
            running.until(lambda: any("ticking" in line for line in running.out))
            monitor = Monitor(*on_ros2, env=environment)
            try:
                monitor.until(lambda: len(conformed(monitor)) >= ENOUGH)
                assert monitor.end(signal.SIGINT) == 0, monitor.said[-3000:]
            finally:
                monitor.close()
        finally:
            running.close()
    assert {verdict["outcome"] for verdict in monitor.verdicts} <= {"conforming", "inconclusive"}


def conformed(monitor: Monitor) -> set[str]:
    """The machines that were found to conform, at whatever time."""
    return {item["machine"] for item in monitor.verdicts if item["outcome"] == "conforming"}
