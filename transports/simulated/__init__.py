"""A middleware in one process on virtual time: delays, reordering, loss and crashes from a seed."""

from transports.simulated.conditions import (
    Conditions,
    Cut,
    HostClock,
    Kill,
    Lost,
    Pause,
    Reordered,
    Rules,
)
from transports.simulated.transport import SimulatedTransport, connect
from transports.simulated.world import SimulatedWorld

__all__ = [
    "Conditions",
    "Cut",
    "HostClock",
    "Kill",
    "Lost",
    "Pause",
    "Reordered",
    "Rules",
    "SimulatedTransport",
    "SimulatedWorld",
    "connect",
]
