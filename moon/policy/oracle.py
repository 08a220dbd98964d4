"""The oracle of a behaviour-tree policy: observations in, verdicts out.

It listens to the policy's own end of its calls. What is newer than the latency bound waits, as something
older may still be received, unless the policy's node numbers its reports and none is missing; then it is
handed to the judge (``moon.policy.judge``), in order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from m2c.model.machine import Machine
from m2c.policy.program import Policy
from m2c.policy.ticks import TICKS_CHANNEL
from moon.feed.held import Held
from moon.feed.lives import ANOTHER, PAST, Lives
from moon.feed.numbers import Numbers
from moon.feed.progress import Progress
from moon.judge import Gap
from moon.oracle.bounds import FOREVER, Bounds
from moon.policy.judge import PolicyJudge
from moon.verdict import Outcome, Verdict
from transports.interface import CLIENT_END, Observation, ObservationKind
from transports.sequences import Sequel

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
        repeated, late: observations received twice, and too late.
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
        self.repeated = 0
        self.late = 0
        self._progress = Progress()
        self._lives = Lives()
        """Of all that the policy's node reports, where it numbers that."""
        if rate_hz is not None:
            policy = msgspec.structs.replace(policy, tick_rate_hz=rate_hz)
        self._judge = PolicyJudge(
            policy, node, self.bounds, synchronised, plugins, places or {}, self._progress
        )
        self._held: Held[Observation] = Held()
        self._watermark = 0
        self._judged_ns = -1
        """The newest that was judged happened then."""
        self._numbers = Numbers()
        """Of the policy's node, where nobody else looks at them."""
        self._unclear_until = 0
        """Something is known to be missing of what happened until then."""

    # --- what a user calls -------------------------------------------------------------------------

    def start(self, stamp_ns: int, whole: bool = False) -> None:
        """The policy starts now, its tree is fresh.

        Args:
            stamp_ns: when, ns since the epoch.
            whole: nothing was missed; it makes no difference here, as numbers show what was.
        """
        self._lives.start(stamp_ns)
        if self._progress.reported_ns < stamp_ns:  # of the life before
            self._progress.restart()
        # what has come of it already stays, if that is all of it
        self._held.take(self._held.count(stamp_ns - 1))
        self._numbers.forget(self.node, stamp_ns)
        held = self._held.observations
        begun = {event.channel for event in held if event.sequence <= 0}
        is_whole = self._judged_ns < stamp_ns and begun.issuperset(e.channel for e in held)
        self._unclear_until = 0
        self._watermark = max(self._watermark, stamp_ns - self.bounds.latency)
        self._judge.start(stamp_ns)
        if self._judge.is_judging and not is_whole:
            self.lose(self._watermark, f"what {self.node} did first was missed")

    def listen(self, since_ns: int) -> None:
        """All that the policy does from ``since_ns`` on is received; see ``Oracle.listen``.

        Until then none of its calls is missing of a service of which nothing was received from it yet.
        """
        self._judge.received_since = since_ns

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether such an observation concerns the policy."""
        if source == self.node:
            return True
        return channel in self._judge.leaves and kind is not ObservationKind.MESSAGE

    def uses(self, channel: str) -> bool:
        """Whether a leaf is ticked on ``channel``."""
        return channel in self._judge.leaves

    @property
    def has_timers(self) -> bool:
        """Whether what the policy does depends on how much time has passed: it ticks at a rate."""
        return True

    def takes(self, channel: str) -> bool:
        """Whether messages on ``channel`` can make a difference: they cannot."""
        return False

    def observe(self, observation: Observation) -> Verdict:
        """Take one observation; the verdict as it stands then."""
        verdicts = self.feed(observation)
        return verdicts[-1] if verdicts else self.verdict(observation.stamp_ns)

    def verdict(self, stamp_ns: int = 0) -> Verdict:
        """The verdict as it stands."""
        return self._judge.conclusion.verdict(stamp_ns)

    @property
    def suspected(self) -> Verdict | None:
        """The violation that makes the verdict inconclusive, as it is not certain; None: none does."""
        return self._judge.conclusion.suspected

    @property
    def outcome(self) -> Outcome:
        """Of the verdict as it stands."""
        return self._judge.conclusion.outcome

    @property
    def violations(self) -> int:
        """How many were found."""
        return self._judge.conclusion.violations

    @property
    def inputs(self) -> int:
        """Answers judged."""
        return self._judge.inputs

    @property
    def outputs(self) -> int:
        """Calls judged; of a tree that calls no skill, its ticks."""
        return self._judge.outputs

    def feed(self, observation: Observation, sequel: Sequel | None = None) -> list[Verdict]:
        """Take one observation; verdicts that it, and the time that has passed, bring about.

        Args:
            observation: what was received.
            sequel: how its number follows, where that is known; else it is looked up.
        """
        judge = self._judge
        if not judge.is_judging:
            return []
        channel, kind = observation.channel, observation.kind
        verdicts: list[Verdict] = []
        watermark = observation.received_ns - self.bounds.latency
        if observation.source == self.node:
            verdicts = judge.note_heard(observation)
            if observation.life != self._lives.present:
                which = self._lives.see(observation.life, observation.stamp_ns)
                if which == PAST:
                    return []
                if which == ANOTHER:
                    verdicts += self._begin_again(observation.stamp_ns)
            if observation.order >= 0:
                self._progress.take(observation.order, observation.stamp_ns, watermark)
                watermark = max(watermark, min(self._progress.reported_ns, observation.received_ns))
            verdicts += judge.look_at_reports()
            if (kind in CLIENT_END and _PARTS not in channel) or (
                channel == TICKS_CHANNEL and judge.reads_reports
            ):
                verdicts += self._take(observation, sequel)
        elif self.concerns(channel, observation.source, kind):
            judge.note_elsewhere(observation)
        return verdicts if watermark <= self._watermark else verdicts + self._settle(watermark)

    def advance(self, now_ns: int) -> list[Verdict]:
        """Time has passed: what can no longer change is judged, what is overdue is reported.

        Args:
            now_ns: on the clock of ``Observation.received_ns``.
        """
        watermark = now_ns - self.bounds.latency
        return [] if watermark <= self._watermark else self._settle(watermark)

    def _settle(self, watermark: int) -> list[Verdict]:
        """All that happened until ``watermark`` (ns) has been received."""
        self._watermark = watermark
        judge, held = self._judge, self._held
        verdicts: list[Verdict] = []
        if self._progress.ahead:
            self._progress.advance(watermark)
        verdicts += judge.look_at_reports()
        while held.stamps and held.stamps[0] <= watermark:
            self._judged_ns = held.stamps[0]
            together = _in_order(held.take(held.count(self._judged_ns)))
            while together:
                verdicts += judge.observe(together.pop(judge.choose(together)))
        return verdicts + judge.advance(watermark)

    @property
    def wake(self) -> int:
        """Until all that happened by then (ns) has been received, time alone changes nothing."""
        due = self._judge.due_ns
        return min(due, self._held.stamps[0]) if self._held.stamps else due

    @property
    def silent_ns(self) -> int:
        """From then on (ns) it decides something if the node did nothing more, and the node can say so.

        FOREVER: nothing is due, or the node's word would not be enough.
        """
        due = self._judge.due_ns
        return due if self._progress.reported_ns and due > self._watermark else FOREVER

    def reported(self, number: int, stamp_ns: int, now_ns: int) -> list[Verdict]:
        """The node was asked how far it is; see ``Oracle.reported``."""
        self._progress.answered(number, stamp_ns)
        verdicts = self._judge.look_at_reports()
        watermark = max(now_ns - self.bounds.latency, min(self._progress.reported_ns, now_ns))
        return verdicts if watermark <= self._watermark else verdicts + self._settle(watermark)

    @property
    def hypotheses(self) -> Sequence[object]:
        """What the policy may be doing, as far as is known."""
        return self._judge.hypotheses

    def states(self) -> list[str]:
        """What the policy may be doing."""
        return self._judge.states()

    # --- what is received --------------------------------------------------------------------------

    def _take(self, observation: Observation, sequel: Sequel | None) -> list[Verdict]:
        verdicts: list[Verdict] = []
        number, stamp, channel = observation.sequence, observation.stamp_ns, observation.channel
        if number >= 0:
            if sequel is None:
                sequel = self._numbers.of(observation).follow(number, stamp, observation.life)
            if sequel is Sequel.AGAIN:
                self.repeated += 1
                return []
            is_start = sequel is Sequel.FIRST and self._judge.is_fresh
            if sequel is Sequel.ANEW:
                verdicts = self._begin_again(stamp)
            elif sequel is Sequel.AFTER_A_GAP or (is_start and number > 0):
                why = f"observations on {channel} from {self.node} were lost"
                verdicts = self.lose(stamp - 1, why)
        if stamp <= self._unclear_until:
            return verdicts
        if stamp <= self._watermark:
            self.late += 1
            why = f"an observation on {observation.channel} came too late"
            return [*verdicts, *self.lose(stamp, why)]
        self._held.add(observation)
        return verdicts

    def _begin_again(self, stamp: int) -> list[Verdict]:
        """The policy has started again: what it reports is of another life from ``stamp`` (ns) on."""
        self._numbers.forget(self.node, stamp)
        self._progress.restart()
        self._judge.restart()
        return self.lose(stamp - 1, f"{self.node} was restarted")

    def doubt(self, since_ns: int = 0) -> None:
        """See ``Oracle.doubt``."""
        self._judge.conclusion.unconfirmed.doubt(since_ns)

    def lose(self, stamp: int, text: str) -> list[Verdict]:
        """Something from before ``stamp`` (ns) was missed: nothing of then is judged any more."""
        self._unclear_until = stamp
        self._held.take(self._held.count(stamp))
        return self._judge.gap(Gap("", self.node, 0, stamp, text))


def _in_order(together: list[Observation]) -> list[Observation]:
    """What happened at one stamp, in the order in which its node reports it, where that is known."""
    if len(together) > 1 and all(event.order >= 0 for event in together):
        together.sort(key=_order)
    return together


def _order(event: Observation) -> int:
    return event.order
