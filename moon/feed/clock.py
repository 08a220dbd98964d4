"""The clock by which a monitor judges: never ahead of what it can have received.

A monitor that is held up itself (no processor time, a slow link) receives late what happened in time. If
its oracles were given the time of day meanwhile, they would miss what is only waiting to be received. So
their clock runs behind for as long as observations come late, and catches up at twice the speed.

There is an end to that: oracles that look for a certain moment keep four latency bounds of what they
received. What is later than ``limit_ns`` is not waited for; it is reported as missed.
"""

from __future__ import annotations

import time
from collections.abc import Callable

NS = 1_000_000_000

PERIOD_NS = 10_000_000
"""Where nothing is received, time passes for the oracles at most so often."""
USUAL_GAP_NS = 50_000_000
"""The ticks of a monitor that is not held up are hardly further apart."""
_MEMORY_NS = NS
"""How long a late observation keeps the clock back, at least."""


_TOGETHER_NS = 100_000
_TRIES = 5

SET_NS = 500_000
"""The time of day was set if it moved by more than this against a clock that nobody sets: more than two
readings can be wrong by, and half of what a timer may be off (``Bounds.tolerance``)."""


def clock_nobody_sets(connection: object) -> Callable[[], int]:
    """A clock (ns) by which a time of day that is set is seen, and distinguished from a standstill.

    Args:
        connection: whose time of day it is. ``steady_ns`` (``transports.interface.VirtualTime``) is asked for
            by name: what is handed on by ``__getattr__``, ``isinstance`` does not see from Python 3.12 on.
    """
    steady_ns: Callable[[], int] = getattr(connection, "steady_ns", time.monotonic_ns)
    return steady_ns


def clocks_of(connection: object) -> Callable[[str], str]:
    """By which host's clock each node stamps, to who listens by ``connection``.

    Args:
        connection: of one that does not tell (``transports.interface.TellsClocks``) nothing is known: "".
            It is asked for by name, as above.
    """
    clock_of: Callable[[str], str] = getattr(connection, "clock_of", _not_told)
    return clock_of


def _not_told(_: str) -> str:
    return ""


def read_together(now_ns: Callable[[], int], monotonic_ns: Callable[[], int]) -> tuple[int, int]:
    """The time of day and of a clock that nobody sets, at one moment (ns).

    A process that is held up between the two readings would take its own delay for a clock that was
    set; so they are read again then, a few times.
    """
    tries = []
    for _ in range(_TRIES):
        before = monotonic_ns()
        now = now_ns()
        tries.append((monotonic_ns() - before, now, before))
        if tries[-1][0] <= _TOGETHER_NS:
            break
    _, now, before = min(tries)
    return now, before


class EventTimeClock:
    """The clock of the oracles.

    Args:
        now_ns: the time of day now.
        latency_ns: by how much observations may be late; half of it is kept free.
    """

    def __init__(self, now_ns: int, latency_ns: int) -> None:
        self.limit_ns = 5 * latency_ns // 2
        """What comes later than this after its stamp is too late; also, a monitor held up for longer
        has missed what happened meanwhile (links are closed then)."""
        self.clock_ns = now_ns
        """The time that the oracles are given."""
        self.now_ns = now_ns
        """The time of day at the last tick."""
        self._latency_ns = latency_ns
        self._free_ns = latency_ns // 2
        """What is not later than this does not keep the clock back."""
        self._reach_ns = max(0, min(USUAL_GAP_NS, self._free_ns - 2 * PERIOD_NS))
        """So far behind a tick there is nothing late yet that could have waited for it."""
        self._late_ns = 0
        self._late_before_ns = 0
        self._since_ns = now_ns

    def received(self, lag_ns: int) -> None:
        """An observation came ``lag_ns`` after its stamp, not more than the limit."""
        self._late_ns = max(self._late_ns, lag_ns)

    def tick(self, now_ns: int) -> int:
        """It is ``now_ns`` now; the time that the oracles are to be given."""
        gap = max(now_ns - self.now_ns, 0)
        self.now_ns = now_ns
        if now_ns - self._since_ns > _MEMORY_NS:
            self._late_before_ns, self._late_ns, self._since_ns = self._late_ns, 0, now_ns
        late_ns = max(self._late_ns, self._late_before_ns)
        if late_ns <= self._free_ns and gap <= USUAL_GAP_NS and now_ns - self.clock_ns <= 2 * gap:
            target = now_ns  # nothing is late: as nearly always
        else:
            behind = max(late_ns - self._free_ns, 0)
            target = min(now_ns - behind, self.clock_ns + 2 * min(gap, USUAL_GAP_NS))
        self.clock_ns = max(self.clock_ns, target)
        return self.clock_ns

    def reach_ns(self, now_ns: int) -> int:
        """The time that the oracles may be given when something is received between two ticks."""
        if self.clock_ns < self.now_ns or max(self._late_ns, self._late_before_ns) > self._free_ns:
            return self.clock_ns
        return max(self.clock_ns, min(now_ns, self.now_ns + self._reach_ns))

    @property
    def lag_ns(self) -> int:
        """The longest lag of the last second or two."""
        return max(self._late_ns, self._late_before_ns)

    @property
    def is_lost(self) -> bool:
        """Whether the clock is further behind than oracles can bear."""
        return self.now_ns - self.clock_ns > 3 * self._latency_ns

    def restart(self, now_ns: int, held_up: bool = False) -> None:
        """Go on from ``now_ns``: what was before is given up.

        Args:
            now_ns: the time of day.
            held_up: what waits to be received comes as late as can be waited for, and one channel later
                than another: for a while that is expected.
        """
        self.clock_ns = self.now_ns = self._since_ns = now_ns
        self._late_before_ns = 0
        self._late_ns = self.limit_ns if held_up else 0
