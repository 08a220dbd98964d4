"""What whoever launches a node may set: ROS 2's parameters."""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import math
from typing import Any

from rclpy.exceptions import InvalidParameterException

from transports.interface import TransportError
from transports.ros2.interfaces import ros_class


def positive(node: Any, name: str, default: float, meaning: str) -> float:
    """A positive number, declared on ``node``: what the launcher has set (``-p name:=2.5``), or ``default``.

    It is read once, when the node is made; so it is declared read-only, and ``ros2 param set`` is told so.

    Args:
        node: an ``rclpy.node.Node``.
        name: of the parameter; the same one may be asked for again.
        default: where nothing is set.
        meaning: shown by ``ros2 param describe``.

    Raises:
        TransportError: what was set is no positive number, or ROS 2 does not take the name.
    """
    value = _declared(node, name, default, meaning)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or value <= 0:
        raise TransportError(f"the parameter {name} is {value!r}: expected a positive number")
    return float(value)


def given(node: Any, name: str, meaning: str) -> object:
    """What the launcher has set, declared on ``node`` as :func:`positive` does; None if it has set nothing.

    Raises:
        TransportError: ROS 2 does not take the name.
    """
    return _declared(node, name, None, meaning)


def _declared(node: Any, name: str, default: float | None, meaning: str) -> Any:
    if not node.has_parameter(name):
        # an integer will do, which a parameter of ROS 2's type double would refuse
        descriptor = ros_class("rcl_interfaces/msg/ParameterDescriptor")(
            description=meaning, read_only=True, dynamic_typing=True
        )
        try:
            node.declare_parameter(name, default, descriptor)
        except InvalidParameterException as error:
            raise TransportError(f"ROS 2 does not take the parameter name {name!r}") from error
    return node.get_parameter(name).value
