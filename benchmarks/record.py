"""What recording and checking cost: messages a second, how much faster than life checking is, memory.

Recording: one process publishes on a loopback link as fast as it is told, ``moon record``'s recorder hears it
over Zenoh in this one, and what is in the file is counted. Before that, without a network, how many messages
a second the writer takes. Checking: a tour in virtual time with all monitors and properties, recorded with
the monitor's turns, is checked again; times are of the processor, so that other work on the machine counts
less. Memory: the growth of this process from a third of the check to its end.

With ``--gigabytes``, only memory: beside the tour what a camera would send is recorded, a message of a
megabyte which no model names, until the file is so large; ``moon check`` reads it in a process of its own,
whose resident memory is looked at twice a second.
"""

from __future__ import annotations

import base64
import logging
import os
import resource
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from benchmarks.page import Row, command
from benchmarks.processes import ROOT, Child, free_endpoint, read_so_far, resident_mb
from benchmarks.tap import TOPICS, Job, run_robot
from m2c.launch.in_process import SimulatedRun, compile_system
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.monitor.watch import SystemWatch
from moon.offline.engine import check_recording
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Ended
from moon.recording.mcap_writing import Compression
from moon.recording.reader import open_recording
from moon.recording.recorded import RecordedConnection
from moon.recording.recorder import Recorder
from moon.recording.writer import FLUSH_S, RecordingWriter
from transports.interface import Observation, ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld
from transports.zenoh import connect

EXAMPLE = ROOT / "examples" / "lab_tour"
SYSTEM = EXAMPLE / "system.xml"
RECORD_TARGET = 50_000
FRAME_BYTES, FRAME_S = 1 << 20, 1 / 30
"""Of the camera's messages, and between two of them."""
LOOK_S = 0.5
PARTS = 8
"""So often the memory is told."""


def message(channel: str, type_name: str, data: object, stamp_ns: int, number: int) -> Observation:
    """What the writer gets of it."""
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel=channel,
        kind=ObservationKind.MESSAGE,
        type_name=type_name,
        data={"data": data},
        source="node",
        sequence=number,
        order=number,
    )


# -- recording --------------------------------------------------------------------------------------


def written(folder: Path, count: int) -> Row:
    """Messages a second of processor time that the writer takes, without a network."""
    seen = [message("/level", "std_msgs/msg/Int32", n, 10**18 + n, n) for n in range(count)]
    writer = RecordingWriter(folder / "written.mcap", Definitions())
    start = time.process_time()
    for item in seen:
        writer.add(item)
    writer.close()
    taken = time.process_time() - start
    return Row("the writer alone, of processor time", count / taken, "messages/s")


def over_zenoh(folder: Path, rate_hz: float, count: int) -> list[Row]:
    """The rate at which was sent, and how many of ``count`` are not in the recording."""
    endpoint = free_endpoint()
    path = folder / "heard.mcap"
    here = connect("recorder", {"listen": endpoint})
    with Child.calling("the robot", run_robot, endpoint) as robot:
        robot.answer()
        writer = RecordingWriter(path, Definitions())
        recorder = Recorder(here, "zenoh", writer, [topic.name for topic in TOPICS], print)
        recorder.start()
        here.every(FLUSH_S, recorder.look_around)
        here.wait_for_nodes(["robot"], 10)
        quiet = [0, 0]

        def is_over() -> bool:
            return writer.observations >= count or quiet[1] > 10

        def look() -> None:
            quiet[1] = quiet[1] + 1 if writer.observations == quiet[0] else 0
            quiet[0] = writer.observations

        here.every(LOOK_S, look)
        robot.tell(msgspec.json.encode(Job(count, round(rate_hz))).decode())
        here.spin(until=is_over)
        recorder.finish()
        here.close()
        rate = count / robot.answer()["seconds"]
    stored = sum(isinstance(entry, Observation) for entry in open_recording(path).entries())
    return [
        Row("recorded over Zenoh", rate, "messages/s", least=RECORD_TARGET),
        Row("of them lost", count - stored, f"of {count:,}", most=0.0),
    ]


