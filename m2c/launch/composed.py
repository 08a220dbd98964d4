"""Several nodes in one process: ``python -m m2c.launch.composed --node NAME=PACKAGE …``.

They share what the middleware opens for a process (a Zenoh session, an rclpy context). Each has an executor
on a thread of its own, which is named after it: a handler that takes its time holds up nobody else, and the
thread says of what is logged or raised whose it is.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import logging
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, NoReturn

from m2c.launch import threads
from m2c.launch.description import NODE_CLASS
from m2c.logs import LOG_FORMAT, LineFormatter
from m2c.policy.library import PolicyError
from m2c.policy.main import RunningPolicy, add_policy_options, policy_settings
from m2c.raised import described
from m2c.runtime.beginning import Observers
from m2c.runtime.main import (
    add_node_options,
    add_transport_options,
    connect_or_exit,
    log_on,
    node_settings,
    set_up_logging,
    split_ros_arguments,
)
from m2c.runtime.node import warn_of_slips
from m2c.terminal import fail, say
from transports.interface import Connection, TransportError
from transports.stop_signals import StopSignals

SEPARATOR = " | "
"""Behind the name of the node that logs a line."""
DIED = "it died"
"""The line of a node that ends its process: what the launcher reads, wherever the middleware logs."""


class _OfNode(LineFormatter):
    """Begins with the node's name what one of ``names`` logs."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(LOG_FORMAT)
        self._names = frozenset(names)

    def format(self, record: logging.LogRecord) -> str:
        """The record's lines."""
        text = super().format(record)
        name = record.threadName or ""
        if name not in self._names:
            return text
        return "\n".join(f"{name}{SEPARATOR}{line}" for line in text.split("\n"))


class _Composition:
    """The nodes of this process, and its policy if it has one.

    Args:
        owner: the connection of one of them, beside which the others are.
        observers: who is to receive what the nodes send before they begin
            (:class:`m2c.runtime.beginning.Observers`).
    """

    def __init__(self, owner: Connection, observers: Sequence[str]) -> None:
        self._owner = owner
        self._observers = Observers(observers)
        self._connections = {owner.node: owner}
        self._threads: list[threading.Thread] = []
        self._nodes: list[tuple[Connection, Any]] = []
        self.policy: RunningPolicy | None = None
        self.died = ""
        """Whose handler raised."""

    def connection(self, name: str) -> Connection:
        """That of the node ``name``; TransportError if there can be none."""
        if name not in self._connections:
            self._connections[name] = self._owner.beside(name)
        return self._connections[name]

    def add_node(self, connection: Connection, node: Any) -> None:
        """``node`` is made on ``connection``."""
        self._nodes.append((connection, node))

    def close(self) -> None:
        """End all; from any thread."""
        self._ask_all()
        self._owner.post(self._owner.close)

    def _ask_all(self) -> None:
        """Who learns that the process is to end does not hang; who is at work when it is killed does."""
        for connection in self._connections.values():
            connection.post(threads.end_work)

    def stop(self) -> None:
        """A signal: the policy first, as it halts its tree, for which its skills must be there."""
        self._observers.give_up()
        self._ask_all()
        self._owner.post(self.close if self.policy is None else self.policy.stop)

    def run(self) -> int:
        """Run until the policy has ended, somebody died, or ``stop``; the exit code."""
        self._observers.wait([connection for connection, _ in self._nodes])
        # Systems list what acts by itself before what listens to it; all have declared their channels by now.
        for connection, node in reversed(self._nodes):
            connection.post(node.start)
            connection.announce()  # whoever watches knows of it before it reports anything
        for connection in self._connections.values():
            if connection is not self._owner:
                thread = threading.Thread(
                    target=self._spin, args=[connection], name=connection.node
                )
                self._threads.append(thread)
                thread.start()
        if self.policy is not None:
            self.policy.start()
        threading.current_thread().name = self._owner.node
        self._spin(self._owner)
        code = 0 if self.policy is None else self.policy.join()
        self._owner.close()
        for thread in self._threads:
            thread.join()
        return 1 if self.died else code

    def _spin(self, connection: Connection) -> None:
        is_over = False
        try:
            with threads.working_for(list(self._connections).index(connection.node)):
                connection.spin()
            is_over = True
        finally:
            if not is_over:
                self._end_for(connection)

    def _end_for(self, dead: Connection) -> None:
        """A handler of ``dead`` raised; nobody serves what it served, so the tree is not halted."""
        if not self.died:
            self.died = dead.node
            _say_died(dead.node, sys.exception())
        if self.policy is not None:
            self.policy.stop()
        if dead is self._owner:
            dead.close()
        else:
            self.close()


