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

from m2c.language.numerals import integer
from m2c.policy.library import PolicyError
from m2c.policy.program import Policy
from m2c.policy.runner import PolicyRunner, TreeTick
from m2c.runtime.beginning import Observers
from m2c.runtime.main import (
    add_transport_options,
    connect_or_exit,
    log_on,
    positive,
    set_up_logging,
    split_ros_arguments,
)
from m2c.terminal import say
from transports.interface import Connection, TransportError
from transports.stop_signals import StopSignals

START_TIMEOUT_S = 30.0
"""How long the next of the nodes of ``--wait-for`` may take to be up, unless ``--wait-timeout`` says it."""


class PolicySettings(msgspec.Struct, frozen=True):
    """How a policy is run.

    Attributes:
        rate_hz: ticks a second; by default the system's.
        ticks: after how many to stop; 0: never.
        wait_for: the nodes that must be up before the first tick.
        observers: the nodes that must receive what the policy sends before it
            (:class:`m2c.runtime.beginning.Observers`).
        wait_timeout_s: how long the next of them may take to be up; 0: as long as it takes.
        tick_timeout_s: how long one leaf may take.
        report_to: an open file, to which a line of JSON is written for each tick.
    """

    rate_hz: float | None = None
    ticks: int = 0
    wait_for: tuple[str, ...] = ()
    wait_timeout_s: float = START_TIMEOUT_S
    tick_timeout_s: float = 5.0
    report_to: int | None = None
    observers: tuple[str, ...] = ()


def _positive_or_zero(text: str) -> float:
    return 0.0 if text == "0" else positive(text)


def _count(text: str) -> int:
    number = integer(text)
    if number is None or number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of ticks")
    return number


def add_policy_options(parser: argparse.ArgumentParser) -> None:
    """The options that :func:`policy_settings` reads."""
    parser.add_argument("--rate", type=positive, help="ticks a second (default: the system's)")
    parser.add_argument("--ticks", type=_count, default=0, help="stop after so many (0: no end)")
    parser.add_argument(
        "--wait-for", action="append", default=[], metavar="NODE", help="tick once this node is up"
    )
    parser.add_argument(
        "--wait-timeout",
        type=_positive_or_zero,
        default=START_TIMEOUT_S,
        help="seconds within which the next of them must be up (default: 30; 0: no limit)",
    )
    parser.add_argument(
        "--report-to",
        type=int,
        metavar="FD",
        help="write a line of JSON per tick to this open file",
    )
    parser.add_argument("--tick-timeout", type=positive, default=5.0, help="seconds, for one leaf")


def policy_settings(parsed: argparse.Namespace) -> PolicySettings:
    """What the options of :func:`add_policy_options` say."""
    return PolicySettings(
        parsed.rate,
        parsed.ticks,
        tuple(parsed.wait_for),
        parsed.wait_timeout,
        parsed.tick_timeout,
        parsed.report_to,
        tuple(parsed.observers),
    )


class RunningPolicy:
    """A policy at work, on a thread of its own, because a tick waits for its skills' answers.

    Args:
        connection: the policy's.
        folder: the generated package.
        plugins: node classes by name.
        settings: how to run it.
        ended: called on that thread when it has halted the tree and will do no more.

    Attributes:
        code: 0 after the last tick or ``stop``, 1 if the tree cannot be ticked on, 2 if it cannot be started.

    Raises:
        PolicyError: the tree cannot be built.
        TransportError: something cannot be declared.
    """

    def __init__(
        self,
        connection: Connection,
        folder: Path,
        plugins: Mapping[str, Callable[..., Any]],
        settings: PolicySettings,
        ended: Callable[[], None],
    ) -> None:
        policy = msgspec.json.decode((folder / "policy.json").read_bytes(), type=Policy)
        report = None if settings.report_to is None else _report_to(settings.report_to)
        self._connection = connection
        self._settings = settings
        self._rate_hz = settings.rate_hz or policy.tick_rate_hz
        self._runner = PolicyRunner(connection, policy, plugins, settings.tick_timeout_s, report)
        self._awaited = _Awaited(settings.wait_for)
        self._observers = Observers(settings.observers)
        self._ended = ended
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name=connection.node)
        self.code = 0

    def start(self) -> None:
        """Begin, once the nodes that are waited for are up."""
        self._connection.announce()
        if self._settings.wait_for:
            self._connection.watch_nodes(self._awaited.changed)
        self._thread.start()

    def stop(self) -> None:
        """Halt the tree and end; on the connection's executor."""
        self._stopped = True
        self._runner.stop()
        self._awaited.give_up()
        self._observers.give_up()

    def join(self) -> int:
        """Wait for the end; the code."""
        self._thread.join()
        return self.code

    def _run(self) -> None:
        try:
            timeout_s = self._settings.wait_timeout_s
            if missing := self._awaited.wait(timeout_s or None):
                say(f"error: not up after {timeout_s:g} s: {', '.join(missing)}")
                self.code = 2
                return
            # they are to know of all nodes before these do something
            known = (*self._settings.wait_for, self._connection.node)
            self._observers.wait([self._connection], known)
            if not self._stopped:
                self.code = 1  # unless it ends as it should
                self._runner.run(self._rate_hz, self._settings.ticks or None)
                self.code = 0
        except PolicyError as error:
            say(f"error: {error}")
        finally:
            self._ended()


def main(
    folder: Path,
    plugins: Mapping[str, Callable[..., Any]],
    arguments: Sequence[str] | None = None,
    transport: str = "zenoh",
) -> NoReturn:
    """Run the policy in ``folder`` until SIGINT, SIGTERM or its last tick; exits with 0 then.

    Exits with 1 if the tree cannot be ticked on, with 2 if it cannot be started. Its middleware is
    ``transport``, unless ``--transport`` says otherwise. The main thread runs the transport.
    """
    parser = argparse.ArgumentParser(
        prog="policy",
        description="Run a behaviour-tree policy.",
        epilog="example: --endpoint tcp/127.0.0.1:7447 --rate 5 --ticks 100",
    )
    add_transport_options(parser, transport)
    parser.add_argument("--node-name", default="policy")
    add_policy_options(parser)
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    parsed = parser.parse_args(own)
    set_up_logging(parsed.log_level)
    signals = StopSignals()
    connection = connect_or_exit(parsed, ros_arguments)
    log_on(connection)
    try:
        policy = RunningPolicy(
            connection,
            folder,
            plugins,
            policy_settings(parsed),
            lambda: connection.post(connection.close),
        )
    except (PolicyError, TransportError) as error:
        say(f"error: {error}")
        connection.close()
        sys.exit(2)
    signals.call(lambda: connection.post(policy.stop))
    if signals.asked:  # while it connected: nothing is ticked
        policy.stop()
    policy.start()
    connection.spin()
    code = policy.join()
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
        self._given_up = False
        self._changed = threading.Condition()

    def changed(self, name: str, up: bool) -> None:
        """A node is up, or no longer."""
        with self._changed:
            if up:
                self._missing.discard(name)
            elif name in self._names:
                self._missing.add(name)
            self._changed.notify_all()

    def give_up(self) -> None:
        """End the waiting."""
        with self._changed:
            self._given_up = True
            self._changed.notify_all()

    def wait(self, timeout_s: float | None) -> list[str]:
        """Wait until all are up, or until ``give_up``; who is missing if none has come for ``timeout_s``."""
        with self._changed:
            while self._missing and not self._given_up:
                if not self._changed.wait(timeout_s):
                    return sorted(self._missing)
            return []
