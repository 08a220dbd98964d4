"""Whether clocks of other hosts go on as the monitor's: one that is set shows in the lags of its nodes.

The lag of a report is the time from its stamp to its reception. When the clock of a node's host is set, the
lags of all that the node reports change by as much, at once, and stay so; those of other nodes do not. A
network or a host that is slow for a while delays what was sent meanwhile, and nothing that is sent later.
Nodes hold reports back, too: what is not later than half the latency bound shows nothing.
So what comes unusually late leaves a doubt, which the next reports decide; what comes before it was sent is
certain. The least lags of before and after tell by how much the clock was set, as in NTP (RFC 5905, 10).
"""

from __future__ import annotations

from collections.abc import Iterable

from moon.ordering.event_time_clock import PERIOD_NS, SET_NS

KEPT_LAGS = 32
"""The lags of so many reports, and of up to as many before them, say what is usual of a node."""
FEW_LAGS = 4
"""Fewer say nothing."""
MOST_NODES = 1000
"""Nodes that are followed; their names come from the wire, and never end."""
_LEAST, _MOST = -(1 << 62), 1 << 62


class HostClock:
    """The clock of one node's host, as its reports show it.

    Attributes:
        behind_ns: by how much it is behind the monitor's since it was set.
        margin_ns: by how much ``behind_ns`` may be wrong.
        differs: whether that is more than delays can be mistaken for.
        least, most: of the lags that are usual (ns).
        is_known: whether there are enough to say what is usual.
        unusual: the lags of the last reports, of which none was usual (ns).
        is_certain: whether one of them cannot be but of a clock that was set.
        open: so many reports have to be usual before there is no doubt.
        since_ns: when the first of ``unusual`` was received (ns).
        until_ns: the doubt ends then (ns), if nothing more is received.
        usual_ns: when a report was last received as usual (ns).
        went_back_ns: when its stamps were last found to go back (ns).
    """

    __slots__ = (
        "_count",
        "_least",
        "_most",
        "behind_ns",
        "differs",
        "is_certain",
        "is_known",
        "least",
        "margin_ns",
        "most",
        "open",
        "since_ns",
        "until_ns",
        "unusual",
        "usual_ns",
        "went_back_ns",
    )

    def __init__(self) -> None:
        self.behind_ns = self.usual_ns = self.went_back_ns = 0
        self.since_ns = self.until_ns = self.open = self.margin_ns = 0
        self.unusual: list[int] = []
        self.is_certain = self.is_known = self.differs = False
        self.least, self.most = _MOST, _LEAST
        self._least, self._most, self._count = _MOST, _LEAST, 0

    def note(self, lag_ns: int, now_ns: int) -> None:
        """A report came as usual."""
        self.usual_ns = now_ns
        if self.open:
            self.open -= 1
            self.unusual.clear()
        if self._count == KEPT_LAGS:
            self.least, self.most = self._least, self._most
            self._least, self._most, self._count = _MOST, _LEAST, 0
        self._count += 1
        if self._count >= FEW_LAGS:
            self.is_known = True
        if lag_ns < self._least:
            self._least = lag_ns
            self.least = min(lag_ns, self.least)
        if lag_ns > self._most:
            self._most = lag_ns
            self.most = max(lag_ns, self.most)

    @property
    def has_moved(self) -> bool:
        """Whether many lags rose by more than they differ among them: those of a busy monitor do not."""
        lags = self.unusual
        return len(lags) == KEPT_LAGS and max(lags) - min(lags) < min(lags) - self.most

    def set_by(self, most_ns: int) -> int:
        """The clock was set, by the unusual lags: by how much (ns).

        Args:
            most_ns: clocks may differ by that.
        """
        least, most = (self.least, self.most) if self.is_known else (0, 0)
        set_back_ns = min(self.unusual) - least
        lags, now_ns = tuple(self.unusual), self.usual_ns
        self.behind_ns += set_back_ns
        self.margin_ns = max(lags) - min(lags)
        is_clear = self.is_certain or set_back_ns > 2 * (most - least)
        self.differs = is_clear and abs(self.behind_ns) > most_ns + self.is_known * (most - least)
        self.is_certain = self.is_known = False
        self.least, self.most = _MOST, _LEAST
        self._least, self._most, self._count = _MOST, _LEAST, 0
        for lag_ns in lags:
            self.note(lag_ns - set_back_ns, now_ns)
        return -set_back_ns


