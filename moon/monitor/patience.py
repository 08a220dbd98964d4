"""How long a monitor waits for what may still be on its way before it says that something did not come.

What happened in time is heard a little later. That little is learned from what is heard: verdicts on
silence wait for a multiple of the longest lag of late, and never less than :data:`LEAST_NS`. As long as
nothing was heard at all, after a loss, and at the most, they wait for the latency bound. A monitor that
is held up itself cannot know how late things are, so by how much it does late what it planned counts as a
lag: who shares its processors is held up, too.
"""

from __future__ import annotations

from moon.ordering.event_time_clock import NS

LEAST_NS = 25_000_000
"""Several times what a message takes on an idle machine, service events' 3.5 ms at their node included (12
on a busy one, and up to 50 where a node is at work all the time, which is learned)."""
MARGIN = 2
"""How much later than the latest so far the next one may be."""
WINDOW_NS = 30 * NS
"""Lags are remembered for one to two windows in which something was heard."""


class Patience:
    """Learns how long to wait.

    Args:
        latency_ns: the latency bound.
    """

    def __init__(self, latency_ns: int) -> None:
        self._latency_ns = latency_ns
        self._any = False
        self._worst_ns = self._before_ns = 0
        """The longest lag of this window, and of the one before."""
        self._since_ns = 0

    def heard(self, lag_ns: int, now_ns: int) -> None:
        """Something was heard ``lag_ns`` after it happened."""
        if now_ns - self._since_ns > WINDOW_NS:
            self._before_ns, self._worst_ns, self._since_ns = self._worst_ns, 0, now_ns
        self._any = True
        self._worst_ns = max(self._worst_ns, lag_ns)

    def distrust(self) -> None:
        """Something was missed: for a while, nothing is said before the latency bound is over."""
        self._worst_ns = self._latency_ns

    def held_up(self, delay_ns: int) -> None:
        """The monitor's regular work was done ``delay_ns`` later than it should have been."""
        self._worst_ns = max(self._worst_ns, delay_ns)

    @property
    def wait_ns(self) -> int:
        """How long to wait now."""
        if not self._any:
            return self._latency_ns
        learned_ns = MARGIN * max(self._worst_ns, self._before_ns)
        return min(max(LEAST_NS, learned_ns), self._latency_ns)
