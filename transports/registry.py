"""Finding a transport by name: entry points of group ``m2c.transports``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from transports import ros_names
from transports.interface import Connection, TransportError, TransportFactory
from transports.open_files import FOR_A_CONNECTION, allow_open_files

GROUP = "m2c.transports"
NAMES_GROUP = "m2c.transport_names"
"""Entry points of what a transport refuses; each is called as its transport is."""
NameRule = Callable[[str, str], tuple[str, str] | None]
"""See :func:`transports.ros_names.refusal`."""
_OWN_NAMES: Mapping[str, NameRule] = {"ros2": ros_names.refusal}
"""Zenoh and the simulated world take every name that is a channel (``transports.interface``)."""
_NEEDS = {
    "ros2": "it needs rclpy: pip install 'm2c-moon[ros2]', or source a ROS 2 Jazzy "
    "(. /opt/ros/jazzy/setup.bash) for a Python that it supports",
}
"""What a transport of this repository needs that is not always installed."""


def available() -> list[str]:
    """Names of the installed transports, sorted."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def name_rules() -> dict[str, NameRule]:
    """What the transports refuse of names that others take, by transport, without connecting.

    Raises:
        TransportError: an installed rule cannot be loaded.
    """
    theirs = {point.name: _load(point) for point in entry_points(group=NAMES_GROUP)}
    return {**_OWN_NAMES, **theirs}


def connect(transport: str, node: str, options: Mapping[str, str]) -> Connection:
    """Connect ``node`` by the transport called ``transport``.

    Args:
        transport: one of :func:`available`.
        node: the node's name, unique in the system.
        options: the transport's own options (``endpoint``, ``listen``, ``config``, …).

    Raises:
        TransportError: there is no such transport, or it cannot connect.
    """
    found = [point for point in entry_points(group=GROUP) if point.name == transport]
    if not found:
        hint = f"installed: {', '.join(available()) or 'none'}"
        raise TransportError(f"no transport `{transport}` is installed; {hint}")
    allow_open_files(FOR_A_CONNECTION)
    factory: TransportFactory = _load(found[0])
    return factory(node, options)


def _load(point: EntryPoint) -> Any:
    distribution = point.dist.name if point.dist is not None else "an unknown distribution"
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        needs = _NEEDS.get(point.name, "")
        raise TransportError(
            f"the transport `{point.name}` of {distribution} cannot be loaded: {error}"
            + (f"; {needs}" if needs else "")
        ) from error
