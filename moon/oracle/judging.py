"""Judging one machine: what is settled is taken in order, and what cannot be is said.

What time brings about, what a violation is, and how a machine is resynchronised where something is missing.
"""

from __future__ import annotations

from bisect import insort
from collections import deque
from operator import attrgetter
from pathlib import Path

from m2c.model.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Machine
from m2c.model.system import library_for
from moon.oracle.bounds import FOREVER, Bounds, TooManyError
from moon.oracle.channels import Channels
from moon.oracle.clock import Clock
from moon.oracle.confirmation import Confirmation
from moon.oracle.explain import described, explanation_of
from moon.oracle.program import TooOpenError
from moon.oracle.request_tracking import RequestTracking
from moon.oracle.resynchronisation import Resynchronisation
from moon.oracle.search import Search
from moon.oracle.source_streams import SourceStreams
from moon.oracle.state import Hypothesis
from moon.oracle.taken_messages import TakenMessages
from moon.oracle.trace_events import Role, TraceEvent
from moon.oracle.unconfirmed import (
    UNCONFIRMED,
    Losses,
    OtherEnds,
    Publishers,
    Unconfirmed,
    Waiting,
)
from moon.ordering.progress import Progress
from moon.verdict import Evidence, Explanation, Outcome, Verdict

EVIDENCE = 12
"""So many observations are kept for explanations."""

TRIES = 20
"""So many times in a latency bound it is tried to find a machine of which nothing is known."""

_STAMP = attrgetter("stamp")


