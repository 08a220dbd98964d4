"""The command line of a generated policy."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

import msgspec

from m2c.policy.program import Policy
from m2c.policy.runner import PolicyRunner
from m2c.policy.ticking import PolicyError
from m2c.runtime.main import (
    add_transport_options,
    connect_or_exit,
    log_on,
    set_up_logging,
    split_ros_arguments,
)

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
    parser.add_argument("--rate", type=float, help="ticks a second (default: the system's)")
    parser.add_argument("--ticks", type=int, default=0, help="stop after so many (0: no end)")
    parser.add_argument(
        "--wait-for", action="append", default=[], metavar="NODE", help="tick once this node is up"
    )
    parser.add_argument("--tick-timeout", type=float, default=5.0, help="seconds, for one leaf")
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    parsed = parser.parse_args(own)
    set_up_logging(parsed.log_level)
    policy = msgspec.json.decode((folder / "policy.json").read_bytes(), type=Policy)
    connection = connect_or_exit(parsed, ros_arguments)
    log_on(connection)
    rate = parsed.rate or policy.tick_rate_hz
    try:
        runner = PolicyRunner(connection, policy, plugins, parsed.tick_timeout)
    except PolicyError as error:
        print(f"error: {error}", file=sys.stderr)
        connection.close()
        sys.exit(2)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: runner.stop())

    failed = True

    def tick() -> None:
        nonlocal failed
        try:
            runner.run(rate, parsed.ticks or None)
            failed = False
        except PolicyError as error:
            print(f"error: {error}", file=sys.stderr)
        finally:
            connection.post(connection.close)

    thread = threading.Thread(target=tick, name="policy")
    connection.announce()
    missing = connection.wait_for_nodes(parsed.wait_for, START_TIMEOUT_S)
    if missing:
        print(f"error: not up after {START_TIMEOUT_S:g} s: {', '.join(missing)}", file=sys.stderr)
        connection.close()
        sys.exit(2)
    thread.start()
    connection.spin()
    thread.join()
    connection.close()
    sys.exit(1 if failed else 0)
