"""The command line of a generated node."""

from __future__ import annotations

import argparse
import functools
import logging
import math
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn

import msgspec

from m2c.language.numerals import decimal
from m2c.logs import LOG_FORMAT, LineFormatter
from m2c.runtime.beginning import LINKED_S, Observers
from m2c.runtime.binding import HasLog, HasParameters, NodeSettings
from m2c.runtime.node import Node, warn_of_slips
from m2c.terminal import fail, say
from transports.interface import Connection, TransportError
from transports.options import transport_options
from transports.registry import connect
from transports.stop_signals import StopSignals


def add_transport_options(parser: argparse.ArgumentParser, transport: str = "zenoh") -> None:
    """The options by which every process finds its middleware, ``transport`` unless told, and begins."""
    parser.add_argument("--transport", default=transport, help=f"middleware (default: {transport})")
    parser.add_argument(
        "--endpoint", action="append", default=[], help="where to connect, e.g. tcp/127.0.0.1:7447"
    )
    parser.add_argument(
        "--router", action="store_true", help="Zenoh: talk through the router at the endpoint"
    )
    parser.add_argument("--zenoh-config", default="", help="a Zenoh configuration file (JSON5)")
    parser.add_argument("--namespace", default="", help="prefix of every channel")
    parser.add_argument(
        "--secure", default="", metavar="DIR", help="Zenoh: the certificates of `moon keys init`"
    )
    parser.add_argument(
        "--identity",
        default="",
        metavar="NAME",
        help="whose certificate of these (default: the node's)",
    )
    parser.add_argument(
        "--observer",
        action="append",
        default=[],
        metavar="NODE",
        dest="observers",
        help="begin once this node, a monitor, receives all that is sent here, or after "
        f"{LINKED_S:g} s (repeatable)",
    )
    parser.add_argument(
        "--log-level",
        default="INFO",
        type=str.upper,
        choices=("DEBUG", "INFO", "WARNING", "ERROR"),
        help="from which severity on",
    )


def add_node_options(parser: argparse.ArgumentParser) -> None:
    """The options of every process that runs nodes of models, or of hand."""
    parser.add_argument(
        "--call-timeout", type=positive, default=5.0, help="seconds, for the nodes' own calls"
    )
    parser.add_argument(
        "--channels",
        type=_channels_of,
        default=frozenset(),
        metavar="FILE",
        help="of a node written by hand: warn of a channel that is a slip for one in this launch.json",
    )


class _Described(msgspec.Struct):
    """What is needed of a generated system's ``launch.json``."""

    channels: frozenset[str] = frozenset()


def _channels_of(file: str) -> frozenset[str]:
    """The channels that a system's models name; argparse's error if ``file`` is no ``launch.json``."""
    try:
        return msgspec.json.decode(Path(file).read_bytes(), type=_Described).channels
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{file}: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise argparse.ArgumentTypeError(
            f"{file}: {error}; expected the launch.json that `m2c generate` writes"
        ) from error


def positive(text: str) -> float:
    """The number that an argument of the command line says; argparse's error if it is none, or not
    more than 0, or ``inf``.
    """
    value = decimal(text)
    if value is None or not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def connect_or_exit(arguments: argparse.Namespace, ros_arguments: str) -> Connection:
    """The connection that parsed arguments ask for; exits with 2 if there can be none.

    Args:
        arguments: with those of :func:`add_transport_options`, and ``node_name``.
        ros_arguments: what :func:`split_ros_arguments` found for ROS 2.
    """
    options = transport_options(
        arguments.endpoint,
        arguments.zenoh_config,
        arguments.namespace,
        arguments.secure,
        arguments.identity,
        arguments.router,
    )
    if ros_arguments:
        options["args"] = ros_arguments
    try:
        return connect(arguments.transport, arguments.node_name, options)
    except TransportError as error:
        fail(str(error))


