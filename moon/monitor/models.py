"""The oracles of all machines of a system, each given what concerns it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Machine
from moon.feed.intake import Feed
from moon.feed.places import nodes_at
from moon.monitor.compiled import CompiledSystem
from moon.monitor.status import POLICY
from moon.monitor.turns import BEHIND_NS, MACHINES_NS
from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.confirmation import Publishers
from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from moon.policy.oracle import PolicyOracle
from moon.verdict import Verdict
from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel

_MESSAGE = ObservationKind.MESSAGE


class ModelMonitor:
    """Checks the nodes of one system against their models.

    Args:
        machines: the models; each runs on a node of its name.
        library: their message types.
        bounds: what is assumed of the middleware.
        synchronised: whether the nodes are known to start after the monitor (else they are found in
            the middle of a run).
        policy: the oracle of the behaviour tree that ticks them, if it is monitored too.
        compiled: their system, ready to be stepped, if it is already.
        feed: what it is told of, if that has a feed, which follows the numbers of all sources.

    Attributes:
        losses: whether observations are known to get lost; the first gap tells as well.
    """

    def __init__(
        self,
        machines: Iterable[Machine],
        library: InterfaceLibrary,
        bounds: Bounds | None = None,
        synchronised: bool = True,
        policy: PolicyOracle | None = None,
        compiled: CompiledSystem | None = None,
        feed: Feed | None = None,
    ) -> None:
        machines = tuple(machines)
        programs = {} if compiled is None else compiled.programs
        self.policy = policy
        self.bounds = bounds or Bounds()
        nodes = (*machines, *(() if compiled is None else compiled.others))
        callers = {POLICY, *(node.name for node in nodes)}
        publish = {
            place: names for (place, kind), names in nodes_at(nodes).items() if kind is _MESSAGE
        }
        self._publishers = Publishers(publish, callers)
        shared = Shared(
            publishers=self._publishers,
            numbers=None if feed is None else feed.numbers,
            sources=None if feed is None else feed.sources,
        )
        self.losses, self._clock = shared.losses, shared.clock
        self.oracles = {
            machine.name: Oracle(
                machine,
                library,
                machine.name,
                self.bounds,
                synchronised,
                shared,
                programs.get(machine.name),
            )
            for machine in machines
        }
        self._all = tuple(self.oracles.values())
        self.watched: dict[str, Oracle | PolicyOracle] = dict(self.oracles)
        """All oracles by the node they watch, the policy's included."""
        if policy is not None:
            self.watched[policy.node] = policy
        self._since: dict[str, int] = {}
        """When each node began to connect last (ns)."""
        self.unconcerned = 0
        """Observations that concern no monitored machine."""
        by_channel: dict[str, list[Oracle]] = {}
        for oracle in self.oracles.values():
            for channel in oracle.channels.ports:
                by_channel.setdefault(channel, []).append(oracle)
        self._by_channel = {channel: tuple(found) for channel, found in by_channel.items()}
        self._targets: dict[tuple[str, str, ObservationKind], Sequence[Oracle | PolicyOracle]] = {}

    def feed(self, observation: Observation, sequel: Sequel | None = None) -> list[Verdict]:
        """Take one observation; the verdicts it brings about.

        Args:
            observation: what was received.
            sequel: how its number follows, where that is known.
        """
        place = (observation.channel, observation.source, observation.kind)
        targets = self._targets.get(place)
        if targets is None:
            targets = self._targets[place] = self._find_targets(*place)
        if len(targets) == 1:
            return targets[0].feed(observation, sequel)
        verdicts: list[Verdict] = []
        for oracle in targets:
            verdicts += oracle.feed(observation, sequel)
        if not targets:
            self.unconcerned += 1
        return verdicts

    def _find_targets(
        self, channel: str, source: str, kind: ObservationKind
    ) -> Sequence[Oracle | PolicyOracle]:
        if len(self._targets) > _KEPT_TARGETS:
            self._targets.clear()  # names come from the wire: there is no end of them
        found: list[Oracle | PolicyOracle] = [
            oracle
            for oracle in self._by_channel.get(channel, ())
            if oracle.channels.concerns(channel, source, kind)
        ]
        own = self.oracles.get(source)
        if own is not None and own not in found:
            found.append(own)
        if self.policy is not None and self.policy.concerns(channel, source, kind):
            found.append(self.policy)
        return tuple(found)

    def that_hear(self, node: str) -> set[str]:
        """The nodes whose verdicts depend on when ``node`` did something."""
        found = {node}
        for (_, source, _), oracles in self._targets.items():
            if source == node:
                found.update(oracle.node for oracle in oracles)
        return found

    def advance(self, now_ns: int) -> list[Verdict]:
        """Time has passed (ns, on the clock of ``Observation.received_ns``)."""
        verdicts: list[Verdict] = []
        clock, watermark = self._clock, now_ns - self.bounds.latency
        if watermark > clock.watermark:
            clock.watermark = watermark
        if watermark >= clock.wake:
            wake = FOREVER
            for oracle in self._all:
                if oracle.wake <= watermark:
                    verdicts += oracle.advance(now_ns)
                if oracle.wake < wake:
                    wake = oracle.wake
            clock.wake = wake
        verdicts += self.told()
        return verdicts if self.policy is None else verdicts + self.policy.advance(now_ns)

    def told(self) -> list[Verdict]:
        """Nodes have reported something: violations of others that are certain by that."""
        return [verdict for oracle in self._all for verdict in oracle.told()]

    def to_ask(self) -> list[str]:
        """The nodes to be asked now how far they have reported, to make violations certain."""
        return sorted({name for oracle in self._all for name in oracle.to_ask()})

    @property
    def turn_ns(self) -> int:
        """When a turn is wanted, on the clock of ``advance``; 0: at once.

        So long after time alone may change something: :data:`MACHINES_NS` of machines, :data:`BEHIND_NS`
        of the policy.
        """
        wake = _behind(self._clock.wake, MACHINES_NS)
        if self.policy is not None:
            wake = min(wake, _behind(self.policy.wake, BEHIND_NS))
        return _behind(wake, self.bounds.latency)

    def node_found(self, node: str, stamp_ns: int) -> None:
        """``node`` was up already; what it does from ``stamp_ns`` on is received.

        ``FOREVER``: it is not known to be there.
        """
        if stamp_ns != FOREVER:
            self._publishers.came_up(node)
        oracle = self.oracles.get(node)
        if oracle is not None:
            oracle.listen(stamp_ns)
        if self.policy is not None and node == self.policy.node:
            self.policy.listen(stamp_ns)

    def take_unreached(self) -> set[str]:
        """Nodes of which it has to be known whether they can be reached: they are to be asked."""
        return {node for oracle in self._all for node in oracle.take_unreached()}

    def take_findings(self, now_ns: int) -> list[str]:
        """What was found of links, one sentence each."""
        return [found for oracle in self._all for found in oracle.take_findings(now_ns)]

    def sender_changed(self, node: str, stamp_ns: int, since_ns: int = 0) -> None:
        """``node`` came or went: what it sent last may never have left.

        Args:
            node: its name.
            stamp_ns: when that was known.
            since_ns: when it began to connect, if it came; as before where it was only out of reach.
        """
        if since_ns and since_ns != self._since.get(node):
            self._since[node] = stamp_ns = since_ns
        for oracle in self._all:
            oracle.sender_changed(node, stamp_ns)

    def node_started(self, node: str, stamp_ns: int, earliest_ns: int = FOREVER) -> None:
        """``node`` has just come up: its machine is in its initial state at ``stamp_ns``.

        Its delays may run since ``earliest_ns``, when the node began to connect.
        """
        self._publishers.came_up(node)
        oracle = self.oracles.get(node)
        if oracle is not None:
            oracle.start(stamp_ns, earliest_ns=earliest_ns)
        if self.policy is not None and node == self.policy.node:
            self.policy.start(stamp_ns)


_KEPT_TARGETS = 65_536


def _behind(wake_ns: int, by_ns: int) -> int:
    """So long behind ``wake_ns``, unless that is at once (0) or never."""
    return wake_ns + by_ns if 0 < wake_ns < FOREVER else wake_ns
