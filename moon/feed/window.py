"""What a judge is told, in the order in which it happened.

What is received waits until all that happened before it was received, or is known to be missing: up to the
latency bound ago. Then it is handed over, each thing once. Where something is missing, the judge is told so
before each thing that came after it, or may have. What it finds violated is reported once nothing may be
missing that was not received until then (``moon.feed.unreceived``).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from moon.feed.held import Held
from moon.feed.nodes import Nodes
from moon.feed.unreceived import Stretch, Unreceived
from moon.judge import Gap, Intake, Judge, Missing, NodeChange
from moon.monitor.status import PROPERTY, UNSEEN, MachineStatus
from moon.oracle.bounds import FOREVER
from moon.sources.source import Reach
from moon.verdict import Outcome, Verdict
from transports.interface import Answer, Observation, ObservationKind

KEPT_VIOLATIONS = 64
"""So many that are not certain yet are kept; the oldest go."""


class _Waiting(msgspec.Struct, frozen=True):
    """A violation, found when all that happened until ``until_ns`` was handed over."""

    verdict: Verdict
    until_ns: int


class Window:
    """Hands ``judge`` in order what is received late (``moon.run.Watch``).

    Args:
        judge: is told.
        latency_ns: nothing is received later than this after its stamp.
        nodes: how far all nodes have reported; kept up to date by whoever makes this.
        reporters: the nodes that may report something on each channel, by their models, and whether those
            are messages; empty: any node that comes up may, on any.

    Attributes:
        name: of what it judges.
        violations: how often something was violated.
        late: observations that came too late to be judged.
    """

    def __init__(
        self,
        judge: Judge[Observation],
        latency_ns: int,
        nodes: Nodes,
        reporters: Mapping[tuple[str, bool], Iterable[str]],
    ) -> None:
        self.name = judge.name
        self.violations = 0
        self.late = 0
        self._judge = judge
        self._latency_ns = latency_ns
        self._held: Held[Observation | NodeChange] = Held()
        self._gaps: list[Gap] = []
        """What is missing of what was not handed over yet."""
        self._until_ns = 0
        """All that happened by then was handed over."""
        self._now_ns = 0
        self._nodes = nodes
        self._unreceived = Unreceived(nodes)
        self._is_anybody = not reporters
        for (channel, is_message), names in reporters.items():
            for name in names:
                if any(judge.concerns(channel, name, kind) for kind in _kinds(is_message)):
                    self._unreceived.expect(name, channel, is_message)
        self._waiting: list[_Waiting] = []
        self._to_ask: set[str] = set()
        self._received = 0
        self._outcome = ""
        self._last = ""

    def start(self, since_ns: int, linked_ns: int) -> None:
        """All is received since ``since_ns``; see ``Unreceived.linked_ns``."""
        self._until_ns = since_ns - 1
        self._unreceived.linked_ns = linked_ns

    # --- what is received --------------------------------------------------------------------------

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether it tells the judge something."""
        return self._judge.concerns(channel, source, kind)

    def observe(self, seen: Intake) -> Iterator[Verdict]:
        """Take what was received; it is handed over when :meth:`advance` says that its latency is over."""
        event = seen.seen
        if not self.concerns(event.channel, event.source, event.kind):
            return
        self._received += 1
        self._unreceived.received(event)
        if event.stamp_ns > self._until_ns:
            self._held.add(event)
            return
        self.late += 1
        why, stamp_ns = f"an observation on {event.channel} came too late", event.stamp_ns
        yield from self.gap(
            Gap(event.channel, event.source, stamp_ns, stamp_ns + 1, why, event.kind)
        )

    def gap(self, gap: Gap) -> Iterator[Verdict]:
        """Something is missing: what was found since then may not be so."""
        if gap.cause is Missing.OTHER_TIME:  # nothing is missing
            yield from self._found(self._judge.gap(gap), self._until_ns)
            return
        is_anew = gap.cause in (Missing.ANEW, Missing.OWN_CLOCK_SET)
        if is_anew:  # what comes is not of the same time
            yield from self._hand_over(FOREVER)
        elif gap.channel and not any(
            self.concerns(gap.channel, gap.source, kind)
            for kind in ([gap.kind] if gap.kind is not None else ObservationKind)
        ):
            return
        self._unreceived.is_lossy = True
        self._waiting = [it for it in self._waiting if it.until_ns < gap.from_ns]
        if is_anew or gap.from_ns <= self._until_ns:
            yield from self._found(self._judge.gap(gap), self._until_ns)
        if is_anew:
            self._waiting.clear()
            self._gaps.clear()
            self._unreceived.restart()
            self._until_ns = gap.until_ns - 1
        elif gap.until_ns > self._until_ns:
            self._gaps.append(gap)

    def node_changed(self, change: NodeChange) -> Iterator[Verdict]:
        """A node came up, or went away."""
        self._held.add(change)
        if not change.is_up:
            return
        if self._is_anybody:
            self._unreceived.expect(change.node)
        for channel, from_ns, until_ns in self._unreceived.started(change.node, change.since_ns):
            why = f"what {change.node} did first may not have been received"
            yield from self.gap(Gap(channel, change.node, from_ns, until_ns, why))

    # --- time --------------------------------------------------------------------------------------

    def answered(self, node: str, answer: Answer, reach_ns: int) -> Iterator[Verdict]:
        """``node`` said up to where it has reported everything; it is ``reach_ns`` (ns)."""
        return self.advance(reach_ns)

    def advance(self, until_ns: int) -> Iterator[Verdict]:
        """It is ``until_ns``: what was stamped the latency bound before was received, or is lost."""
        self._now_ns = until_ns
        yield from self._pass_to(until_ns - self._latency_ns)
        waiting, self._waiting = self._waiting, []
        for item in waiting:
            yield from self._found((item.verdict,), item.until_ns)

    def finish(self, known_ns: int, end_ns: int) -> Iterator[Verdict]:
        """Nothing more is received; what happened after ``known_ns`` may be missing, and is not judged."""
        yield from self.advance(known_ns + self._latency_ns)
        for item in self._waiting:
            if all(it.can_answer for it in self._missing_by(item.until_ns)):
                yield item.verdict
        self._waiting.clear()

    def _pass_to(self, until_ns: int) -> Iterator[Verdict]:
        if until_ns <= self._until_ns:
            return
        yield from self._hand_over(until_ns)
        self._until_ns = until_ns
        if self._judge.due_ns <= until_ns:
            yield from self._pass_time(until_ns)

    def _hand_over(self, until_ns: int) -> Iterator[Verdict]:
        judge = self._judge
        for event in self._held.take(self._held.count(until_ns)):
            if judge.due_ns < event.stamp_ns:
                yield from self._pass_time(event.stamp_ns - 1)
            yield from self._tell_gaps(event.stamp_ns)
            told = (
                judge.node_changed(event) if isinstance(event, NodeChange) else judge.observe(event)
            )
            yield from self._found(told, event.stamp_ns)

    def _pass_time(self, until_ns: int) -> Iterator[Verdict]:
        yield from self._tell_gaps(until_ns)
        yield from self._found(self._judge.advance(until_ns), until_ns)

    def _tell_gaps(self, until_ns: int) -> Iterator[Verdict]:
        """What is missing that may have happened by ``until_ns``: once more, as more of it may have since."""
        for gap in self._gaps:
            if gap.from_ns <= until_ns:
                yield from self._found(self._judge.gap(gap), until_ns)
        self._gaps = [gap for gap in self._gaps if gap.until_ns > until_ns]

    # --- what is certain ---------------------------------------------------------------------------

    def _found(self, verdicts: Iterable[Verdict], until_ns: int) -> Iterator[Verdict]:
        """Those of ``verdicts`` that are news, and certain if all until ``until_ns`` was received."""
        for verdict in verdicts:
            if verdict.outcome is not Outcome.VIOLATED:
                if verdict.outcome != self._outcome:
                    yield verdict
                continue
            missing = list(self._missing_by(until_ns))
            if not missing:
                yield verdict
                continue
            self._waiting = [*self._waiting[1 - KEPT_VIOLATIONS :], _Waiting(verdict, until_ns)]
            self._to_ask.update(it.place.node for it in missing if it.can_answer)

    def _missing_by(self, until_ns: int) -> Iterator[Stretch]:
        """Where something that happened until then (ns) may not have been received yet."""
        found = self._unreceived.windows(lambda channel: True, until_ns, self._now_ns)
        return (stretch for stretch in found if stretch.from_ns <= until_ns)

    @property
    def due_ns(self) -> int:
        """When a turn is wanted (ns)."""
        due_ns = min([self._judge.due_ns, *self._held.stamps[:1]])
        if self._waiting:
            due_ns = min(due_ns, self._until_ns + 1)
        return due_ns if due_ns >= FOREVER else due_ns + self._latency_ns

    def take_questions(self) -> Sequence[str]:
        """The nodes to be asked now how far they have reported."""
        if not self._to_ask:
            return ()
        names, self._to_ask = sorted(self._to_ask), set()
        return names

    # --- how it stands -----------------------------------------------------------------------------

    def report(self, verdict: Verdict) -> Reach:
        """``verdict``, which the judge found, is reported: to whom."""
        self.violations += verdict.outcome is Outcome.VIOLATED
        self._outcome, self._last = verdict.outcome, verdict.reason or self._last
        return Reach.PEOPLE

    def statuses(self) -> list[MachineStatus]:
        """How what it judges stands, with all that was ever found."""
        ((_, _, verdict, states),) = self.standings()
        if self.violations and verdict == Outcome.CONFORMING:
            verdict = str(Outcome.VIOLATED)
        numbers = (self._received, 0, self.violations, self.late)
        return [MachineStatus(self.name, verdict, states, *numbers, None, self._last, PROPERTY)]

    def standings(self) -> list[tuple[str, str, str, tuple[str, ...]]]:
        """Name, kind and verdict of what it judges, as it is now; no states."""
        verdict = self._outcome or (str(Outcome.CONFORMING) if self._received else UNSEEN)
        return [(self.name, PROPERTY, str(verdict), ())]


def _kinds(is_message: bool) -> Sequence[ObservationKind]:
    if is_message:
        return (ObservationKind.MESSAGE,)
    return [kind for kind in ObservationKind if kind is not ObservationKind.MESSAGE]
