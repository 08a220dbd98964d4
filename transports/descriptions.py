"""What is to be known of a transport before anything is connected by it.

What a connection itself can do is asked of the connection (:class:`transports.interface.Listener`,
:class:`transports.interface.Namespaces`, :class:`transports.interface.VirtualTime`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from transports import ros_names

NameRule = Callable[[str, str], tuple[str, str] | None]
"""See :func:`transports.ros_names.refusal`."""


class Description(NamedTuple):  # msgspec's would cost each --help its import
    """A transport, as commands that are to use it see it; by default one that is not of this repository.

    Attributes:
        has_endpoints: whether nodes meet at an address, where whoever comes first listens; then there may be
            a router, a configuration file, and certificates.
        is_one_process: whether all nodes live in the process that makes the world, in virtual time.
        needs_packages: whether types are of interface packages that have been built, and nodes are packages
            of such a workspace.
        has_diagnostics: whether others look for what is wrong on ``/diagnostics``.
        has_namespaces: whether one connection may be able to listen to the systems of many namespaces.
        refused: what it refuses of names that are channels (:mod:`transports.interface`).
        needs: what it needs that is not always installed.
        diagnosis: ``module:function`` that looks at it (:mod:`transports.diagnosis`); "": it is loaded.
        library: the distribution that carries its messages, whose version is its own; "" for none.
    """

    has_endpoints: bool = False
    is_one_process: bool = False
    needs_packages: bool = False
    has_diagnostics: bool = False
    has_namespaces: bool = True
    refused: NameRule | None = None
    needs: str = ""
    diagnosis: str = ""
    library: str = ""


OWN = {
    "ros2": Description(
        needs_packages=True,
        has_diagnostics=True,
        has_namespaces=False,
        refused=ros_names.refusal,
        needs="it needs rclpy: pip install 'm2c-moon[ros2]', or source a ROS 2 Jazzy "
        "(. /opt/ros/jazzy/setup.bash) for a Python that it supports",
        diagnosis="transports.ros_diagnosis:diagnose",
        library="rclpy",
    ),
    "simulated": Description(is_one_process=True),
    "zenoh": Description(
        has_endpoints=True,
        diagnosis="transports.zenoh_link.diagnosis:diagnose",
        library="eclipse-zenoh",
    ),
}
"""The transports of this repository."""


def described(transport: str) -> Description:
    """The transport of that name."""
    return OWN.get(transport, Description())
