"""The oracle of a behaviour-tree policy: what it calls must be what its tree would tick.

It listens to the policy's own end of its calls: they come from one process, one after the other, so
their stamps order them. What is newer than the latency bound waits, as something older may still be
received, unless the policy's node numbers its reports and none is missing; then each call is compared with
what the very tree, given the answers so far, ticks or halts next (``moon.policy.follow``).

What is checked: which leaf is ticked or halted next; that the next call comes while a tick is not
over; that no call is made before the last one is answered; that no tick begins sooner than the rate
allows. The policy waits from when a tick was due, so a late tick may be followed by an early one: the
tick after the next comes no sooner than a period after this one was over.

What is not: what plugins do inside the policy, and when the clock ends a ``Sleep``, ``Delay`` or
``Timeout`` (either is accepted); that a tick begins at all.
"""

from __future__ import annotations

from bisect import insort
from collections import deque
from collections.abc import Hashable, Iterable, Mapping, Sequence

from m2c.model.machine import Machine
from m2c.policy.program import Policy
from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.unconfirmed import UNCONFIRMED, Unconfirmed, Waiting
from moon.ordering.progress import Progress
from moon.policy.calls import Call, HeardElsewhere, call_of, doing_of, status_of
from moon.policy.follow import Fit, Follower, TooManyError
from moon.policy.run import Ask, Life
from moon.policy.shape import shape_of
from moon.verdict import Evidence, Explanation, Outcome, Verdict
from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel, Sequences

EVIDENCE = 12
"""So many calls and answers are kept for explanations."""

KEPT_CALLS = 256
"""Calls that were heard of at their other end only, or that were not seen to end."""

KEPT_CHANNELS = 4096
"""Channels of which the last number is remembered; names come from the wire."""

_OWN = (ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_RECEIVED)
_PARTS = "/_action/"
"""What the names of an action's services have in them; a policy has none but its plugins'."""