def split_ros_arguments(arguments: Sequence[str]) -> tuple[list[str], str]:
    """A command line without what ROS 2's launch puts between ``--ros-args`` and ``--``, and that.

    Returns:
        Our own arguments, and the others as one string (option ``args`` of the ros2 transport).
    """
    own: list[str] = []
    theirs: list[str] = []
    target = own
    for argument in arguments:
        if argument == "--ros-args":
            target = theirs
        elif argument == "--" and target is theirs:
            target = own
        else:
            target.append(argument)
    return own, shlex.join(theirs)


def set_up_logging(level: str, formatter: logging.Formatter | None = None) -> None:
    """One line per record on standard error, flushed at once; by default in ``LOG_FORMAT``."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter or LineFormatter(LOG_FORMAT))
    logging.basicConfig(level=level.upper(), handlers=[handler])


def log_on(connection: Connection) -> None:
    """Log where the middleware does, if it has a log of its own; else it stays where it was set up."""
    if isinstance(connection, HasLog):
        root = logging.getLogger()
        handler = connection.log_handler(root.level)
        handler.setFormatter(LineFormatter())
        root.handlers[:] = [handler]


def node_settings(connection: Connection, call_timeout_s: float) -> NodeSettings:
    """How a node on ``connection`` is run; TransportError if what its launcher has set is no number."""
    if isinstance(connection, HasParameters):
        meaning = "how many seconds a call of another node's service may take"
        call_timeout_s = connection.parameter("call_timeout_s", call_timeout_s, meaning)
    return NodeSettings(call_timeout_s)


def main(
    node_class: Callable[[Connection, NodeSettings], Any],
    name: str,
    arguments: Sequence[str] | None = None,
    transport: str = "zenoh",
) -> NoReturn:
    """Run one generated node until SIGINT or SIGTERM; exits with 0 then, 2 if it cannot start.

    Args:
        node_class: the generated ``…Node``.
        name: the machine's name, also the node's unless ``--node-name`` says otherwise.
        arguments: command line; this process's by default.
        transport: the middleware, unless ``--transport`` says otherwise.
    """
    package = node_class.__module__.partition(".")[0]
    file = Path(sys.argv[0]).name
    parser = argparse.ArgumentParser(
        prog=f"python {file}" if package == "__main__" else f"python -m {package}",
        description=f"Run the node {name}.",
        epilog="example: --transport zenoh --endpoint tcp/127.0.0.1:7447",
    )
    add_transport_options(parser, transport)
    parser.add_argument("--node-name", default=name, help="name of this node in the system")
    add_node_options(parser)
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    parsed = parser.parse_args(own)
    set_up_logging(parsed.log_level)
    signals = StopSignals()
    connection = connect_or_exit(parsed, ros_arguments)
    observers = Observers(parsed.observers)

    def stop() -> None:
        observers.give_up()
        connection.post(connection.close)

    signals.call(stop)
    log_on(connection)
    sys.excepthook = functools.partial(_died, connection.node)
    try:
        node = node_class(connection, node_settings(connection, parsed.call_timeout))
    except TransportError as error:
        say(f"error: {error}")
        connection.close()
        sys.exit(2)
    warn_of_slips(node, parsed.channels)
    observers.wait([connection])
    connection.post(node.start)
    connection.announce()  # whoever watches knows of it before it reports anything
    connection.spin()
    connection.close()
    sys.exit(0)


def _died(
    name: str,
    kind: type[BaseException],
    exception: BaseException,
    trace: TracebackType | None,
) -> None:
    """Log that the node ``name`` ends its process, and what its code raised."""
    logging.getLogger(name).critical("it died", exc_info=(kind, exception, trace))


def run_node(node_class: Callable[[Connection, NodeSettings], Node]) -> NoReturn:
    """Run a node as a process, with the command line of generated nodes, until SIGINT or SIGTERM.

    Exits with 0 then, with 2 if it cannot start.

    Args:
        node_class: the class; the node is called as the class is, unless ``--node-name`` says otherwise.
    """
    main(node_class, getattr(node_class, "__name__", "node"))
