"""From options to a node of ROS 2. The nodes of one process may share a context, and so a DDS participant.

Options (all strings, all optional):
    domain: the ROS domain, 0 to 232; the environment's ROS_DOMAIN_ID by default.
    namespace: a prefix of all channels, so that several systems share one domain; ``-r __ns:=/name`` of ROS
        2's launch takes its place.
    use_sim_time: ``true`` to take time from ``/clock``; the parameter of that name does the same.
    args: ROS arguments as one would write them after ``--ros-args``, e.g. ``-p use_sim_time:=true``.

Everything else (the middleware, loopback only, profiles of Fast DDS) is said by ROS 2's own
environment variables, e.g. RMW_IMPLEMENTATION and ROS_AUTOMATIC_DISCOVERY_RANGE.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.exceptions import InvalidNamespaceException, InvalidNodeNameException
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.parameter import Parameter
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name

from transports.interface import TransportError
from transports.options import refuse_unknown

OPTIONS = ("domain", "namespace", "use_sim_time", "args")
MAX_DOMAIN = 232
"""Beyond it DDS's port numbers would not fit."""


def prefix_of(options: Mapping[str, str]) -> str:
    """The namespace that is asked for as a prefix of channels: ``""`` or ``/name``."""
    namespace = options.get("namespace", "").strip("/")
    return f"/{namespace}" if namespace else ""


def prefix_of_node(ros_node: Any) -> str:
    """The namespace of a node as a prefix of channels: ROS 2's launch may give another than the options."""
    namespace: str = ros_node.get_namespace()
    return namespace.rstrip("/")


def open_node(name: str, options: Mapping[str, str], context: Context | None = None) -> Any:
    """An ``rclpy.node.Node``.

    Args:
        name: the node's.
        options: see above.
        context: where there are nodes already; a new one by default.

    Raises:
        TransportError: an option is unknown or wrong, or ROS 2 refuses the name or cannot start.
    """
    refuse_unknown("ros2", options, OPTIONS)
    simulated = options.get("use_sim_time", "false")
    if simulated not in ("true", "false"):
        raise TransportError(f"use_sim_time {simulated!r}: expected true or false")
    prefix = prefix_of(options)
    try:  # create_node checks too, but leaves a complaint of rcl behind
        validate_node_name(name)
        validate_namespace(prefix or "/")
    except (InvalidNodeNameException, InvalidNamespaceException) as error:
        raise TransportError(
            f"ROS 2 does not take the name {prefix}/{name}: {_one_line(error)}"
        ) from error
    owned, context = context is None, context or Context()
    try:
        if owned:
            context.init(args=_arguments(options), domain_id=_domain(options))
        parameters = [Parameter("use_sim_time", value=True)] if simulated == "true" else []
        return rclpy.create_node(
            name,
            context=context,
            namespace=prefix or None,
            parameter_overrides=parameters,
        )
    except (_rclpy.RCLError, _rclpy.UnknownROSArgsError, RuntimeError, ValueError) as error:
        if owned:
            _shut_down(context)
        raise TransportError(f"cannot start a ROS 2 node: {_one_line(error)}") from error


def _shut_down(context: Context) -> None:
    if context.ok():
        context.shutdown()


def _arguments(options: Mapping[str, str]) -> list[str]:
    try:
        written = shlex.split(options.get("args", ""))
    except ValueError as error:
        raise TransportError(f"args {options['args']!r}: {error}") from error
    return ["--ros-args", *written, "--"] if written else []


def _domain(options: Mapping[str, str]) -> int | None:
    written = options.get("domain", "")
    if not written:
        return None
    if not (written.isascii() and written.isdecimal()) or int(written) > MAX_DOMAIN:
        raise TransportError(f"domain {written!r}: expected a number from 0 to {MAX_DOMAIN}")
    return int(written)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
