"""When a monitor looks at the time: seldom, as it shares processors with what it watches.

A turn wakes a process that slept, and takes processor time from a tick that goes on then (decision 15). So
turns are planned for when something is due. They follow each other by ``PERIOD_NS`` only while the monitor is
behind, looks for a machine in the middle of its run, or knows of a loss that goes on.
"""

from __future__ import annotations

from collections.abc import Callable

from moon.feed.clock import NS, PERIOD_NS, USUAL_GAP_NS
from moon.sources.source import Source
from transports.interface import Timer

_SOON_NS = 20_000_000
"""How long after an observation the time is looked at: what else belongs to it has come by then."""
BEHIND_NS = 15_000_000
"""How long after the latency bound of an observation what can wait is looked at: a policy, and properties of
which more was received meanwhile. At five, ten or twenty ticks a second the default bound is over just when
another tick begins, and a turn then would delay that tick (decision 15)."""
MACHINES_NS = 8_000_000
"""The same for machines, whose verdicts wait for the bound and are to come within 10 ms of it. A tick that
begins when the bound is over takes 5 to 7 ms with four skills: it is over by then."""
_LOOKS = 3
"""So often at least the time is looked at while the latency bound passes."""


class Turns:
    """The turns of one monitor, one planned at a time.

    Args:
        connection: the monitor's.
        turn: what a turn is; it has to ``plan`` the next one.
        latency_ns: the latency bound.
    """

    def __init__(self, connection: Source, turn: Callable[[], None], latency_ns: int) -> None:
        self.is_over = False
        """Whether there is no further turn."""
        self.due_ns = 0
        """When the next turn is to be, on the clock of the connection."""
        self._connection = connection
        self._turn = turn
        self._at_most_ns = max(PERIOD_NS, min(USUAL_GAP_NS, latency_ns // _LOOKS))
        self._soon_ns = min(_SOON_NS, self._at_most_ns)
        self._timer: Timer | None = None

    def plan(self, next_ns: int) -> None:
        """Take a turn at ``next_ns`` (0: as soon as may be), or before if that is far away."""
        now_ns = self._connection.now_ns()
        self._take_in(now_ns, min(max(next_ns - now_ns, PERIOD_NS), self._at_most_ns))

    def received(self, now_ns: int) -> None:
        """Something was received: have a turn soon."""
        if self.due_ns > now_ns + self._soon_ns:
            self._take_in(now_ns, self._soon_ns)

    def end(self) -> None:
        """There is no further turn."""
        self.is_over = True
        if self._timer is not None:
            self._timer.cancel()

    def _take_in(self, now_ns: int, wait_ns: int) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self.due_ns = now_ns + wait_ns
        if self.is_over:
            return
        self._timer = self._connection.after(wait_ns / NS, self._turn)