# -- checking ---------------------------------------------------------------------------------------


def recorded(
    path: Path,
    monitored: Monitored,
    run: Callable[[SimulatedRun, RecordingWriter, RecordedConnection], None],
    compression: Compression = Compression.ZSTD,
) -> None:
    """A recording of the tour with its monitor's turns; ``run`` has it run."""
    world = SimulatedWorld(1)
    writer = RecordingWriter(path, Definitions(monitored.system.library), compression)
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
    run(SimulatedRun(compile_system(monitored.system), world), writer, connection)
    writer.add(Ended(connection.now_ns()))
    writer.close()
    world.close()


def checked(folder: Path, seconds: float) -> list[Row]:
    """Record a tour of ``seconds``, and check it."""
    path = folder / "tour.mcap"
    subject = Subject((SYSTEM,), (EXAMPLE / "properties.yaml",), (), (), (), Bounds())
    monitored = read_subject(subject)
    recorded(path, monitored, lambda run, *_: run.run(seconds) and None)
    grown: list[int] = []
    start = time.process_time()
    result = check_recording(
        path,
        subject,
        monitored,
        progress=lambda _: grown.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss),
    )
    speed = seconds / (time.process_time() - start)
    more = (grown[-1] - grown[len(grown) // 3]) / 1024
    what = f"a tour of {seconds:,.0f} s ({result.recording.observations:,} observations)"
    return [
        Row(f"checking {what}, times as fast as life", speed, "x", least=200.0),
        Row("memory, from a third of it to the end", more, "MB more"),
    ]


def large(folder: Path, gigabytes: float) -> list[Row]:
    """Memory of ``moon check`` in the course of a large recording."""
    path = folder / "large.mcap"
    frame = base64.b64encode(os.urandom(FRAME_BYTES * 3 // 4)).decode()

    def run(tour: SimulatedRun, writer: RecordingWriter, connection: RecordedConnection) -> None:
        for number in range(round(gigabytes * 1e9) // len(frame)):
            tour.run(FRAME_S)
            now_ns = connection.now_ns()
            writer.add(message("/camera", "std_msgs/msg/String", frame, now_ns, number))

    monitored = read_subject(Subject((SYSTEM,), (), (), (), (), Bounds()))
    recorded(path, monitored, run, Compression.NONE)
    found: list[tuple[float, float]] = []
    pause = threading.Event()
    with Child("moon check", ["-m", "moon.cli", "check", str(path), str(SYSTEM)]) as check:
        while check.exit_code is None:
            if memory := resident_mb(check.pid):
                found.append((read_so_far(check.pid) / 1e9, memory))
            pause.wait(LOOK_S)
        assert check.exit_code == 0, check.last_lines
    parts = [found[-1][0] * part / PARTS for part in range(1, PARTS + 1)]
    told = [next(item for item in found if item[0] >= part) for part in parts]
    rows = [Row(f"moon check, resident after {read:.1f} GB", memory, "MB") for read, memory in told]
    return [*rows, Row("at the most", max(memory for _, memory in found), "MB")]


def rows(
    seconds: float = 600.0,
    messages: int = 500_000,
    rate: float = RECORD_TARGET,
    gigabytes: float = 0.0,
    folder: str = "",
) -> list[Row]:
    """What is shown.

    Args:
        seconds: length of the tour.
        messages: recorded.
        rate: of the publisher, a second.
        gigabytes: memory of so large a recording, only.
        folder: where there is room for the file.
    """
    logging.disable(logging.ERROR)
    with tempfile.TemporaryDirectory(dir=folder or None) as name:
        here = Path(name)
        if gigabytes:
            return large(here, gigabytes)
        heard = over_zenoh(here, rate, messages)
        return [*checked(here, seconds), *heard, written(here, messages)]


if __name__ == "__main__":
    command(rows)
