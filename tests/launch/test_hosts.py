"""One system on two hosts: whoever meets at an address that both reach hears all the others."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.launch.system import Run, System
from tests.monitor.processes import Process
from tests.transports.hosts import ADDRESSES, may_be_made, plug, two_hosts

pytestmark = [
    pytest.mark.zenoh,
    pytest.mark.skipif(not may_be_made(), reason="only root may make network namespaces"),
]

MEETING = f"tcp/{ADDRESSES[0]}:7447"


@pytest.fixture
def hosts() -> Iterator[tuple[list[str], list[str]]]:
    with two_hosts() as both:
        yield both


def test_nodes_of_two_hosts_call_one_another_and_are_heard_on_both(
    system: System, hosts: tuple[list[str], list[str]]
) -> None:
    here, there = hosts
    with contextlib.ExitStack() as stack:
        taps = [
            stack.enter_context(
                contextlib.closing(
                    Process("moon", "tap", "--json", "--endpoint", MEETING, inside=host)
                )
            )
            for host in hosts
        ]
        runs = [
            Run(system.path, "--only", "LevelSkill", endpoint=MEETING, inside=here),
            Run(system.path, "--only", "MoveSkill", endpoint=MEETING, inside=there),
        ]
        for run in runs:
            run.until("1 node is up")
        runs.append(
            Run(system.path, "--only", "policy", "--rate", 20, endpoint=MEETING, inside=there)
        )
        runs[-1].until("RUNNING  Level ok  Move ..")
        for tap in taps:
            for node in ("LevelSkill", "MoveSkill"):
                answer = f'"kind":"response","channel":"/{node}/tick","source":"{node}"'
                tap.until(lambda tap=tap, answer=answer: answer in tap.said)
        for run in reversed(runs):
            run.process.send_signal(signal.SIGINT)
            assert run.end() == 0, run.output
        for tap in taps:
            assert tap.end(signal.SIGINT) == 0, tap.said
            assert "warning" not in tap.said


def test_each_host_starts_its_part_and_waits_for_the_rest(
    system: System, hosts: tuple[list[str], list[str]]
) -> None:
    here, there = hosts
    deployment = system.folder / "deployment.xml"
    deployment.write_text(
        '<deployment><process name="brain" host="robot"><node name="policy"/><node name="LevelSkill"/>'
        '</process><process name="arm" host="base"><node name="MoveSkill"/></process></deployment>'
    )
    start = [system.path, "--deployment", deployment, "--host"]
    base = Run(*start, "base", endpoint=MEETING, inside=there)
    base.until("waiting for another host")  # nobody listens at the meeting point yet
    robot = Run(*start, "robot", endpoint=MEETING, inside=here)
    robot.until("starting 1 of 2 nodes")
    base.until("starting 1 of 2 nodes")
    robot.until("RUNNING  Level ok  Move ..")
    base.until("2 nodes are up")
    robot.process.send_signal(signal.SIGINT)
    assert robot.end() == 0, robot.output
    base.process.send_signal(signal.SIGINT)
    assert base.end() == 0, base.output
    assert base.lines[-1] == "stopped; all nodes have ended"


def test_who_listens_on_loopback_only_says_that_a_third_host_cannot_reach_it(
    hosts: tuple[list[str], list[str]], tmp_path: Path
) -> None:
    here, there = hosts
    config = tmp_path / "loopback.json5"
    config.write_text(
        f'{{connect: {{endpoints: ["{MEETING}"]}}, listen: {{endpoints: ["tcp/127.0.0.1:0"]}}}}'
    )
    with (
        contextlib.closing(Process("moon", "tap", "--endpoint", MEETING, inside=here)) as first,
        contextlib.closing(Process("moon", "tap", "--zenoh-config", config, inside=there)) as tap,
    ):
        tap.until(lambda: "nodes of a third host cannot reach it" in tap.said)
        (said,) = [line for line in tap.err if "third host" in line]
        assert f"meets others at {MEETING} and listens on tcp/127.0.0.1:0 only" in said
        assert "set listen/endpoints in a Zenoh configuration file" in said
        for process in (tap, first):
            process.end(signal.SIGINT)
            assert "Traceback" not in process.said


LINKS = (
    "the link between policy and MoveSkill was down or slow",
    "late: the link between it and this monitor was down or slow",
)
"""A request was under way for longer than the deadline, or what came after it was late for the monitor."""


@pytest.mark.parametrize("cut_s", [1.5, 3.0])
def test_a_cut_between_two_hosts_is_a_finding_of_the_link_and_violates_nobody(
    cut_s: float, system: System, hosts: tuple[list[str], list[str]]
) -> None:
    here, there = hosts
    command = ("moon", "monitor", system.path, "--json", "--endpoint", MEETING)
    with contextlib.closing(Process(*command, inside=here)) as monitor:
        monitor.until(lambda: "not linked to any node yet" in monitor.said)
        runs = [
            Run(system.path, "--only", "LevelSkill", endpoint=MEETING, inside=here),
            Run(system.path, "--only", "MoveSkill", endpoint=MEETING, inside=there),
        ]
        for run in runs:
            run.until("1 node is up")
        rate = ("--rate", 20)
        runs.append(Run(system.path, "--only", "policy", *rate, endpoint=MEETING, inside=here))
        runs[-1].until("RUNNING  Level ok  Move ..")
        for name in ("MoveSkill", "policy"):
            judged = f'"machine":"{name}","node":"{name}","outcome":"conforming"'
            monitor.until(lambda judged=judged: judged in monitor.said)
        plug(here, is_in=False)
        time.sleep(cut_s)  # it lasts so long: nothing tells the time to a cable
        plug(here, is_in=True)
        monitor.until(lambda: any(link in monitor.said for link in LINKS))
        for run in reversed(runs):
            run.process.send_signal(signal.SIGINT)
            assert run.end() == 0, run.output
        assert monitor.end(signal.SIGINT) == 0, monitor.said
        assert '"violated"' not in monitor.said
