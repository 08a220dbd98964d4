"""The tour as processes, on Zenoh or on ROS 2; the monitor is this one."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from catalogue import Fault
from inject import SYSTEM, replacement
from listener import Listener, Run

if TYPE_CHECKING:
    from m2c.model.system import System
    from moon.properties.property import Property
    from transports.interface import Connection

TICK_S = 0.01
"""How often the run looks whether it is over."""
START_S = 90.0
"""How long it may take from the start of all processes to the first tick that is heard."""
STOP_S = 60.0
"""How long ``m2c run`` may take to stop: it gives the policy ten seconds, and then its nodes."""
ROOT = SYSTEM.parents[2]


class RunError(Exception):
    """A run could not be held; the text says why."""


def on_zenoh(
    chosen: Fault | None,
    system: System,
    seconds: float,
    properties: Sequence[Property] = (),
    keeps: bool = True,
) -> Run:
    """The tour as processes on Zenoh; see ``run.py`` for the arguments."""
    from transports.registry import connect

    endpoint = _free_endpoint()
    with tempfile.TemporaryDirectory(prefix="faults-") as scratch:
        # the nodes meet at the monitor, which so is there before them
        meeting = Path(scratch) / "zenoh.json5"
        meeting.write_bytes(msgspec.json.encode({"connect": {"endpoints": [endpoint]}}))
        transport = connect("zenoh", "fault_monitor", {"listen": endpoint})
        faulty = "" if chosen is None else chosen.node
        listener = Listener(transport, system, faulty, properties, keeps)
        arguments = ["--zenoh-config", str(meeting)]
        return _held(arguments, chosen, transport, listener, seconds, Path(scratch))


def on_ros2(
    chosen: Fault | None,
    system: System,
    seconds: float,
    properties: Sequence[Property] = (),
    keeps: bool = True,
) -> Run:
    """The tour as processes on ROS 2, on loopback and in a domain that no other run uses.

    ``find_interfaces`` must have been called when this process began.
    """
    from transports.registry import connect

    with own_domain(), tempfile.TemporaryDirectory(prefix="faults-") as scratch:
        transport = connect("ros2", "fault_monitor", {})
        faulty = "" if chosen is None else chosen.node
        listener = Listener(transport, system, faulty, properties, keeps)
        arguments = ["--transport", "ros2"]
        return _held(arguments, chosen, transport, listener, seconds, Path(scratch))


def _held(
    arguments: Sequence[str],
    chosen: Fault | None,
    transport: Connection,
    listener: Listener,
    seconds: float,
    scratch: Path,
) -> Run:
    """Run ``m2c run`` with ``arguments``, and listen to it over ``transport``, which is closed."""
    process = None
    try:
        command = [str(Path(sys.executable).parent / "m2c"), "run", str(SYSTEM), "--quiet"]
        command += [*arguments, "--observer", transport.node]
        if chosen is not None:
            command += ["--replace", f"{chosen.node}={replacement(chosen, scratch)}"]
        listener.start()
        with (scratch / "said").open("w+") as said:
            process = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
            _spin(transport, process, listener, seconds)
            if process.poll() is not None:
                said.seek(0)
                raise RunError(f"m2c run ended by itself:\n{said.read()}")
            if not listener.first_ns and not listener.is_over:
                said.seek(0)
                raise RunError(
                    f"no tick was received in {START_S:g} s; this monitor is linked to "
                    f"{', '.join(listener.peers()) or 'nobody'}; m2c run said:\n{said.read()}"
                )
            result = listener.result()
            process.send_signal(signal.SIGINT)
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired as error:
                raise RunError(f"m2c run did not stop its nodes in {STOP_S:g} s") from error
        return result
    finally:
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()
        transport.close()


def _spin(
    transport: Connection, process: subprocess.Popen[bytes], listener: Listener, seconds: float
) -> None:
    """Listen until all is found, ``seconds`` after the first tick heard, or if none is to be expected."""
    ended = False
    began_s = time.monotonic()

    def look() -> None:
        nonlocal ended
        if listener.first_ns:
            is_over = transport.now_ns() - listener.first_ns > seconds * 1e9
        else:
            is_over = time.monotonic() - began_s > START_S
        ended = ended or is_over or process.poll() is not None

    transport.every(TICK_S, look)
    transport.spin(lambda: ended or listener.is_over)


def _free_endpoint() -> str:
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain that nobody else here has taken, on loopback; for this process and its children.

    Raises:
        RunError: what chooses it is not installed.
    """
    try:
        from domain_coordinator import domain_id
    except ImportError as error:
        raise RunError("domain_coordinator is missing: pip install 'm2c-moon[ros2]'") from error
    next_one = os.getpid()

    def candidate() -> int:
        nonlocal next_one
        next_one += 1
        return next_one % 100 + 1

    with domain_id(candidate) as number:
        os.environ["ROS_DOMAIN_ID"] = str(number)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        yield number


def find_interfaces() -> None:
    """Make the tour's interface packages importable: call it when the process begins.

    Raises:
        RunError: they cannot be built.
    """
    from m2c.rosidl.build import InterfaceBuildError, begin_again_with

    try:
        begin_again_with([SYSTEM.parent / "interfaces"], ROOT / "build" / "interfaces")
    except InterfaceBuildError as error:
        raise RunError(str(error)) from error
