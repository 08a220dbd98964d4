"""The oracle of one machine: observations in, verdicts out.

Observations of different channels do not come in the order in which things happened, so each is
kept for one latency bound before it is judged, in its place among the others. A violation is
therefore only said when nothing that could still come would explain it, and never taken back.
"""

from __future__ import annotations

from bisect import insort
from collections import deque
from operator import attrgetter
from pathlib import Path

from m2c.model.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import EventKind, Machine
from m2c.model.system import library_for
from moon.oracle.anchoring import Anchoring
from moon.oracle.bounds import FOREVER, Bounds, TooManyError
from moon.oracle.channels import Channels
from moon.oracle.clock import Clock
from moon.oracle.explain import explanation_of, told
from moon.oracle.facts import Fact, Role
from moon.oracle.hypothesis import Hypothesis
from moon.oracle.lanes import Count, Lanes, Sequel
from moon.oracle.progress import Progress
from moon.oracle.search import Search
from moon.oracle.steps import TooOpenError
from moon.oracle.suspicions import Losses, Suspicions
from moon.oracle.uptake import Uptake
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from transports.interface import Observation, ObservationKind

EVIDENCE = 12
"""So many observations are kept for explanations."""

_STAMP = attrgetter("stamp")
_TAKEN_UP = (EventKind.REQUEST, EventKind.GOAL)


