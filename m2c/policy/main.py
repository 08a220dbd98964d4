"""The command line of a generated policy."""

from __future__ import annotations

import argparse
import os
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import msgspec

from m2c.policy.program import Policy
from m2c.policy.runner import PolicyRunner, TreeTick
from m2c.policy.ticking import PolicyError
from m2c.runtime.main import (
    add_transport_options,
    connect_or_exit,
    log_on,
    positive,
    set_up_logging,
    split_ros_arguments,
)
from m2c.terminal import say
from transports.interface import TransportError
from transports.stop_signals import StopSignals

START_TIMEOUT_S = 30.0
"""How long the nodes of ``--wait-for`` may take to be up."""


def main(
    folder: Path,
    plugins: Mapping[str, Callable[..., Any]],
    arguments: Sequence[str] | None = None,
    transport: str = "zenoh",
) -> NoReturn:
    """Run the policy in ``folder`` until SIGINT, SIGTERM or its last tick; exits with 0 then.

    Exits with 1 if the tree cannot be ticked on, with 2 if it cannot be started. Its middleware is
    ``transport``, unless ``--transport`` says otherwise.

    The tree is ticked on a thread of its own, because a tick waits for its skills' answers; the main
    thread runs the transport.
    """
    parser = argparse.ArgumentParser(
        prog="policy",
        description="Run a behaviour-tree policy.",
        epilog="example: --endpoint tcp/127.0.0.1:7447 --rate 5 --ticks 100",
    )
    add_transport_options(parser, transport)
    parser.add_argument("--node-name", default="policy")
    parser.add_argument("--rate", type=positive, help="ticks a second (default: the system's)")
    parser.add_argument("--ticks", type=int, default=0, help="stop after so many (0: no end)")
    parser.add_argument(
        "--wait-for", action="append", default=[], metavar="NODE", help="tick once this node is up"
    )
    parser.add_argument(
        "--report-to",
        type=int,
        metavar="FD",
        help="write a line of JSON per tick to this open file",
    )
    parser.add_argument("--tick-timeout", type=positive, default=5.0, help="seconds, for one leaf")
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    parsed = parser.parse_args(own)
    set_up_logging(parsed.log_level)
    policy = msgspec.json.decode((folder / "policy.json").read_bytes(), type=Policy)
    signals = StopSignals()
    connection = connect_or_exit(parsed, ros_arguments)
    log_on(connection)
    rate = parsed.rate or policy.tick_rate_hz
    report = None if parsed.report_to is None else _report_to(parsed.report_to)
    try:
        runner = PolicyRunner(connection, policy, plugins, parsed.tick_timeout, report)
    except (PolicyError, TransportError) as error:
        say(f"error: {error}")
        connection.close()
        sys.exit(2)
    awaited = _Awaited(parsed.wait_for)
    code = 0

    def stop() -> None:
        runner.stop()
        awaited.give_up()

    def tick() -> None:
        nonlocal code
        try:
            if missing := awaited.wait(START_TIMEOUT_S):
                names = ", ".join(missing)
                say(f"error: not up after {START_TIMEOUT_S:g} s: {names}")
                code = 2
            elif not signals.asked:
                code = 1  # unless it ends as it should
                runner.run(rate, parsed.ticks or None)
                code = 0
        except PolicyError as error:
            say(f"error: {error}")
        finally:
            connection.post(connection.close)

    signals.call(lambda: connection.post(stop))
    connection.announce()
    if parsed.wait_for:
        connection.watch_nodes(awaited.changed)
    thread = threading.Thread(target=tick, name="policy")
    thread.start()
    connection.spin()
    thread.join()
    connection.close()
    sys.exit(code)


def _report_to(descriptor: int) -> Callable[[TreeTick], None]:
    """Who writes each tick to ``descriptor``: whoever started the policy shows it.

    The middleware is no way for that: a subscription that is discovered late has missed the first ticks.
    """
    file = os.fdopen(descriptor, "wb", buffering=0)

    def write(tick: TreeTick) -> None:
        file.write(msgspec.json.encode(tick) + b"\n")

    return write


class _Awaited:
    """The nodes that must be up before the first tick; one thread hears of them, another waits."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._missing = set(names)
        self._over = threading.Event()
        if not names:
            self._over.set()

    def changed(self, name: str, up: bool) -> None:
        """A node is up, or no longer."""
        if up:
            self._missing.discard(name)
        elif name in self._names:
            self._missing.add(name)
        if not self._missing:
            self._over.set()

    def give_up(self) -> None:
        """End the waiting."""
        self._over.set()

    def wait(self, timeout_s: float) -> list[str]:
        """Wait until all are up, or until ``give_up``; who is missing after ``timeout_s``."""
        return [] if self._over.wait(timeout_s) else sorted(self._missing.copy())
