"""``moon monitor --properties`` as a process on real Zenoh, without models and beside them."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from moon.sinks.topic import VERDICTS
from tests.monitor.processes import BIN, WAIT_S, Monitor, Process, router
from transports.interface import Topic
from transports.zenoh import connect

pytestmark = [pytest.mark.zenoh, pytest.mark.slow]
TOUR = Path(__file__).parents[2] / "examples" / "lab_tour"
SYSTEM = TOUR / "system.xml"
RATE = 10
FILE = """\
ports:
  asked: {topic: /asked}
  answered: {topic: /answered}
  level: {topic: /level, field: data}
properties:
  - {id: answers, pattern: response, request: asked, response: answered, within: 300 ms,
     severity: critical, text: Nobody answered.}
  - {id: high, formula: "historically{level >= 30}", severity: warning}
"""


class Number(msgspec.Struct):
    data: int = 0

    __type_name__ = "std_msgs/msg/Int32"


class Robot:
    """A node that says what a test wants it to, and hears the verdicts."""

    def __init__(self, endpoint: str) -> None:
        self._connection = connect("robot", {"endpoint": endpoint})
        self.told: list[object] = []
        self._heard = threading.Event()
        self._connection.subscribe(VERDICTS, self._hear)
        self._publishers = {
            name: self._connection.publisher(Topic(f"/{name}", "std_msgs/msg/Int32", Number))
            for name in ("asked", "answered", "level")
        }
        self._matched = threading.Condition()
        for publisher in self._publishers.values():
            publisher.declared.declare_matching_listener(
                zenoh.handlers.Callback(self._matching, indirect=False)
            )
        self._connection.announce()
        self._thread = threading.Thread(target=self._connection.spin)
        self._thread.start()

    def _hear(self, message: object) -> None:
        self.told.append(message)
        if message.outcome == "violated":
            self._heard.set()

    def _matching(self, _: zenoh.MatchingStatus) -> None:
        with self._matched:
            self._matched.notify_all()

    def is_listened_to(self) -> bool:
        """Whether somebody listens to all it says, before long."""
        publishers = [publisher.declared for publisher in self._publishers.values()]
        with self._matched:
            return self._matched.wait_for(
                lambda: all(item.matching_status.matching for item in publishers), WAIT_S
            )

    def say(self, name: str, value: int = 0) -> None:
        self._publishers[name].publish(Number(value))

    def hears_of_a_violation(self) -> bool:
        return self._heard.wait(WAIT_S)

    def close(self) -> None:
        self._connection.close()
        self._thread.join(WAIT_S)


@contextlib.contextmanager
def a_robot(endpoint: str) -> Iterator[Robot]:
    made = Robot(endpoint)
    try:
        yield made
    finally:
        made.close()


@pytest.fixture
def endpoint(tmp_path) -> Iterator[str]:
    with router(tmp_path) as (endpoint, _):
        yield endpoint


@pytest.fixture
def robot(endpoint) -> Iterator[tuple[Robot, str]]:
    with a_robot(endpoint) as made:
        yield made, endpoint


@pytest.fixture
def properties(tmp_path) -> Path:
    path = tmp_path / "p.yaml"
    path.write_text(FILE)
    return path


def linked(monitor: Process, robot: Robot) -> None:
    """Wait until they know of each other: the monitor of the robot, and the robot that somebody listens."""
    monitor.until(lambda: any("linked to" in line and "robot" in line for line in monitor.err))
    assert robot.is_listened_to()


def test_without_models_silence_is_told_everywhere_and_ends_it_with_1(
    start, robot, properties, tmp_path
) -> None:
    node, endpoint = robot  # before the monitor: what it says is in doubt until it was found
    log = tmp_path / "verdicts.jsonl"
    monitor = start(
        Monitor,
        *("--properties", properties, "--endpoint", endpoint),
        *("--log", log, "--exit-on-violation"),
    )
    linked(monitor, node)
    monitor.until(lambda: monitor.of("answers")[-1:] == ["inconclusive"])  # it was found
    node.say("asked")
    assert monitor.end() == 1, monitor.said
    (verdict,) = [item for item in monitor.verdicts if item["outcome"] == "violated"]
    assert (verdict["machine"], verdict["kind"]) == ("answers", "property")
    assert verdict["reason"] == "critical: Nobody answered."
    assert verdict["explanation"]["expected"] == [
        "Always, every `asked` is followed by `answered` within 300 ms."
    ]
    assert verdict["explanation"]["observed"].endswith("not (answered) for 300 ms")
    first, *_ = verdict["explanation"]["evidence"]
    assert first["text"].startswith("asked: message on /asked of robot")
    assert verdict["stamp_ns"] - first["stamp_ns"] == 300_000_000
    assert re.search(r"p\.yaml:6:\d+$", verdict["explanation"]["places"][0])
    logged = [json.loads(line) for line in log.read_text().splitlines()]
    assert [item["outcome"] for item in logged if item["machine"] == "answers"][-1] == "violated"
    assert node.hears_of_a_violation()
    (told,) = [item for item in node.told if item.outcome == "violated"]
    assert (told.machine, told.reason) == ("answers", "critical: Nobody answered.")
    rows = {item["machine"]: item["verdict"] for item in monitor.summary["machines"]}
    assert rows["answers"] == "violated"


def test_without_models_and_without_violation_it_ends_with_0(start, endpoint, properties) -> None:
    monitor = start(Monitor, "--properties", properties, "--endpoint", endpoint)
    monitor.until_listening()
    with a_robot(endpoint) as node:
        linked(monitor, node)
        for value in range(20):
            node.say("asked")
            node.say("answered")
            node.say("level", 50 + value)
        monitor.until(lambda: monitor.of("high") == ["conforming"])  # once a level was heard
        assert monitor.end(signal.SIGINT) == 0, monitor.said
    assert monitor.violated == set()
    rows = {item["machine"]: item for item in monitor.summary["machines"]}
    assert set(rows) == {"answers", "high"}
    assert all(row["verdict"] == "conforming" for row in rows.values())
    assert rows["high"]["inputs"] >= 1


def test_a_violation_is_printed_with_its_witness_for_people(start, robot, properties) -> None:
    node, endpoint = robot  # before the monitor: nothing is known of what it did, or left out
    monitor = start(Process, "moon", "monitor", "--properties", properties, "--endpoint", endpoint)
    linked(monitor, node)
    node.say("level", 20)
    wanted = ("high  VIOLATED", "answers  inconclusive")
    monitor.until(lambda: all(any(text in line for line in monitor.out) for text in wanted))
    assert monitor.end(signal.SIGINT) == 1, monitor.said
    text = "\n".join(monitor.out)
    assert "high  VIOLATED  warning: At every moment, `level >= 30`." in text
    assert "not (level >= 30): message on /level of robot {data: 20}" in text
    assert re.search(r"answers  inconclusive  messages on /(asked|answered) were missed", text)
    assert "2 properties: 1 violated, 1 inconclusive" in text


def test_beside_models_both_find_a_skill_that_answers_the_opposite(start, wrong, tmp_path) -> None:
    with router(tmp_path) as (endpoint, config):
        monitor = start(
            Monitor, SYSTEM, "--properties", TOUR / "properties.yaml", "--endpoint", endpoint
        )
        monitor.until_listening()
        run = start(
            Process,
            *("m2c", "run", SYSTEM, "--replace", f"BatteryLevelSkill={wrong}", "--rate", RATE),
            *("--zenoh-config", config, "--ticks", 200),
        )
        monitor.until(lambda: {"BatteryLevelSkill", "P1"} <= monitor.violated)
        assert monitor.end(signal.SIGINT) == 1, monitor.said
        run.end(signal.SIGINT)
    assert monitor.violated == {"BatteryLevelSkill", "P1"}
    kinds = {item["machine"]: item["kind"] for item in monitor.summary["machines"]}
    assert kinds["BatteryLevelSkill"] == "model"
    assert [name for name, kind in kinds.items() if kind == "property"] == [
        *("P1", "P2", "P3", "A1", "A2", "A3")
    ]


@pytest.mark.soak
def test_beside_models_a_nominal_tour_breaks_nothing(start, tmp_path) -> None:
    with router(tmp_path) as (endpoint, config):
        monitor = start(
            Monitor,
            *(SYSTEM, "--properties", TOUR / "properties.xml", "--endpoint", endpoint),
        )
        monitor.until_listening()
        run = start(
            Process,
            *("m2c", "run", SYSTEM, "--ticks", 60, "--rate", RATE),
            *("--zenoh-config", config, "--quiet"),
        )
        assert run.end() == 0, run.said
        assert monitor.end(signal.SIGINT) == 0, monitor.said
    assert monitor.violated == set()


def test_where_nobody_listens_is_exit_code_2(properties) -> None:
    with socket.socket() as silent:  # bound, and does not listen: nobody else can
        silent.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{silent.getsockname()[1]}"
        done = subprocess.run(
            [str(BIN / "moon"), "monitor", "--properties", properties, "--endpoint", endpoint],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
