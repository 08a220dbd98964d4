"""Finding the thread in the middle of a run: a moment at which a machine was between two steps."""

from __future__ import annotations

from collections import deque

from moon.oracle.trace_events import Role, TraceEvent

KEPT_FACTS = 4096
"""Facts kept while the oracle looks for a moment that is certain."""

_STEPS = (Role.INPUT, Role.OUTPUT, Role.STATUS, Role.RESULT, Role.UNDECLARED)
"""What a machine is known to do at the moment of its stamp; a message it takes some time later."""


class Resynchronisation:
    """What is heard of a machine of which nothing is known.

    Args:
        latency: a message is taken, and an observation heard, within this time of its stamp (ns).
    """

    def __init__(self, latency: int) -> None:
        self._latency = latency
        self.recent: deque[TraceEvent] = deque()
        """What is remembered, as it was received."""
        self._since = 0
        self._last_step = 0
        """When it last took or sent something."""

    def begin(self, stamp: int) -> None:
        """Listen from ``stamp`` (ns) on; what came before is forgotten, and what is newer is not known to
        be all that there was: nothing is concluded from before the newest that was forgotten.
        """
        stamps = (min(fact.stamp, fact.observation.received_ns) for fact in self.recent)
        newest = max(stamps, default=0)
        self.recent.clear()
        self._since = self._last_step = max(stamp, newest)

    def remember(self, fact: TraceEvent, finished: int) -> None:
        """Keep ``fact``; nothing that came ``finished`` (ns) or earlier is waited for."""
        recent = self.recent
        recent.append(fact)
        oldest = finished - 4 * self._latency
        while recent[0].stamp < oldest:
            recent.popleft()
        if len(recent) > KEPT_FACTS:  # what is forgotten may have been the beginning of a step
            self._since = max(self._since, recent.popleft().stamp)

    def find(self, settled: int) -> tuple[int, tuple[TraceEvent, ...], list[TraceEvent]] | None:
        """The first moment until ``settled`` (ns) at which the machine was between two steps.

        That is so when it takes an input (everything it owed is out by then), or when it has taken and
        sent nothing for as long as the latency bound: what it took just before, it may still owe the
        answer to. Messages from before the oracle listened have been taken one latency bound later.

        Returns:
            The moment (ns), the messages that may be under way then, and the facts after it; or None.
        """
        earliest = self._since + self._latency
        facts = sorted((f for f in self.recent if f.stamp <= settled), key=lambda f: f.stamp)
        anchor = None
        quiet_since = self._last_step
        for fact in facts:
            calm = fact.stamp - quiet_since > self._latency
            if fact.stamp >= earliest and (fact.role is Role.INPUT or calm):
                anchor = fact.stamp - 1
                break
            if fact.role in _STEPS:
                quiet_since = self._last_step = fact.stamp
        if anchor is None:
            if settled < earliest or settled - quiet_since <= self._latency:
                return None
            anchor = settled
        pending = tuple(
            f
            for f in facts
            if f.role is Role.MESSAGE and anchor - self._latency < f.stamp <= anchor
        )
        for fact in pending:
            fact.may_be_lost = True
        later = [f for f in facts if f.stamp > anchor]
        return anchor, pending, later + [f for f in self.recent if f.stamp > settled]

    def found(self) -> None:
        """What was kept is not needed any more."""
        self.recent.clear()
