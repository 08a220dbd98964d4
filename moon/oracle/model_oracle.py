"""The judge of one machine: what happened goes in, in order; what the model says to that comes out.

It is a ``moon.ordering.judge.Judge`` of what a machine took and did: every event comes when it is its turn,
once. Who puts in order what is received is of no concern here (``delivery``), nor is by which numbers a
violation becomes certain (``confirmation``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from m2c.model.machine import OutputKind
from moon.oracle.bounds import FOREVER, TooManyError
from moon.oracle.confirmation import Conclusion, Violation
from moon.oracle.explain import described, explanation_of
from moon.oracle.program import TooOpenError
from moon.oracle.resynchronisation import Resynchronisation
from moon.oracle.search import Search
from moon.oracle.state import Hypothesis
from moon.oracle.trace_events import Role, TraceEvent
from moon.ordering.judge import Gap
from moon.ordering.numbers import Place
from moon.verdict import Evidence, Explanation, Outcome, Verdict

EVIDENCE = 12
"""So many events are kept for explanations."""

TRIES = 20
"""So many times in a latency bound it is tried to find a machine of which nothing is known."""

AT_ONCE = 0
"""As ``due_ns``: it is to be told how far time has passed, now that something happened."""

_INCONCLUSIVE = Outcome.INCONCLUSIVE  # looked up for every event
_NOTHING: list[Verdict] = []
"""Of most events nothing is said; never changed."""

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

    Attributes:
        hypotheses: what the machine may be doing after the last event; None: that is not known.
        due_ns: from then on it decides something if nothing more happens; FOREVER: it does not.
        search: the hypotheses of the machine.
        gave_up_ns: since then it does not know any more what the machine does, and waits for ``listen``;
            None where it does not wait.
        since_start: whether it is known what the machine did since it started.
    """

    def __init__(self, name: str, node: str, search: Search, conclusion: Conclusion) -> None:
        self.hypotheses: list[Hypothesis] | None = None
        self.due_ns = FOREVER
        self.gave_up_ns: int | None = None
        self.since_start = False
        self.resynchronisation = Resynchronisation(search.bounds.latency)
        self._name = name
        self._node = node
        self.search = search
        self._bounds = search.bounds
        self._conclusion = conclusion
        self._history: deque[TraceEvent] = deque(maxlen=EVIDENCE)
        self._known_since = 0
        """Since when (ns) it is known what the machine does."""
        self._linked_ns = 0
        self._next_try = 0
        """Not before this (ns) is it tried again to find what the machine does."""

    # --- what the node does ---------------------------------------------------------------------------

    def start(self, stamp_ns: int, whole: bool = False, linked_ns: int = 0) -> None:
        """The machine starts, in its initial state.

        Args:
            stamp_ns: when, ns since the epoch.
            whole: whether its timers run from that very moment, and what it sends at once is known.
            linked_ns: what is sent to it before that (ns) may not reach it.
        """
        self._known_since = stamp_ns
        self._linked_ns = linked_ns
        self.since_start = True
        self.gave_up_ns = None
        self.hypotheses = self.search.successors.started(stamp_ns, whole)
        self.search.last = 0
        self._note_due()

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
        if len(known) == 1:
            only = search.deterministic_successor.of(known[0], event)
            if only is not None:
                search.last = event.stamp
                self.hypotheses = [only]
                self._history.append(event)
                is_open = self._conclusion.outcome is _INCONCLUSIVE
                self.due_ns = AT_ONCE if is_open else search.next_due(only)
                return _NOTHING
        event.may_be_lost = event.stamp < self._linked_ns
        said: Sequence[Verdict] = _NOTHING
        try:
            after = search.after(known, event)
        except (TooManyError, TooOpenError) as error:
            said = self._give_up(event.stamp, error)
        else:
            if after:
                self.hypotheses = after
                self._history.append(event)
            else:
                said = self._unexplained(event)
        self.due_ns = AT_ONCE
        return said

    def gap(self, gap: Gap) -> Sequence[Verdict]:
        """Something is missing: nothing is said until the machine's doing is certain again."""
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
        explanation = Explanation((expected,), f"nothing: {why}", (), evidence)
        verdict = self._verdict_of(event.stamp, explanation, "unresponsive: ")
        places = [(self._node, event.observation.channel, False)]
        return self._conclusion.found(self._violation(verdict, until_ns, True, places))[0]

    def foreseen(self, events: Sequence[TraceEvent]) -> list[Hypothesis]:
        """What the machine may be doing if these events come next, which are not handed over yet."""
        known = self.hypotheses or []
        if not known or not events:
            return known
        last = self.search.last
        try:
            for event in events:
                event.may_be_lost = event.stamp < self._linked_ns
                after = self.search.after(known, event)
                if not after:
                    break  # what comes before it may still explain it
                known = after
        except (TooManyError, TooOpenError):
            return self.hypotheses or []
        finally:
            self.search.last = last
        return known

    # --- what time brings about -----------------------------------------------------------------------

    def _note_due(self) -> None:
        next_due = self.search.next_due
        self.due_ns = min(map(next_due, self.hypotheses or ()), default=FOREVER)

    def _note_knowledge(self) -> None:
        """Say so once it is known again what the machine does, and nothing that it did is open."""
        if self._conclusion.outcome is _INCONCLUSIVE and self.hypotheses:
            states = {tuple(state for state, _ in h.instances) for h in self.hypotheses}
            if len(states) == 1:
                self._conclusion.known()

    def _time_passed(self, until: int) -> Sequence[Verdict]:
        """Inputs that must have been taken, outputs that should have come."""
        search = self.search
        known = self.hypotheses or []
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
        """``event`` cannot be: say so, and go on from what is still certain."""
        before = self.hypotheses or []
        explanation = explanation_of(self.search, before, event, self._history)
        verdict = self._verdict_of(event.stamp, explanation)
        violation = self._violation(verdict, event.stamp, False, self._places_of(before))
        violation.is_certain = event.role is Role.UNDECLARED
        said, is_known = self._conclusion.found(violation)
        self._history.append(event)
        if is_known:
            self._recover(before, event, event.stamp)
        else:
            self._forget(event.stamp)
        return said

    def _overdue(self, until: int, before: list[Hypothesis]) -> Sequence[Verdict]:
        """What ``before`` owe has not come."""
        places = self._places_of(before)
        if self._conclusion.may_have_missed(places, until):
            self._forget(until)
            return self._conclusion.unknown(until, "what it sent may not have been received yet")
        explanation = explanation_of(self.search, before, None, self._history)
        verdict = self._verdict_of(until, explanation, "unresponsive: ")
        violation = self._violation(verdict, until, True, places)
        owed = [h.owed[0] for h in before if h.owed]
        calls = {item.call for item in owed if item.kind is OutputKind.RESPONSE}
        if len(owed) == len(before) and len(calls) == 1:
            violation.call = calls.pop()
            violation.asked_ns = min(item.low for item in owed)
        said, is_known = self._conclusion.found(violation)
        if is_known:
            self._recover(before, None, until)
        else:
            self._forget(until)
        return said

    def _violation(
        self, verdict: Verdict, until: int, is_silence: bool, places: list[Place]
    ) -> Violation:
        return Violation(verdict, self._known_since, until, is_silence, places)

    def _verdict_of(self, stamp: int, explanation: Explanation, prefix: str = "") -> Verdict:
        expected = " or ".join(explanation.expected) or "nothing"
        reason = f"{prefix}expected {expected}, observed {explanation.observed}"
        return Verdict(self._name, self._node, Outcome.VIOLATED, stamp, reason, explanation)

    def _places_of(self, before: list[Hypothesis]) -> list[Place]:
        """Where what ``before`` owe would come."""
        channel_of = self.search.program.channel_of_output
        found: dict[Place, None] = {}
        for item in (h.owed[0] for h in before if h.owed):
            part, is_message = _PARTS.get(item.kind, ("", item.kind is OutputKind.PUBLISH))
            found[self._node, channel_of(item.kind, item.interface) + part, is_message] = None
        return list(found)

    def _recover(self, before: list[Hypothesis], event: TraceEvent | None, stamp: int) -> None:
        """After a violation: as if what was owed had come, else from any state."""
        search = self.search
        found: list[Hypothesis] = []
        try:
            if event is not None and event.role is Role.UNDECLARED:
                found = before
            elif event is None or event.role is Role.INPUT:
                settled = [h.with_owed(()) for h in search.reachable(before, stamp, stamp)]
                found = settled if event is None else search.inputs.take(settled, event)
            if not found:
                found = search.successors.unconstrained_states(stamp, self._unsettled(stamp))
        except (TooManyError, TooOpenError):
            self._forget(stamp)
            return
        self.hypotheses, search.last = found, stamp
        self._note_due()

    def _unsettled(self, stamp: int) -> tuple[TraceEvent, ...]:
        """Messages that may or may not have been taken by ``stamp``."""
        kept = {id(event): event for h in self.hypotheses or () for event in h.pending}
        events = sorted(kept.values(), key=lambda event: event.stamp)
        recent = [event for event in events if event.stamp > stamp - self._bounds.latency]
        for event in recent:
            event.may_be_lost = True
        return tuple(recent)

    # --- losing and finding the thread ----------------------------------------------------------------

    def _give_up(self, stamp: int, why: Exception) -> Sequence[Verdict]:
        """There is too much to follow; it is tried again after a while, as that costs time."""
        self._forget(stamp)
        self._next_try = stamp + self._bounds.deadline
        return self._conclusion.unknown(stamp, str(why) or "too many possibilities to follow")

    def _forget(self, stamp: int) -> None:
        self.hypotheses = None
        self.since_start = False
        self.gave_up_ns = stamp
        self.due_ns = self._next_try = AT_ONCE

    def _try_to_resynchronise(self, until: int) -> Sequence[Verdict]:
        """Begin anew where the machine was certainly between two steps."""
        self.due_ns = self._next_try = until + self._bounds.latency // TRIES
        found = self.resynchronisation.find(until)
        if found is None:
            return _NOTHING
        anchor, pending, later = found
        try:
            if pending:
                self.search.check_pending(len(pending), pending[-1])
            self.hypotheses = self.search.successors.unconstrained_states(anchor, pending)
        except TooManyError:
            return _NOTHING
        self.resynchronisation.found()
        self.search.last = self._known_since = anchor
        self._note_due()
        said: list[Verdict] = []
        for place, event in enumerate(later):
            said += self.observe(event)
            if self.gave_up_ns is not None:
                for rest in later[place + 1 :]:
                    self.resynchronisation.remember(rest)
                return said
        if later:
            self._note_due()
            self._note_knowledge()
        return said
