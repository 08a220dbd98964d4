"""The command line of a generated node."""

from __future__ import annotations

import argparse
import logging
import shlex
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from m2c.runtime.binding import NodeSettings
from transports.interface import Transport, TransportError
from transports.registry import connect


def add_transport_options(parser: argparse.ArgumentParser, transport: str = "zenoh") -> None:
    """The options by which every process finds its middleware, ``transport`` unless told."""
    parser.add_argument("--transport", default=transport, help=f"middleware (default: {transport})")
    parser.add_argument(
        "--endpoint", action="append", default=[], help="where to connect, e.g. tcp/127.0.0.1:7447"
    )
    parser.add_argument("--zenoh-config", default="", help="a Zenoh configuration file (JSON5)")
    parser.add_argument("--namespace", default="", help="prefix of every channel")
    parser.add_argument("--log-level", default="INFO", help="DEBUG, INFO, WARNING or ERROR")


def transport_options(arguments: argparse.Namespace) -> dict[str, str]:
    """The transport's options, from parsed arguments."""
    options = {
        "endpoint": ",".join(arguments.endpoint),
        "config": arguments.zenoh_config,
        "namespace": arguments.namespace,
    }
    return {name: value for name, value in options.items() if value}


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


def set_up_logging(level: str) -> None:
    """One line per record on standard error, flushed at once."""
    logging.basicConfig(
        level=level.upper(), stream=sys.stderr, format="%(levelname)s %(name)s: %(message)s"
    )


def main(
    node_class: Callable[[Transport, NodeSettings], Any],
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
    parser = argparse.ArgumentParser(
        prog=f"python -m {node_class.__module__.partition('.')[0]}",
        description=f"Run the node {name}.",
        epilog="example: --transport zenoh --endpoint tcp/127.0.0.1:7447",
    )
    add_transport_options(parser, transport)
    parser.add_argument("--node-name", default=name, help="name of this node in the system")
    parser.add_argument(
        "--call-timeout", type=float, default=5.0, help="seconds, for its own calls"
    )
    own, ros_arguments = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    parsed = parser.parse_args(own)
    set_up_logging(parsed.log_level)
    options = transport_options(parsed)
    if ros_arguments:
        options["args"] = ros_arguments
    try:
        connection = connect(parsed.transport, parsed.node_name, options)
    except TransportError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: connection.post(connection.close))
    node = node_class(connection, NodeSettings(parsed.call_timeout))
    connection.post(node.start)
    connection.post(connection.announce)
    connection.spin()
    connection.close()
    sys.exit(0)