class Oracle:
    """Checks one running machine against its model.

    Args:
        machine: the model.
        library: message types; found beside the model if not given.
        node: the node that runs it; by default called as the machine.
        bounds: what is assumed of the middleware.
        synchronised: whether the first observation comes from a machine that has just started.
        losses: whether observations get lost, known to all oracles of one tap.
        clock: how far time has passed, for all oracles of one monitor.
    """

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary | None = None,
        node: str = "",
        bounds: Bounds | None = None,
        synchronised: bool = True,
        losses: Losses | None = None,
        clock: Clock | None = None,
    ) -> None:
        self.losses = losses or Losses()
        self._clock = clock or Clock()
        self._suspicions = Suspicions()
        if library is None:
            library = library_for([Path(machine.position.file)], [], DiagnosticLog())
        self.machine = machine
        self.node = node or machine.name
        self.bounds = bounds or Bounds()
        self.channels = Channels(machine, library, self.node)
        self.search = Search(machine, library, self.channels, self.bounds)
        self._lanes = Lanes(self.channels, self.node)
        self._latency = self.bounds.latency
        self._progress = Progress()
        self._alone = not self.channels.hears_others
        """Everything that concerns the machine is told by its own node: it is known how far that is."""
        self._certain_since = 0
        """Since when (ns) what the machine does is known; what was lost before does not matter."""
        self._anchoring = Anchoring(self._latency)
        self.outcome = Outcome.CONFORMING
        self.violations = 0
        self.inputs = 0
        self.outputs = 0
        self.repeated = 0
        """Observations heard twice."""
        self.late = 0
        """Observations that came after their time, and others that could not be used."""
        self._base: list[Hypothesis] | None = None
        self._window: list[Fact] = []
        """What is not judged yet, in order."""
        self._history: deque[Fact] = deque(maxlen=EVIDENCE)
        self._finished = 0
        self._synchronised = synchronised
        self._listening_since: int | None = None
        self._uptake = Uptake(self.bounds.deadline)
        self._reason = ""
        self._next_due = FOREVER
        self.wake = 0
        """Until this is settled (ns), time alone changes nothing."""
        self._droppable_until = 0
        self._lost_until = 0
        self._from_start = False

    # --- what a user calls -------------------------------------------------------------------------

    def start(self, stamp_ns: int, whole: bool = False) -> None:
        """The machine starts now, in its initial state.

        Args:
            stamp_ns: when, ns since the epoch.
            whole: nothing was missed: its timers run from this very moment, what it sends at once is
                heard, and it hears all that is sent from now on. Otherwise these are uncertain for
                one latency bound.
        """
        self._synchronised = True
        self._window.clear()
        self._uptake.clear()
        self._lanes.restart()
        self._progress.restart()
        self._begin(stamp_ns, whole)
        self._droppable_until = 0 if whole else stamp_ns + self.bounds.latency
        self._finished = max(self._finished, stamp_ns - self.bounds.latency)
        self.outcome, self._reason = Outcome.CONFORMING, ""

    def observe(self, observation: Observation) -> Verdict:
        """Take one observation; the verdict as it stands then."""
        verdicts = self.feed(observation)
        return verdicts[-1] if verdicts else self.verdict(observation.stamp_ns)

    def verdict(self, stamp_ns: int = 0) -> Verdict:
        """The verdict as it stands."""
        return Verdict(self.machine.name, self.node, self.outcome, stamp_ns, self._reason)

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether observations like this can mean anything to the machine."""
        return self.channels.concerns(channel, source, kind)

    def feed(self, observation: Observation) -> list[Verdict]:
        """Take one observation; verdicts that it, and the time that has passed, bring about."""
        lane = self._lanes.of(observation)
        verdicts: list[Verdict] = []
        count = lane.count
        if count is not None:
            number = observation.sequence
            if number == count.next and not self._suspicions.kept:
                count.next, count.stamp = number + 1, observation.stamp_ns
            elif number >= 0 and not self._follows(observation, count, verdicts):
                return verdicts + self.advance(observation.received_ns)
        fact: Fact | None = None
        more: list[Fact] | None = None
        read = lane.read
        try:
            if read is not None:
                fact = read(observation)
                if lane.more:
                    found = (other(observation) for other in lane.more)
                    more = [item for item in found if item is not None]
        except (KeyError, TypeError, ValueError, AttributeError):
            self.late += 1
            text = f"an observation on {observation.channel} cannot be read"
            verdicts += self.lose(observation.stamp_ns, text)
        received_ns = observation.received_ns
        if self._clock.settled > self._finished:
            self._finished = self._clock.settled
        settled = received_ns - self._latency
        progress, order = self._progress, observation.order
        if lane.own and order >= 0:
            if order == progress.next and not progress.ahead:
                progress.next, progress.heard = order + 1, observation.stamp_ns
            else:
                progress.take(order, observation.stamp_ns, settled)
            if self._alone and settled >= self._droppable_until:  # before, not all was told
                heard = progress.heard
                if heard > settled:
                    settled = heard if heard < received_ns else received_ns
            if (
                fact is not None
                and not more
                and settled < self.wake
                and self._at_once(fact, settled)
            ):
                return verdicts
        if fact is not None:
            self._take(fact, verdicts)
        if more:
            for fact in more:
                self._take(fact, verdicts)
        if settled < self.wake:
            if settled > self._finished:
                self._finished = settled
            return verdicts
        return verdicts + self._settle(settled)

    def _at_once(self, fact: Fact, settled: int) -> bool:
        """Whether ``fact``, the next thing that happened, is judged here and now.

        A short cut for what ``_take`` and ``_settle`` do where nothing waits to be judged, nothing is due
        by ``settled`` (ns), and the machine can have done one thing only.
        """
        base, stamp = self._base, fact.stamp
        if base is None or len(base) != 1 or self._window or not self._finished < stamp <= settled:
            return False
        only = self.search.only(base[0], fact)
        if only is None or self.outcome is Outcome.INCONCLUSIVE:
            return False
        if fact.role is Role.OUTPUT:
            self.outputs += 1
        else:
            self.inputs += 1
            if fact.event is not None and fact.event[0] in _TAKEN_UP:
                self._uptake.take(fact, self._finished)
        self.search.last = stamp
        self._base = [only]
        self._history.append(fact)
        self._finished = settled
        due = self._next_due = self.search.next_due(only)
        self._wake_at(due if due < self._uptake.due else self._uptake.due)
        return True

    def advance(self, now_ns: int) -> list[Verdict]:
        """Time has passed: what can no longer change is settled, what is overdue is said.

        Args:
            now_ns: on the clock of ``Observation.received_ns``.
        """
        settled = now_ns - self._latency
        if settled < self.wake:
            if settled > self._finished:
                self._finished = settled
            return []
        return self._settle(settled)

    def _settle(self, settled: int) -> list[Verdict]:
        """All that happened until ``settled`` (ns) has been heard."""
        if settled <= self._finished:
            return []
        if settled < self.wake:
            self._finished = settled
            return []
        verdicts: list[Verdict] = []
        if self._progress.ahead:
            self._progress.settle(settled)
        if self._window:
            verdicts += self._judge(settled)
        self._finished = settled
        if self._base is not None and self._next_due <= settled:
            verdicts += self._time_passed(settled)
        if self._uptake.due <= settled:
            verdicts += self._not_taken_up(settled)
        if self._base is None and self._listening_since is not None:
            verdicts += self._try_to_anchor(settled)
        self._wake_at(self._next_time())
        return verdicts

    def _wake_at(self, due: int) -> None:
        self.wake = due
        if due < self._clock.wake:
            self._clock.wake = due

    def _next_time(self) -> int:
        """Until this time (ns) nothing is settled, due or to be found."""
        if self._base is None:
            return FOREVER if self._listening_since is None else 0
        wake = self._next_due if self._next_due < self._uptake.due else self._uptake.due
        if self._window and self._window[0].stamp < wake:
            wake = self._window[0].stamp
        return wake

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """What the machine may be doing, by all that was heard until now."""
        base = self._base or []
        if not base or not self._window:
            return base
        last = self.search.last
        try:
            for fact in self._window:
                after = self.search.after(base, fact)
                if not after:
                    break  # late observations may still explain it
                base = after
        except (TooManyError, TooOpenError):
            return self._base or []
        finally:
            self.search.last = last
        return base

    def states(self) -> list[str]:
        """Names of the states in which the machine may be."""
        program = self.search.programs[0]
        found = {program.states[h.instances[0][0]].name for h in self.hypotheses}
        return sorted(found)

    # --- taking facts ------------------------------------------------------------------------------

    def _follows(self, observation: Observation, count: Count, verdicts: list[Verdict]) -> bool:
        """Whether this is new; what its number tells of losses goes to ``verdicts``."""
        stamp, number = observation.stamp_ns, observation.sequence
        sequel = count.sequel(number, stamp)
        if sequel is Sequel.AGAIN:
            self.repeated += 1
            return False
        if self._suspicions.kept:
            proven = self._suspicions.hear(count.place, number, stamp)
            verdicts += [v for verdict in proven for v in self._convict(verdict, certain=True)]
        match sequel:
            case Sequel.FIRST if number > 0 and self._is_expected(observation):
                # a number above 0 comes first where a tap joins later, or where the first was lost
                text = f"what came first on {observation.channel} was not heard"
                verdicts += self.lose(stamp, text)
            case Sequel.AFTER_A_GAP:
                self.losses.happen = True
                text = f"observations on {observation.channel} from {observation.source} were lost"
                verdicts += self.lose(stamp, text)
            case Sequel.ANEW if observation.source == self.node:
                self._progress.restart()
                verdicts += self.lose(stamp, f"{self.node} was restarted")
        return True

    def _is_expected(self, observation: Observation) -> bool:
        """Whether its channel's first observation should have been heard by now."""
        if self.losses.happen:
            return self._base is not None
        return self._from_start and observation.source == self.node

    def _take(self, fact: Fact, verdicts: list[Verdict]) -> None:
        role, stamp = fact.role, fact.stamp
        if role is Role.ASKED:
            if stamp > self._lost_until:
                self._uptake.ask(fact)
                self._wake_at(min(self.wake, self._uptake.due))
            return
        if role is Role.OUTPUT or role is Role.STRANGE:
            self.outputs += 1
        elif role is Role.MESSAGE or role is Role.INPUT:
            self.inputs += 1
        if role is Role.INPUT and fact.event is not None and fact.event[0] in _TAKEN_UP:
            self._uptake.take(fact, self._finished)
        if self._listening_since is None:
            self._listen(stamp)
        if self._base is None:
            self._anchoring.remember(fact, self._finished)
        elif stamp <= self._finished:
            self.late += 1
            text = f"an observation on {fact.observation.channel} came too late"
            verdicts += self.lose(stamp, text)
        else:
            fact.droppable = stamp < self._droppable_until
            self._keep(fact)

    def _listen(self, stamp: int) -> None:
        """The first fact is from ``stamp``."""
        if self._synchronised:
            self._begin(stamp)
            return
        self._listening_since = stamp
        self._wake_at(0)
        self._anchoring.begin(stamp)
        self.outcome = Outcome.INCONCLUSIVE
        self._reason = "started in the middle: waiting for a moment that is certain"

    def _keep(self, fact: Fact) -> None:
        """Put ``fact`` in its place; mostly that is the last."""
        stamp, window = fact.stamp, self._window
        if stamp < self.wake:
            self._wake_at(stamp)
        if not window or window[-1].stamp <= stamp:
            window.append(fact)
        else:
            insort(window, fact, key=_STAMP)

    def _begin(self, stamp: int, whole: bool = False) -> None:
        self._listening_since = self._certain_since = stamp
        self._from_start = True
        self._base = self.search.started(stamp, whole)
        self._wake_at(0)
        self.search.last = 0
        self._note_due()

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
            only = search.only(base[0], fact) if len(base) == 1 else None
            if only is not None:
                search.last = stamp
                self._base = [only]
                self._history.append(fact)
                continue
            try:
                after = self.search.after(base, fact)
            except (TooManyError, TooOpenError) as error:
                text = str(error) or "too many possibilities to follow"
                return [*verdicts, *self.lose(stamp, text)]
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
        """Say so once it is known again what the machine does."""
        if not self._base:
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
            grown = search.reachable(alive, settled, settled)
            owing = [*(h for h in base if h.owed), *(h for h in grown if h.owed)]
            grown = [
                search.normalised(h, settled) for h in grown if not self._owes_since(h, settled)
            ]
        except (TooManyError, TooOpenError) as error:
            return self.lose(settled, str(error) or "too many possibilities to follow")
        if not grown and base:
            return self._overdue(settled, owing or base)
        self._base = grown
        self._note_due()
        return []

    def _owes_since(self, hypothesis: Hypothesis, now: int) -> bool:
        """Whether it owes an output whose deadline was before ``now``."""
        owed = hypothesis.owed
        return bool(owed) and not owed[0].optional and owed[0].high + self.bounds.deadline <= now

    def _not_taken_up(self, settled: int) -> list[Verdict]:
        """Requests that others sent and the machine's node never received."""
        verdicts = []
        for fact in self._uptake.overdue(settled):
            if self._base is None or not (self.inputs or self._from_start):
                continue  # perhaps its end is not instrumented
            observed = "nothing: the request was not taken up"
            expected = (f"request {fact.call[1]} of {fact.call[0]} to be received",)
            verdicts += self._say(fact.stamp, observed, expected, "unresponsive: ")
        return verdicts

    # --- verdicts ----------------------------------------------------------------------------------

    def _violation(self, fact: Fact) -> list[Verdict]:
        """``fact`` cannot be: say so, and go on from what is still certain."""
        before = self._base or []
        explanation = explanation_of(self.search, before, fact, self._history)
        certain = fact.role is Role.STRANGE
        verdicts = self._convict(self._verdict_of(fact.stamp, explanation), certain)
        self._history.append(fact)
        if self._is_doubtful() and not certain:
            self._forget(fact.stamp)
        else:
            self._recover(before, fact)
        return verdicts

    def _overdue(self, settled: int, base: list[Hypothesis]) -> list[Verdict]:
        explanation = explanation_of(self.search, base, None, self._history)
        verdicts = self._convict(self._verdict_of(settled, explanation, "unresponsive: "))
        if self._is_doubtful():
            self._forget(settled)
        else:
            self._recover(base, None)
        return verdicts

    def _is_doubtful(self) -> bool:
        """Whether something that its node told since its doing is known was not heard, and may concern it."""
        return self._progress.gap > self._certain_since

    def _recover(self, before: list[Hypothesis], fact: Fact | None) -> None:
        """After a violation: as if what was owed had come, else from any state."""
        search = self.search
        stamp = self._finished if fact is None else fact.stamp
        found: list[Hypothesis] = []
        try:
            if fact is not None and fact.role is Role.STRANGE:
                found = before
            elif fact is None or fact.role is Role.INPUT:
                settled = [h.with_owed(()) for h in search.reachable(before, stamp, stamp)]
                found = settled if fact is None else search.take_input(settled, fact)
            if not found:
                found = search.anything(stamp, self._unsettled(stamp))
        except (TooManyError, TooOpenError):
            self._forget(stamp)
            return
        self._base, search.last = found, stamp
        self._wake_at(0)
        self._note_due()

    def _unsettled(self, stamp: int) -> tuple[Fact, ...]:
        """Messages that may or may not have been taken by ``stamp``."""
        kept = {id(f): f for h in self._base or () for f in h.pending}
        facts = sorted(kept.values(), key=lambda f: f.stamp)
        recent = [f for f in facts if f.stamp > stamp - self.bounds.latency]
        for fact in recent:
            fact.droppable = True
        return tuple(recent)

    def _say(
        self, stamp: int, observed: str, expected: tuple[str, ...], prefix: str = ""
    ) -> list[Verdict]:
        evidence = tuple(Evidence(f.stamp, told(f)) for f in self._history)
        explanation = Explanation(expected, observed, (), evidence)
        return self._convict(self._verdict_of(stamp, explanation, prefix))

    def _verdict_of(self, stamp: int, explanation: Explanation, prefix: str = "") -> Verdict:
        expected = " or ".join(explanation.expected) or "nothing"
        reason = f"{prefix}expected {expected}, observed {explanation.observed}"
        return Verdict(self.machine.name, self.node, Outcome.VIOLATED, stamp, reason, explanation)

    def _convict(self, verdict: Verdict, certain: bool = False) -> list[Verdict]:
        """Say ``verdict``; where observations get lost, only once none can be missing.

        None is, when the next observation of every channel concerned has come and its number
        follows.
        """
        if not certain and (self.losses.happen or self._is_doubtful()):
            self._suspicions.add(verdict, self._lanes.counts.values())
            if self.outcome is Outcome.INCONCLUSIVE:
                return []
            self.outcome = Outcome.INCONCLUSIVE
            self._reason = f"observations were lost; if none is missing here: {verdict.reason}"
            return [self.verdict(verdict.stamp_ns)]
        self.violations += 1
        self.outcome = Outcome.VIOLATED
        self._reason = verdict.reason
        return [verdict]

    # --- losing and finding the thread -------------------------------------------------------------

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

    def _forget(self, stamp: int) -> None:
        stamps = (min(fact.stamp, fact.observation.received_ns) for fact in self._window)
        newest = max(stamps, default=0)
        if self._base is not None:
            newest = max(newest, self.search.last)
        self._synchronised = False
        self._from_start = False
        self._base = None
        self._wake_at(0)
        self._window.clear()
        self._uptake.clear()
        self._lost_until = stamp + self._latency
        self._listening_since = stamp
        self._anchoring.begin(max(stamp, newest))

    def _try_to_anchor(self, settled: int) -> list[Verdict]:
        """Begin anew where the machine was certainly between two steps."""
        found = self._anchoring.find(settled)
        if found is None:
            return []
        anchor, pending, later = found
        try:
            self._base = self.search.anything(anchor, pending)
        except TooManyError:
            return []
        self._anchoring.found()
        self.search.last = self._certain_since = anchor
        self._note_due()
        for fact in later:
            self._keep(fact)
        return self._judge(settled)
