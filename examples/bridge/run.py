"""Runs the lab tour on two middlewares with a bridge between them, and monitors all of it at once.

``python examples/bridge/run.py [--seconds 25] [--replace NODE=PATH] [--properties FILE]``. Exit code 0:
nothing was violated, and every machine was judged; 1: not so; 2: it could not be run.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from bridge import NAME, options_of
from routes import POLICY, Placement, PlacementError, read_placement

HERE = Path(__file__).resolve().parent
LAB_TOUR = HERE.parent / "lab_tour"
sys.path.append(str(LAB_TOUR / "faults"))

from processes import START_S, RunError, find_interfaces, own_domain  # noqa: E402 - of the example beside

if TYPE_CHECKING:
    from m2c.model.system import System
    from moon.properties.property import Property
    from moon.run import Run
    from moon.verdict import Verdict
    from transports.interface import Connection

LATENCY_NS = 200_000_000
"""The latency bound, as ``moon monitor`` has it when nothing is said."""
DEADLINE_NS = 1_000_000_000
TICK_S = 0.05
"""How often it is looked whether it is over."""
STOP_S = 60.0
"""How long each part may take to stop: ``m2c run`` gives the policy ten seconds, and then its nodes."""


class Monitor:
    """One monitor of both sides; see ``sides`` for how it is cut.

    Args:
        sides: the monitor's own connections by the transport's name; on the first one everything runs.
        system, placement: what runs where.
        properties: monitored too, over everything.
    """

    def __init__(
        self,
        sides: Mapping[str, Connection],
        system: System,
        placement: Placement,
        properties: Sequence[Property] = (),
    ) -> None:
        from sides import AllSides, Side

        from moon.monitor.reading import no_system
        from moon.monitor.subject import Monitored
        from moon.oracle.bounds import Bounds
        from moon.run import Run
        from moon.sources.source import Outputs

        home = next(iter(sides.values()))
        bounds = Bounds(latency=LATENCY_NS, deadline=DEADLINE_NS)
        views = {name: Side(transport, home) for name, transport in sides.items()}
        self.verdicts: list[Verdict] = []
        self.watches: dict[str, Run] = {}
        for name, nodes in placement.sides.items():
            machines = [machine for machine in system.nodes if machine.name in nodes]
            policy = POLICY in nodes
            monitored = Monitored(system, tuple(machines), (), bounds, policy=policy)
            self.watches[name] = Run(views[name], monitored, Outputs([self], say))
        if properties:
            everything = AllSides(list(views.values()), [NAME])
            monitored = Monitored(no_system(), (), tuple(properties), bounds)
            self.watches["properties"] = Run(everything, monitored, Outputs([self], say))

    def start(self) -> None:
        """Listen on both sides: before the nodes start."""
        for watch in self.watches.values():
            watch.start()

    def take(self, verdict: Verdict) -> None:
        """A verdict, from any watch."""
        from moon.monitor.report import verdict_lines
        from moon.verdict import Outcome

        if verdict.outcome is Outcome.VIOLATED:
            self.verdicts.append(verdict)
            say("\n".join(verdict_lines(verdict)))

    def show(self) -> bool:
        """Each machine as it stands; whether all is well."""
        from moon.monitor.report import table

        statuses = []
        for name, watch in self.watches.items():
            print(f"\n{name}:")
            print("\n".join(table(watch.statuses())))
            statuses += watch.statuses()
        unseen = [item.machine for item in statuses if item.verdict == "unseen"]
        if unseen:
            print(f"never seen: {', '.join(unseen)}")
        return not unseen and not self.verdicts


def say(text: str) -> None:
    """Tell a person."""
    print(text, file=sys.stderr, flush=True)


def run(
    system_file: Path,
    placement_file: Path,
    seconds: float,
    replacements: Sequence[str] = (),
    properties: Sequence[Path] = (),
) -> Monitor:
    """Run both halves and the bridge for ``seconds`` from when all are up.

    Args:
        system_file: what is run.
        placement_file: which node is where.
        seconds: how long.
        replacements: ``NODE=PATH`` as for ``m2c run --replace``.
        properties: files of properties.

    Raises:
        PlacementError, RunError, ModelError, TransportError: it cannot be run.
    """
    from moon.monitor.reading import read_checked
    from moon.properties.files import load_properties
    from transports.registry import connect

    system = read_checked([system_file])
    placement = read_placement(placement_file, system)
    endpoint = free_endpoint()
    sides: dict[str, Connection] = {}
    threads: list[threading.Thread] = []
    with contextlib.ExitStack() as stack:
        stack.enter_context(own_domain())
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bridge-")))
        for name in placement.sides:
            sides[name] = connect(name, "bridge_monitor", options_of(name, endpoint, listens=True))
            stack.callback(sides[name].close)
        home, *others = sides.values()
        monitor = Monitor(sides, system, placement, load_properties(*properties))
        monitor.start()
        threads = [threading.Thread(target=other.spin) for other in others]
        for thread in threads:
            thread.start()
        processes = _Processes(scratch, system_file, placement, endpoint, home)
        stack.callback(processes.stop)
        processes.start(
            "bridge",
            [
                *(sys.executable, str(HERE / "bridge.py"), str(system_file), str(placement_file)),
                *("--endpoint", endpoint),
            ],
        )
        processes.wait("bridge", "bridging ")
        # first who serves, last who ticks
        for name in sorted(placement.sides, key=lambda side: POLICY in placement.sides[side]):
            processes.start_side(name, replacements)
            processes.wait(name, "nodes are up")
        processes.pass_time(seconds)
    for thread in threads:
        thread.join()
    return monitor


class _Processes:
    """The bridge and both halves, as processes; the monitor runs while they are waited for."""

    def __init__(
        self, scratch: Path, system: Path, placement: Placement, endpoint: str, home: Connection
    ) -> None:
        self._scratch = scratch
        self._system = system
        self._placement = placement
        self._endpoint = endpoint
        self._home = home
        self._said: dict[str, TextIO] = {}
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, command: Sequence[str]) -> None:
        """Start a process; what it says goes to a file."""
        self._said[name] = (self._scratch / name).open("w+")
        self._running[name] = subprocess.Popen(
            command, stdout=self._said[name], stderr=subprocess.STDOUT
        )

    def start_side(self, side: str, replacements: Sequence[str]) -> None:
        """Start the nodes of one side."""
        nodes = self._placement.sides[side]
        command = [str(Path(sys.executable).parent / "m2c"), "run", str(self._system), "--quiet"]
        command += ["--transport", side]
        for node in nodes:
            command += ["--only", node]
        for replacement in replacements:
            if replacement.partition("=")[0] in nodes:
                command += ["--replace", replacement]
        if side == "zenoh":  # it meets the monitor, which listens already
            config = self._scratch / "zenoh.json5"
            config.write_text(f'{{"connect": {{"endpoints": ["{self._endpoint}"]}}}}')
            command += ["--zenoh-config", str(config)]
        self.start(side, command)

    def wait(self, name: str, text: str) -> None:
        """Run the monitor until a process has said ``text``; RunError if it does not."""
        deadline_s = time.monotonic() + START_S
        self._spin(lambda: text in self._text(name) or time.monotonic() > deadline_s)
        if text not in (said := self._text(name)):
            raise RunError(f"{name} was not ready in {START_S:g} s; it said:\n{said}")

    def pass_time(self, seconds: float) -> None:
        """Run the monitor for so long."""
        end_ns = self._home.now_ns() + round(seconds * 1e9)
        self._spin(lambda: self._home.now_ns() > end_ns)

    def _spin(self, is_over: Callable[[], bool]) -> None:
        over = False

        def look() -> None:
            nonlocal over
            over = is_over() or any(item.poll() is not None for item in self._running.values())

        timer = self._home.every(TICK_S, look)
        self._home.spin(lambda: over)
        timer.cancel()
        for name, process in self._running.items():
            if process.poll() is not None:
                raise RunError(f"{name} ended by itself:\n{self._text(name)}")

    def _text(self, name: str) -> str:
        return (self._scratch / name).read_text()

    def stop(self) -> None:
        """The policy's half first: it halts its tree, for which the skills must still be there."""
        for process in reversed(self._running.values()):
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(STOP_S)
            if process.poll() is None:
                process.kill()
                process.wait()
        for said in self._said.values():
            said.close()


def free_endpoint() -> str:
    """A loopback endpoint that nobody uses at the moment."""
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="The lab tour on two middlewares, monitored.")
    parser.add_argument("--seconds", type=float, default=25.0, help="how long (default: a tour)")
    parser.add_argument(
        "--replace", action="append", default=[], metavar="NODE=PATH", help="run a changed node"
    )
    parser.add_argument("--placement", type=Path, default=HERE / "placement.yaml")
    parser.add_argument("--properties", action="append", type=Path, default=[], metavar="FILE")
    chosen = parser.parse_args(arguments)
    from m2c.model import ModelError
    from transports.interface import TransportError

    try:
        find_interfaces()
        monitor = run(
            LAB_TOUR / "system.xml",
            chosen.placement,
            chosen.seconds,
            chosen.replace,
            chosen.properties,
        )
    except (PlacementError, RunError, ModelError, TransportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0 if monitor.show() else 1


if __name__ == "__main__":
    sys.exit(main())
