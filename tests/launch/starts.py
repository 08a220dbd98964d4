"""Nodes that are started and stopped, again and again, on a busy machine: each ends, and leaves nothing.

``python -m tests.launch.starts --transport zenoh|ros2 [--nodes 1000] [--busy 2] [--seed N]``. Four at a time are told to
end at a random moment: while Python starts, while the middleware connects, as they have just announced themselves, or
at work. Ends with 1 if one does not end in time, or ends otherwise than it should, or is still there for the others.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from examples.lab_tour.faults.busy import busy
from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.launch.description import Package, read_description
from m2c.launch.process import STOP_TIMEOUT_S, Module, NodeProcess
from m2c.model import DiagnosticLog, load
from m2c.rosidl.build import build_interfaces
from tests.monitor.processes import free_endpoint
from tests.transports import ros2_network, shared_memory
from transports.interface import Connection
from transports.networks import spinning
from transports.registry import connect

ROOT = Path(__file__).parents[2]
LAB_TOUR = ROOT / "examples" / "lab_tour"
BUILT = ROOT / "build" / "interfaces"
NAMES = ("BatteryComponent", "BatteryLevelSkill", "GoToPoiSkill")
"""One with a timer, one that serves and hears, one with an action's client."""
AT_A_TIME = 4
UP_S = 60.0
"""A node is up after this; only a failing run waits that long."""
GONE_S = 30.0
"""A node that has ended is gone for the others after this."""
LATEST_S = 2.0
"""The latest moment for a signal, counted from the start of the process."""
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Up:
    """Who is up, as another node hears it."""

    def __init__(self, connection: Connection) -> None:
        self._names: set[str] = set()
        self._changed = threading.Condition()
        connection.watch_nodes(self._take)

    def _take(self, name: str, up: bool) -> None:
        with self._changed:
            (self._names.add if up else self._names.discard)(name)
            self._changed.notify_all()

    def wait(self, name: str, up: bool, timeout_s: float) -> bool:
        """Wait until ``name`` is up, or no longer; whether that came."""
        with self._changed:
            return self._changed.wait_for(lambda: (name in self._names) == up, timeout_s)

    def left(self, timeout_s: float) -> list[str]:
        """Who is still up, at the end."""
        with self._changed:
            self._changed.wait_for(lambda: not self._names, timeout_s)
            return sorted(self._names)


def start_and_stop(
    package: Package, folder: Path, arguments: Sequence[str], name: str, up: Up, seed: int
) -> str:
    """Start one node, tell it to end at a moment that ``seed`` decides; what was wrong, or ""."""
    chance = random.Random(seed)
    ended = threading.Event()
    process = NodeProcess(
        name,
        Module(package.package, [folder / package.path], [*arguments, "--node-name", name]),
        lambda *_: None,
        lambda *_: ended.set(),
    )
    after_it_is_up = chance.random() < 0.5
    if after_it_is_up:
        if not up.wait(name, True, UP_S):
            process.kill()
            return f"{name} was not up after {UP_S:g} s: {list(process.last_lines)}"
        pause_s = chance.choice((0.0, 0.0, chance.uniform(0.0, 0.1), chance.uniform(0.0, 0.5)))
    else:
        pause_s = chance.uniform(0.0, LATEST_S)
    ended.wait(pause_s)
    # Python itself, before it runs anything of ours, takes SIGINT for a mistake of the program.
    number = chance.choice(SIGNALS if after_it_is_up else SIGNALS[1:])
    for _ in range(chance.choice((1, 1, 2))):
        process.terminate(number)
    how = process.finish(time.monotonic() + STOP_TIMEOUT_S, number)
    if how:
        return f"{name} (seed {seed}) {how}: {list(process.last_lines)}"
    return ""


@contextlib.contextmanager
def middleware(transport: str) -> Iterator[tuple[Connection, list[str]]]:
    """A node that hears the others, and their command line."""
    with contextlib.ExitStack() as around:
        arguments, options = ["--transport", transport], {}
        if transport == "zenoh":
            endpoint = free_endpoint()
            arguments += ["--endpoint", endpoint]
            options = {"rendezvous": endpoint}
        else:
            around.enter_context(ros2_network.own_domain())
            install = build_interfaces([LAB_TOUR / "interfaces"], BUILT)
            os.environ.update(install.environment(os.environ))
        connection = connect(transport, "observer", options)
        with spinning(connection):
            yield connection, arguments


def run(transport: str, nodes: int, processes: int, seed: int) -> list[str]:
    """Start and stop ``nodes`` of them beside ``processes`` that compute; what was wrong."""
    wrong: list[str] = []
    before = shared_memory.segments()
    with (
        tempfile.TemporaryDirectory(prefix="starts-") as scratch,
        middleware(transport) as (connection, arguments),
        busy(processes),
    ):
        folder = Path(scratch)
        system = load([LAB_TOUR / "system.xml"], DiagnosticLog())
        assert system is not None
        write_files(system_files(system), folder)
        packages = [node for node in read_description(folder).nodes if node.name in NAMES]
        up = Up(connection)
        turns = iter(range(nodes))
        lock = threading.Lock()

        def work() -> None:
            while True:
                with lock:
                    number = next(turns, None)
                    if number is None or wrong:
                        return
                package = packages[number % len(packages)]
                said = start_and_stop(
                    package, folder, arguments, f"Node{number}", up, seed + number
                )
                with lock:
                    wrong.extend([said] if said else [])
                    if (number + 1) % 100 == 0:
                        print(f"{number + 1} of {nodes}", flush=True)

        workers = [threading.Thread(target=work) for _ in range(AT_A_TIME)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        wrong += [f"{name} has ended and is still up" for name in up.left(GONE_S)]
    if transport == "ros2":
        wrong += [f"left in shared memory: {name}" for name in shared_memory.left_over(before)]
    return wrong


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.launch.starts", description=__doc__)
    parser.add_argument("--transport", choices=("zenoh", "ros2"), default="zenoh")
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--busy", type=int, default=2, help="processes that compute beside it")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args(arguments)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # what is started by nohup(1) has it ignored
    if chosen.transport == "ros2":
        shared_memory.separate()
    began = time.monotonic()
    wrong = run(chosen.transport, chosen.nodes, chosen.busy, chosen.seed)
    for sentence in wrong:
        print(sentence)
    what = f"{chosen.nodes} nodes on {chosen.transport}, {time.monotonic() - began:.0f} s"
    print(f"{what}: {len(wrong)} wrong" if wrong else f"{what}: each has ended, none is left")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
