"""A monitor at work: what is received goes to the oracles, their verdicts go to the sinks."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import msgspec

from m2c.model.machine import Machine
from m2c.model.system import System
from moon.feed.asking import Silence
from moon.feed.clock import NS, clock_nobody_sets
from moon.feed.counts import Counts
from moon.feed.intake import Feed
from moon.feed.reception import Reception
from moon.feed.senders import Senders, places
from moon.judge import Gap, Missing
from moon.monitor.compiled import CompiledSystem
from moon.monitor.models import ModelMonitor
from moon.monitor.nodes import WatchedNode
from moon.monitor.properties import PropertyWatch
from moon.monitor.status import POLICY, PROPERTY, UNSEEN, MachineStatus, Summary
from moon.monitor.turns import Turns
from moon.oracle.bounds import FOREVER, LINKED_NS, Bounds
from moon.oracle.oracle import Oracle
from moon.policy.oracle import PolicyOracle
from moon.sources.source import Sink, Source
from moon.verdict import Outcome, Verdict
from transports.interface import Answer, Observation, ObservationKind, Tap

MIDDLE = "started in the middle of a run: waiting until its state is certain"
GONE = "its node is no longer up"


class SystemWatch:
    """Watches one system over ``transport``.

    Args:
        transport: the monitor's own connection.
        system: the models, all of them.
        machines: those to be monitored.
        bounds: what is assumed of the middleware.
        sinks: each gets every verdict that is new.
        say: called with what a person should know, one sentence each.
        properties: what else is to be monitored, of the same observations.
        policy: whether the policy is monitored; by default, if all machines of ``system`` are.
        monotonic_ns: a clock that nobody sets: by it a standstill is distinguished from a clock that was.
        repeated: takes each violation that repeats one of its node (``Verdict.pattern``): sinks do not.
        screens: sinks for people, who are told once when all machines are resynchronised, not of each.
        compiled: ``system``, if it was compiled already: watches of many runs of it share that.
        in_order: ``transport`` hands over each observation before all that happened after it.
    """

    def __init__(
        self,
        transport: Source,
        system: System,
        machines: Sequence[Machine],
        bounds: Bounds,
        sinks: Iterable[Sink],
        say: Callable[[str], None],
        properties: PropertyWatch | None = None,
        policy: bool | None = None,
        monotonic_ns: Callable[[], int] | None = None,
        repeated: Callable[[Verdict], None] = lambda verdict: None,
        screens: Iterable[Sink] = (),
        compiled: CompiledSystem | None = None,
        in_order: bool = False,
    ) -> None:
        self.counts = Counts()
        self._repeated = repeated
        self._violations = 0
        """By machines."""
        self._transport = transport
        self._machines = tuple(machines)
        monitored = {machine.name for machine in machines}
        self._others = {node.name: node for node in system.nodes if node.name not in monitored}
        """Nodes that are not monitored: what they publish matters all the same."""
        self._others_up: set[str] = set()
        self._library = system.library
        self._bounds = bounds
        self._sinks = tuple(sinks)
        self._screens = tuple(screens)
        self._say = say
        self._properties = properties or PropertyWatch((), bounds.latency)
        everything = (*system.nodes, *system.plugins)
        reception = Reception(everything, system.library, bounds.latency, self.counts)
        reception.know(self._properties.channels)
        self._senders = Senders(system.nodes, system.plugins)
        self._feed = Feed(
            transport.now_ns,
            monotonic_ns or clock_nobody_sets(transport),
            bounds.latency,
            transport.repair_s,
            reception,
            self.counts,
            (POLICY, *(node.name for node in everything)),
            bounds.skew,
            in_order,
        )
        self._clock = self._feed.clock
        self._properties.rely_on(self._feed.sources, _reporters(system))
        if policy is None:
            policy = {machine.name for machine in machines} >= {node.name for node in system.nodes}
        self._has_policy = policy and system.policy is not None
        self._compiled = compiled or CompiledSystem(system, machines)
        self._models = self._fresh_models()
        self._nodes = {name: WatchedNode() for name in self._models.watched}
        self._up: tuple[str, ...] = ()
        """The nodes that are up, and since when each is."""
        self._up_since: list[int] = []
        self._gone: list[tuple[str, WatchedNode]] = []
        self._turns = Turns(transport, self._turn, bounds.latency)
        self._silence = Silence(self._answered, bounds.latency / NS, transport.now_ns)
        self._began_ns = 0
        self.listener: Tap | None = None

    def start(self, since_ns: int = 0) -> None:
        """Begin to listen (on the executor, or before it spins).

        Args:
            since_ns: since when all is received of what ``transport`` hands over, ns since the epoch; 0: now.
        """
        transport = self._transport
        self.listener = transport.tap([], self._observe)
        self._began_ns = self._feed.start(self.listener, since_ns, transport.repair_s)
        transport.watch_nodes(self._node_changed)
        self._turns.plan(0)
        # such a middleware links who listens channel by channel
        self._properties.start(self._began_ns, LINKED_NS if transport.repair_s else 0)

    # --- what is received --------------------------------------------------------------------------

    def _observe(self, received: Observation) -> None:
        now_ns = self._transport.now_ns()
        self._turns.received(now_ns)
        seen = self._senders.attributed(received)
        if seen is None:
            return
        intake = self._feed.take(seen, now_ns)
        for gap in intake.gaps:
            self.gap(gap)
        judged = intake.judged
        if judged is not None:
            self._note_received(judged, now_ns)
            self._properties.observe(seen)
            self._take(self._models.feed(judged, intake.sequel))

    def _note_received(self, judged: Observation, now_ns: int) -> None:
        node = self._nodes.get(judged.source)
        if node is not None:
            node.lags.append(now_ns - judged.stamp_ns)
            if not node.up:
                if not node.received_ns:
                    self._models.node_found(judged.source, now_ns + LINKED_NS)
                node.received_ns = max(node.received_ns, judged.stamp_ns)

    def gap(self, gap: Gap | None) -> None:
        """Something is missing; None: nothing is."""
        if gap is None:
            return
        match gap.cause:
            case Missing.ANEW | Missing.SET_BACK:
                self._start_anew(gap)
            case Missing.CLOCK_SET:
                self._host_clock_set(gap)
            case Missing.NUMBERED if not gap.channel:
                self._properties.gap(gap)
            case _:
                if gap.kind is not ObservationKind.MESSAGE_TAKEN:  # of which properties say nothing
                    self._properties.lose(gap.channel, gap.from_ns, gap.until_ns)
                if gap.cause is not Missing.NUMBERED:  # the oracles follow numbers themselves
                    self._lose_of_models(gap)

    def _lose_of_models(self, gap: Gap) -> None:
        kinds = ObservationKind if gap.kind is None else (gap.kind,)
        for name, oracle in self._models.watched.items():
            if gap.kind is None and not self._nodes[name].is_seen:
                continue
            if any(oracle.concerns(gap.channel, gap.source, kind) for kind in kinds):
                self._lose(oracle, gap.why)

    # --- time --------------------------------------------------------------------------------------

    def _turn(self) -> None:
        now_ns, monotonic_ns = self._feed.read_clocks()
        self.gap(self._feed.look_at_clock(now_ns, monotonic_ns))
        # behind what the tap has already handed over
        self._transport.post(functools.partial(self._advance, now_ns, monotonic_ns))

    def _advance(self, now_ns: int, monotonic_ns: int) -> None:
        clock_ns, gaps = self._feed.tick(now_ns, monotonic_ns)
        for gap in gaps:
            self.gap(gap)
        up_since = list(map(self._transport.up_since, self._up))
        if up_since != self._up_since:  # hardly ever
            for name, since in zip(self._up, up_since, strict=True):
                if since != self._nodes[name].since:
                    self._node_up(name, self._nodes[name])
        if clock_ns >= self._feed.since_ns:
            self._take(self._models.advance(clock_ns))
            self._look_at_links(clock_ns)
        self._advance_properties(clock_ns)
        for name, node in self._gone:
            if node.gone_ns is not None and node.gone_ns < clock_ns - 2 * self._bounds.latency:
                self._lose(self._models.watched[name], GONE)  # what it had sent is judged by now
        self._report_changes(now_ns)
        silent_ns = FOREVER
        if self.listener is not None:
            silent_ns = self._silence.look(self.listener, self._models.watched, clock_ns)
            for asked in (*self._models.to_ask(), *self._feed.sources.clocks.take_questions()):
                self._silence.ask(self.listener, asked)
        is_behind = clock_ns < now_ns
        wanted_ns = min(self._models.turn_ns, self._properties.turn_ns, silent_ns)
        self._turns.plan(0 if is_behind else wanted_ns)

    def finish(self, known_ns: int, end_ns: int) -> None:
        """Nothing is received any more.

        What a node did is judged up to the end: of what it reports, nothing overtakes what came before.

        Args:
            known_ns: all that happened until then (ns) was received, or is lost.
            end_ns: what was received last was received then; what happened since ``known_ns`` may be missing.
        """
        if end_ns < self._feed.since_ns:
            return
        reach_ns = end_ns + self._bounds.latency
        for gap in self._feed.sources.advance(reach_ns):
            self.gap(gap)
        self._take(self._models.advance(reach_ns))
        self._report_properties(self._properties.finish(known_ns, end_ns))
        self._report_changes(end_ns)

    def close(self) -> None:
        """Listen no more, and judge nothing more: what was said stands; idempotent."""
        self._turns.end()
        if self.listener is not None:
            self.listener.close()

    def _look_at_links(self, now_ns: int) -> None:
        """Ask who has to be reached before it is known who is at fault; say what a network did."""
        for node in self._models.take_unreached():
            if self.listener is not None:
                self._silence.ask(self.listener, node)
        for found in self._models.take_findings(now_ns):
            self._say(f"warning: {found}")

    def _answered(self, node: str, answer: Answer, asked_ns: int) -> None:
        """``node`` says up to where it has reported everything, and what its clock shows."""
        now_ns = self._transport.now_ns()
        if asked_ns:
            self.gap(self._feed.answered(node, asked_ns, answer.stamp_ns, now_ns))
        if not self._feed.is_timed(answer.stamp_ns, now_ns):
            return
        self.gap(self._feed.heard(node, answer.stamp_ns, now_ns))
        reach_ns = self._clock.reach_ns(now_ns)
        self._feed.sources.answered(node, answer.next_order, answer.stamp_ns)
        oracle = self._models.watched.get(node)
        if oracle is not None:
            self._take(oracle.reported(answer.next_order, answer.stamp_ns, reach_ns))
        self._take(self._models.told())
        self._advance_properties(reach_ns)

    def _advance_properties(self, now_ns: int) -> None:
        self._report_properties(self._properties.advance(now_ns, self._clock.lag_ns))
        for node in self._properties.take_questions():
            if self.listener is not None:
                self._silence.ask(self.listener, node)

    def _host_clock_set(self, gap: Gap) -> None:
        """The stamps of its source of before and after are not compared."""
        self._properties.clock_set(gap.from_ns, gap.until_ns)
        watched = self._models.watched
        names = [name for name in watched if name in self._models.that_hear(gap.source)]
        for name in names:
            watched[name].doubt()
            self._lose(watched[name], gap.why)
        concerned = f"resynchronised: {', '.join(names)}" if names else "nothing depends on it"
        self._say(f"warning: {gap.why}: {concerned}")

    def _start_anew(self, gap: Gap) -> None:
        """Find every machine in the middle of what it does."""
        self._silence.clock_set()
        for name, oracle in self._models.watched.items():
            self._nodes[name].resynchronise(oracle, gap.why)
        self._models = self._fresh_models()
        if gap.cause is Missing.SET_BACK:
            self._report_properties(self._properties.begin_anew(gap.until_ns, gap.why))
        else:
            self._properties.clock_set(gap.from_ns, gap.until_ns)
        self._say(f"warning: {gap.why}: all machines are resynchronised")
        for name, node in self._nodes.items():
            if node.is_seen:
                self._models.node_found(name, gap.until_ns)
                self._take(self._models.watched[name].lose(gap.until_ns, gap.why))

    def _fresh_models(self) -> ModelMonitor:
        models = ModelMonitor(
            self._machines,
            self._library,
            self._bounds,
            synchronised=False,
            policy=self._compiled.policy_oracle(self._bounds) if self._has_policy else None,
            others=self._others.values(),
            numbers=self._feed.numbers,
            programs=self._compiled.programs,
            sources=self._feed.sources,
        )
        for name in models.oracles:
            models.node_found(name, FOREVER)  # it is not known to be there
        for name in self._others_up:
            models.node_found(name, self._feed.since_ns)
        return models

    # --- nodes -------------------------------------------------------------------------------------

    def _node_changed(self, name: str, up: bool) -> None:
        if self._turns.is_over:
            return
        now_ns = self._transport.now_ns()
        self._turns.received(now_ns)
        self._feed.sources.changed(name, up, self._transport.up_since(name) if up else now_ns)
        self._properties.node_changed(name, up, now_ns)
        self._models.sender_changed(name, now_ns, self._transport.up_since(name) if up else 0)
        node = self._nodes.get(name)
        if up and self._transport.up_since(name) < self._feed.since_ns:
            # what it did before is not known, so nothing is reported of what should have been before
            self._properties.lose_all(0, max(self._feed.since_ns, now_ns) + 1)
        if node is None:
            if up and name in self._others:
                self._others_up.add(name)
                self._models.node_found(name, now_ns)
            return
        if up:
            self._node_up(name, node)
            return
        if node.end(now_ns):
            verdict = self._models.watched[name].verdict(now_ns)
            self._publish(msgspec.structs.replace(verdict, outcome=Outcome.CONFORMING, reason=""))
        self._sort_nodes()

    def _sort_nodes(self) -> None:
        """One of them came or went."""
        self._up = tuple(name for name, node in self._nodes.items() if node.up)
        self._up_since = [self._nodes[name].since for name in self._up]
        self._gone = [item for item in self._nodes.items() if item[1].gone_ns is not None]

    def _node_up(self, name: str, node: WatchedNode) -> None:
        """Synchronised if everything that it did and got was received; else found in the middle.

        It was, if it began to connect after this monitor listened: then the two were linked before
        the node could declare anything (opening a connection waits for those who are there).
        """
        before, node.since = node.since, self._transport.up_since(name)
        started = node.since >= self._feed.since_ns and node.since != before
        # what it did before is of the life that has ended
        received, node.received_ns = node.received_ns >= max(node.since, 1), 0
        oracle = self._models.oracles.get(name)
        if oracle is not None and oracle.has_acted(max(node.since, 1)):
            received = True  # its callers were heard before it was known that it is there
        again = before != 0
        node.up, node.gone_ns = True, None
        self._sort_nodes()
        if not started or received:
            if again or received:
                self._lose(self._models.watched[name], MIDDLE)
            found_ns = max(self._transport.now_ns(), self._feed.since_ns)
            self._models.node_found(name, found_ns + LINKED_NS)
            return
        self._feed.numbers.forget(name, node.since)
        if again:
            self._say(f"{name} has started again")
        # what it did while it came up is received from now on: half the bound, before it is too late
        reach_ns = self._clock.reach_ns(self._transport.now_ns())
        stamp_ns = reach_ns - self._bounds.latency // 2
        started_ns = max(stamp_ns, node.since)
        self._models.node_started(name, started_ns, node.since)
        if self.listener is not None:
            self._silence.ask(self.listener, name)
        if self._transport.repair_s:  # such a middleware links who listens channel by channel
            self._models.node_found(name, started_ns + LINKED_NS)

    # --- verdicts ----------------------------------------------------------------------------------

    def _lose(self, oracle: Oracle | PolicyOracle, why: str) -> None:
        self._take(oracle.lose(self._clock.now_ns, why))

    def _take(self, verdicts: Sequence[Verdict]) -> None:
        for verdict in verdicts:
            if verdict.outcome is not Outcome.VIOLATED:
                continue
            node = self._nodes[verdict.node]
            if node.gone_ns is not None and verdict.is_silence:
                continue  # who is not there owes nothing
            node.violations += 1
            self._violations += 1
            if node.repeats(verdict):
                self._repeated(verdict)
            else:
                self._publish(verdict)

    def _report_properties(self, verdicts: Sequence[Verdict]) -> None:
        for verdict in verdicts:
            for sink in (*self._sinks, *self._screens):
                sink.take(verdict)

    def _report_changes(self, now_ns: int) -> None:
        """What else has changed: a machine is known again, or no longer."""
        for oracle, node in zip(self._models.watched.values(), self._nodes.values(), strict=True):
            outcome = oracle.outcome
            if outcome is Outcome.VIOLATED:
                continue
            is_news = node.suspects(oracle.suspected)
            if outcome is node.reported and not is_news:
                continue
            if node.gone_ns is not None or not node.is_seen:
                continue  # what was known of it stands
            if outcome is Outcome.CONFORMING and not oracle.hypotheses:
                continue  # found in the middle, and silent since
            self._publish(oracle.verdict(now_ns))

    def _publish(self, verdict: Verdict) -> None:
        is_for_people = self._nodes[verdict.node].report(verdict)
        for sink in self._sinks:
            sink.take(verdict)
        for sink in self._screens if is_for_people else ():
            sink.take(verdict)

    # --- what can be asked -------------------------------------------------------------------------

    @property
    def violations(self) -> int:
        """How often a model or a property was violated."""
        return self._violations + self._properties.violations

    def oracles(self) -> Mapping[str, Oracle | PolicyOracle]:
        """The oracle of each watched node, until all are resynchronised."""
        return self._models.watched

    def statuses(self) -> list[MachineStatus]:
        """Each machine as it stands, then each property."""
        return [
            *self._of_machines(),
            *self._properties.statuses(),
        ]

    def standings(self) -> Iterator[tuple[str, str, str, tuple[str, ...]]]:
        """Name, kind, verdict and states of each machine as it is now, then of each property.

        A machine that conforms again is conforming, whatever it did before.
        """
        for name, oracle in self._models.watched.items():
            verdict, states = self._nodes[name].standing(oracle)
            yield name, "model", verdict, states
        for name, outcome in self._properties.outcomes():
            yield name, PROPERTY, UNSEEN if outcome is None else str(outcome), ()

    def _of_machines(self) -> Iterator[MachineStatus]:
        for name, oracle in self._models.watched.items():
            yield self._nodes[name].status(name, oracle)

    def _late_in_all(self) -> int:
        watched = self._models.watched
        machines = sum(self._nodes[name].late(oracle) for name, oracle in watched.items())
        return self.counts.late + self._properties.late + machines

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
        return [*found, *self._senders.sentences()]

    def summary(self) -> Summary:
        """How it stands at the end."""
        statuses = tuple(self.statuses())
        counts = msgspec.structs.replace(
            self.counts, late=self._late_in_all(), unconcerned=self._models.unconcerned
        )
        seconds = (self._transport.now_ns() - self._began_ns) / NS
        return Summary(seconds, statuses, counts, tuple(self.problems()))


def _reporters(system: System) -> dict[str, set[str]]:
    """The nodes that may report something on each channel, by their models.

    The policy calls its skills, and sends what its plugins do.
    """
    found: dict[str, set[str]] = {}
    for machine in (*system.nodes, *system.plugins):
        name = machine.name if machine in system.nodes else POLICY
        for channel, kind in places(machine):
            if kind is not ObservationKind.MESSAGE_TAKEN:
                found.setdefault(channel, set()).add(name)
            if kind is ObservationKind.RESPONSE_SENT:
                found[channel].add(POLICY)
    return found