class HostClocks:
    """The clocks of all nodes' hosts.

    Args:
        latency_ns: nothing is received later than this after it was sent.
        skew_ns: clocks differ by at most this.

    Attributes:
        now_ns: time has passed up to then.
    """

    def __init__(self, latency_ns: int, skew_ns: int = 0) -> None:
        self.now_ns = 0
        self._latency_ns = latency_ns
        self._most_ns = skew_ns + SET_NS
        self._known: dict[str, HostClock] = {}

    def heard(self, node: str, stamp_ns: int, now_ns: int) -> int:
        """Something of ``node``, stamped ``stamp_ns`` by its clock, is received at ``now_ns``.

        Returns:
            By how much its clock was set (ns); 0: it was not, as far as is known.
        """
        clock = self._known.get(node)
        if clock is None:
            if len(self._known) >= MOST_NODES:
                return 0
            clock = self._known[node] = HostClock()
        if now_ns > self.now_ns:
            self.now_ns = now_ns
        lag_ns = now_ns - stamp_ns - clock.behind_ns
        is_early = lag_ns < -self._most_ns - clock.margin_ns
        is_late = clock.is_known and lag_ns > max(clock.most + PERIOD_NS, self._latency_ns // 2)
        if is_early or is_late or clock.is_certain:
            return self._unusual(clock, lag_ns, is_early, now_ns)
        clock.note(lag_ns, now_ns)
        return 0

    def _unusual(self, clock: HostClock, lag_ns: int, is_early: bool, now_ns: int) -> int:
        if is_early and not clock.is_certain:
            clock.is_certain = True
            clock.unusual.clear()
        if not clock.unusual:
            clock.since_ns = now_ns
        clock.open = FEW_LAGS
        clock.until_ns = now_ns + max(lag_ns, 0) + self._latency_ns
        # what a slow link held up comes at once when it goes on
        goes_on = now_ns - lag_ns > clock.since_ns or now_ns > clock.since_ns + self._latency_ns
        clock.unusual.append(lag_ns)
        del clock.unusual[:-KEPT_LAGS]
        if len(clock.unusual) < 2 * FEW_LAGS or not (goes_on or is_early):
            return 0
        if not (clock.is_certain or clock.has_moved or self._is_alone(clock)):
            return 0
        return clock.set_by(self._most_ns)

    def _is_alone(self, clock: HostClock) -> bool:
        """Whether another node was heard as usual since this one was not."""
        return any(other.usual_ns > clock.since_ns for other in self._known.values())

    def went_back(self, node: str) -> bool:
        """The stamps of ``node`` went back, against the numbers of what it sent: whether that is news."""
        clock = self._known.get(node)
        if clock is None or self._is_doubtful(clock) or self._went_back_lately(clock):
            return False
        clock.went_back_ns = self.now_ns
        clock.open, clock.until_ns = FEW_LAGS, self.now_ns + self._latency_ns
        return True

    def _went_back_lately(self, clock: HostClock) -> bool:
        """Whether what its other channels show now is of the same time that it was set."""
        return self.now_ns - clock.went_back_ns < 5 * self._latency_ns

    def doubtful(self, nodes: Iterable[str]) -> set[str]:
        """Those of ``nodes`` whose clocks differ from the monitor's, or perhaps do since a short time."""
        clocks = ((node, self._known.get(node)) for node in nodes)
        return {node for node, clock in clocks if clock is not None and self._is_doubtful(clock)}

    def _is_doubtful(self, clock: HostClock) -> bool:
        if clock.is_certain or clock.differs:
            return True
        return clock.open > 0 and self.now_ns <= clock.until_ns

    def restart(self) -> None:
        """The monitor's own clock was set, or it stood still."""
        self._known.clear()
