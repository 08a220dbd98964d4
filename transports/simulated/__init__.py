"""A middleware in one process on virtual time: delays, reordering, loss and crashes from a seed."""

from transports.simulated.transport import SimulatedTransport, connect
from transports.simulated.world import Conditions, SimulatedWorld

__all__ = ["Conditions", "SimulatedTransport", "SimulatedWorld", "connect"]
