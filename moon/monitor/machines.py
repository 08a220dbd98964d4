"""Machines at work in a monitor: what is known of their nodes, and what their oracles say of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import msgspec

from moon.feed.asking import Silences
from moon.feed.intake import Feed
from moon.judge import Gap, Intake, Missing, NodeChange
from moon.monitor.compiled import CompiledSystem
from moon.monitor.models import ModelMonitor
from moon.monitor.nodes import WatchedNode
from moon.monitor.status import MachineStatus
from moon.monitor.subject import Monitored
from moon.oracle.bounds import FOREVER, LINKED_NS
from moon.oracle.oracle import Oracle
from moon.policy.oracle import PolicyOracle
from moon.sources.source import Reach, Source
from moon.verdict import MIDDLE, Outcome, Verdict
from transports.interface import Answer, Observation, ObservationKind

GONE = "its node is no longer up"


class MachineWatch:
    """Monitors the machines of one system, and its policy.

    Args:
        monitored: the models, and which of them are monitored.
        feed: what it is told of; its numbers and nodes are relied on.
        source: where that comes from.
        say: called with what a person should know, one sentence each.
    """

    def __init__(
        self, monitored: Monitored, feed: Feed, source: Source, say: Callable[[str], None]
    ) -> None:
        self.name = "models"
        self.violations = 0
        self._monitored = monitored
        self._bounds = monitored.bounds
        self._others = {node.name for node in monitored.compiled.others}
        self._others_up: set[str] = set()
        self._feed = feed
        self._clock = feed.clock
        self._source = source
        self._say = say
        self.models = self._fresh_models()
        """The oracle of each watched node, until all are resynchronised."""
        self._nodes = {name: WatchedNode() for name in self.models.watched}
        self._up: tuple[str, ...] = ()
        """The nodes that are up, and since when each is."""
        self._up_since: list[int] = []
        self._gone: list[tuple[str, WatchedNode]] = []
        self._to_ask: list[str] = []
        self._silences = Silences()

    def _fresh_models(self) -> ModelMonitor:
        monitored = self._monitored
        compiled: CompiledSystem = monitored.compiled
        models = ModelMonitor(
            monitored.machines,
            monitored.system.library,
            self._bounds,
            synchronised=False,
            policy=compiled.policy_oracle(self._bounds) if monitored.policy else None,
            compiled=compiled,
            feed=self._feed,
        )
        for name in models.oracles:
            models.node_found(name, FOREVER)  # it is not known to be there
        for name in self._others_up:
            models.node_found(name, self._feed.since_ns)
        models.losses.by_channel = self._source.repair_s > 0
        return models

    def start(self, since_ns: int, linked_ns: int) -> None:
        """Nothing is known before something is received.

        A middleware that links who listens channel by channel stamps by the clock of each host.
        """
        if linked_ns and self._bounds.skew < self._bounds.differ:
            self._bounds = msgspec.structs.replace(self._bounds, skew=self._bounds.differ)
            self.models = self._fresh_models()
        self.models.losses.by_channel = linked_ns > 0

    # --- what is received --------------------------------------------------------------------------

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether it concerns one of the machines."""
        return any(it.concerns(channel, source, kind) for it in self.models.watched.values())

    def observe(self, seen: Intake) -> Sequence[Verdict]:
        """Take what was received next."""
        judged = seen.judged
        if judged is None:
            return ()
        self._note_received(judged, seen.now_ns)
        return self._violated(self.models.feed(judged, seen.sequel))

    def _note_received(self, judged: Observation, now_ns: int) -> None:
        node = self._nodes.get(judged.source)
        if node is not None:
            node.lags.append(now_ns - judged.stamp_ns)
            if not node.up:
                if not node.received_ns:
                    self.models.node_found(judged.source, now_ns + LINKED_NS)
                node.received_ns = max(node.received_ns, judged.stamp_ns)

    def gap(self, gap: Gap) -> Sequence[Verdict]:
        """Something is missing; what numbers show of that is followed by the oracles themselves."""
        match gap.cause:
            case Missing.ANEW | Missing.OWN_CLOCK_SET:
                return self._start_anew(gap)
            case Missing.CLOCK_SET:
                return self._host_clock_set(gap)
            case Missing.NUMBERED:
                return ()
            case Missing.NOT_RECEIVED:
                watched = self.models.watched.items()
                users = [
                    it
                    for name, it in watched
                    if gap.source in ("", name)
                    and self._nodes[name].is_seen
                    and it.uses(gap.channel)
                ]
                return [verdict for oracle in users for verdict in self._miss(oracle, gap)]
            case Missing.MAY_NOT_BE_TAKEN:
                taker = self.models.watched.get(gap.source)
                if taker is None or not taker.takes(gap.channel):
                    return ()
                return self._miss(taker, gap) if self._nodes[gap.source].is_seen else ()
            case Missing.OTHER_TIME:
                timed = self.models.watched.get(gap.source)
                if timed is None or not timed.has_timers:
                    return ()
                return self._miss(timed, gap) if self._nodes[gap.source].is_seen else ()
            case Missing.CONTESTED:
                if (claimed := self.models.watched.get(gap.source)) is not None:
                    claimed.doubt()  # it may have been silent because it had ended
        found: list[Verdict] = []
        kinds = ObservationKind if gap.kind is None else (gap.kind,)
        for name, oracle in self.models.watched.items():
            if gap.kind is None and not self._nodes[name].is_seen:
                continue
            if any(oracle.concerns(gap.channel, gap.source, kind) for kind in kinds):
                found += self._miss(oracle, gap)
        return found

    def _miss(self, oracle: Oracle | PolicyOracle, gap: Gap) -> Sequence[Verdict]:
        oracle.doubt(gap.from_ns)
        return self._lose(oracle, gap.why)

    def _host_clock_set(self, gap: Gap) -> Sequence[Verdict]:
        """The stamps of its source of before and after are not compared."""
        found: list[Verdict] = []
        watched = self.models.watched
        names = [name for name in watched if name in self.models.that_hear(gap.source)]
        for name in names:
            watched[name].doubt()
            found += self._lose(watched[name], gap.why)
        concerned = f"resynchronised: {', '.join(names)}" if names else "nothing depends on it"
        self._say(f"warning: {gap.why}: {concerned}")
        return found

    def _start_anew(self, gap: Gap) -> Sequence[Verdict]:
        """Find every machine in the middle of what it does."""
        for name, oracle in self.models.watched.items():
            self._nodes[name].resynchronise(oracle, gap.why)
        self.models = self._fresh_models()
        self._say(f"warning: {gap.why}: all machines are resynchronised")
        found: list[Verdict] = []
        for name, node in self._nodes.items():
            if node.is_seen:
                self.models.node_found(name, gap.until_ns)
                found += self._violated(self.models.watched[name].lose(gap.until_ns, gap.why))
        self._to_ask += self._up  # what they report next follows on what they have reported
        return found

    def _lose(self, oracle: Oracle | PolicyOracle, why: str) -> Sequence[Verdict]:
        return self._violated(oracle.lose(self._clock.now_ns, why))

    # --- time --------------------------------------------------------------------------------------

    def advance(self, until_ns: int) -> Iterator[Verdict]:
        """It is ``until_ns`` (ns); what that brings about."""
        now_ns = self._clock.now_ns
        yield from self._look_who_is_up()
        if until_ns >= self._feed.since_ns:
            yield from self._violated(self.models.advance(until_ns))
            self._to_ask += self.models.take_unreached()
            links = self._feed.sources.take_findings(until_ns)
            for found in (*self.models.take_findings(until_ns), *links):
                self._say(f"warning: {found}")
        for name, node in self._gone:
            if node.gone_ns is not None and node.gone_ns < until_ns - 2 * self._bounds.latency:
                # what it had sent is judged by now
                yield from self._lose(self.models.watched[name], GONE)
        yield from self._changes(now_ns)
        due = ((node, oracle.silent_ns) for node, oracle in self.models.watched.items())
        self._to_ask += self._silences.look(due, until_ns)
        self._to_ask += self.models.to_ask()

    def finish(self, known_ns: int, end_ns: int) -> Iterator[Verdict]:
        """Nothing is received any more: what nodes did is judged up to the end (``end_ns``)."""
        yield from self._violated(self.models.advance(end_ns + self._bounds.latency))
        yield from self._changes(end_ns)

    def answered(self, node: str, answer: Answer, reach_ns: int) -> Sequence[Verdict]:
        """``node`` said up to where it has reported everything; it is ``reach_ns`` (ns)."""
        found: list[Verdict] = []
        oracle = self.models.watched.get(node)
        if oracle is not None:
            found += oracle.reported(answer.next_order, answer.stamp_ns, reach_ns)
        return self._violated(found + self.models.told())

    def take_questions(self) -> Sequence[str]:
        """The nodes to be asked now how far they have reported."""
        if not self._to_ask:
            return ()
        names, self._to_ask = self._to_ask, []
        return names

    @property
    def due_ns(self) -> int:
        """When a turn is wanted (ns); 0: at once."""
        return min(self.models.turn_ns, self._silences.next_ns)

    # --- nodes -------------------------------------------------------------------------------------

    def node_changed(self, change: NodeChange) -> Sequence[Verdict]:
        """A node came up, or went away."""
        name, now_ns = change.node, change.now_ns
        self.models.sender_changed(name, now_ns, change.since_ns)
        node = self._nodes.get(name)
        if node is None:
            if change.is_up and name in self._others:
                self._others_up.add(name)
                self.models.node_found(name, now_ns)
            return ()
        if change.is_up:
            return self._node_up(name, node)
        found: list[Verdict] = []
        if node.end(now_ns):
            verdict = self.models.watched[name].verdict(now_ns)
            found.append(msgspec.structs.replace(verdict, outcome=Outcome.CONFORMING, reason=""))
        self._sort_nodes()
        return found

    def _sort_nodes(self) -> None:
        """One of them came or went."""
        self._up = tuple(name for name, node in self._nodes.items() if node.up)
        self._up_since = [self._nodes[name].since for name in self._up]
        self._gone = [item for item in self._nodes.items() if item[1].gone_ns is not None]

    def _look_who_is_up(self) -> Sequence[Verdict]:
        """Whether some node that was up has started again."""
        up_since = list(map(self._source.up_since, self._up))
        found: list[Verdict] = []
        if up_since != self._up_since:  # hardly ever
            for name, since in zip(self._up, up_since, strict=True):
                if since != self._nodes[name].since:
                    found += self._node_up(name, self._nodes[name])
        return found

    def _node_up(self, name: str, node: WatchedNode) -> Sequence[Verdict]:
        """Synchronised if everything that it did and got was received; else found in the middle.

        It was, if it began to connect after this monitor listened: then the two were linked before
        the node could declare anything (opening a connection waits for those who are there).
        """
        before, node.since = node.since, self._source.up_since(name)
        started = node.since >= self._feed.since_ns and node.since != before
        # what it did before is of the life that has ended
        received, node.received_ns = node.received_ns >= max(node.since, 1), 0
        oracle = self.models.oracles.get(name)
        if self._source.repair_s and oracle is not None and oracle.has_acted(max(node.since, 1)):
            # its callers were heard first, and where links come late numbers do not tell what is missing
            received = True
        again = before != 0
        if again and started:
            self._say(f"{name} has started again")
        node.up, node.gone_ns = True, None
        self._sort_nodes()
        if not started or received:
            found: Sequence[Verdict] = ()
            if again or received:
                found = self._lose(self.models.watched[name], MIDDLE)
            found_ns = max(self._source.now_ns(), self._feed.since_ns)
            self.models.node_found(name, found_ns + LINKED_NS)
            self._to_ask.append(name)
            return found
        self._feed.numbers.forget(name, node.since)
        # what it did while it came up is received from now on: half the bound, before it is too late
        reach_ns = self._clock.reach_ns(self._source.now_ns())
        stamp_ns = reach_ns - self._bounds.latency // 2
        started_ns = max(stamp_ns, node.since)
        self.models.node_started(name, started_ns, node.since)
        self._to_ask.append(name)
        if self._source.repair_s:  # such a middleware links who listens channel by channel
            self.models.node_found(name, started_ns + LINKED_NS)
        return ()

    # --- verdicts ----------------------------------------------------------------------------------

    def _violated(self, verdicts: Iterable[Verdict]) -> Sequence[Verdict]:
        """The violations among ``verdicts``; what else has changed is looked at when time passes."""
        return [
            it for it in verdicts if it.outcome is Outcome.VIOLATED and not self._is_excused(it)
        ]

    def _is_excused(self, verdict: Verdict) -> bool:
        """Whether it is of a node that is not there: that owes nothing."""
        return self._nodes[verdict.node].gone_ns is not None and verdict.is_silence

    def _changes(self, now_ns: int) -> Iterator[Verdict]:
        """What else has changed: a machine is known again, or no longer."""
        for oracle, node in zip(self.models.watched.values(), self._nodes.values(), strict=True):
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
            yield oracle.verdict(now_ns)

    def report(self, verdict: Verdict) -> Reach:
        """``verdict``, which it found, is reported: to whom."""
        node = self._nodes[verdict.node]
        if verdict.outcome is Outcome.VIOLATED:
            node.violations += 1
            self.violations += 1
            if node.repeats(verdict):
                return Reach.NOBODY
        return Reach.PEOPLE if node.report(verdict) else Reach.PROGRAMS

    # --- how they stand ----------------------------------------------------------------------------

    @property
    def late(self) -> int:
        """Observations that came too late to be judged."""
        return sum(self._nodes[name].late(it) for name, it in self.models.watched.items())

    def statuses(self) -> list[MachineStatus]:
        """Each machine as it stands."""
        return [self._nodes[name].status(name, it) for name, it in self.models.watched.items()]

    def standings(self) -> Iterator[tuple[str, str, str, tuple[str, ...]]]:
        """Name, kind, verdict and states of each machine as it is now, whatever it did before."""
        for name, oracle in self.models.watched.items():
            verdict, states = self._nodes[name].standing(oracle)
            yield name, "model", verdict, states
