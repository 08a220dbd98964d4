"""Resynchronisation in the middle of a run: a moment at which a machine was between two steps."""

from __future__ import annotations

from collections import deque

from moon.oracle.trace_events import Role, TraceEvent

KEPT_FACTS = 4096
"""Events kept while the oracle looks for a moment that is certain."""

_KEPT_LATENCIES = 5
"""So many times the latency bound they are kept."""

_STEPS = (Role.INPUT, Role.OUTPUT, Role.STATUS, Role.RESULT, Role.UNDECLARED)
"""What a machine is known to do at the moment of its stamp; a message it takes some time later."""


class Resynchronisation:
    """What happened to a machine of which nothing is known.

    Args:
        latency: a message is taken within this time of its stamp (ns).
    """

    def __init__(self, latency: int) -> None:
        self._latency = latency
        self.recent: deque[TraceEvent] = deque()
        """What is remembered, in the order in which it was told."""
        self._since = 0
        self._forgotten = 0
        """The newest that happened and is not remembered any more happened then."""
        self._last_step = 0
        """When it last took or sent something."""

    def begin(self, since_ns: int, known_ns: int) -> None:
        """Begin anew: only what happened after ``since_ns``, and after all that is forgotten now, is whole.

        Args:
            since_ns: since the epoch.
            known_ns: the newest that happened while it was known what the machine does, happened then.
        """
        newest = max((event.stamp for event in self.recent), default=0)
        self.recent.clear()
        self._forgotten = max(self._forgotten, newest, known_ns)
        self._since = self._last_step = max(since_ns, self._forgotten)

    def remember(self, event: TraceEvent) -> None:
        """``event`` happened; nothing is made of it yet, so it may be told after what came after it."""
        recent = self.recent
        recent.append(event)
        oldest = event.stamp - _KEPT_LATENCIES * self._latency
        while recent[0].stamp < oldest or len(recent) > KEPT_FACTS:
            # what is forgotten may have been the beginning of a step
            self._since = max(self._since, recent.popleft().stamp)

    def find(self, until_ns: int) -> tuple[int, tuple[TraceEvent, ...], list[TraceEvent]] | None:
        """The first moment until ``until_ns`` at which the machine was between two steps.

        That is so when it takes an input (everything it owed is out by then), or when it has taken and
        sent nothing for as long as the latency bound: what it took just before, it may still owe the
        answer to. Messages from before the oracle listened have been taken one latency bound later.

        Returns:
            The moment (ns), the messages that may be under way then, and what happened after it; or None.
        """
        earliest = self._since + self._latency
        anchor = None
        quiet_since = self._last_step
        events = sorted(self.recent, key=lambda event: event.stamp)
        for event in events:
            calm = event.stamp - quiet_since > self._latency
            if event.stamp >= earliest and (event.role is Role.INPUT or calm):
                anchor = event.stamp - 1
                break
            if event.role in _STEPS:
                quiet_since = self._last_step = event.stamp
        if anchor is None:
            if until_ns < earliest or until_ns - quiet_since <= self._latency:
                return None
            anchor = until_ns
        pending = tuple(
            event
            for event in events
            if event.role is Role.MESSAGE and anchor - self._latency < event.stamp <= anchor
        )
        for event in pending:
            event.may_be_lost = True
        return anchor, pending, [event for event in events if event.stamp > anchor]

    def found(self) -> None:
        """What was kept is not needed any more."""
        self.recent.clear()
