"""The judge of one machine: what happened goes in, in order; what the model says to that comes out.

It is a ``moon.judge.Judge`` of what a machine took and did: every event comes when it is its turn,
once. Who puts in order what is received is of no concern here (``delivery``), nor is by which numbers a
violation becomes certain (``confirmation``). Where the judge does not know what the machine does,
``Resynchronisation`` looks for a moment to begin at.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from m2c.model.machine import OutputKind
from moon.feed.numbers import Place
from moon.judge import Gap
from moon.oracle.bounds import FOREVER, Bounds, TooManyError
from moon.oracle.confirmation import Conclusion, Violation
from moon.oracle.explain import described, explanation_of, survivors_of
from moon.oracle.resynchronisation import Resynchronisation
from moon.oracle.search import Search
from moon.oracle.state import Hypothesis
from moon.oracle.steps import TooOpenError
from moon.oracle.trace_events import Role, TraceEvent
from moon.verdict import Cause, Evidence, Explanation, Outcome, Verdict, violation_of
from transports.interface import CLIENT_END

EVIDENCE = 12
"""So many events are kept for explanations."""

MOST_PAUSES = 8
"""So many times the deadline is waited at most where there is too much to follow, again and again."""

TRIES = 20
"""So many times in a latency bound it is tried to find a machine of which nothing is known."""

MISSED = "what it sent may not have been received yet"

STOOD_STILL = "its node stood still for longer than the deadline"

ANYBODY = "who calls {} is not named, and may be in no model"

AT_ONCE = 0
"""As ``due_ns``: it is to be advanced, now that something happened."""


_INCONCLUSIVE = Outcome.INCONCLUSIVE  # looked up for every event
_NOTHING: list[Verdict] = []
"""For most events; never changed."""

_PARTS = {
    OutputKind.ACCEPT_GOAL: ("/_action/send_goal", False),
    OutputKind.REJECT_GOAL: ("/_action/send_goal", False),
    OutputKind.SEND_GOAL: ("/_action/send_goal", False),
    OutputKind.SEND_CANCEL: ("/_action/cancel_goal", False),
    OutputKind.FEEDBACK: ("/_action/feedback", True),
    OutputKind.SUCCEED: ("/_action/status", True),
    OutputKind.ABORT: ("/_action/status", True),
    OutputKind.CANCEL: ("/_action/status", True),
}
"""The part of an action by which an output leaves, and whether that is a topic."""


class ModelOracle:
    """Judges one machine.

    What the machine may be doing is known from ``start`` on, or is found out some time after ``listen``. It
    is not known any more where something is missing (``gap``), where there is too much to follow, and after
    a violation that something missing may explain. In the latter two cases it waits for a further
    ``listen``. While it is not known, events are remembered only, so that their order does not matter.

    Args:
        name: of the machine.
        node: the node that runs it.
        search: the hypotheses of the machine.
        conclusion: what is concluded from what it finds.
        may_have_missed: whether what is expected at some places may have been missed by some time (ns), as
            their channels were silent by then.

    Attributes:
        hypotheses: what the machine may be doing after the last event; None: that is not known.
        due_ns: from then on it decides something if nothing more happens; FOREVER: it does not.
        search: the hypotheses of the machine.
        gave_up_ns: since then it does not know any more what the machine does, and waits for ``listen``;
            None where it does not wait.
        since_start: whether it is known what the machine did since it started.
    """

    def __init__(
        self,
        name: str,
        node: str,
        search: Search,
        conclusion: Conclusion,
        may_have_missed: Callable[[list[Place], int], bool],
    ) -> None:
        self.hypotheses: list[Hypothesis] | None = None
        self.due_ns = FOREVER
        self.gave_up_ns: int | None = None
        self.since_start = False
        self.resynchronisation = Resynchronisation(search.bounds)
        self._name = name
        self._node = node
        self._calls = [(node, channel, False) for channel in search.program.services()]
        """Where inputs come of which the node itself reports that it took them."""
        self.search = search
        self._bounds = search.bounds
        self._conclusion = conclusion
        self._may_have_missed = may_have_missed
        self._history: deque[TraceEvent] = deque(maxlen=EVIDENCE)
        self._known_since = 0
        """Since when (ns) it is known what the machine does."""
        self._followed_since = 0
        """Since when (ns) it is followed without a break, from one state or from several."""
        self._linked_ns = 0
        self._silent_since = 0
        """Since when (ns) it had done nothing as it was found, and has done nothing; 0: it has."""
        self._running: list[Hypothesis] | None = None
        """What the machine might be doing when its node was seen to run last, with the messages since; None:
        time has changed nothing since then."""
        self._next_try = 0
        """Not before this (ns) is it tried again to find what the machine does."""
        self._next_busy = 0
        """Nor, before this (ns), where it may be within a step: that costs time."""
        self._callers: set[str] | None = None if search.bounds.names_callers else set()
        """The channels on which it is certainly the machine that calls; None: on all of them."""
        self._pause_ns = 0
        """It waited for so long after there was too much to follow."""

    # --- what the node does ---------------------------------------------------------------------------

    def start(
        self, stamp_ns: int, whole: bool = False, linked_ns: int = 0, earliest_ns: int = FOREVER
    ) -> None:
        """The machine starts, in its initial state.

        Args:
            stamp_ns: when, ns since the epoch.
            whole: whether its timers run from that very moment, and what it sends at once is known.
            linked_ns: what is sent to it before that (ns) may not reach it.
            earliest_ns: it may have started then already (ns).
        """
        self._known_since = self._followed_since = stamp_ns
        self._linked_ns = linked_ns
        self.since_start = True
        self.gave_up_ns = None
        self.search.last = 0
        self._running = None
        self._silent_since = 0
        try:
            self.hypotheses = self.search.beginnings.started(stamp_ns, whole, earliest_ns)
        except (TooManyError, TooOpenError) as error:
            self._give_up(stamp_ns, error)
        else:
            self._note_due()

    def linked(self, since_ns: int) -> None:
        """What is sent to the machine before ``since_ns`` may not reach it."""
        self._linked_ns = max(self._linked_ns, since_ns)

    def listen(self, since_ns: int) -> None:
        """All that happens after ``since_ns`` is handed over, and nothing is known of what was before."""
        self.resynchronisation.begin(since_ns, self.search.last)
        self.gave_up_ns = None
        self.due_ns = self._next_try

    # --- what happens ---------------------------------------------------------------------------------

    def observe(self, event: TraceEvent) -> Sequence[Verdict]:
        """Take what happened next."""
        known = self.hypotheses
        if known is None:
            self.resynchronisation.remember(event)
            return _NOTHING
        search = self.search
        acted_ns = self._silent_since or search.last
        was_silent = event.role is not Role.MESSAGE and self._note_silence(acted_ns, event.stamp)
        is_late = was_silent and _shows_standstill(known, event, self._bounds)
        if len(known) == 1 and not is_late:
            only = search.deterministic_successor.of(known[0], event)
            if only is not None:
                search.last = event.stamp
                self.hypotheses = [only]
                self._running = None
                self._silent_since = 0
                self._history.append(event)
                if self._callers is not None:
                    self._note_caller(event, self._callers)
                is_open = self._conclusion.outcome is _INCONCLUSIVE
                self.due_ns = AT_ONCE if is_open else search.next_due(only)
                return _NOTHING
        if is_late and 0 < event.sent < event.stamp - self._bounds.deadline - self._bounds.skew:
            self._stands_still(acted_ns)
            self.resynchronisation.remember(event)
            return self._conclusion.unknown(event.stamp, STOOD_STILL)
        event.may_be_lost = event.stamp < self._linked_ns or not event.is_linked
        verdicts: Sequence[Verdict] = _NOTHING
        try:
            after = self._after(known, event, is_late)
        except (TooManyError, TooOpenError) as error:
            verdicts = self._give_up(event.stamp, error)
        else:
            if after:
                self.hypotheses = after
                self._history.append(event)
                if self._callers is not None:
                    self._note_caller(event, self._callers)
            else:
                verdicts = self._unexplained(event)
        self.due_ns = AT_ONCE
        return verdicts

    def _after(self, known: list[Hypothesis], event: TraceEvent, is_late: bool) -> list[Hypothesis]:
        """What the machine may be doing after ``event``; ``is_late``: its node stood still until then."""
        search = self.search
        if event.role is Role.MESSAGE:
            if self._running is not None:
                self._running = search.after(self._running, event)
            return search.after(known, event)
        running = known if self._running is None else self._running
        self._running = None
        acted_ns, self._silent_since = self._silent_since or search.last, 0
        if is_late:
            search.successors.stood_still(acted_ns, event.stamp)
            return search.after(running, event)
        return search.after(known, event)

    def gap(self, gap: Gap) -> Sequence[Verdict]:
        """Something is missing: no verdict until the machine's doing is certain again."""
        self._forget(gap.from_ns)
        self.listen(gap.until_ns - 1)
        return self._conclusion.unknown(gap.from_ns, gap.why)

    def advance(self, until_ns: int) -> Sequence[Verdict]:
        """All that happened until then (ns) was handed over."""
        if self.hypotheses is None:
            return self._try_to_resynchronise(until_ns) if self.due_ns <= until_ns else _NOTHING
        if self.due_ns == AT_ONCE:
            self._note_due()
            self._note_knowledge()
        return self._time_passed(until_ns) if self.due_ns <= until_ns else _NOTHING

    def never_arrived(
        self, event: TraceEvent, expected: str, why: str, until_ns: int
    ) -> Sequence[Verdict]:
        """What another node sent to the machine did not reach it.

        Args:
            event: as it was sent.
            expected: what the machine's node should have done with it, for people.
            why: what it did not do, for people.
            until_ns: all that happened until then was handed over.
        """
        if self.hypotheses is None:
            return _NOTHING
        evidence = tuple(
            Evidence(f.stamp, described(f, self.search.wording)) for f in self._history
        )
        channel = event.observation.channel
        explanation = Explanation((expected,), f"nothing: {why}", (), evidence, channel=channel)
        verdict = self._verdict_of(event.stamp, explanation, Cause.NOT_TAKEN)
        places = [(self._node, channel, False)]
        return self._was_silent(self._violation(verdict, until_ns, True, places))

    def foreseen(self, events: Sequence[TraceEvent]) -> list[Hypothesis]:
        """What the machine may be doing if these events come next, which are not handed over yet."""
        known = self.hypotheses or []
        if not known or not events:
            return known
        last = self.search.last
        try:
            for event in events:
                event.may_be_lost = event.stamp < self._linked_ns or not event.is_linked
                after = self.search.after(known, event)
                if not after:
                    break  # what comes before it may still explain it
                known = after
        except (TooManyError, TooOpenError):
            return self.hypotheses or []
        finally:
            self.search.last = last
        return known

    def _note_silence(self, acted_ns: int, now: int) -> bool:
        """Whether the node, which did something at ``acted_ns``, may have stood still until ``now``."""
        if now - acted_ns <= self._bounds.latency:
            return False
        self.search.successors.was_silent(acted_ns, now)
        return True

    # --- what time brings about -----------------------------------------------------------------------

    def _note_due(self) -> None:
        next_due = self.search.next_due
        self.due_ns = min(map(next_due, self.hypotheses or ()), default=FOREVER)

    def _note_knowledge(self) -> None:
        """It is conforming once it is known again what the machine does, and nothing that it did is open.

        That is so in one state; or where what it does does not tell its states apart, and it did something
        one deadline after it was found: what it had begun before is over by then, so all that it does is
        judged.
        """
        if self._conclusion.outcome is _INCONCLUSIVE and self.hypotheses:
            states = {tuple(state for state, _ in h.instances) for h in self.hypotheses}
            over_ns = self._followed_since + self._bounds.deadline
            if len(states) == 1 or self.search.last > over_ns:
                self._conclusion.known()

    def _time_passed(self, until: int) -> Sequence[Verdict]:
        """Inputs that must have been taken, outputs that should have come."""
        search = self.search
        known = self.hypotheses or []
        if self._running is None:
            self._running = known
        self._note_silence(self._silent_since or search.last, until)
        try:
            alive = [h for h in known if not self._owes_since(h, until)]
            grown = search.passed(alive, until)
            owing = [*(h for h in known if h.owed), *(h for h in grown if h.owed)]
            grown = [
                search.successors.normalised(h, until)
                for h in grown
                if not self._owes_since(h, until)
            ]
        except (TooManyError, TooOpenError) as error:
            return self._give_up(until, error)
        if not grown and known:
            return self._overdue(until, owing or known)
        self.hypotheses = grown
        self._note_due()
        return _NOTHING

    def _owes_since(self, hypothesis: Hypothesis, now: int) -> bool:
        """Whether it owes an output whose deadline was before ``now``."""
        owed = hypothesis.owed
        return bool(owed) and not owed[0].optional and owed[0].high + self._bounds.deadline <= now

    # --- violations -----------------------------------------------------------------------------------

    def _unexplained(self, event: TraceEvent) -> Sequence[Verdict]:
        """``event`` cannot be: a violation; go on from what is still certain."""
        if self._may_be_anybodys(event):
            self._forget(event.stamp)
            return self._conclusion.unknown(event.stamp, ANYBODY.format(event.stream[1]))
        before = self.hypotheses or []
        survivors = survivors_of(self.search, before, event)
        places = self._places_of(survivors)
        missed = [*places, *self._calls]
        is_open = event.role is not Role.UNDECLARED
        if is_open and self._may_have_missed(missed, event.stamp):
            self._forget(event.stamp)
            return self._conclusion.unknown(event.stamp, MISSED)
        explanation = explanation_of(self.search, survivors, event, self._history)
        undeclared = event.role is Role.UNDECLARED
        cause = Cause.UNDECLARED if undeclared else Cause.UNEXPECTED
        verdict = self._verdict_of(event.stamp, explanation, cause)
        violation = self._violation(verdict, event.stamp, False, places)
        violation.is_certain = undeclared
        verdicts, is_known = self._conclusion.found(violation)
        self._history.append(event)
        if is_known:
            self._recover(before, event, event.stamp)
        else:
            self._forget(event.stamp)
        return verdicts

    def _note_caller(self, event: TraceEvent, callers: set[str]) -> None:
        """The machine did what ``event`` says, as it should: calls on this channel are its own."""
        if event.role is Role.OUTPUT and self._conclusion.outcome is not _INCONCLUSIVE:
            callers.add(event.stream[1])

    def _may_be_anybodys(self, event: TraceEvent) -> bool:
        """Whether ``event`` is of a call that somebody made who is in no model."""
        if self._callers is None or event.observation.kind not in CLIENT_END:
            return False
        return event.stream[1] not in self._callers

    def _overdue(self, until: int, before: list[Hypothesis]) -> Sequence[Verdict]:
        """What ``before`` owe has not come."""
        places = self._places_of(before)
        if self._may_have_missed(places, until):
            self._forget(until)
            return self._conclusion.unknown(until, MISSED)
        explanation = explanation_of(self.search, before, None, self._history)
        verdict = self._verdict_of(until, explanation, Cause.UNRESPONSIVE)
        violation = self._violation(verdict, until, True, places)
        owed = [h.owed[0] for h in before if h.owed]
        calls = {(item.interface, item.call) for item in owed if item.kind is OutputKind.RESPONSE}
        if len(owed) == len(before) and len(calls) == 1:
            ((_, violation.call),) = calls
        return self._was_silent(violation)

    def _was_silent(self, violation: Violation) -> Sequence[Verdict]:
        """What was to come did not: its node stands still, or left it out."""
        verdicts, _ = self._conclusion.found(violation)
        self._stands_still(violation.until_ns)
        return verdicts

    def _violation(
        self, verdict: Verdict, until: int, is_silence: bool, places: list[Place]
    ) -> Violation:
        return Violation(verdict, self._known_since, until, is_silence, places)

    def _verdict_of(self, stamp: int, explanation: Explanation, cause: Cause) -> Verdict:
        return violation_of(self._name, self._node, stamp, explanation, cause)

    def _places_of(self, before: list[Hypothesis]) -> list[Place]:
        """Where what ``before`` owe would come."""
        channel_of = self.search.program.channel_of_output
        found: dict[Place, None] = {}
        for item in (h.owed[0] for h in before if h.owed):
            part, is_message = _PARTS.get(item.kind, ("", item.kind is OutputKind.PUBLISH))
            found[self._node, channel_of(item.kind, item.interface) + part, is_message] = None
        return list(found)

    def _recover(self, before: list[Hypothesis], event: TraceEvent, stamp: int) -> None:
        """After a violation: as if what was owed had come, else from any state."""
        search = self.search
        found: list[Hypothesis] = []
        try:
            if event.role is Role.UNDECLARED:
                found = before
            elif event.role is Role.INPUT:
                open_ = search.reachable(before, stamp, stamp)
                clear = [self._as_if_fulfilled(h, stamp) for h in open_]
                found = search.inputs.take(clear, event)
            if not found:
                found = search.beginnings.unconstrained_states(stamp, self._under_way(stamp))
        except (TooManyError, TooOpenError):
            self._forget(stamp)
            return
        self.hypotheses, search.last = found, stamp
        self._running = None
        self._silent_since = 0
        self._followed_since = stamp
        self._note_due()

    def _as_if_fulfilled(self, hypothesis: Hypothesis, stamp: int) -> Hypothesis:
        """``hypothesis`` without what it owed, its timers brought up to ``stamp``."""
        limit = stamp - self._bounds.latency
        timers = hypothesis.timers
        skipped = tuple(timer.not_before(limit) if timer.period else timer for timer in timers)
        return hypothesis.but(owed=(), timers=skipped)

    def _under_way(self, stamp: int) -> tuple[TraceEvent, ...]:
        """Messages that may or may not have been taken by ``stamp``."""
        kept = {id(event): event for h in self.hypotheses or () for event in h.pending}
        events = sorted(kept.values(), key=lambda event: event.stamp)
        oldest = stamp - self._bounds.latency - self._bounds.skew
        recent = [event for event in events if event.stamp > oldest]
        for event in recent:
            event.may_be_lost = True
        return tuple(recent)

    # --- not known, and resynchronised ----------------------------------------------------------------

    def _give_up(self, stamp: int, why: Exception) -> Sequence[Verdict]:
        """There is too much to follow; it is tried again after a while, as that costs time."""
        self._forget(stamp)
        self._next_try = self._waited(stamp, stamp - self._known_since)
        return self._conclusion.unknown(stamp, str(why) or "too many possibilities to follow")

    def _waited(self, stamp: int, known_ns: int) -> int:
        """When (ns) to try again: where that helped for a short time only, after twice the time of before.

        Args:
            stamp: now (ns).
            known_ns: for so long it was known what the machine does.
        """
        least = self._bounds.deadline
        doubled = min(2 * self._pause_ns, MOST_PAUSES * least)
        self._pause_ns = max(least, doubled if known_ns < self._pause_ns else 0)
        return stamp + self._pause_ns

    def _stands_still(self, since_ns: int) -> None:
        """The node stands still for longer than the deadline: what it does next tells the machine's state."""
        self._forget(since_ns)
        self.resynchronisation.begin(since_ns, self.search.last, stands_still=True)
        self.gave_up_ns = None

    def _forget(self, stamp: int) -> None:
        self.hypotheses = self._running = None
        self.since_start = False
        self.gave_up_ns = stamp
        self.due_ns = self._next_try = self._next_busy = AT_ONCE

    def _try_to_resynchronise(self, until: int) -> Sequence[Verdict]:
        """Begin anew where the machine was certainly between two steps; if it never is, at any moment."""
        self.due_ns = self._next_try = until + self._bounds.latency // TRIES
        resynchronisation, beginnings = self.resynchronisation, self.search.beginnings
        anchor = resynchronisation.find(until)
        is_busy = anchor is None
        if anchor is None and self._next_busy <= until:
            anchor = resynchronisation.find_busy(until)
        if anchor is None:
            return _NOTHING
        acted_ns = anchor if is_busy else resynchronisation.acted_ns
        if resynchronisation.may_be_slow:
            # a callback may have run until then, and what came meanwhile waits, or is what it took
            self.search.successors.was_silent(anchor - self._bounds.deadline, anchor)
            self.search.successors.stood_still(anchor - self._bounds.deadline, anchor)
        else:
            self._note_silence(acted_ns, anchor)
        events = resynchronisation.remembered()
        pending = self._perhaps_under_way(events, anchor)
        try:
            if pending:
                self.search.check_pending(len(pending), pending[-1])
            self.hypotheses = (
                beginnings.unfinished_steps(anchor, pending)
                if is_busy
                else beginnings.unconstrained_states(anchor, pending)
            )
        except (TooManyError, TooOpenError):
            if is_busy:
                self._next_busy = self._waited(until, 0)
            return _NOTHING
        resynchronisation.found()
        self.search.last = self._known_since = self._followed_since = anchor
        self._silent_since = 0 if is_busy else acted_ns
        self._note_due()
        verdicts: list[Verdict] = []
        later = [event for event in events if event.stamp_ns > anchor]
        left = deque(later)
        while left:
            verdicts += self.advance(left[0].stamp_ns - 1)
            if self.gave_up_ns is None:
                verdicts += self.observe(left.popleft())
            if self.gave_up_ns is not None:
                for rest in left:
                    self.resynchronisation.remember(rest)
                return verdicts
        if later:
            self._note_due()
            self._note_knowledge()
        return verdicts

    def _perhaps_under_way(self, events: list[TraceEvent], now: int) -> tuple[TraceEvent, ...]:
        """Those of ``events``, in order, that may or may not have been taken by ``now``.

        The machine is followed from then on (ns).
        """
        oldest = self.search.successors.due_since(now) - self._bounds.skew
        near = [it for it in events if it.role is Role.MESSAGE and oldest < it.stamp]
        under_way = tuple(event for event in near if event.stamp_ns <= now)
        for event in under_way:
            event.may_be_lost = True
        return under_way


def _shows_standstill(known: list[Hypothesis], event: TraceEvent, bounds: Bounds) -> bool:
    """Whether ``event`` shows that its node stood still, which did nothing for longer than the latency bound.

    That is so if the machine may owe something that would be out else, or if it takes now what was sent
    longer ago than that.
    """
    if event.role is Role.INPUT and 0 < event.sent < event.stamp - bounds.latency - bounds.skew:
        return True
    for hypothesis in known:
        owed = hypothesis.owed
        if owed and not owed[0].optional and owed[0].high < event.stamp:
            return True
    return False
