"""What a tap can take: observations decoded and written to a file, none lost.

One process publishes at a fixed rate on several channels. A bare Zenoh subscriber (counting only), a
transport's tap (decoding, each observation a line of JSON in a file) and the command ``moon tap --json``
hear it in turns of one run.
"""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from benchmarks.page import Row, beside, command
from benchmarks.processes import Child, free_endpoint, processor_s, ready, say, spinning
from transports.interface import Observation, Topic, Transport
from transports.zenoh import connect
from transports.zenoh.session import open_session

CHANNELS = 4
PEER = "a bare Zenoh subscriber that counts"


class BatteryState(msgspec.Struct):
    percentage: float = 0.0
    voltage: float = 0.0
    power_supply_status: int = 0
    location: str = ""


TOPICS = [
    Topic(f"/robot{n}/battery_state", "sensor_msgs/msg/BatteryState", BatteryState)
    for n in range(CHANNELS)
]


class Job(msgspec.Struct):
    """Messages to be published, in all, and so many a second."""

    count: int
    rate: int


def run_robot(endpoint: str) -> None:
    """Carry out a job a line of standard input, once who listens is there."""
    transport = connect("robot", {"endpoint": endpoint})
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
                        BatteryState(number * 0.001, 24.5, 2, "charging dock 1")
                    )
                sent = max(sent, due)
                pace.wait(0.001)
            say({"seconds": time.monotonic() - start})


def settled(count: Callable[[], int]) -> int:
    """``count`` when nothing more comes."""
    pace = threading.Event()
    before = -1
    while (now := count()) != before:
        before = now
        pace.wait(1.0)
    return before


def compare(transport: Transport, endpoint: str, robot: Child, job: Job) -> list[Row]:
    """A bare subscriber, a tap, and the command: each hears the same ``job`` of the robot's."""
    transport.wait_for_nodes(["robot"], 10)

    def sent_s() -> float:
        expected = job.count / job.rate
        return float(robot.ask(msgspec.to_builtins(job), expected + 60)["seconds"])

    count = [0]

    def count_one(_: object) -> None:
        count[0] += 1

    with contextlib.closing(open_session({"endpoint": endpoint})) as bare:
        subscriber = bare.declare_subscriber("**", count_one)
        used = time.process_time()
        took = sent_s()
        heard = settled(lambda: count[0])
        bare_s = time.process_time() - used
        subscriber.undeclare()
    print(f"a bare subscriber heard {heard:,} of {job.count:,}, sent in {took:.2f} s")

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "observations.jsonl"
        encode = msgspec.json.Encoder().encode_into
        buffer = bytearray()
        count[0] = 0
        with path.open("wb", buffering=1 << 20) as file:

            def write(observation: Observation) -> None:
                count[0] += 1
                encode(observation, buffer)
                buffer.extend(b"\n")
                file.write(buffer)
                buffer.clear()

            tap = transport.tap([], write)
            used = time.process_time()
            took = sent_s()
            settled(lambda: count[0])
            used = time.process_time() - used
            print("; ".join(tap.problems()) or "the tap has no problem")
            tap.close()
        rows = report("transport's tap", job, took, path, used, bare_s)

        path = Path(folder) / "command.jsonl"
        words = [sys.executable, "-m", "moon.cli", "tap", "--json", "--endpoint", endpoint]
        with path.open("wb") as file, subprocess.Popen(words, stdout=file) as moon:
            took = sent_s()
            settled(lambda: path.stat().st_size)
            used = processor_s(moon.pid)
            moon.send_signal(signal.SIGINT)
        return rows + report("moon tap --json", job, took, path, used, bare_s)


def report(name: str, job: Job, took: float, path: Path, used_s: float, bare_s: float) -> list[Row]:
    """What ``name`` wrote to ``path``, and what that took of the processor."""
    what = f"{name}, processor time of an observation, decoded and in a file"
    lost = job.count - path.read_bytes().count(b"\n")
    return [
        beside(what, "µs", [[used_s / job.count * 1e6]], PEER, [[bare_s / job.count * 1e6]]),
        Row(f"{name}, written", job.count / took, "observations/s", least=50_000.0),
        Row(f"{name}, lost", lost, f"of {job.count:,}", most=0.0),
    ]


def rows(rate: int = 60_000, seconds: float = 5.0) -> list[Row]:
    """What is shown; ``rate`` messages a second."""
    endpoint = free_endpoint()
    transport = connect("monitor", {"listen": endpoint})
    with spinning(transport), Child.calling("the robot", run_robot, endpoint) as robot:
        robot.answer()
        return compare(transport, endpoint, robot, Job(int(rate * seconds), rate))


if __name__ == "__main__":
    command(rows)
