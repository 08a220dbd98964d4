"""What a monitor of a fleet takes follows the robots that do something, and comes back when they go."""

from __future__ import annotations

import contextlib
import gc
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from moon.fleet import robot as robot_module
from moon.fleet.fleet import Fleet
from moon.monitor.reading import read_checked
from moon.monitor.subject import monitored_of
from moon.oracle.bounds import Bounds
from moon.run import Run
from moon.sources.source import Outputs
from tests.fleet import strangers
from tests.fleet.test_on_zenoh import ALL, FleetMonitor, small
from tests.monitor.processes import Process, router
from tests.transports.conftest import network
from tests.transports.zenoh_network import Network, eventually
from transports.zenoh.namespaces import Within
from transports.zenoh.tokens import node_key
from transports.zenoh.wire import MEDIA_TYPE, attachment

__all__ = ["network", "small"]

pytestmark = pytest.mark.zenoh

STRANGERS = 1000
MOST_MB = 60
"""What they may take: a name, a subscriber without a message, and three of Zenoh's tokens each."""


PER_ROBOT = 2
"""Threads: its tap's, and that of the policy's tree."""
LAST = 2
"""Robots that an executor still has in hand: what it ran last, and its last timer."""


def status(pid: int) -> dict[str, int]:
    """Threads and memory (kB) of a process."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    fields = dict(line.split(":", 1) for line in lines)
    return {name: int(fields[name].split()[0]) for name in ("Threads", "VmRSS")}


@contextlib.contextmanager
def announced(endpoint: str, count: int) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, strangers.__file__, endpoint, str(count)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert int(process.stdout.readline()) == count + 1
        yield
        process.stdin.close()


def test_robots_beside_a_thousand_strangers_are_judged_and_these_take_hardly_anything(
    start: Any, small: tuple[Path, Path], wrong: Path, tmp_path: Path
) -> None:
    system, generated = small
    with router(tmp_path) as (endpoint, config):
        monitor = start(FleetMonitor, system, endpoint)
        monitor.waits()
        before = status(monitor.process.pid)
        with announced(endpoint, STRANGERS):
            monitor.until(lambda: any("more than 255 characters" in line for line in monitor.err))
            runs = {
                name: start(
                    *(Process, "m2c", "run", *options, "--namespace", name),
                    *("--zenoh-config", config),
                )
                for name, options in (
                    ("robots/r1", (generated,)),
                    ("robots/r2", (system, "--replace", f"BatteryLevelSkill={wrong}")),
                )
            }
            monitor.until(lambda: monitor.conforming("robots/r1") == ALL)
            monitor.until(lambda: ("robots/r2", "BatteryLevelSkill") in monitor.violated)
            most = before["Threads"] + 2 * PER_ROBOT + 1
            eventually(lambda: status(monitor.process.pid)["Threads"] <= most)
            after = status(monitor.process.pid)
            assert after["VmRSS"] <= before["VmRSS"] + MOST_MB * 1000
            for run in runs.values():
                assert run.end(signal.SIGINT) == 0, run.said
        assert monitor.end(signal.SIGINT) == 1, monitor.said
        assert monitor.violated == {("robots/r2", "BatteryLevelSkill")}
        assert monitor.robots == {*runs}
        assert max(map(len, monitor.err)) < 1000
        summary = json.loads(monitor.out[-1])
        assert summary["robots"]["gone, conforming until it ended"] == 1
        assert summary["robots"]["gone, violated"] == 1


class Robots:
    """Robots that say one thing each, all of one session."""

    def __init__(self, network: Network) -> None:
        self._session = network.bare()
        self._payload = msgspec.msgpack.encode({"data": 7})
        self._declared: list[Any] = []

    def come(self, names: list[str]) -> None:
        zid = str(self._session.info.zid())
        for name in names:
            key = f"{name}/{node_key(zid, 'BatteryComponent', 1)}"
            self._declared.append(self._session.liveliness().declare_token(key))

    def speak(self, names: list[str], number: int) -> None:
        for name in names:
            self._session.put(
                f"{name}/BatteryComponent/level",
                self._payload,
                encoding=f"{MEDIA_TYPE};std_msgs/msg/Int32",
                attachment=attachment(number, number, b"BatteryComponent"),
            )

    def go(self) -> None:
        for token in self._declared:
            token.undeclare()
        self._declared.clear()


def alive(kind: type) -> int:
    gc.collect()
    return sum(type(found) is kind for found in gc.get_objects())


def test_what_robots_took_is_free_when_they_have_gone(
    network: Network, small: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_module, "KEPT_S", 0.05)
    connection = network.node("moon_monitor")
    models = monitored_of(read_checked([small[0]]), (), Bounds())
    said: list[str] = []
    fleet = Fleet(connection, "robots/*", models, Outputs(say=said.append), most=60)
    connection.post(fleet.start)
    robots = Robots(network)
    threads = threading.active_count()
    others = {kind: alive(kind) for kind in (Run, Within)}  # of tests before this one

    def seen() -> dict[str, tuple[bool, int]]:
        return {r.name: (r.is_judged, r.received) for r in fleet.robots()}

    for turn in range(6):
        names = [f"robots/r{turn}-{number}" for number in range(20)]
        robots.come(names)
        numbers = iter(range(10**6))

        def spoken(names: list[str] = names, numbers: Iterator[int] = numbers) -> bool:
            robots.speak(names, next(numbers))
            return all(seen().get(name, (False, 0)) > (True, 0) for name in names)

        eventually(spoken)
        assert threading.active_count() <= threads + 20 + 1
        robots.go()
        eventually(lambda: not any(judged for judged, _ in seen().values()))
        eventually(lambda: threading.active_count() <= threads)
        assert len(seen()) <= 60
    eventually(lambda: all(alive(kind) <= others[kind] + LAST for kind in others))
    assert not any("error" in line for line in said), said


def test_a_namespace_in_which_nobody_answers_or_speaks_is_none_of_a_robot(
    network: Network, small: tuple[Path, Path]
) -> None:
    connection = network.node("moon_monitor")
    models = monitored_of(read_checked([small[0]]), (), Bounds())
    fleet = Fleet(connection, "robots/*", models, Outputs())
    connection.post(fleet.start)
    robots = Robots(network)
    robots.come(["robots/r1", "robots/r2"])
    there = network.node("adder", namespace="robots/r3")  # it answers, and says nothing
    there.announce()
    eventually(lambda: [robot.name for robot in fleet.robots()] == ["robots/r3"])
    assert {robot.verdict for robot in fleet.robots()} == {"unseen"}
    numbers = iter(range(10**6))

    def found() -> bool:
        robots.speak(["robots/r2"], next(numbers))
        return {robot.name for robot in fleet.robots()} == {"robots/r2", "robots/r3"}

    eventually(found)
    robots.go()
    eventually(lambda: [robot.is_present for robot in fleet.robots()].count(True) == 1)


def test_so_many_robots_are_judged_at_most_and_those_that_are_gone_make_room(
    network: Network, small: tuple[Path, Path]
) -> None:
    connection = network.node("moon_monitor")
    models = monitored_of(read_checked([small[0]]), (), Bounds())
    said: list[str] = []
    fleet = Fleet(connection, "robots/*", models, Outputs(say=said.append), most_judged=2)
    connection.post(fleet.start)
    first, second = Robots(network), Robots(network)
    names = [f"robots/r{number}" for number in range(3)]
    first.come(names[:2])
    numbers = iter(range(10**6))

    def judged(wanted: set[str], speaker: Robots, names: list[str]) -> bool:
        speaker.speak(names, next(numbers))
        return {robot.name for robot in fleet.robots() if robot.is_judged} == wanted

    eventually(lambda: judged({*names[:2]}, first, names[:2]))
    second.come(names[2:])
    eventually(lambda: judged({*names[:2]}, second, names[2:]) and said)
    assert said == [
        "warning: more than 2 robots: the others are not monitored; "
        "--shard spreads a fleet over several monitors"
    ]
