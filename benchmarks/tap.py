"""What a tap can take: observations decoded and written to a file, none lost.

One process publishes at a fixed rate on several channels. A bare Zenoh subscriber (counting only),
a transport's tap (decoding, each observation a line of JSON in a file) and the command
``moon tap --json > file`` hear it in turns of one run.

Usage: ``python -m benchmarks.tap [--rate N] [--seconds S]``. Prints counts, losses and the
processor time that each observation needed.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec

from benchmarks.page import Row, publish, slower
from benchmarks.processes import free_endpoint, spinning
from transports.interface import Observation, Topic, Transport
from transports.zenoh import connect
from transports.zenoh.session import open_session

CHANNELS = 4


class BatteryState(msgspec.Struct):
    percentage: float = 0.0
    voltage: float = 0.0
    power_supply_status: int = 0
    location: str = ""


TOPICS = [
    Topic(f"/robot{n}/battery_state", "sensor_msgs/msg/BatteryState", BatteryState)
    for n in range(CHANNELS)
]


def run_robot(endpoint: str, pipe: Connection) -> None:
    transport = connect("robot", {"endpoint": endpoint})
    publishers = [transport.publisher(topic) for topic in TOPICS]
    transport.announce()
    pace = threading.Event()
    pipe.send(True)
    while job := pipe.recv():
        rate, seconds = job
        while not all(publisher.declared.matching_status.matching for publisher in publishers):
            pace.wait(0.01)
        start = time.monotonic()
        sent, total = 0, int(rate * seconds)
        while sent < total:
            due = min(total, int((time.monotonic() - start) * rate) + 1)
            for number in range(sent, due):
                publishers[number % CHANNELS].publish(
                    BatteryState(number * 0.001, 24.5, 2, "charging dock 1")
                )
            sent = max(sent, due)
            pace.wait(0.001)
        pipe.send((sent, time.monotonic() - start))
    transport.close()


def settled(count: list[int], total: int) -> None:
    """Wait until all has arrived, or nothing more does."""
    pace = threading.Event()
    before = -1
    while count[0] < total and count[0] != before:
        before = count[0]
        pace.wait(1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=int, default=60_000, help="messages per second")
    parser.add_argument("--seconds", type=float, default=5.0)
    arguments = parser.parse_args()
    job = (arguments.rate, arguments.seconds)

    endpoint = free_endpoint()
    transport = connect("monitor", {"listen": endpoint})
    context = multiprocessing.get_context("spawn")
    pipe, there = context.Pipe()
    robot = context.Process(target=run_robot, args=(endpoint, there), daemon=True)
    with spinning(transport):
        robot.start()
        pipe.recv()
        rows = compare(transport, endpoint, pipe, job)
        pipe.send(None)
        robot.join(5)
        robot.terminate()
    publish(rows)


def compare(
    transport: Transport, endpoint: str, pipe: Connection, job: tuple[int, float]
) -> list[Row]:
    """A bare subscriber, a tap, and the command, each hears the same ``job`` of the robot's."""
    transport.wait_for_nodes(["robot"], 10)
    count = [0]

    def count_one(_: object) -> None:
        count[0] += 1

    with contextlib.closing(open_session({"endpoint": endpoint})) as bare:
        subscriber = bare.declare_subscriber("**", count_one)
        bare_processor = time.process_time()
        pipe.send(job)
        sent, took = pipe.recv()
        settled(count, sent)
        bare_processor = (time.process_time() - bare_processor) / sent * 1e6
        subscriber.undeclare()
    rows: list[Row] = []
    print(f"a bare subscriber heard {count[0]:,} of {sent:,}, sent in {took:.2f} s")

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "observations.jsonl"
        heard = [0]
        encode = msgspec.json.Encoder().encode_into
        buffer = bytearray()
        with path.open("wb", buffering=1 << 20) as file:

            def write(observation: Observation) -> None:
                heard[0] += 1
                encode(observation, buffer)
                buffer.extend(b"\n")
                file.write(buffer)
                buffer.clear()

            tap = transport.tap([], write)
            processor = time.process_time()
            pipe.send(job)
            sent, took = pipe.recv()
            settled(heard, sent)
            processor = time.process_time() - processor
            problems = list(tap.problems())
            tap.close()
        lines = path.read_bytes().count(b"\n")
        rows += report("transport's tap", sent, took, lines, processor, bare_processor)
        for problem in problems:
            print(f"  {problem}")
        rows += by_command(endpoint, pipe, job, Path(folder), bare_processor)
    return rows


def by_command(
    endpoint: str, pipe: Connection, job: tuple[int, float], folder: Path, bare_us: float
) -> list[Row]:
    """The same by ``moon tap --json``, a process of its own that is ended by a signal."""
    path, said = folder / "command.jsonl", folder / "command.err"
    moon = [sys.executable, "-m", "moon.cli", "tap", "--json", "--endpoint", endpoint]
    with path.open("wb") as file, said.open("wb") as errors:
        command = subprocess.Popen(moon, stdout=file, stderr=errors)
        pipe.send(job)
        sent, took = pipe.recv()
        pace = threading.Event()
        size = -1
        while size != path.stat().st_size:  # until nothing more is written
            size = path.stat().st_size
            pace.wait(1.0)
        command.send_signal(signal.SIGINT)
        _, status, usage = os.wait4(command.pid, 0)
        command.returncode = os.waitstatus_to_exitcode(status)
    lines = path.read_bytes().count(b"\n")
    processor = usage.ru_utime + usage.ru_stime
    rows = report("moon tap --json", sent, took, lines, processor, bare_us)
    for text in said.read_text(encoding="utf-8").splitlines():
        print(f"  {text}")
    return rows


def report(
    name: str, sent: int, took: float, lines: int, processor: float, bare_us: float
) -> list[Row]:
    return [
        slower(
            f"{name}, processor time of an observation, decoded and in a file",
            processor / sent * 1e6,
            "µs",
            "a bare Zenoh subscriber that counts",
            bare_us,
        ),
        Row(f"{name}, written", sent / took, "observations/s", least=50_000.0),
        Row(f"{name}, lost", sent - lines, f"of {sent:,}", most=0.0),
    ]


if __name__ == "__main__":
    main()
