"""What listening can take: observations decoded and written to a file, none lost.

One process publishes at a fixed rate on several channels. A bare Zenoh subscriber (counting only),
``moon tap --json`` and ``moon record`` hear it in turns of one run.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import msgspec

from benchmarks.page import Row, beside, command
from benchmarks.processes import Child, free_endpoint, processor_s, ready, say
from moon.recording.reader import open_recording
from transports.interface import Observation, Topic
from transports.zenoh import connect
from transports.zenoh_link.session import open_session

CHANNELS = 4
PEER = "a bare Zenoh subscriber that counts"
QUIET_S, BUSY = 1.0, 0.1
"""Nothing more comes when who listens has used less than a part of a processor for so long."""


class Quaternion(msgspec.Struct):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


TOPICS = [
    Topic(f"/robot{n}/orientation", "geometry_msgs/msg/Quaternion", Quaternion)
    for n in range(CHANNELS)
]


class Job(msgspec.Struct):
    """Messages to be published, in all, and so many a second."""

    count: int
    rate: int


def run_robot(endpoint: str) -> None:
    """Carry out a job a line of standard input, once who listens is there."""
    transport = connect("robot", {"listen": endpoint})
    publishers = [transport.publisher(topic) for topic in TOPICS]
    transport.announce()
    pace = threading.Event()
    with contextlib.closing(transport):
        ready()
        for line in sys.stdin:
            job = msgspec.json.decode(line, type=Job)
            while not all(item.declared.matching_status.matching for item in publishers):
                pace.wait(0.01)
            start = time.monotonic()
            sent = 0
            while sent < job.count:
                due = min(job.count, int((time.monotonic() - start) * job.rate) + 1)
                for number in range(sent, due):
                    publishers[number % CHANNELS].publish(
                        Quaternion(number * 0.001, 24.5, 2.0, 0.5)
                    )
                sent = max(sent, due)
                pace.wait(0.001)
            say({"seconds": time.monotonic() - start})


def sent_s(robot: Child, job: Job, pid: int) -> float:
    """How long the robot took for ``job``; returns once process ``pid``, which listens, is idle."""
    taken = float(robot.ask(msgspec.to_builtins(job), job.count / job.rate + 60)["seconds"])
    pause = threading.Event()
    before = 0.0
    while (now := processor_s(pid)) > before + BUSY * QUIET_S:
        before = now
        pause.wait(QUIET_S)
    return taken


def bare_s(robot: Child, endpoint: str, job: Job) -> float:
    """Processor time of a bare subscriber that counts."""
    count = itertools.count()
    with contextlib.closing(open_session({"endpoint": endpoint})) as session:
        subscriber = session.declare_subscriber("**", lambda _: next(count))
        began = time.process_time()
        taken = sent_s(robot, job, os.getpid())
        used = time.process_time() - began
        subscriber.undeclare()
    print(f"a bare subscriber heard {next(count):,} of {job.count:,}, sent in {taken:.2f} s")
    return used


def lines_of(path: Path) -> int:
    """Observations in what ``moon tap --json`` wrote."""
    return path.read_bytes().count(b"\n")


def entries_of(path: Path) -> int:
    """Observations in a recording."""
    return sum(isinstance(entry, Observation) for entry in open_recording(path).entries())


def rows(rate: int = 60_000, seconds: float = 5.0) -> list[Row]:
    """What is shown; ``rate`` messages a second."""
    endpoint, job = free_endpoint(), Job(int(rate * seconds), rate)
    found = []
    with Child.calling("the robot", run_robot, endpoint) as robot:
        robot.answer()
        bare = bare_s(robot, endpoint, job) / job.count * 1e6
        with tempfile.TemporaryDirectory() as folder:
            recording, said = Path(folder) / "run.mcap", Path(folder) / "said.jsonl"
            for words, path, count in (
                (["tap", "--json"], said, lines_of),
                (["record", "-o", str(recording)], recording, entries_of),
            ):
                line = [sys.executable, "-m", "moon.cli", *words, "--endpoint", endpoint]
                with said.open("wb") as file, subprocess.Popen(line, stdout=file) as moon:
                    try:
                        taken = sent_s(robot, job, moon.pid)
                        used = processor_s(moon.pid) / job.count * 1e6
                    finally:
                        moon.send_signal(signal.SIGINT)
                lost = job.count - count(path)
                what = f"moon {words[0]}, processor time of an observation, decoded and in a file"
                found += [
                    beside(what, "µs", [[used]], PEER, [[bare]]),
                    Row(
                        f"moon {words[0]}, written",
                        job.count / taken,
                        "observations/s",
                        least=50_000.0,
                    ),
                    Row(f"moon {words[0]}, lost", lost, f"of {job.count:,}", most=0.0),
                ]
    return found


if __name__ == "__main__":
    command(rows)
