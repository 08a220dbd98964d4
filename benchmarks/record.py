"""How much faster than life a recording is checked, and what memory that takes.

A tour in virtual time with all monitors and properties, recorded with the monitor's turns, is checked again;
times are of the processor, so that other work on the machine counts less. Memory: the growth of this process
from a third of the check to its end.
"""

from __future__ import annotations

import logging
import resource
import tempfile
import time
from pathlib import Path

from benchmarks.page import Row, command
from benchmarks.processes import ROOT
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.offline.engine import check_recording
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Ended
from moon.recording.writer import RecordingWriter
from moon.run import Run
from moon.sources.recorded import RecordedConnection
from moon.sources.source import Outputs
from transports.simulated import SimulatedTransport, SimulatedWorld

EXAMPLE = ROOT / "examples" / "lab_tour"


def record_tour(path: Path, monitored: Monitored, seconds: float) -> None:
    """A recording of the tour with its monitor's turns."""
    world = SimulatedWorld(1)
    writer = RecordingWriter(path, Definitions(monitored.system.library))
    connection = RecordedConnection(SimulatedTransport(world, "monitor"), writer.add, "simulated")
    watch = Run(connection, monitored, Outputs(say=print))
    watch.start()
    SimulatedRun(compile_system(monitored.system), world).run(seconds)
    writer.add(Ended(connection.now_ns()))
    writer.close()
    world.close()


def rows(seconds: float = 600.0) -> list[Row]:
    """What is shown, of a tour of ``seconds``."""
    logging.disable(logging.ERROR)
    bounds = Bounds()
    subject = Subject((EXAMPLE / "system.xml",), (EXAMPLE / "properties.yaml",), (), (), (), bounds)
    monitored = read_subject(subject)
    grown: list[int] = []

    def look(_: object) -> None:
        grown.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tour.mcap"
        record_tour(path, monitored, seconds)
        start = time.process_time()
        result = check_recording(path, subject, monitored, progress=look)
        speed = seconds / (time.process_time() - start)
    more = (grown[-1] - grown[len(grown) // 3]) / 1024
    what = f"a tour of {seconds:,.0f} s ({result.recording.observations:,} observations)"
    return [
        Row(f"checking {what}, times as fast as life", speed, "x", least=200.0),
        Row("memory, from a third of it to the end", more, "MB more"),
    ]


if __name__ == "__main__":
    command(rows)
