"""A judge that is neither a model, nor a policy, nor a property: live, simulated, recorded and in a fleet."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

import moon
import transports
from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from moon.oracle.bounds import FOREVER
from moon.recording.definitions import Definitions
from moon.recording.recorder import Recorder
from moon.recording.writer import RecordingWriter
from tests.fleet.by_hand import FleetByHand
from tests.monitor.processes import free_endpoint
from transports import Conditions, Observation, SimulatedWorld, Topic

S = 1_000_000_000


class Number(msgspec.Struct):
    data: int = 0

    __type_name__ = "std_msgs/msg/Int32"


BATTERY = Topic("/battery", "std_msgs/msg/Int32", Number)


class CountsUp(moon.Judge[Observation]):
    """Each message is one more than the one before, and comes within a second."""

    name = "counts up"
    last: int | None = None
    due_ns = FOREVER

    def concerns(self, channel: str, source: str, kind: str) -> bool:
        return (channel, kind) == ("/battery", "message")

    def observe(self, seen: Observation) -> Iterator[moon.Verdict]:
        number = seen.data["data"]
        if self.last is not None and number != self.last + 1:
            why = f"{number} after {self.last}"
            yield moon.Verdict.of(self.name, moon.Outcome.VIOLATED, seen.stamp_ns, why)
        self.last, self.due_ns = number, seen.stamp_ns + S

    def gap(self, gap: moon.Gap) -> Iterator[moon.Verdict]:
        self.last, self.due_ns = None, FOREVER
        yield moon.Verdict.of(self.name, moon.Outcome.INCONCLUSIVE, gap.from_ns, gap.why)

    def advance(self, until_ns: int) -> Iterator[moon.Verdict]:
        if until_ns >= self.due_ns:
            yield moon.Verdict.of(
                self.name, moon.Outcome.VIOLATED, self.due_ns, f"nothing after {self.last}"
            )
            self.due_ns = FOREVER


def reasons(verdicts: list[moon.Verdict]) -> list[str]:
    return [verdict.reason for verdict in verdicts if verdict.outcome == "violated"]


class Simulated:
    """Two nodes count together, by turns; what they send is received late and in disorder."""

    def __init__(self, loss: float = 0.0, path: Path | None = None) -> None:
        self.world = SimulatedWorld(1, Conditions(tap_delay_s=(0.0, 0.15), tap_loss=loss))
        self.verdicts: list[moon.Verdict] = []
        self.monitor = moon.Monitor(
            self.world.connect("monitor"), judges=[CountsUp], on_verdict=self.verdicts.append
        )
        self.monitor.start()
        if path is not None:
            self.writer = RecordingWriter(
                path, Definitions(InterfaceLibrary.load([], DiagnosticLog()))
            )
            connection = self.world.connect("recorder")
            world = self.world
            recorder = Recorder(
                connection, "simulated", self.writer, (), print, lambda: world.now_ns
            )
            recorder.start()
            connection.every(0.5, recorder.look_around)
        self.world.run_for(0.5)
        self.publishers = []
        for name in ("even", "odd"):
            node = self.world.connect(name)
            self.publishers.append((node, node.publisher(BATTERY)))
            node.announce()
        self.world.run_for(0.5)

    def count(self, *numbers: int) -> None:
        for number in numbers:
            node, publisher = self.publishers[number % 2]
            node.post(lambda to=publisher, number=number: to.publish(Number(number)))
            self.world.run_for(0.02)


def test_it_is_told_in_order_of_what_comes_late_in_a_simulated_run() -> None:
    run = Simulated()
    run.count(*range(100))
    run.world.run_for(0.5)
    assert reasons(run.verdicts) == []
    assert [status.verdict for status in run.monitor.statuses()] == ["conforming"]
    run.count(200)
    run.world.run_for(2.0)
    assert reasons(run.verdicts) == ["200 after 99", "nothing after 200"]
    assert run.monitor.violations == 2
    assert [(status.machine, status.verdict) for status in run.monitor.statuses()] == [
        ("counts up", "violated")
    ]


def test_it_says_of_a_recording_what_it_said_of_the_run(tmp_path: Path) -> None:
    run = Simulated(path=tmp_path / "run.mcap")
    run.count(*range(50), 70, *range(71, 90))
    run.world.run_for(2.0)
    run.writer.close()
    result = moon.check_recording(tmp_path / "run.mcap", judges=[CountsUp])
    recorded = [found.verdict for found in result.violated]
    assert reasons(recorded) == reasons(run.verdicts) == ["70 after 49", "nothing after 89"]


@pytest.mark.zenoh
def test_it_judges_what_it_hears_on_zenoh() -> None:
    endpoint = free_endpoint()
    connection = transports.connect("zenoh", "monitor", {"listen": endpoint})
    robot = transports.connect("zenoh", "robot", {"endpoint": endpoint})
    spinning = threading.Thread(target=robot.spin)
    verdicts: list[moon.Verdict] = []
    try:
        monitor = moon.Monitor(connection, judges=[CountsUp], on_verdict=verdicts.append)
        monitor.start()
        battery = robot.publisher(BATTERY)
        robot.announce()
        robot.every(0.02, lambda: battery.publish(Number(20)))
        spinning.start()
        connection.spin(until=lambda: monitor.violations > 0)
    finally:
        robot.close()
        connection.close()
        if spinning.ident is not None:
            spinning.join()
    assert reasons(verdicts)[0] == "20 after 20"


def test_each_robot_of_a_fleet_has_one_of_its_own(tmp_path: Path) -> None:
    by_hand = FleetByHand(tmp_path, judges=(CountsUp,))
    for name, numbers in (("robots/r1", (1, 2, 3)), ("robots/r2", (1, 2, 7))):
        robot = by_hand.robot(name)
        robot.start()
        for number in numbers:
            robot.message(number)
            robot.pass_time(300)
    found = [it for it in by_hand.verdicts if it.machine == "counts up" and it.reason]
    assert [(it.robot, it.reason) for it in found] == [("robots/r2", "7 after 2")]
    assert by_hand.status("robots/r1").violations == 0


def test_what_is_missing_it_is_told_of_before_what_came_after() -> None:
    run = Simulated(loss=0.2)
    run.count(*range(100))
    run.world.run_for(0.5)
    assert reasons(run.verdicts) == []
    assert any(verdict.outcome == "inconclusive" for verdict in run.verdicts)
