"""The loop of every monitor: what is received goes to the judges, and their verdicts go to the sinks.

Live, simulated and recorded runs differ in their source only; each robot of a fleet has a run of its own.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Protocol

import msgspec

from m2c.model.system import System
from m2c.suggestions import nearest
from moon.feed.asking import Asking
from moon.feed.clock import NS
from moon.feed.counts import Counts
from moon.feed.intake import Feed
from moon.feed.places import by_channel, nodes_at
from moon.feed.reception import Reception
from moon.feed.senders import Senders
from moon.feed.window import Window
from moon.judge import Gap, Intake, Judge, Missing, NodeChange
from moon.monitor.machines import MachineWatch
from moon.monitor.properties import PropertyWatch
from moon.monitor.status import POLICY, MachineStatus, Summary
from moon.monitor.subject import Monitored
from moon.monitor.turns import Turns
from moon.oracle.bounds import LINKED_NS
from moon.oracle.oracle import Oracle
from moon.policy.oracle import PolicyOracle
from moon.sources.catching_up import Backlog, CatchingUp
from moon.sources.source import Outputs, Reach, Source
from moon.verdict import Verdict
from transports.interface import Answer, Observation, ObservationKind, ReadsParts, Tap


class Watch(Judge[Intake], Protocol):
    """A judge of what is received, in the order in which it is received.

    What is received late it puts in order itself; it knows what its verdicts rely on, and whom to ask. Its
    ``due_ns`` is when a turn is wanted (ns); 0: at once.
    """

    def start(self, since_ns: int, linked_ns: int) -> None:
        """All is received since ``since_ns``.

        Args:
            since_ns: ns since the epoch.
            linked_ns: so long after it was found, a node is linked on all its channels (ns); 0: at once.
        """
        ...

    def answered(self, node: str, answer: Answer, reach_ns: int) -> Iterable[Verdict]:
        """``node`` said up to where it has reported everything; it is ``reach_ns`` (ns)."""
        ...

    def finish(self, known_ns: int, end_ns: int) -> Iterable[Verdict]:
        """Nothing is received any more; see :meth:`Run.finish`."""
        ...

    def take_questions(self) -> Sequence[str]:
        """The nodes to be asked now how far they have reported."""
        ...

    def report(self, verdict: Verdict) -> Reach:
        """``verdict``, which it found, is reported: to whom."""
        ...

    @property
    def violations(self) -> int:
        """How often something was violated."""
        ...

    @property
    def late(self) -> int:
        """Observations that came too late to be judged."""
        ...

    def statuses(self) -> Iterable[MachineStatus]:
        """How what it judges stands, with all that was ever found."""
        ...

    def standings(self) -> Iterable[tuple[str, str, str, tuple[str, ...]]]:
        """Name, kind, verdict and states of what it judges, as it is now."""
        ...


class Run:
    """Judges one run of a system: from source to feed, from feed to judges, from judges to outputs.

    Args:
        source: where what is judged comes from.
        monitored: what is monitored.
        outputs: where what is found goes.
        properties: a fresh monitor of the properties of ``monitored``, if there is one already.
        in_order: ``source`` hands over each observation before all that happened after it.
    """

    def __init__(
        self,
        source: Source,
        monitored: Monitored,
        outputs: Outputs,
        properties: PropertyWatch | None = None,
        in_order: bool = False,
    ) -> None:
        self.counts = Counts()
        latency_ns = monitored.bounds.latency
        self._source = source = CatchingUp(
            source, latency_ns, self._woke, self._is_whole, outputs.say
        )
        self._outputs = outputs
        system, bounds = monitored.system, monitored.bounds
        self._latency_ns = bounds.latency
        properties = properties or monitored.property_watch()
        everything = (*system.nodes, *system.plugins)
        properties = properties or PropertyWatch((), bounds.latency)
        self._fields_read = monitored.fields_read
        reception = Reception(everything, system.library, bounds.latency, self.counts)
        reception.know(properties.channels)
        self._reception = reception
        self._senders = Senders(system.nodes, system.plugins)
        known = (POLICY, *(node.name for node in everything))
        self._feed = Feed(source, bounds, reception, self.counts, known, in_order)
        self._clock = self._feed.clock
        reporters = _reporters(system)
        properties.rely_on(self._feed.sources, by_channel(reporters), self._clock)
        self._properties = properties
        self._named = system.channels
        self._models = MachineWatch(monitored, self._feed, source, outputs.say)
        nodes = self._feed.sources
        others = [Window(make(), bounds.latency, nodes, reporters) for make in monitored.judges]
        self._judges: tuple[Watch, ...] = (self._models, properties, *others)
        self._turns = Turns(source, self._turn, bounds.latency)
        self._asking = Asking(source.gated(self._answered), source.now_ns)
        self._began_ns = 0
        self.listener: Tap | None = None

    def start(self, since_ns: int = 0, finds_nodes: bool = True) -> None:
        """Begin to listen (on the executor, or before it spins).

        Args:
            since_ns: since when all is received of what the source hands over, ns since the epoch; 0: now.
            finds_nodes: the source says which nodes are there, as all do but recordings of others.
        """
        source = self._source
        self.listener = tap = source.tap([], self._observe)
        if self._fields_read is not None and isinstance(tap, ReadsParts):
            tap.read_only(self._fields_read)
        self._began_ns = self._feed.start(self.listener, since_ns, finds_nodes)
        source.watch_nodes(self._node_changed)
        self._turns.plan(0)
        # such a middleware links who listens channel by channel
        linked_ns = LINKED_NS if source.repair_s else 0
        for judge in self._judges:
            judge.start(self._began_ns, linked_ns)

    # --- what is received --------------------------------------------------------------------------

    def _observe(self, received: Observation) -> None:
        now_ns = self._source.now_ns()
        self._turns.received(now_ns)
        seen = self._senders.attributed(received)
        if seen is None:
            return
        intake = self._feed.take(seen, now_ns)
        for gap in intake.gaps:
            self.gap(gap)
        if intake.judged is not None:
            for judge in self._judges:
                self._report(judge, judge.observe(intake))

    def gap(self, gap: Gap | None) -> None:
        """Something is missing; None: nothing is."""
        if gap is None:
            return
        if gap.cause in (Missing.ANEW, Missing.OWN_CLOCK_SET):
            self._asking.clock_set()
        for judge in self._judges:
            self._report(judge, judge.gap(gap))

    def _woke(self) -> list[str]:
        """Who can be asked is asked how far it has reported: what it did meanwhile may be missing."""
        names = self._feed.sources.to_ask()
        self._ask(names)
        return names

    def _is_whole(self, backlog: Backlog) -> bool:
        return self._feed.is_whole(backlog.seen, backlog.answers)

    def _node_changed(self, name: str, up: bool) -> None:
        if self._turns.is_over:
            return
        now_ns = self._source.now_ns()
        self._turns.received(now_ns)
        since_ns, clock = (
            (self._source.up_since(name), self._source.clock_of(name)) if up else (0, "")
        )
        change = NodeChange(name, up, since_ns, now_ns, clock)
        self._feed.sources.changed(name, up, change.since_ns if up else now_ns)
        for judge in self._judges:
            self._report(judge, judge.node_changed(change))

    # --- time --------------------------------------------------------------------------------------

    def _turn(self) -> None:
        now_ns, monotonic_ns = self._feed.read_clocks()
        self.gap(self._feed.look_at_clock(now_ns, monotonic_ns))
        # behind what the tap has already handed over
        self._source.post(functools.partial(self._advance, now_ns, monotonic_ns))

    def _advance(self, now_ns: int, monotonic_ns: int) -> None:
        clock_ns, gaps = self._feed.tick(now_ns, monotonic_ns)
        for gap in gaps:
            self.gap(gap)
        for judge in self._judges:
            self._report(judge, judge.advance(clock_ns))
        self._ask(self._feed.sources.clocks.take_questions())
        is_behind = clock_ns < now_ns
        self._turns.plan(0 if is_behind else min(judge.due_ns for judge in self._judges))

    def finish(self, known_ns: int, end_ns: int) -> None:
        """Nothing is received any more.

        What a node did is judged up to the end: of what it reports, nothing overtakes what came before.

        Args:
            known_ns: all that happened until then (ns) was received, or is lost.
            end_ns: what was received last was received then; what happened since ``known_ns`` may be missing.
        """
        self.settle()
        if end_ns < self._feed.since_ns:
            return
        for gap in self._feed.sources.advance(end_ns + self._latency_ns):
            self.gap(gap)
        for judge in self._judges:
            self._report(judge, judge.finish(known_ns, end_ns))

    def settle(self) -> None:
        """It is to end: if it stood still just now, what has waited is not waited for any longer."""
        self._source.begin_anew()

    def ending(self, now_ns: int) -> None:
        """Who runs the system begins to end its nodes: from ``now_ns`` (ns) on none of them owes anything."""
        if self.listener is not None:
            self._properties.ending(now_ns)

    def close(self) -> None:
        """Listen no more, and judge nothing more: what was said stands; idempotent."""
        self.settle()
        self._turns.end()
        if self.listener is not None:
            self.listener.close()

    def _ask(self, nodes: Iterable[str]) -> None:
        """Ask ``nodes`` how far they have reported."""
        for node in nodes:
            if self.listener is not None:
                self._asking.ask(self.listener, node)

    def _answered(self, node: str, answer: Answer, asked_ns: int) -> None:
        """``node`` says up to where it has reported everything, and what its clock shows."""
        if self._feed.sources.is_past(node, answer):
            return
        now_ns = self._source.now_ns()
        clock_ns = answer.clock_ns or answer.stamp_ns
        if asked_ns:
            self.gap(self._feed.answered(node, asked_ns, clock_ns, now_ns))
        if not self._feed.is_timed(answer.stamp_ns, now_ns):
            return
        self.gap(self._feed.heard(node, clock_ns, now_ns))
        reach_ns = self._clock.reach_ns(now_ns)
        self._feed.sources.answered(node, answer.next_order, answer.stamp_ns)
        for judge in self._judges:
            self._report(judge, judge.answered(node, answer, reach_ns))

    # --- verdicts ----------------------------------------------------------------------------------

    def _report(self, judge: Watch, verdicts: Iterable[Verdict]) -> None:
        """Hand the ``verdicts`` of ``judge`` to the sinks, each as it is found; ask what it has to ask."""
        for verdict in verdicts:
            reach = judge.report(verdict)
            if reach is Reach.NOBODY:
                self._outputs.repeated(verdict)
                continue
            for sink in self._outputs.sinks:
                sink.take(verdict)
            for sink in self._outputs.screens if reach is Reach.PEOPLE else ():
                sink.take(verdict)
        self._ask(judge.take_questions())

    # --- what can be asked -------------------------------------------------------------------------

    @property
    def violations(self) -> int:
        """How often a model or a property was violated."""
        return sum(judge.violations for judge in self._judges)

    def oracles(self) -> Mapping[str, Oracle | PolicyOracle]:
        """The oracle of each watched node, until all are resynchronised."""
        return self._models.models.watched

    def statuses(self) -> list[MachineStatus]:
        """Each machine as it stands, then each property."""
        return [status for judge in self._judges for status in judge.statuses()]

    def standings(self) -> Iterator[tuple[str, str, str, tuple[str, ...]]]:
        """Name, kind, verdict and states of each machine as it is now, then of each property.

        A machine that conforms again is conforming, whatever it did before.
        """
        for judge in self._judges:
            yield from judge.standings()

    def _late_in_all(self) -> int:
        return self.counts.late + sum(judge.late for judge in self._judges)

    def problems(self) -> list[str]:
        """What cannot be received or judged, one sentence each, counts in front of ``message``."""
        counts = self.counts
        found = list(self.listener.problems()) if self.listener is not None else []
        for number, what in (
            (counts.future, "stamped in the future: clocks differ, or were set"),
            (counts.unnamed, "without a sender's name: their stamps are not relied on"),
            (counts.mistyped, "of a type that is not the models': nodes drop them too"),
            (self._late_in_all(), "that came too late to be judged"),
            (counts.before, "from before it was connected"),
        ):
            if number:
                found.append(f"received {number} message{'s' * (number != 1)} {what}")
        return [*found, *self._reception.slips(), *self._senders.sentences()]

    def silent(self) -> list[str]:
        """Where nothing was received that properties need and no model names, one sentence each."""
        return [
            f"nothing was received on {channel}{'; ' if hint else ''}{hint}"
            for channel in self._properties.silent()
            if channel not in self._named
            for hint in [nearest(channel, self.counts.unknown)]
        ]

    def summary(self) -> Summary:
        """How it stands at the end."""
        statuses = tuple(self.statuses())
        counts = msgspec.structs.replace(
            self.counts, late=self._late_in_all(), unconcerned=self._models.models.unconcerned
        )
        seconds = (self._source.now_ns() - self._began_ns) / NS
        return Summary(seconds, statuses, counts, tuple(self.problems()))


def _reporters(system: System) -> dict[tuple[str, bool], set[str]]:
    """The nodes that may report something on each channel, by their models, and whether those are messages.

    The policy calls its skills, and sends what its plugins do.
    """
    found: dict[tuple[str, bool], set[str]] = {}
    for (channel, kind), names in nodes_at(system.nodes, system.plugins).items():
        if kind is not ObservationKind.MESSAGE_TAKEN:
            at = found.setdefault((channel, kind is ObservationKind.MESSAGE), set())
            at |= names
            if kind is ObservationKind.RESPONSE_SENT and system.policy is not None:
                at.add(POLICY)
    return found
