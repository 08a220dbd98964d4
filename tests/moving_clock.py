"""A connection in virtual time whose clock moves on while its node computes, as clocks do."""

from __future__ import annotations

from transports.simulated import SimulatedTransport, SimulatedWorld

READING_NS = 1_000
"""So much later it is at least when the clock is read once more."""
MOST_NS = 200_000
"""Beyond so much it moves by a nanosecond only: nodes' clocks stand still, and none of them is behind for that."""


class MovingClock(SimulatedTransport):
    """The time of a world stands still while something is done in it; this clock is read twice, and shows two times.

    Args:
        world: where the node is.
        node: its name.
    """

    def __init__(self, world: SimulatedWorld, node: str) -> None:
        super().__init__(world, node)
        self._read_ns = 0
        self._ahead_ns = 0
        """The time of day is so much later than the clock that nobody sets."""

    def now_ns(self) -> int:
        """The time of day of the node's host, later than at the last reading."""
        host_ns = super().now_ns()
        ahead_ns = host_ns - super().steady_ns()
        if ahead_ns != self._ahead_ns:  # it was set
            self._read_ns += ahead_ns - self._ahead_ns
            self._ahead_ns = ahead_ns
        later_ns = READING_NS if self._read_ns < host_ns + MOST_NS else 1
        self._read_ns = max(host_ns, self._read_ns + later_ns)
        return self._read_ns

    def steady_ns(self) -> int:
        """A clock that nobody sets: as far as this one has moved on."""
        return super().steady_ns() + max(self._read_ns - super().now_ns(), 0)
