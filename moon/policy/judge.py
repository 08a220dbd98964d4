"""The judge of a behaviour-tree policy: what it calls must be what its tree would tick.

It is handed the policy's own end of its calls, in order: they come from one process, one after the other.
Each call is compared with what the very tree, given the answers so far, ticks or halts next
(``moon.policy.follow``).

What is checked: which leaf is ticked or halted next; that the next call comes while a tick is not
over; that no call is made before the last one is answered; that no tick begins sooner than the rate
allows. The policy waits from when a tick was due, so a late tick may be followed by an early one: the
tick after the next comes no sooner than a period after this one was over.

A tree that remembers more than what is RUNNING is followed by the ticks that the policy reports, too
(``moon.policy.reported``): which leaves they have and how they end is checked.

What is not: what plugins do inside the policy, and when the clock ends a ``Sleep``, ``Delay`` or
``Timeout`` (either is accepted); that a tick begins at all.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence

from m2c.model.machine import Machine
from m2c.policy.program import Policy
from m2c.policy.ticks import HALTED, TICKS_CHANNEL
from moon.feed.nodes import LEASE_NS
from moon.feed.numbers import Place
from moon.feed.progress import Progress
from moon.judge import Gap
from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.confirmation import NOT_NEEDED, Conclusion, Violation, Waiting
from moon.policy.calls import Call, SeenByServer, call_of, doing_of, status_of
from moon.policy.follow import Fit, Follower, TooManyError
from moon.policy.reported import ReportedFollower, report_of
from moon.policy.run import Ask, AskKind, Life
from moon.policy.shape import shape_of
from moon.verdict import MIDDLE, Cause, Evidence, Explanation, Outcome, Verdict, violation_of
from transports.bounded import BoundedDict
from transports.interface import Observation, ObservationKind

EVIDENCE = 12
"""So many calls and answers are kept for explanations."""

KEPT_CALLS = 256
"""Calls that were reported by their other end only, or that were not seen to end."""


MAX_DEFERRED = 4096
"""So much of one tick is kept until its report is received."""

MISSED = "what it called may not have been received yet"
_UNHEARD = (
    f"what plugins and the clock answer is in its ticks ({TICKS_CHANNEL}), and none was received"
)
_UNREADABLE = f"its ticks ({TICKS_CHANNEL}) do not say what plugins wrote and which times were over"


class PolicyJudge:
    """Judges a running policy by its behaviour tree; see :class:`moon.policy.oracle.PolicyOracle`.

    Args:
        policy: the tree and its leaves; a rate of 0 is not known.
        node: the node that runs it.
        bounds: deadlines and tolerances.
        synchronised: whether the first call comes from a policy that has just started.
        plugins: the machines that run leaves of the tree.
        places: ``file:line:column`` of each leaf, by its id.
        progress: of all that the policy's node reports, where it numbers that.
    """

    def __init__(
        self,
        policy: Policy,
        node: str,
        bounds: Bounds,
        synchronised: bool,
        plugins: Iterable[Machine],
        places: Mapping[str, Sequence[str]],
        progress: Progress,
    ) -> None:
        self.name = policy.name
        self.node = node
        self.bounds = bounds
        self.inputs = 0
        self.outputs = 0
        self._shape = shape_of(policy, plugins)
        self._places = places
        kind = Follower if self._shape.plain else ReportedFollower
        self._follower: Follower | ReportedFollower = kind(
            policy, self._shape, policy.tick_rate_hz, bounds.slack(0)
        )
        self._reported = self._follower if isinstance(self._follower, ReportedFollower) else None
        """Follows the policy by its reports, if it is such a tree."""
        self._deferred: list[Observation] = []
        """What the policy did in a tick of which the report decides whether it was right."""
        self._is_heard = False
        """Whether any report was received."""
        self.leaves: dict[str, str] = {}
        """What a call of a channel does."""
        for leaf in policy.leaves:
            if leaf.plugin:
                continue
            for channel, what in ((leaf.tick, "tick"), (leaf.halt, "halt")):
                if channel:
                    self.leaves.setdefault(channel, f"{what} {leaf.name}")
        self._synchronised = synchronised
        self.is_fresh = synchronised
        """Whether all that the policy ever did was judged."""
        self._pending: Observation | None = None
        self._last_ns = 0
        self._owed = False
        """Whether the next call has to come within the deadline."""
        self._seen_by_server = SeenByServer(KEPT_CALLS)
        """Calls of the policy that their server reported, and the policy did not."""
        self._own: BoundedDict[Call, None] = BoundedDict(KEPT_CALLS)
        """The last calls of the policy that were judged."""
        self._progress = progress
        self._since = 0
        """What was lost before (ns) does not matter: the policy was resynchronised then."""
        self.conclusion = Conclusion(policy.name, node, self._needed)
        self.received_since = 0
        """From then on (ns) all that the policy does is received; FOREVER: its node is not known to be up."""
        self._first_ns: dict[str, int] = {}
        """Of each channel of a leaf, when the first that was received from the policy happened (ns)."""
        self._next: dict[str, int] = {}
        """Of each channel of a leaf, the number that the policy's next report has there; 0: it has none."""
        self._unanswered: BoundedDict[Call, Observation] = BoundedDict(KEPT_CALLS)
        """Calls that were followed by another before their answer was received."""
        self._life = Life(self._follower.close)  # its runs' threads end with it
        self._history: deque[Evidence] = deque(maxlen=EVIDENCE)
        if self._shape.unchecked:
            where = "".join(f"{place}: " for place in places.get(self._shape.unchecked_at, ())[:1])
            self.conclusion.unknown(0, f"{where}{self._shape.unchecked}")

    # --- what it is handed -------------------------------------------------------------------------

    def start(self, stamp_ns: int) -> None:
        """The policy starts at ``stamp_ns`` (ns since the epoch), its tree is fresh."""
        self._synchronised = self.is_fresh = True
        self._since = stamp_ns
        self.received_since = 0
        self._first_ns.clear()
        self._next.clear()
        self._seen_by_server.clear()
        self._unanswered.clear()
        self._own.clear()
        self._pending = None
        self._deferred = []
        self._owed = False
        if self.is_judging:
            self._follower.start()
            self.conclusion.restart()

    def restart(self) -> None:
        """Its node numbers its calls anew."""
        self._unanswered.clear()
        self._next.clear()
        self._own.clear()
        self.conclusion.unconfirmed.restart()

    @property
    def reads_reports(self) -> bool:
        """Whether it wants the ticks that the policy publishes."""
        return self._reported is not None

    @property
    def is_judging(self) -> bool:
        """Whether such a tree can be checked."""
        return not self._shape.unchecked

    def choose(self, events: Sequence[Observation]) -> int:
        """Which of ``events``, all of one stamp, comes first: what is possible, else the first.

        Clocks may be too coarse to distinguish an answer from the call that follows it.
        """
        pending = self._pending
        for place, event in enumerate(events):
            is_answer = event.kind is ObservationKind.RESPONSE_RECEIVED
            if pending is None:
                if not is_answer:
                    return place
            elif is_answer and call_of(event) == call_of(pending):
                return place
        return 0

    def observe(self, event: Observation) -> list[Verdict]:
        """Take the next thing that the policy did."""
        if event.kind is ObservationKind.MESSAGE:
            return self._judge_report(event)
        if self._deferred or self._has_to_wait(event):
            return self._defer(event)
        return self._judge(event)

    def note_heard(self, seen: Observation) -> list[Verdict]:
        """Something that the policy did was received: its number may show that a violation is certain."""
        channel, stamp_ns, number = seen.channel, seen.stamp_ns, seen.sequence
        if channel not in self.leaves:
            return []
        if stamp_ns < self._first_ns.get(channel, FOREVER):
            self._first_ns[channel] = stamp_ns
        self._next[channel] = number + 1
        if not self.conclusion.unconfirmed.kept:
            return []
        return self.conclusion.numbered((self.node, channel, False), number, stamp_ns)

    def note_elsewhere(self, event: Observation) -> None:
        """The other end of a call of the policy reported it: the policy's own end must, too."""
        call = call_of(event)
        if event.client != self.node or call in self._own:
            return
        if event.channel not in self._shape.hidden:
            self._seen_by_server.note(call, event.stamp_ns)

    def gap(self, gap: Gap) -> list[Verdict]:
        """Something is missing: nothing of before is judged any more."""
        self._pending = None
        self._deferred = []
        return self._doubt(gap.until_ns, gap.why)

    def advance(self, until_ns: int) -> list[Verdict]:
        """All that happened until ``until_ns`` was handed over."""
        certain = self.conclusion.silent(
            lambda since_ns: self._last_ns > since_ns or until_ns > since_ns + LEASE_NS,
            until_ns,
            True,
        )
        if self._owed and until_ns - self._last_ns > self.bounds.deadline:
            return [*certain, *self._overdue(until_ns)]
        if self._is_unheard and until_ns - self._deferred[0].stamp_ns > self.bounds.deadline:
            return [*certain, *self.conclusion.unknown(until_ns, _UNHEARD)]
        return certain

    @property
    def due_ns(self) -> int:
        """From then on (ns) the next call is missing, or a violation is certain; FOREVER: neither."""
        certain_ns = self.conclusion.unconfirmed.silent_ns
        if self._owed:
            return min(certain_ns, self._last_ns + self.bounds.deadline + 1)
        if self._is_unheard and self.conclusion.outcome is not Outcome.INCONCLUSIVE:
            return min(certain_ns, self._deferred[0].stamp_ns + self.bounds.deadline + 1)
        return certain_ns

    # --- what it says ------------------------------------------------------------------------------

    @property
    def hypotheses(self) -> Sequence[object]:
        """What the policy may be doing, as far as is known."""
        return self._follower.runs

    def states(self) -> list[str]:
        """What the policy may be doing."""
        return sorted({doing_of(run, self._pending) for run in self._follower.runs})

    # --- judging -----------------------------------------------------------------------------------

    def _judge(self, event: Observation) -> list[Verdict]:
        if event.kind is ObservationKind.REQUEST_SENT:
            return self._judge_call(event)
        return self._judge_answer(event)

    def _is_plugins(self, channel: str) -> bool:
        """Whether a call of ``channel`` may be a plugin's."""
        return channel in self._shape.hidden or (
            channel not in self.leaves and self._shape.strangers
        )

    def _has_to_wait(self, event: Observation) -> bool:
        """Whether only the report of the tick can say if ``event`` is right."""
        if self._reported is None or event.kind is not ObservationKind.REQUEST_SENT:
            return False
        if self._pending is not None or self._is_plugins(event.channel):
            return False
        self._begin()
        return self._reported.waits()

    def _defer(self, event: Observation) -> list[Verdict]:
        self._deferred.append(event)
        if len(self._deferred) <= MAX_DEFERRED:
            return []
        return self._doubt(event.stamp_ns, _UNHEARD)

    @property
    def _is_unheard(self) -> bool:
        """Whether a report is waited for, and none was ever received."""
        return bool(self._deferred) and not self._is_heard

    def _judge_report(self, event: Observation) -> list[Verdict]:
        """The policy reports a tick: what was deferred can be judged, and how the tick ended."""
        follower, report = self._reported, report_of(event)
        if follower is None:
            return []
        if report is None:
            return self._doubt(event.stamp_ns, _UNREADABLE) if self._shape.is_open else []
        self._is_heard = True
        self.outputs += not self.leaves
        self._begin()
        deferred, self._deferred = self._deferred, []
        verdicts: list[Verdict] = []
        try:
            follower.reported(report)
            for earlier in deferred:
                if self._has_to_wait(earlier):
                    break  # the tree asks for a leaf that was not ticked
                verdicts += self._judge(earlier)
        except ValueError as error:
            return [*verdicts, *self._doubt(event.stamp_ns, f"{_UNREADABLE}: {error}")]
        self._owed = False
        if self._pending is not None and follower.certain:
            text = f"no answer to {self._call_text(self._pending)} was received"
            return [*verdicts, *self._doubt(event.stamp_ns, text)]
        observed = follower.over(event.stamp_ns)
        if observed:
            verdicts += self._violated(event.stamp_ns, follower.wanted, observed)
        elif follower.certain and not verdicts:
            self.conclusion.known()
        return verdicts

    def _judge_call(self, observation: Observation) -> list[Verdict]:
        channel, stamp = observation.channel, observation.stamp_ns
        if self._is_plugins(channel):
            return []
        self._begin()
        self._keep_own(call_of(observation))
        verdicts: list[Verdict] = []
        self.outputs += 1
        if self._pending is not None:
            # its answer was lost on the way to here, or the policy did not wait for it
            unanswered = self._pending
            self._unanswered[call_of(unanswered)] = observation
            verdicts += self._doubt(
                stamp, f"no answer to {self._call_text(unanswered)} was received"
            )
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
        elif follower.certain and not verdicts:
            self.conclusion.known()
        self._remember(stamp, self._call_text(observation))
        self._pending, self._last_ns, self._owed = observation, stamp, False
        return verdicts

    def _judge_answer(self, observation: Observation) -> list[Verdict]:
        if self._is_plugins(observation.channel):
            return []
        stamp, call = observation.stamp_ns, call_of(observation)
        self._keep_own(call)
        later = self._unanswered.pop(call, None)
        if later is not None:
            return self._impatient(observation, later)
        pending = self._pending
        if pending is None or call_of(pending) != call:
            if observation.channel not in self.leaves or not self._follower.certain:
                return []
            return self._doubt(
                stamp, f"an answer on {observation.channel} to a call that was not observed"
            )
        self._pending, self._last_ns = None, stamp
        self.inputs += 1
        tick = self.leaves.get(observation.channel, "").startswith("tick")
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
        elif self.conclusion.outcome is Outcome.CONFORMING:
            self.conclusion.unknown(0, self._waits_for())
        self._synchronised = False

    def _waits_for(self) -> str:
        if self._reported is None:
            return MIDDLE
        if self._shape.forgets:
            return f"{MIDDLE}, once a tick ends with SUCCESS or FAILURE"
        return f"{MIDDLE}; its tree remembers what cannot be observed, until the policy starts anew"

    def _keep_own(self, call: Call) -> None:
        self._seen_by_server.forget(call)
        self._own[call] = None

    def _missed_before(self, stamp_ns: int) -> bool:
        """Whether a server reported a call of the policy by then that the policy did not report."""
        return self._seen_by_server.forget_until(stamp_ns - self.bounds.skew) > 0

    def _call_text(self, observation: Observation) -> str:
        """What a call does, in words."""
        channel = observation.channel
        if channel not in self.leaves:
            return f"a call of {channel}, which no leaf of the tree makes"
        return f"{self.leaves[channel]} ({channel})"

    def _remember(self, stamp_ns: int, text: str) -> None:
        self._history.append(Evidence(stamp_ns, text))

    # --- verdicts ----------------------------------------------------------------------------------

    def _violation(self, observation: Observation) -> list[Verdict]:
        """A call that the tree does not make: report it, and resynchronise."""
        follower = self._follower
        observed = self._call_text(observation)
        if follower.early_ns:
            observed += f" {follower.early_ns / 1e6:.1f} ms before the next tick of the tree is due"
        return self._violated(
            observation.stamp_ns, follower.wanted, observed, channel=observation.channel
        )

    def _overdue(self, watermark: int) -> list[Verdict]:
        if self._missed_before(watermark):
            return self._doubt(
                watermark, f"a call of {self.node} was reported by its other end only"
            )
        return self._violated(watermark, self._follower.owes(), "nothing", Cause.UNRESPONSIVE)

    def _impatient(self, answer: Observation, later: Observation) -> list[Verdict]:
        expected = f"the answer on {answer.channel}"
        observed = f"{self._call_text(later)} before it"
        why = Explanation((expected,), observed, channel=later.channel)
        return self._convict(
            violation_of(self.name, self.node, later.stamp_ns, why, Cause.UNEXPECTED), ()
        )

    def _violated(
        self,
        stamp: int,
        wanted: Sequence[Ask],
        observed: str,
        cause: Cause = Cause.UNEXPECTED,
        channel: str = "",
    ) -> list[Verdict]:
        if self._may_have_missed(wanted, stamp):
            return self._doubt(stamp, MISSED)
        expected: list[str] = []
        places: list[str] = []
        for ask in wanted:
            if ask.kind is AskKind.END:
                expected.append(f"a tick that ends with {ask.status}")
            if ask.leaf is not None:
                expected.append(_text_of(ask))
                places += self._places.get(ask.leaf.id, ())
        why = Explanation(
            tuple(dict.fromkeys(expected)),
            observed,
            tuple(self.states()),
            tuple(self._history),
            tuple(dict.fromkeys(places)),
            channel,
        )
        verdict = violation_of(self.name, self.node, stamp, why, cause)
        reported = self._convict(verdict, wanted, is_silence=cause is Cause.UNRESPONSIVE)
        self._forget(stamp)
        return reported

    def _may_have_missed(self, wanted: Sequence[Ask], by_ns: int) -> bool:
        """Whether one of the calls that the tree makes next may have been made by then (ns) and missed.

        A tap finds channels one after the other. What a node numbers, it numbers on those too that are not
        found yet.
        """
        silent_ns = self.bounds.deadline + self.bounds.latency
        if self._progress.reported_ns or by_ns - silent_ns >= self.received_since:
            return False
        return any(
            ask.channel in self.leaves and self._first_ns.get(ask.channel, FOREVER) > by_ns
            for ask in wanted
        )

    def _convict(
        self, verdict: Verdict, wanted: Sequence[Ask], is_silence: bool = False
    ) -> list[Verdict]:
        """Report ``verdict``, once no lost report of the policy's node can be the reason (decision 26)."""
        places = [(self.node, ask.channel, False) for ask in wanted]
        violation = Violation(verdict, self._since, verdict.stamp_ns, is_silence, places)
        return self.conclusion.found(violation)[0]

    def _needed(self, violation: Violation) -> Waiting | None:
        """What the policy's node has to report before ``violation`` is certain; None: some of it was lost."""
        progress, at_ns, since_ns = self._progress, violation.until_ns, violation.since_ns
        if not progress.reported_ns:
            places = self._next_at(violation.expected)
            return Waiting(violation.verdict, places, since_ns=since_ns)
        if progress.gap > since_ns:
            return None
        is_reported = progress.reported_ns >= at_ns
        by_ns = NOT_NEEDED if is_reported else at_ns + violation.is_silence
        return Waiting(violation.verdict, {}, by_ns, since_ns)

    def _next_at(self, expected: Iterable[Place]) -> dict[Place, int]:
        """The numbers that show that none of the calls that were ``expected`` is only late.

        A node that numbers each channel by itself may have made the call: each channel comes when it comes.
        """
        found = {place: self._next.get(place[1], 0) for place in expected}
        return {place: number for place, number in found.items() if number}

    def look_at_reports(self) -> list[Verdict]:
        """What the node reported since may confirm a violation."""
        if not self.conclusion.unconfirmed.kept:
            return []
        return self.conclusion.reported(self._progress.reported_ns, self._progress.gap)

    def _doubt(self, stamp: int, text: str) -> list[Verdict]:
        """Something is missing: nothing is reported until the policy's doing is certain again."""
        self._forget(stamp)
        return self.conclusion.unknown(stamp, text)

    def _forget(self, stamp: int) -> None:
        self._since = max(self._since, stamp)
        self._synchronised = self.is_fresh = self._owed = False
        self._deferred = []
        self._follower.forget()


def _text_of(ask: Ask) -> str:
    name = "" if ask.leaf is None else ask.leaf.name
    if ask.kind is AskKind.OPEN:
        return f"{'halt' if ask.choices == (HALTED,) else 'tick'} {name}"
    return f"{ask.kind.value} {name} ({ask.channel})"
