"""What recording and checking cost: messages a second recorded, and how much faster than life checking is.

Recording: one process publishes on a loopback link as fast as it is told, ``moon record``'s recorder hears it
over Zenoh in this one, and what is in the file is counted. Before that, without a network, how many messages
a second the writer takes. Checking: a tour in virtual time with all monitors and properties, recorded with
the monitor's turns, is checked again; times are of the processor, so that other work on the machine counts
less. Memory: the growth of this process from a third of the check to its end.

Usage: ``python benchmarks/record.py [--seconds N] [--messages N] [--rate HZ]``.
"""

from __future__ import annotations

import argparse
import logging
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import ClassVar

import msgspec
from loopback import free_endpoint

from m2c.launch.in_process import SimulatedRun, compile_system
from m2c.model.datatypes import Primitive, Structure
from moon.monitor.subject import Subject, read_subject
from moon.monitor.watch import SystemWatch
from moon.offline.engine import check_recording
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Ended, Entry
from moon.recording.reader import open_recording
from moon.recording.recorded import RecordedConnection
from moon.recording.recorder import Recorder
from moon.recording.writer import FLUSH_S, RecordingWriter
from transports.interface import Observation, ObservationKind, Topic
from transports.simulated import SimulatedTransport, SimulatedWorld
from transports.zenoh import connect

EXAMPLE = Path(__file__).parents[1] / "examples" / "lab_tour"
RECORD_TARGET = 50_000
CHECK_TARGET = 200
GROUP_S = 0.001
"""The publisher sends what is due by then, again and again: a sleep for each message would be too long."""


class Level(msgspec.Struct):
    """The message that is recorded."""

    __type_name__: ClassVar[str] = "std_msgs/msg/Int32"
    data: int = 0


LEVEL = Structure("std_msgs/msg/Int32", (("data", Primitive("int32")),))


def written(folder: Path, count: int) -> float:
    """Messages a second of processor time that the writer takes, without a network."""
    path = folder / "written.mcap"
    seen = [
        Observation(
            stamp_ns=10**18 + number,
            received_ns=10**18 + number,
            channel="/level",
            kind=ObservationKind.MESSAGE,
            type_name=Level.__type_name__,
            data={"data": number},
            source="node",
            sequence=number,
            order=number,
        )
        for number in range(count)
    ]
    writer = RecordingWriter(path, Definitions())
    start = time.process_time()
    for item in seen:
        writer.add(item)
    writer.close()
    return count / (time.process_time() - start)


def publish(endpoint: str, rate_hz: float, count: int) -> None:
    """The other process: ``count`` messages at ``rate_hz``, in groups of a millisecond."""
    node = connect("publisher", {"endpoint": endpoint})
    publisher = node.publisher(Topic("/level", Level.__type_name__, Level))
    node.announce()
    input()
    start = time.monotonic()
    sent = 0
    while sent < count:
        due = min(count, int((time.monotonic() - start) * rate_hz))
        while sent < due:
            publisher.publish(Level(sent))
            sent += 1
        time.sleep(GROUP_S)  # paces the publisher; nothing is waited for
    print(f"{count / (time.monotonic() - start):.0f}", flush=True)
    input()
    node.close()


def over_zenoh(folder: Path, rate_hz: float, count: int) -> tuple[float, int]:
    """The rate at which was sent, and how many of ``count`` are in the recording."""
    endpoint = free_endpoint()
    path = folder / "heard.mcap"
    here = connect("recorder", {"listen": endpoint})
    command = [sys.executable, __file__, "--publish", endpoint, str(rate_hz), str(count)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdin is not None
        assert other.stdout is not None
        writer = RecordingWriter(path, Definitions())
        recorder = Recorder(here, "zenoh", writer, ["/level"], print)
        recorder.start()
        here.every(FLUSH_S, recorder.look_around)
        here.wait_for_nodes(["publisher"], 10)
        quiet = [0, 0]

        def is_over() -> bool:
            return writer.observations >= count or quiet[1] > 10

        def look() -> None:
            quiet[1] = quiet[1] + 1 if writer.observations == quiet[0] else 0
            quiet[0] = writer.observations

        here.every(0.5, look)
        print("go", file=other.stdin, flush=True)
        here.spin(until=is_over)
        recorder.finish()
        here.close()
        rate = float(other.stdout.readline())
        print("end", file=other.stdin, flush=True)
    stored = sum(isinstance(entry, Observation) for entry in open_recording(path).entries())
    return rate, stored


def checked(folder: Path, seconds: float) -> None:
    """Record a tour of ``seconds``, check it, and print how it went."""
    path = folder / "tour.mcap"
    properties = (EXAMPLE / "properties.yaml",)
    subject = Subject((EXAMPLE / "system.xml",), properties, (), (), (), Bounds())
    monitored = read_subject(subject)
    world = SimulatedWorld(1)
    writer = RecordingWriter(path, Definitions(monitored.system.library))
    connection = RecordedConnection(SimulatedTransport(world, "monitor"), writer.add, "simulated")
    watch = SystemWatch(
        connection,
        monitored.system,
        monitored.machines,
        monitored.bounds,
        [],
        print,
        monitored.property_watch(),
        monotonic_ns=connection.monotonic_ns,
    )
    watch.start()
    SimulatedRun(compile_system(monitored.system), world).run(seconds)
    end: Entry = Ended(connection.now_ns())
    writer.add(end)
    writer.close()
    world.close()
    size = path.stat().st_size
    grown: list[int] = []
    start = time.process_time()
    result = check_recording(
        path,
        subject,
        monitored,
        progress=lambda _: grown.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss),
    )
    taken = time.process_time() - start
    rate = seconds / taken
    print(
        f"checking {seconds:.0f} s of the lab tour ({result.recording.observations:,} observations, "
        f"{size / 1e6:.1f} MB), {len(result.machines)} monitors: {taken:.1f} s of processor time, "
        f"{rate:.0f} times as fast as life (target {CHECK_TARGET})"
    )
    third = grown[len(grown) // 3]
    print(
        f"memory: {grown[-1] / 1024:.0f} MB, {(grown[-1] - third) / 1024:.1f} MB more than after a "
        "third of it"
    )


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="length of the tour")
    parser.add_argument("--messages", type=int, default=500_000)
    parser.add_argument("--rate", type=float, default=RECORD_TARGET, help="of the publisher")
    parser.add_argument("--publish", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.publish:
        endpoint, rate, count = arguments.publish
        publish(endpoint, float(rate), int(count))
        return
    logging.disable(logging.ERROR)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(f"writing: {written(folder, arguments.messages):,.0f} messages/s of processor time")
        rate, stored = over_zenoh(folder, arguments.rate, arguments.messages)
        print(
            f"over Zenoh: sent {arguments.messages:,} at {rate:,.0f}/s (target {RECORD_TARGET:,}), "
            f"recorded {stored:,}, lost {arguments.messages - stored:,}"
        )
        checked(folder, arguments.seconds)


if __name__ == "__main__":
    main()
