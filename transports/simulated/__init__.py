"""A middleware in one process on virtual time: delays, reordering, loss and crashes from a seed."""

from transports.simulated.conditions import (
    Conditions,
    Cut,
    HostClock,
    Introspection,
    Kill,
    Lost,
    Pause,
    Reordered,
    Rules,
    Slowdown,
)
from transports.simulated.connecting import connect
from transports.simulated.world import SimulatedTransport, SimulatedWorld

__all__ = [
    "Conditions",
    "Cut",
    "HostClock",
    "Introspection",
    "Kill",
    "Lost",
    "Pause",
    "Reordered",
    "Rules",
    "SimulatedTransport",
    "SimulatedWorld",
    "Slowdown",
    "connect",
]