def _say_died(name: str, exception: BaseException | None) -> None:
    """``name`` dies of what was raised: logged wherever the middleware logs, and said to the launcher."""
    logging.getLogger(name).critical(DIED, exc_info=exception)
    say(f"{name}{SEPARATOR}{DIED}")


def _log_what_raised(composition: _Composition) -> None:
    """Whatever else ends a thread is logged, unless a node has died: what comes of that is no news."""

    def log(
        kind: type[BaseException], exception: BaseException | None, trace: TracebackType | None
    ) -> None:
        if exception is not None and not composition.died:
            _say_died(threading.current_thread().name, exception)

    threading.excepthook = lambda args: log(args.exc_type, args.exc_value, args.exc_traceback)
    sys.excepthook = log


def _package(text: str) -> tuple[str, str]:
    name, equals, package = text.partition("=")
    if not equals or not name or not package:
        raise argparse.ArgumentTypeError(f"{text!r}: expected NAME=PACKAGE")
    return name, package


def part_of(package: str, wanted: str) -> tuple[ModuleType, Any]:
    """The module that runs ``package``, and what it calls ``wanted``; exits with 2 if there is none.

    A node that is written by hand may be a module of its own instead of a package.
    """
    try:
        spec = importlib.util.find_spec(package)
        is_module = spec is not None and spec.submodule_search_locations is None
        module = importlib.import_module(package if is_module else f"{package}.__main__")
    except ModuleNotFoundError as error:
        fail(f"{package}: {error}; is its folder on PYTHONPATH?")
    except Exception as error:  # it is anybody's code
        fail(f"{package}: {described(error)}")
    found = getattr(module, wanted, None)
    if found is None:
        missing = f"{module.__name__} has no {wanted}"
        fail(f"{missing}; generate the system again, or end a file of your own with {wanted} = …")
    return module, found


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the nodes until SIGINT, SIGTERM or the policy's last tick; exits with 0 then.

    Exits with 1 if a node's handler raised or the tree cannot be ticked on, with 2 if it cannot start.
    """
    parser = argparse.ArgumentParser(
        prog="python -m m2c.launch.composed",
        description="Run several generated nodes, and the policy, in this process.",
        epilog="example: --node AlarmSkill=alarm_skill --node WaitSkill=wait_skill",
    )
    add_transport_options(parser)
    parser.add_argument(
        "--node", action="append", type=_package, default=[], metavar="NAME=PACKAGE", dest="nodes"
    )
    parser.add_argument("--policy", type=_package, metavar="NAME=PACKAGE")
    add_node_options(parser)
    add_policy_options(parser)
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    parsed = parser.parse_args(own)
    parts = [*parsed.nodes, *filter(None, [parsed.policy])]
    if not parts:
        parser.error("there is nothing to run: give --node or --policy")
    set_up_logging(parsed.log_level, _OfNode([name for name, _ in parts]))
    signals = StopSignals()
    parsed.node_name = parts[0][0]
    owner = connect_or_exit(parsed, ros_arguments)
    log_on(owner)
    composition = _Composition(owner, parsed.observers)
    _log_what_raised(composition)
    try:
        for name, package in parsed.nodes:
            _, node_class = part_of(package, NODE_CLASS)
            connection = composition.connection(name)
            settings = node_settings(connection, parsed.call_timeout)
            node = node_class(connection, settings)
            warn_of_slips(node, parsed.channels)
            composition.add_node(connection, node)
        if parsed.policy is not None:
            name, package = parsed.policy
            module, plugins = part_of(package, "PLUGINS")
            folder = Path(str(module.__file__)).parent
            connection = composition.connection(name)
            composition.policy = RunningPolicy(
                connection, folder, plugins, policy_settings(parsed), composition.close
            )
    except (PolicyError, TransportError) as error:
        say(f"error: {error}")
        owner.close()
        sys.exit(2)
    signals.call(composition.stop)
    if signals.asked and composition.policy is not None:  # while it connected: nothing is ticked
        composition.policy.stop()
    sys.exit(composition.run())


if __name__ == "__main__":
    main()
