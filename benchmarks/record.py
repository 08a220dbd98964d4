"""What recording and checking cost: messages a second, how much faster than life checking is, memory.

Recording: one process publishes on a loopback link as fast as it is told, ``moon record``'s recorder hears it
over Zenoh in this one, and what is in the file is counted. Before that, without a network, how many messages
a second the writer takes. Checking: a tour in virtual time with all monitors and properties, recorded with
the monitor's turns, is checked again; times are of the processor, so that other work on the machine counts
less. Memory: the growth of this process from a third of the check to its end.
"""

from __future__ import annotations

import logging
import resource
import tempfile
import time
from pathlib import Path

import msgspec

from benchmarks.page import Row, command
from benchmarks.processes import ROOT, Child, free_endpoint
from benchmarks.tap import TOPICS, Job, run_robot
from m2c.launch.in_process import SimulatedRun, compile_system
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.monitor.watch import SystemWatch
from moon.offline.engine import check_recording
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Ended
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
LOOK_S = 0.5


# -- recording --------------------------------------------------------------------------------------


def written(folder: Path, count: int) -> Row:
    """Messages a second of processor time that the writer takes, without a network."""
    seen = [
        Observation(
            stamp_ns=10**18 + number,
            received_ns=10**18 + number,
            channel="/level",
            kind=ObservationKind.MESSAGE,
            type_name="std_msgs/msg/Int32",
            data={"data": number},
            source="node",
            sequence=number,
            order=number,
        )
        for number in range(count)
    ]
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


def record_tour(path: Path, monitored: Monitored, seconds: float) -> None:
    """A recording of the tour with its monitor's turns."""
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
    writer.add(Ended(connection.now_ns()))
    writer.close()
    world.close()


def checked(folder: Path, seconds: float) -> list[Row]:
    """Record a tour of ``seconds``, and check it."""
    path = folder / "tour.mcap"
    subject = Subject((SYSTEM,), (EXAMPLE / "properties.yaml",), (), (), (), Bounds())
    monitored = read_subject(subject)
    record_tour(path, monitored, seconds)
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


def rows(seconds: float = 600.0, messages: int = 500_000, rate: float = RECORD_TARGET) -> list[Row]:
    """What is shown.

    Args:
        seconds: length of the tour.
        messages: recorded.
        rate: of the publisher, a second.
    """
    logging.disable(logging.ERROR)
    with tempfile.TemporaryDirectory() as name:
        here = Path(name)
        heard = over_zenoh(here, rate, messages)
        return [*checked(here, seconds), *heard, written(here, messages)]


if __name__ == "__main__":
    command(rows)
