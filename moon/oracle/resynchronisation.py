"""Finds a moment at which it is certain between which of its steps a machine was.

Events are remembered while it is not known what the machine does; ``ModelOracle`` begins anew at the moment
that is found.
"""

from __future__ import annotations

from collections import deque
from operator import attrgetter

from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.trace_events import Role, TraceEvent

KEPT_EVENTS = 4096
"""Events kept while the oracle looks for a moment that is certain."""

BUSY_LATENCIES = 4
"""A machine that was never between two steps for sure for so many times the latency bound may never be."""

_KEPT_LATENCIES = 5
"""They are kept for the deadline and so many times the latency bound."""

_STEPS = (Role.INPUT, Role.OUTPUT, Role.STATUS, Role.RESULT, Role.UNDECLARED)
"""What a machine is known to do at the moment of its stamp; a message it takes some time later."""


class Resynchronisation:
    """What happened to a machine of which nothing is known.

    Args:
        bounds: what is assumed.

    Attributes:
        may_be_slow: whether its node is not one of m2c's, which do all of a step at once: a callback that
            somebody wrote may take its time, up to the deadline.
    """

    def __init__(self, bounds: Bounds) -> None:
        self.may_be_slow = False
        self._latency, self._deadline, self._skew = bounds.latency, bounds.deadline, bounds.skew
        self.recent: deque[TraceEvent] = deque()
        """What is remembered, in the order in which it was handed over."""
        self._since = 0
        self._forgotten = 0
        """The newest that happened and is not remembered any more happened then."""
        self._stands_still = False
        """Whether its node stood still, and nothing but what it does shows that it goes on."""
        self._last_step = 0
        """When it last took or sent something, or may have done so."""

    @property
    def _step_ns(self) -> int:
        """So long may it do nothing within a step."""
        return self._deadline if self.may_be_slow else self._latency

    @property
    def acted_ns(self) -> int:
        """When the machine had taken or sent something last, at the moment that was found (ns)."""
        return self._last_step

    def begin(self, since_ns: int, known_ns: int, stands_still: bool = False) -> None:
        """Begin anew: only what happened after ``since_ns``, and after all that is forgotten now, is whole.

        Args:
            since_ns: since the epoch.
            known_ns: the newest that happened while it was known what the machine does, happened then.
            stands_still: whether its node stands still then, and may do so for longer than the deadline.
        """
        has_acted = any(event.role in _STEPS for event in self.recent)
        self._stands_still = stands_still or (self._stands_still and not has_acted)
        newest = max((event.stamp for event in self.recent), default=0)
        self.recent.clear()
        self._forgotten = max(self._forgotten, newest, known_ns)
        self._since = max(since_ns, self._forgotten)
        self._last_step = self._since - self._deadline

    def remember(self, event: TraceEvent) -> None:
        """``event`` happened; nothing is made of it yet, so what came after it may be handed over before."""
        recent = self.recent
        recent.append(event)
        oldest = event.stamp - self._deadline - _KEPT_LATENCIES * self._latency
        while recent[0].stamp < oldest or len(recent) > KEPT_EVENTS:
            # what is forgotten may have been the beginning of a step
            forgotten = recent.popleft()
            self._since = max(self._since, forgotten.stamp)
            self._stands_still = self._stands_still and forgotten.role not in _STEPS

    def remembered(self) -> list[TraceEvent]:
        """What is remembered, by when it may have happened first."""
        return sorted(self.recent, key=attrgetter("stamp_ns"))

    def find(self, until_ns: int) -> int | None:
        """The first moment until ``until_ns`` at which the machine was between two steps.

        That is so when it takes an input (everything it owed is out by then), or when it has taken and
        sent nothing for as long as it may be within a step: what it took just before, it may still owe the
        answer to.

        Returns:
            The moment (ns), or None.
        """
        events = self.remembered()
        earliest = self._whole_from(events)
        for event in events:
            calm_ns = max(earliest, self._last_step + self._step_ns + 1)
            if event.stamp_ns > calm_ns:
                return calm_ns
            if event.stamp >= earliest and event.role is Role.INPUT:
                return event.stamp - 1
            if event.role in _STEPS and event.stamp > self._since:
                self._last_step = event.stamp
        calm_ns = max(earliest, self._last_step + self._step_ns + 1)
        return calm_ns if calm_ns <= until_ns else None

    def find_busy(self, until_ns: int) -> int | None:
        """Where there is no such moment for long: when something was sent. More of that step may follow."""
        if until_ns < self._since + BUSY_LATENCIES * self._latency:
            return None
        events = self.remembered()
        earliest = self._whole_from(events)
        sent = (it.stamp for it in events if it.role is Role.OUTPUT and it.stamp >= earliest)
        return next(sent, None)

    def _whole_from(self, events: list[TraceEvent]) -> int:
        """From when on (ns) it is known what may be under way to the machine, if ``events`` came after that.

        All that came before is taken a latency bound after its node ran for the first time. That was no later
        than one deadline after it was listened to, unless it was known to stand still.
        """
        runs_by = FOREVER if self._stands_still else self._since + self._deadline
        steps = (it.stamp for it in events if it.role in _STEPS and it.stamp > self._since)
        return min(next(steps, runs_by), runs_by) + self._latency + self._skew

    def found(self) -> None:
        """What was kept is not needed any more."""
        self.recent.clear()
        self._stands_still = False
