"""What memory `moon check` takes in the course of a large recording: python benchmarks/check_memory.py

A tour in virtual time is recorded with the monitor's turns, and beside it what a camera would send: a
message of a megabyte, which no model names, again and again, until the file is as large as wanted. Then
`moon check` reads it in a process of its own, whose resident memory is looked at twice a second.

Usage: ``python benchmarks/check_memory.py [--gigabytes N] [--message BYTES] [--folder PATH]``. The file
is removed afterwards.
"""

from __future__ import annotations

import argparse
import base64
import logging
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from m2c.launch.in_process import SimulatedRun, compile_system
from moon.monitor.reading import read_checked
from moon.monitor.watch import SystemWatch
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Ended
from moon.recording.mcap_writing import Compression
from moon.recording.recorded import RecordedConnection
from moon.recording.writer import RecordingWriter
from transports.interface import Observation, ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld

EXAMPLE = Path(__file__).parents[1] / "examples" / "lab_tour"
FRAME_S = 1 / 30
"""Between two of the camera's messages."""
LOOK_S = 0.5
PARTS = 8
"""Lines of the table that is printed."""


def make(path: Path, size: int, message_bytes: int) -> float:
    """A recording of ``size`` bytes at ``path``; how long its tour is (s)."""
    system = read_checked([EXAMPLE / "system.xml"])
    world = SimulatedWorld(1)
    writer = RecordingWriter(path, Definitions(system.library), Compression.NONE)
    connection = RecordedConnection(SimulatedTransport(world, "monitor"), writer.add, "simulated")
    watch = SystemWatch(
        connection,
        system,
        system.nodes,
        Bounds(),
        [],
        print,
        monotonic_ns=connection.monotonic_ns,
    )
    watch.start()
    tour = SimulatedRun(compile_system(system), world)
    frame = base64.b64encode(os.urandom(message_bytes * 3 // 4)).decode()
    count = size // len(frame)
    for number in range(count):
        tour.run(FRAME_S)
        now_ns = connection.now_ns()
        writer.add(
            Observation(
                stamp_ns=now_ns,
                received_ns=now_ns,
                channel="/camera",
                kind=ObservationKind.MESSAGE,
                type_name="std_msgs/msg/String",
                data={"data": frame},
                source="camera",
                sequence=number,
                order=number,
            )
        )
    writer.add(Ended(connection.now_ns()))
    writer.close()
    world.close()
    return count * FRAME_S


def read_so_far(pid: int) -> int:
    """Bytes that the process has read."""
    lines = Path(f"/proc/{pid}/io").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("rchar"))


def resident(pid: int) -> float:
    """Its resident memory (MB)."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS")), 0) / 1024


def check(path: Path) -> list[tuple[float, float]]:
    """How much was read (GB) and the resident memory then (MB), from the first look to the last."""
    command = [sys.executable, "-m", "moon.cli", "check", str(path), str(EXAMPLE / "system.xml")]
    found = []
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            try:
                found.append((read_so_far(process.pid) / 1e9, resident(process.pid)))
                process.wait(LOOK_S)
            except subprocess.TimeoutExpired:
                continue
            except OSError:
                break  # it has just ended
    if process.returncode != 0:
        sys.exit(f"moon check ended with {process.returncode}")
    return found


def main() -> None:
    """Make, check, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=1.0)
    parser.add_argument(
        "--message", type=int, default=1 << 20, help="bytes of the camera's messages"
    )
    parser.add_argument("--folder", type=Path, help="where there is room for the file")
    arguments = parser.parse_args()
    logging.disable(logging.ERROR)
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        path = Path(name) / "large.mcap"
        begin = time.monotonic()
        seconds = make(path, round(arguments.gigabytes * 1e9), arguments.message)
        made = time.monotonic() - begin
        print(f"{path.stat().st_size / 1e9:.2f} GB, a tour of {seconds:.0f} s, in {made:.0f} s")
        begin = time.monotonic()
        found = check(path)
        print(f"moon check: {time.monotonic() - begin:.0f} s")
    total = found[-1][0]
    for part in range(1, PARTS + 1):
        read, memory = next(item for item in found if item[0] >= total * part / PARTS)
        print(f"after {read:6.2f} GB: {memory:4.0f} MB")
    print(f"at the most: {max(memory for _, memory in found):.0f} MB")


if __name__ == "__main__":
    main()
