"""What the oracle assumes of the middleware and of the machines."""

from __future__ import annotations

import msgspec

FOREVER = 1 << 62
"""Later than any stamp (ns)."""

LINKED_NS = 5_000_000_000
"""So long after it was found or started a node is linked to all others, and they to it (DDS takes some 50 ms
for each of sixty subscriptions while a whole system starts)."""

HOSTS_DIFFER_NS = 10_000_000
"""By so much at least the clocks of hosts may differ where each stamps by its own (ROS 2; Zenoh's are hybrid
logical clocks, by which nothing is taken before it was sent), and by so much one may be set unseen. NTP keeps
hosts of a local network within a millisecond, and others within low tens of them (RFC 5905, 1).
"""

FEW_HYPOTHESES = 8
"""Of so many it is not looked whether one follows from another."""

STEPS = 4
LOOSE_STEPS = 32
"""So many steps are tried for each hypothesis that may be kept: with all orders distinguished, and where they
are not, and each message leads on from each state. A step takes some microseconds.
"""


class Bounds(msgspec.Struct, frozen=True):
    """What is assumed of the middleware and the machines (all in ns).

    Attributes:
        latency: a message is taken, and an observation received, within this time of its stamp.
        deadline: an output comes within this time of the step that owes it.
        skew: clocks of different machines differ by at most this.
        tolerance: a timer may ring by this, and what :meth:`slack` adds to it, too early or too late.
        hypotheses: more of them at once are not followed: the verdict is inconclusive.
        names_callers: whether it is known who called. Else calls that only one machine of the models makes
            are its own, but may be anybody's until it was seen to make one as it should.
    """

    latency: int = 200_000_000
    deadline: int = 1_000_000_000
    skew: int = 0
    tolerance: int = 1_000_000
    hypotheses: int = 512
    names_callers: bool = True

    @property
    def differ(self) -> int:
        """By so much at most clocks of hosts differ, where each stamps by its own, and are set unseen."""
        return max(self.skew, HOSTS_DIFFER_NS)

    def slack(self, duration: int) -> int:
        """By how much a timer and the stamps may disagree after ``duration`` (ns).

        Clocks are read with some granularity, and one that is being slewed runs up to 0.05 % too
        fast or too slow (RFC 5905, 11.3). One that is set by no more than clocks differ anyway, while a timer
        runs, does not show. A hybrid logical clock follows the one that is ahead, and stands still until its
        own host's has come up to that.
        """
        return duration // 1000 + self.tolerance + self.differ


class TooManyError(Exception):
    """The hypothesis set is over its cap."""