class PolicyOracle:
    """Checks a running policy against its behaviour tree.

    Args:
        policy: the tree and its leaves.
        node: the node that runs it.
        bounds: what is assumed of the middleware.
        synchronised: whether the first observation comes from a policy that has just started. If not
            (or after observations were lost), it is found in the middle of its run: every memory the
            tree can have is tried at every call, until one of these was the first of a tick for
            certain. That is done for trees that remember only what is RUNNING (``moon.policy.shape``);
            others stay inconclusive until the policy starts anew.
        plugins: the machines that run leaves of the tree, so that their own calls are known.
        places: ``file:line:column`` of each leaf, by its id.
        rate_hz: at which the tree is ticked; by default the policy's own; 0 if it is not known.

    Raises:
        PolicyError: BehaviorTree.CPP refuses the tree.

    Attributes:
        name: the policy's.
        violations, inputs, outputs: how many were found, answers taken, calls judged.
        repeated, late: observations heard twice, and too late.
    """

    def __init__(
        self,
        policy: Policy,
        node: str = "policy",
        bounds: Bounds | None = None,
        *,
        synchronised: bool = True,
        plugins: Iterable[Machine] = (),
        places: Mapping[str, Sequence[str]] | None = None,
        rate_hz: float | None = None,
    ) -> None:
        self.policy = policy
        self.name = policy.name
        self.node = node
        self.bounds = bounds or Bounds()
        self.outcome = Outcome.CONFORMING
        self.violations = 0
        self.inputs = 0
        self.outputs = 0
        self.repeated = 0
        self.late = 0
        self._shape = shape_of(policy, plugins)
        self._places = places or {}
        rate = policy.tick_rate_hz if rate_hz is None else rate_hz
        self._follower = Follower(policy, self._shape, rate, self.bounds.tolerance)
        self._leaves: dict[str, str] = {}
        """What a call of a channel does."""
        for leaf in policy.leaves:
            if leaf.plugin:
                continue
            for channel, what in ((leaf.tick, "tick"), (leaf.halt, "halt")):
                if channel:
                    self._leaves.setdefault(channel, f"{what} {leaf.name}")
        self._synchronised = synchronised
        self._fresh = synchronised
        """Whether all that the policy ever did was heard: each channel's first number is 0."""
        self._window: list[tuple[int, int, Observation]] = []
        self._count = 0
        self._finished = 0
        self._sequences = Sequences(KEPT_CHANNELS)
        """Of the policy's node, by channel."""
        self._pending: Observation | None = None
        self._last_ns = 0
        self._owed = False
        """Whether the next call has to come within the deadline."""
        self._elsewhere = HeardElsewhere(KEPT_CALLS)
        """Calls of the policy that their server heard, and the policy's end was not."""
        self._own: dict[Call, None] = {}
        """The last calls of the policy that were judged."""
        self._unclear_until = 0
        """Something is known to be missing of what happened until then."""
        self._progress = Progress()
        """Of all that the policy's node reports, where it numbers that."""
        self._since = 0
        """What was lost before (ns) does not matter: the policy was resynchronised then."""
        self._unconfirmed = Unconfirmed()
        self._unanswered: dict[Call, Observation] = {}
        """Calls that were followed by another before their answer was heard."""
        self._life = Life(self._follower.close)  # its runs' threads end with it
        self._history: deque[Evidence] = deque(maxlen=EVIDENCE)
        self._reason = ""
        if self._shape.unchecked:
            self.outcome, self._reason = Outcome.INCONCLUSIVE, self._shape.unchecked

    # --- what a user calls -------------------------------------------------------------------------

    def start(self, stamp_ns: int, whole: bool = False) -> None:
        """The policy starts now, its tree is fresh.

        Args:
            stamp_ns: when, ns since the epoch.
            whole: nothing was missed; it makes no difference here, as numbers show what was.
        """
        self._synchronised = self._fresh = True
        self._since = stamp_ns
        self._unconfirmed.restart()
        if self._progress.heard < stamp_ns:  # of the life before
            self._progress.restart()
        # what has come of it already stays, if that is all of it
        window, numbers = self._window, self._sequences.last
        window[:] = [entry for entry in window if entry[0] >= stamp_ns]
        for channel in [c for c, (_, last_ns) in numbers.items() if last_ns < stamp_ns]:
            del numbers[channel]
        self._sequences.complete = True
        begun: set[Hashable] = {entry[2].channel for entry in window if entry[2].sequence <= 0}
        self._elsewhere.clear()
        self._unanswered.clear()
        self._own.clear()
        self._unclear_until = 0
        self._pending = None
        self._owed = False
        self._finished = max(self._finished, stamp_ns - self.bounds.latency)
        if not self._shape.unchecked:
            self._follower.start()
            self.outcome, self._reason = Outcome.CONFORMING, ""
            if not begun.issuperset(numbers):
                self.lose(self._finished, f"what {self.node} did first was missed")

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether such an observation tells something of the policy."""
        if source == self.node:
            return True
        return channel in self._leaves and kind is not ObservationKind.MESSAGE

    def observe(self, observation: Observation) -> Verdict:
        """Take one observation; the verdict as it stands then."""
        verdicts = self.feed(observation)
        return verdicts[-1] if verdicts else self.verdict(observation.stamp_ns)

    def verdict(self, stamp_ns: int = 0) -> Verdict:
        """The verdict as it stands."""
        return Verdict(self.name, self.node, self.outcome, stamp_ns, self._reason)

    def feed(self, observation: Observation) -> list[Verdict]:
        """Take one observation; verdicts that it, and the time that has passed, bring about."""
        if self._shape.unchecked:
            return []
        channel, kind = observation.channel, observation.kind
        verdicts: list[Verdict] = []
        settled = observation.received_ns - self.bounds.latency
        if observation.source == self.node:
            if observation.order >= 0:
                self._progress.take(observation.order, observation.stamp_ns, settled)
                settled = max(settled, min(self._progress.heard, observation.received_ns))
            if self._unconfirmed.kept:
                verdicts = self._look_at_reports()
            if kind in _OWN and _PARTS not in channel:
                verdicts += self._take(observation)
        elif self.concerns(channel, observation.source, kind):
            self._heard_elsewhere(observation)
        return verdicts if settled <= self._finished else verdicts + self._settle(settled)

    def advance(self, now_ns: int) -> list[Verdict]:
        """Time has passed: what can no longer change is judged, what is overdue is said.

        Args:
            now_ns: on the clock of ``Observation.received_ns``.
        """
        settled = now_ns - self.bounds.latency
        return [] if settled <= self._finished else self._settle(settled)

    def _settle(self, settled: int) -> list[Verdict]:
        """All that happened until ``settled`` (ns) has been heard."""
        self._finished = settled
        verdicts: list[Verdict] = []
        if self._progress.ahead:
            self._progress.settle(settled)
        if self._unconfirmed.kept:
            verdicts += self._look_at_reports()
        window = self._window
        while window and window[0][0] <= settled:
            verdicts += self._judge(window.pop(self._next())[2])
        if self._owed and settled - self._last_ns > self.bounds.deadline:
            verdicts += self._overdue(settled)
        return verdicts

    @property
    def wake(self) -> int:
        """Until all that happened by then (ns) has been heard, time alone changes nothing."""
        wake = self._window[0][0] if self._window else FOREVER
        return min(wake, self._last_ns + self.bounds.deadline + 1) if self._owed else wake

    @property
    def silent_ns(self) -> int:
        """From then on (ns) it decides something if the node did nothing more, and the node can say so.

        FOREVER: nothing is due, or the node's word would not be enough.
        """
        if not self._owed or not self._progress.heard:
            return FOREVER
        due = self._last_ns + self.bounds.deadline + 1
        return due if due > self._finished else FOREVER

    def reported(self, number: int, stamp_ns: int, now_ns: int) -> list[Verdict]:
        """The node was asked how far it is; see ``Oracle.reported``."""
        self._progress.answered(number, stamp_ns)
        verdicts = self._look_at_reports() if self._unconfirmed.kept else []
        settled = max(now_ns - self.bounds.latency, min(self._progress.heard, now_ns))
        return verdicts if settled <= self._finished else verdicts + self._settle(settled)

    @property
    def hypotheses(self) -> Sequence[object]:
        """What the policy may be doing, as far as is known."""
        return self._follower.runs

    def states(self) -> list[str]:
        """What the policy may be doing."""
        return sorted({doing_of(run, self._pending) for run in self._follower.runs})

    # --- taking observations -----------------------------------------------------------------------

    def _take(self, observation: Observation) -> list[Verdict]:
        verdicts: list[Verdict] = []
        number, stamp = observation.sequence, observation.stamp_ns
        if number >= 0:
            sequences, channel = self._sequences, observation.channel
            sequel, _ = sequences.follow(channel, number, stamp)
            if sequel is Sequel.AGAIN:
                self.repeated += 1
                return []
            is_start = sequel is Sequel.FIRST and self._fresh and sequences.complete
            if sequel is Sequel.ANEW:
                sequences.last = {channel: (number, stamp)}  # all are numbered anew
                self._unanswered.clear()
                self._own.clear()
                self._progress.restart()
                self._unconfirmed.restart()
                verdicts = self.lose(stamp - 1, f"{self.node} was restarted")
            elif sequel is Sequel.AFTER_A_GAP or (is_start and number > 0):
                why = f"observations on {channel} from {self.node} were lost"
                verdicts = self.lose(stamp - 1, why)
        if stamp <= self._unclear_until:
            return verdicts
        if stamp <= self._finished:
            self.late += 1
            why = f"an observation on {observation.channel} came too late"
            return [*verdicts, *self.lose(stamp, why)]
        self._count += 1
        insort(self._window, (stamp, self._count, observation), key=lambda entry: entry[:2])
        return verdicts

    def _next(self) -> int:
        """Which of the window is judged: the oldest; of two as old, what is possible.

        Clocks may be too coarse to tell an answer from the call that follows it.
        """
        window = self._window
        oldest = window[0][0]
        for place, (stamp, _, observation) in enumerate(window):
            if stamp != oldest:
                break
            answer = observation.kind is ObservationKind.RESPONSE_RECEIVED
            pending = self._pending
            if (
                answer
                if pending is None
                else not answer or call_of(observation) != call_of(pending)
            ):
                continue
            return place
        return 0

    def _heard_elsewhere(self, observation: Observation) -> None:
        """The other end of a call of the policy was heard: the policy's own end must be, too."""
        call = call_of(observation)
        if observation.client != self.node or call in self._own:
            return
        if observation.channel in self._shape.hidden:
            return
        self._elsewhere.note(call, observation.stamp_ns)

    # --- judging -----------------------------------------------------------------------------------

    def _judge(self, observation: Observation) -> list[Verdict]:
        """Take the next thing that the policy did."""
        if observation.kind is ObservationKind.REQUEST_SENT:
            return self._judge_call(observation)
        return self._judge_answer(observation)

    def _judge_call(self, observation: Observation) -> list[Verdict]:
        channel, stamp = observation.channel, observation.stamp_ns
        if channel in self._shape.hidden or (channel not in self._leaves and self._shape.strangers):
            return []  # a plugin's
        self._begin()
        self._keep_own(call_of(observation))
        verdicts: list[Verdict] = []
        self.outputs += 1
        if self._pending is not None:
            # its answer was lost on the way to here, or the policy did not wait for it
            unanswered = self._pending
            self._keep_unanswered(call_of(unanswered), observation)
            verdicts += self._doubt(stamp, f"no answer to {self._told(unanswered)} was received")
        if self._missed_before(stamp):
            verdicts += self._doubt(
                stamp, f"a call of {self.node} was reported by its other end only"
            )
        follower = self._follower
        try:
            fit = follower.called(channel, stamp)
        except TooManyError as error:
            fit = Fit.UNKNOWN
            verdicts += self._doubt(stamp, str(error))
        if fit is Fit.WRONG:
            verdicts += self._violation(observation)
        elif follower.certain and not verdicts and not self._unconfirmed.kept:
            self.outcome, self._reason = Outcome.CONFORMING, ""
        self._remember(stamp, self._told(observation))
        self._pending, self._last_ns, self._owed = observation, stamp, False
        return verdicts

    def _judge_answer(self, observation: Observation) -> list[Verdict]:
        stamp, call = observation.stamp_ns, call_of(observation)
        self._keep_own(call)
        later = self._unanswered.pop(call, None)
        if later is not None:
            return self._impatient(observation, later)
        pending = self._pending
        if pending is None or call_of(pending) != call:
            if observation.channel not in self._leaves or not self._follower.certain:
                return []
            return self._doubt(
                stamp, f"an answer on {observation.channel} to a call that was not observed"
            )
        self._pending, self._last_ns = None, stamp
        self.inputs += 1
        tick = self._leaves.get(observation.channel, "").startswith("tick")
        status = status_of(observation) if tick else "done"
        if status is None:
            return self._doubt(stamp, f"an answer on {observation.channel} cannot be read")
        self._remember(stamp, f"answer {status} on {observation.channel}")
        self._follower.answered(status, stamp)
        self._owed = bool(self._follower.owes())
        return []

    def _begin(self) -> None:
        """Before a call is judged: what is known of the policy, if nothing was so far."""
        if self._follower.certain:
            return
        if self._synchronised:
            self._follower.start()
        elif self.outcome is Outcome.CONFORMING:
            self.outcome = Outcome.INCONCLUSIVE
            self._reason = "started in the middle of a run: waiting until its state is certain"
        self._synchronised = False

    def _keep_unanswered(self, call: Call, later: Observation) -> None:
        kept = self._unanswered
        kept[call] = later
        if len(kept) > KEPT_CALLS:
            del kept[next(iter(kept))]

    def _keep_own(self, call: Call) -> None:
        self._elsewhere.forget(call)
        self._own[call] = None
        if len(self._own) > KEPT_CALLS:
            del self._own[next(iter(self._own))]

    def _missed_before(self, stamp_ns: int) -> bool:
        """Whether a server heard a call of the policy by then that was not heard from the policy."""
        return self._elsewhere.forget_until(stamp_ns - self.bounds.skew) > 0

    def _told(self, observation: Observation) -> str:
        """What a call does, in words."""
        channel = observation.channel
        if channel not in self._leaves:
            return f"a call of {channel}, which no leaf of the tree makes"
        return f"{self._leaves[channel]} ({channel})"

    def _remember(self, stamp_ns: int, text: str) -> None:
        self._history.append(Evidence(stamp_ns, text))

    # --- verdicts ----------------------------------------------------------------------------------

    def _violation(self, observation: Observation) -> list[Verdict]:
        """A call that the tree does not make: say so, and find the policy anew."""
        follower = self._follower
        observed = self._told(observation)
        if follower.early_ns:
            observed += f" {follower.early_ns / 1e6:.1f} ms before the next tick of the tree is due"
        return self._say(observation.stamp_ns, follower.wanted, observed)

    def _overdue(self, settled: int) -> list[Verdict]:
        if self._missed_before(settled):
            return self._doubt(settled, f"a call of {self.node} was reported by its other end only")
        return self._say(settled, self._follower.owes(), "nothing", "unresponsive: ")

    def _impatient(self, answer: Observation, later: Observation) -> list[Verdict]:
        expected = f"the answer on {answer.channel}"
        observed = f"{self._told(later)} before it"
        explanation = Explanation((expected,), observed)
        return self._convict(self._verdict_of(later.stamp_ns, explanation))

    def _say(
        self, stamp: int, wanted: Sequence[Ask], observed: str, prefix: str = ""
    ) -> list[Verdict]:
        expected: list[str] = []
        places: list[str] = []
        for ask in wanted:
            if ask.leaf is not None:
                expected.append(f"{ask.kind.value} {ask.leaf.name} ({ask.channel})")
                places += self._places.get(ask.leaf.id, ())
        told = tuple(dict.fromkeys(expected)), observed, tuple(self.states())
        found = tuple(dict.fromkeys(places))
        verdict = self._verdict_of(stamp, Explanation(*told, tuple(self._history), found), prefix)
        said = self._convict(verdict, is_silence=bool(prefix))
        self._forget(stamp)
        return said

    def _verdict_of(self, stamp: int, explanation: Explanation, prefix: str = "") -> Verdict:
        expected = " or ".join(explanation.expected) or "nothing"
        reason = f"{prefix}expected {expected}, observed {explanation.observed}"
        return Verdict(self.name, self.node, Outcome.VIOLATED, stamp, reason, explanation)

    def _convict(self, verdict: Verdict, is_silence: bool = False) -> list[Verdict]:
        """Say ``verdict``, once no lost report of the policy's node can be the reason (decision 26)."""
        progress, by = self._progress, verdict.stamp_ns + is_silence
        is_reported = progress.heard >= verdict.stamp_ns and progress.gap <= self._since
        if is_reported or not progress.heard:
            return self._confirm([verdict])
        lost = "observations were lost; "
        if progress.gap <= self._since:
            self._unconfirmed.add(Waiting(verdict, None, by, self._since))
            lost = ""
            if self.outcome is Outcome.VIOLATED:
                return []  # it is, whether this one is certain or not
        was, self.outcome = self.outcome, Outcome.INCONCLUSIVE
        self._reason = f"{lost}{UNCONFIRMED}{verdict.reason}"
        return [] if was is Outcome.INCONCLUSIVE else [self.verdict(verdict.stamp_ns)]

    def _look_at_reports(self) -> list[Verdict]:
        return self._confirm(self._unconfirmed.reported(self._progress.heard, self._progress.gap))

    def _confirm(self, verdicts: list[Verdict]) -> list[Verdict]:
        if verdicts:
            self.violations += len(verdicts)
            self.outcome, self._reason = Outcome.VIOLATED, verdicts[-1].reason
        return verdicts

    # --- losing the thread -------------------------------------------------------------------------

    def lose(self, stamp: int, text: str) -> list[Verdict]:
        """Something from before ``stamp`` was missed: nothing of then is judged any more."""
        self._unclear_until = stamp
        self._window[:] = [entry for entry in self._window if entry[0] > stamp]
        self._pending = None
        return self._doubt(stamp, text)

    def _doubt(self, stamp: int, text: str) -> list[Verdict]:
        """Something is missing: nothing is said until the policy's doing is certain again."""
        self._forget(stamp)
        if self.outcome is Outcome.INCONCLUSIVE:
            return []
        self.outcome = Outcome.INCONCLUSIVE
        self._reason = text
        return [self.verdict(stamp)]

    def _forget(self, stamp: int) -> None:
        self._since = max(self._since, stamp)
        self._synchronised = self._fresh = self._owed = False
        self._follower.forget()