class Judging:
    """The judging half of ``Oracle``; see there for the arguments."""

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary | None = None,
        node: str = "",
        bounds: Bounds | None = None,
        synchronised: bool = True,
        losses: Losses | None = None,
        clock: Clock | None = None,
        publishers: Publishers | None = None,
    ) -> None:
        self.losses = losses or Losses()
        self._clock = clock or Clock()
        self._publishers = publishers or Publishers()
        self._unconfirmed = Unconfirmed()
        self._other_ends = OtherEnds()
        if library is None:
            library = library_for([Path(machine.position.file)], [], DiagnosticLog())
        self.machine = machine
        self.node = node or machine.name
        self.bounds = bounds or Bounds()
        self.channels = Channels(machine, library, self.node)
        self.search = Search(machine, library, self.channels, self.bounds)
        self._streams = SourceStreams(self.channels, self.node)
        self._latency = self.bounds.latency
        self._progress = Progress()
        self._takes = TakenMessages(self.bounds.deadline + self.bounds.skew)
        self._confirmation = Confirmation(
            self.node,
            self.search,
            self._streams,
            self._progress,
            self._other_ends,
            self._publishers,
            self.losses,
            self._takes,
        )
        self._is_ordered = self._may_be_ordered = not self.search.program.taken_topics()
        """All that the machine takes and sends is reported by its own node, in order: it is known how far
        that is."""
        self._certain_since = 0
        """Since when (ns) what the machine does is known; what was lost before does not matter."""
        self._resynchronisation = Resynchronisation(self._latency)
        self.outcome = Outcome.CONFORMING
        self.violations = 0
        self.inputs = 0
        self.outputs = 0
        self.repeated = 0
        """Observations heard twice."""
        self.late = 0
        """Observations that came after their time, and others that could not be used."""
        self._base: list[Hypothesis] | None = None
        self._window: list[TraceEvent] = []
        """What is not judged yet, in order."""
        self._history: deque[TraceEvent] = deque(maxlen=EVIDENCE)
        self._finished = 0
        self._synchronised = synchronised
        self._listening_since: int | None = None
        self._heard_since: int | None = None
        """From when on (ns) silence means that the machine did nothing, once it is heard at all."""
        self._requests = RequestTracking(self.bounds.deadline)
        self._reason = ""
        self._next_due = FOREVER
        self._next_try = 0
        """Not before this (ns) is it tried again to find what the machine does."""
        self.wake = 0
        """Until this is settled (ns), time alone changes nothing."""
        self._may_be_lost_until = 0
        self._lost_until = 0
        self._from_start = False

    def verdict(self, stamp_ns: int = 0) -> Verdict:
        """The verdict as it stands."""
        return Verdict(self.machine.name, self.node, self.outcome, stamp_ns, self._reason)

    @property
    def judged_until(self) -> int:
        """What was taken or made by then (ns) has been judged."""
        until = self._finished if self._finished > self._clock.settled else self._clock.settled
        if self._window and self._window[0].stamp <= until:
            return self._window[0].stamp - 1
        return until

    @property
    def silent_ns(self) -> int:
        """From then on (ns) it decides something if the node did nothing more, and the node can say so.

        FOREVER: nothing is due, or the node's word would not be enough.
        """
        if not self._is_ordered or self._base is None or not self._progress.heard:
            return FOREVER
        due = min(self._next_due, self._requests.expected.due, self._takes.expected.due)
        return due if due > self._finished else FOREVER

    @property
    def is_synchronised(self) -> bool:
        """Whether it is known what the machine may be doing."""
        return self._base is not None

    def _settle(self, settled: int) -> list[Verdict]:
        """All that happened until ``settled`` (ns) has been heard."""
        if settled <= self._finished:
            return []
        if settled < self.wake:
            self._finished = settled
            return []
        verdicts: list[Verdict] = []
        if self._takes.awaited_ns <= settled:
            verdicts += self.lose(
                settled, "the contents of a message that it took were not received"
            )
        if self._progress.ahead:
            self._progress.settle(settled)
        if self._unconfirmed.kept:
            verdicts += self._look_at_reports()
        if self._window:
            verdicts += self._judge(settled)
        self._finished = settled
        if self._base is not None and self._next_due <= settled:
            verdicts += self._time_passed(settled)
        if self._requests.expected.due <= settled:
            verdicts += self._not_received(settled)
        if self._takes.expected.due <= settled:
            verdicts += self._not_taken(settled)
        if self._is_to_be_found and settled >= self._next_try:
            verdicts += self._try_to_resynchronise(settled)
        self._wake_at(self._next_time())
        return verdicts

    def _wake_at(self, due: int) -> None:
        self.wake = due
        if due < self._clock.wake:
            self._clock.wake = due

    @property
    def _is_to_be_found(self) -> bool:
        """Whether it is not known what the machine does, and something of it was heard."""
        if self._base is not None or self._listening_since is None:
            return False
        return self._heard_since != FOREVER

    def _next_time(self) -> int:
        """Until this time (ns) nothing is settled, due or to be found."""
        if self._base is None:
            return self._next_try if self._is_to_be_found else FOREVER
        wake = (
            self._next_due
            if self._next_due < self._requests.expected.due
            else self._requests.expected.due
        )
        if self._takes.expected.due < wake:
            wake = self._takes.expected.due
        if self._window and self._window[0].stamp < wake:
            wake = self._window[0].stamp
        return wake

    def _begin(self, stamp: int, whole: bool = False) -> None:
        self._listening_since = self._certain_since = stamp
        self._from_start = True
        self._base = self.search.started(stamp, whole)
        self._wake_at(0)
        self.search.last = 0
        self._note_due()

    def _keep(self, fact: TraceEvent) -> None:
        """Put ``fact`` in its place; mostly that is the last."""
        stamp, window = fact.stamp, self._window
        if stamp < self.wake:
            self._wake_at(stamp)
        if not window or window[-1].stamp <= stamp:
            window.append(fact)
        else:
            insort(window, fact, key=_STAMP)

    def _judge(self, settled: int) -> list[Verdict]:
        """Take in order what can have nothing before it any more."""
        window, search = self._window, self.search
        verdicts: list[Verdict] = []
        taken = 0
        for fact in window:
            stamp, base = fact.stamp, self._base
            if stamp > settled or base is None:
                break
            taken += 1
            only = search.deterministic_successor(base[0], fact) if len(base) == 1 else None
            if only is not None:
                search.last = stamp
                self._base = [only]
                self._history.append(fact)
                continue
            try:
                after = self.search.after(base, fact)
            except (TooManyError, TooOpenError) as error:
                return [*verdicts, *self._give_up(stamp, error)]
            if after:
                self._base = after
                self._history.append(fact)
            else:
                self._finished = max(self._finished, stamp)
                verdicts += self._violation(fact)
                if self._base is None:
                    return verdicts
        if taken:
            del window[:taken]
            self._note_due()
            if self.outcome is Outcome.INCONCLUSIVE:
                self._note_knowledge()
        return verdicts

    def _note_due(self) -> None:
        next_due = self.search.next_due
        self._next_due = min(map(next_due, self._base), default=FOREVER) if self._base else FOREVER

    def _note_knowledge(self) -> None:
        """Say so once it is known again what the machine does, and nothing that it did is open."""
        if not self._base or self._unconfirmed.kept:
            return
        states = {tuple(state for state, _ in h.instances) for h in self._base}
        if len(states) == 1:
            self.outcome, self._reason = Outcome.CONFORMING, ""

    def _time_passed(self, settled: int) -> list[Verdict]:
        """Inputs that must have been taken, outputs that should have come."""
        search = self.search
        base = self._base or []
        try:
            alive = [h for h in base if not self._owes_since(h, settled)]
            grown = search.passed(alive, settled)
            owing = [*(h for h in base if h.owed), *(h for h in grown if h.owed)]
            grown = [
                search.normalised(h, settled) for h in grown if not self._owes_since(h, settled)
            ]
        except (TooManyError, TooOpenError) as error:
            return self._give_up(settled, error)
        if not grown and base:
            return self._overdue(settled, owing or base)
        self._base = grown
        self._note_due()
        return []

    def _owes_since(self, hypothesis: Hypothesis, now: int) -> bool:
        """Whether it owes an output whose deadline was before ``now``."""
        owed = hypothesis.owed
        return bool(owed) and not owed[0].optional and owed[0].high + self.bounds.deadline <= now

    def _not_received(self, settled: int) -> list[Verdict]:
        """Requests that others sent and the machine's node never received."""
        verdicts = []
        for fact in self._requests.expected.overdue(settled):
            if self.inputs or self._from_start:  # else perhaps its end is not instrumented
                request = f"request {fact.call[1]} of {fact.call[0]} to be received"
                verdicts += self._missing(fact, request, "the request was not taken up", settled)
        return verdicts

    def _not_taken(self, settled: int) -> list[Verdict]:
        """Messages on the machine's topics that its node, which reports what it takes, never took."""
        verdicts = []
        for fact in self._takes.expected.overdue(settled):
            source, channel = fact.stream
            message = f"message {fact.observation.sequence} of {source} on {channel} to be taken"
            verdicts += self._missing(fact, message, "the message was not taken", settled)
        return verdicts

    def _missing(self, fact: TraceEvent, expected: str, why: str, settled: int) -> list[Verdict]:
        """``fact``, which another node sent, did not reach the machine."""
        if self._base is None:
            return []
        evidence = tuple(
            Evidence(f.stamp, described(f, self.search.wording)) for f in self._history
        )
        explanation = Explanation((expected,), f"nothing: {why}", (), evidence)
        verdict = self._verdict_of(fact.stamp, explanation, "unresponsive: ")
        place = (self.node, fact.observation.channel, False)
        since = self._certain_since
        needed = self._confirmation.needed(verdict, settled, since, True, [place])
        return self._convict(verdict, needed)

    # --- verdicts ---------------------------------------------------------------------------------

    def _violation(self, fact: TraceEvent) -> list[Verdict]:
        """``fact`` cannot be: say so, and go on from what is still certain."""
        before = self._base or []
        explanation = explanation_of(self.search, before, fact, self._history)
        verdict = self._verdict_of(fact.stamp, explanation)
        certain = fact.role is Role.UNDECLARED
        needed = (
            Waiting(verdict)
            if certain
            else self._confirmation.needed(
                verdict,
                fact.stamp,
                self._certain_since,
                False,
                self._confirmation.places_of(before),
            )
        )
        verdicts = self._convict(verdict, needed)
        self._history.append(fact)
        if needed is None:
            self._forget(fact.stamp)
        else:
            self._recover(before, fact)
        return verdicts

    def _overdue(self, settled: int, base: list[Hypothesis]) -> list[Verdict]:
        if self._is_perhaps_unheard(base, settled):
            return self.lose(settled, "what it sent may not have been received yet")
        explanation = explanation_of(self.search, base, None, self._history)
        verdict = self._verdict_of(settled, explanation, "unresponsive: ")
        confirmation = self._confirmation
        expected = confirmation.places_of(base)
        needed = confirmation.needed(verdict, settled, self._certain_since, True, expected)
        if needed is not None:
            confirmation.may_be_shown_by_its_client(needed, base)
        verdicts = self._convict(verdict, needed)
        if needed is None:
            self._forget(settled)
        else:
            self._recover(base, None)
        return verdicts

    def _is_perhaps_unheard(self, base: list[Hypothesis], settled: int) -> bool:
        """Whether what ``base`` owes may have been sent before its channel was heard."""
        since = self._heard_since
        if since is None or settled >= since + self.bounds.deadline + self._latency:
            return False
        channel_of, is_heard = self.search.program.channel_of_output, self._streams.is_heard
        owed = [h.owed[0] for h in base if h.owed]
        return not all(is_heard(channel_of(item.kind, item.interface)) for item in owed)

    def _recover(self, before: list[Hypothesis], fact: TraceEvent | None) -> None:
        """After a violation: as if what was owed had come, else from any state."""
        search = self.search
        stamp = self._finished if fact is None else fact.stamp
        found: list[Hypothesis] = []
        try:
            if fact is not None and fact.role is Role.UNDECLARED:
                found = before
            elif fact is None or fact.role is Role.INPUT:
                settled = [h.with_owed(()) for h in search.reachable(before, stamp, stamp)]
                found = settled if fact is None else search.take_input(settled, fact)
            if not found:
                found = search.unconstrained_states(stamp, self._unsettled(stamp))
        except (TooManyError, TooOpenError):
            self._forget(stamp)
            return
        self._base, search.last = found, stamp
        self._wake_at(0)
        self._note_due()

    def _unsettled(self, stamp: int) -> tuple[TraceEvent, ...]:
        """Messages that may or may not have been taken by ``stamp``."""
        kept = {id(f): f for h in self._base or () for f in h.pending}
        facts = sorted(kept.values(), key=lambda f: f.stamp)
        recent = [f for f in facts if f.stamp > stamp - self.bounds.latency]
        for fact in recent:
            fact.may_be_lost = True
        return tuple(recent)

    def _verdict_of(self, stamp: int, explanation: Explanation, prefix: str = "") -> Verdict:
        expected = " or ".join(explanation.expected) or "nothing"
        reason = f"{prefix}expected {expected}, observed {explanation.observed}"
        return Verdict(self.machine.name, self.node, Outcome.VIOLATED, stamp, reason, explanation)

    def _convict(self, verdict: Verdict, needed: Waiting | None) -> list[Verdict]:
        """Say ``verdict``, once ``needed`` has come; None: what is missing will not come any more."""
        if needed is not None and needed.is_over:
            return self._confirm([verdict])
        if needed is not None:
            self._unconfirmed.add(needed)
            if self.outcome is Outcome.VIOLATED:
                return []  # it is, whether this one is certain or not
        was, self.outcome = self.outcome, Outcome.INCONCLUSIVE
        self._reason = f"{UNCONFIRMED}{verdict.reason}"
        if needed is None:
            self._reason = f"observations were lost; {self._reason}"
        return [] if was is Outcome.INCONCLUSIVE else [self.verdict(verdict.stamp_ns)]

    def _confirm(self, verdicts: list[Verdict]) -> list[Verdict]:
        """Say ``verdicts``, for which nothing can be missing."""
        if verdicts:
            self.violations += len(verdicts)
            self.outcome = Outcome.VIOLATED
            self._reason = verdicts[-1].reason
        return verdicts

    def _look_at_reports(self) -> list[Verdict]:
        """What the node was heard to do since may confirm a violation."""
        progress = self._progress
        return self._confirm(self._unconfirmed.reported(progress.heard, progress.gap))

    # --- losing and finding the thread ------------------------------------------------------------

    def lose(self, stamp: int, text: str) -> list[Verdict]:
        """Something is missing: nothing is said until the machine's doing is certain again.

        Args:
            stamp: since when (ns).
            text: what is missing, for people.
        """
        self._forget(stamp)
        if self.outcome is Outcome.INCONCLUSIVE:
            return []
        self.outcome = Outcome.INCONCLUSIVE
        self._reason = text
        return [self.verdict(stamp)]

    def _give_up(self, stamp: int, why: Exception) -> list[Verdict]:
        """There is too much to follow; it is tried again after a while, as that costs time."""
        said = self.lose(stamp, str(why) or "too many possibilities to follow")
        self._next_try = stamp + self.bounds.deadline
        return said

    def _forget(self, stamp: int) -> None:
        stamps = (min(fact.stamp, fact.observation.received_ns) for fact in self._window)
        newest = max(stamps, default=0)
        if self._base is not None:
            newest = max(newest, self.search.last)
        self._synchronised = False
        self._from_start = False
        self._base = None
        self._next_try = 0
        self._wake_at(0)
        self._window.clear()
        self._requests.expected.clear()
        self._takes.forget()
        self._lost_until = stamp + self._latency
        self._listening_since = stamp
        self._resynchronisation.begin(max(stamp, newest))

    def _try_to_resynchronise(self, settled: int) -> list[Verdict]:
        """Begin anew where the machine was certainly between two steps."""
        self._next_try = settled + self._latency // TRIES
        found = self._resynchronisation.find(settled)
        if found is None:
            return []
        anchor, pending, later = found
        try:
            if pending:
                self.search.check_pending(len(pending), pending[-1])
            self._base = self.search.unconstrained_states(anchor, pending)
        except TooManyError:
            return []
        self._resynchronisation.found()
        self.search.last = self._certain_since = anchor
        self._note_due()
        for fact in later:
            self._keep(fact)
        return self._judge(settled)
