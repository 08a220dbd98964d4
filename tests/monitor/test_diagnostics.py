"""Verdicts on ``/diagnostics``."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from moon.monitor.command import _diagnostics
from moon.sinks.diagnostics import DIAGNOSTICS, DiagnosticArray, Diagnostics, status_of
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from tests.transports import ros2_network
from transports.interface import TransportError
from transports.simulated.world import SimulatedTransport, SimulatedWorld

ROOT = Path(__file__).parents[2]
LAB_TOUR = ROOT / "examples" / "lab_tour"
WHY = Explanation(("A", "B"), "C", ("idle",), (Evidence(7, "a message"),), ("m.scxml:1:2",))
WRONG = Verdict("Level", "Level", Outcome.VIOLATED, 9, "expected A or B, observed C", WHY)
RIGHT = Verdict("Level", "Level", Outcome.CONFORMING, 10)
UNKNOWN = Verdict("Level", "Level", Outcome.INCONCLUSIVE, 11, "started in the middle")
OTHER = Verdict("Move", "Move", Outcome.CONFORMING, 12)
LIMIT_S = 60


@pytest.mark.parametrize(
    ("verdict", "violations", "level", "message"),
    [
        (RIGHT, 0, 0, "conforming"),
        (UNKNOWN, 0, 1, "inconclusive: started in the middle"),
        (WRONG, 1, 2, "expected A or B, observed C"),
        (RIGHT, 2, 1, "conforming again; violated 2 times before"),
    ],
)
def test_the_level_and_the_message_tell_how_it_stands(verdict, violations, level, message) -> None:
    status = status_of(verdict, violations)
    assert (status.level, status.message) == (level, message)
    assert (status.name, status.hardware_id) == ("moon: Level", "Level")


def test_the_values_tell_why() -> None:
    values = [(item.key, item.value) for item in status_of(WRONG, 1).values]
    assert values[:5] == [
        ("outcome", "violated"),
        ("machine", "Level"),
        ("node", "Level"),
        ("stamp_ns", "9"),
        ("violations", "1"),
    ]
    assert values[5:] == [
        ("expected", "A"),
        ("expected", "B"),
        ("observed", "C"),
        ("state", "idle"),
        ("evidence", "a message"),
        ("place", "m.scxml:1:2"),
    ]


def test_a_verdict_is_published_at_once_and_the_last_of_each_node_every_second() -> None:
    world = SimulatedWorld()
    heard: list[DiagnosticArray] = []
    reader = SimulatedTransport(world, "reader")
    reader.subscribe(DIAGNOSTICS, heard.append)
    monitor = SimulatedTransport(world, "monitor")
    sink = Diagnostics(monitor)
    world.run_for(2.5)
    assert heard == []  # nothing is known
    sink.take(RIGHT)
    sink.take(OTHER)
    sink.take(WRONG)
    world.run_for(0.2)
    levels = [[(status.hardware_id, status.level) for status in array.status] for array in heard]
    assert levels == [[("Level", 0)], [("Move", 0)], [("Level", 2)]]
    world.run_for(2.0)
    levels = [[(status.hardware_id, status.level) for status in array.status] for array in heard]
    assert levels[3:] == [[("Level", 2), ("Move", 0)]] * 2
    assert heard[4].header.stamp.sec - heard[3].header.stamp.sec == 1


class WithoutDiagnostics(SimulatedTransport):
    """A transport where ``diagnostic_msgs`` is not installed."""

    def publisher(self, topic):
        raise TransportError(f"the type `{topic.type_name}` needs an interface package")


def test_without_the_messages_the_monitor_says_so_once_and_goes_on(capsys) -> None:
    assert _diagnostics(WithoutDiagnostics(SimulatedWorld(), "monitor")) == []
    assert capsys.readouterr().err == (
        "no verdicts on /diagnostics: the type `diagnostic_msgs/msg/DiagnosticArray` needs an "
        "interface package\n"
    )


LISTEN = """
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

rclpy.init()
node = rclpy.create_node("dashboard")
found = []

def hear(array):
    found.extend(status for status in array.status if status.level == DiagnosticStatus.OK)

node.create_subscription(DiagnosticArray, "/diagnostics", hear, 10)
print("listening", flush=True)
while not found:
    rclpy.spin_once(node, timeout_sec=0.1)
print(found[0].name, found[0].message, found[0].values[0].value)
node.destroy_node()
rclpy.shutdown()
"""


@pytest.mark.ros2
@pytest.mark.slow
def test_a_monitor_on_ros_2_tells_a_dashboard_what_it_finds() -> None:
    with ros2_network.own_domain():
        model = str(LAB_TOUR / "components" / "BatteryComponent.ascxml")
        processes = [
            subprocess.Popen([sys.executable, "-c", LISTEN], stdout=subprocess.PIPE, text=True),
        ]
        dashboard = processes[0]
        assert dashboard.stdout is not None
        assert dashboard.stdout.readline() == "listening\n"
        moon, m2c = (str(Path(sys.executable).parent / name) for name in ("moon", "m2c"))
        monitor = [moon, "monitor", model, "--transport", "ros2", "--json"]
        system = [m2c, "run", str(LAB_TOUR / "system.xml"), "--transport", "ros2", "--quiet"]
        for command in (monitor, [*system, "--only", "BatteryComponent"]):
            processes.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))
        try:
            told, _ = dashboard.communicate(timeout=LIMIT_S)
            assert told == "moon: BatteryComponent conforming conforming\n"
        finally:
            for process in processes:
                process.terminate()
        assert [process.wait(LIMIT_S) for process in processes[1:]] == [0, 0]
