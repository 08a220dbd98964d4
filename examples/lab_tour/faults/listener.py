"""What is heard and said in one run: a monitor of all models, and of properties beside them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import msgspec

if TYPE_CHECKING:
    from m2c.model.system import System
    from moon.properties.property import Property
    from moon.run import Run
    from moon.verdict import Verdict
    from transports.interface import Connection, Observation, Tap

DEADLINE_NS = 1_000_000_000
"""Of outputs, as ``moon monitor`` has it when nothing is said."""
LATENCY_NS = 150_000_000
"""The latency bound. What was sent in time may be heard one bound later, so a monitor waits that long
after a deadline."""


class Said(msgspec.Struct, frozen=True):
    """A verdict, and when it was said (ns since the epoch, on the monitor's clock)."""

    verdict: Any
    at_ns: int


class Run(msgspec.Struct, frozen=True):
    """What was heard (by stamp) and said in one run."""

    heard: tuple[Any, ...]
    violations: tuple[Said, ...]
    count: int = 0
    """Of everything heard, kept or not."""
    lost: tuple[str, ...] = ()
    """The machines of which the monitor did not know at the end what they do."""
    broken: tuple[Said, ...] = ()
    """Verdicts on properties."""
    standing: dict[str, str] = {}
    """The verdict at the end of each property that was monitored."""
    unconfirmed: tuple[Said, ...] = ()
    """What was said before it was certain that no observation is missing."""


class _Overheard:
    """A monitor's connection; ``hear`` is told what its tap hears, before the monitor is."""

    def __init__(self, connection: Connection, hear: Callable[[Observation], None]) -> None:
        self._connection = connection
        self._hear = hear

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """One tap for both: a second would double what the middleware does for the first."""
        hear = self._hear

        def heard(seen: Observation) -> None:
            hear(seen)
            handler(seen)

        return self._connection.tap(channels, heard)


class Listener:
    """A monitor of all models, and what it heard and said.

    Args:
        transport: its own connection.
        system: the models as they should be.
        faulty: the run is over when this node's machine is violated; "" for the tour as it is.
        properties: to be monitored, too; then the run is not over before its time.
        keeps: whether everything heard is kept; a long run of the tour as it is fills the memory.
    """

    def __init__(
        self,
        transport: Connection,
        system: System,
        faulty: str,
        properties: Sequence[Property] = (),
        keeps: bool = True,
    ) -> None:
        from moon.monitor.properties import PropertyWatch
        from moon.monitor.subject import Monitored
        from moon.oracle.bounds import Bounds
        from moon.run import Run
        from moon.sources.source import Outputs

        self._transport = transport
        self._faulty = faulty
        self._keeps = keeps
        self.heard: list[Observation] = []
        self.count = 0
        self.first_ns = 0
        """Stamp of the first tick of a skill; how long the nodes take to be up before it is no matter."""
        self.violations: list[Said] = []
        self.unconfirmed: list[Said] = []
        self.broken: list[Said] = []
        bounds = Bounds(latency=LATENCY_NS, deadline=DEADLINE_NS)
        monitored = Monitored(system, system.nodes, tuple(properties), bounds)
        overheard: Any = _Overheard(transport, self._hear)
        self._properties = PropertyWatch(properties, LATENCY_NS)
        self.watch = Run(overheard, monitored, Outputs([self], _complain), self._properties)

    def start(self) -> None:
        """Listen: before the nodes start."""
        self.watch.start()

    def _hear(self, seen: Observation) -> None:
        if not self.first_ns and seen.channel.endswith("/tick"):
            self.first_ns = seen.stamp_ns
        self.count += 1
        if self._keeps:
            self.heard.append(seen)

    def take(self, verdict: Verdict) -> None:
        """A verdict, from the watch."""
        from moon.oracle.confirmation import UNCONFIRMED
        from moon.verdict import Outcome

        said = Said(verdict, self._transport.now_ns())
        if verdict.outcome is Outcome.VIOLATED:
            found = self.broken if verdict.kind == "property" else self.violations
            found.append(said)
        elif UNCONFIRMED in verdict.reason:
            self.unconfirmed.append(said)

    @property
    def is_over(self) -> bool:
        """Whether what should be found is found, and all that led there has been heard."""
        since = self._transport.now_ns() - LATENCY_NS
        found = any(s.verdict.node == self._faulty and s.at_ns < since for s in self.violations)
        return found and not self._properties.properties

    def peers(self) -> Sequence[str]:
        """Names of the nodes that the monitor is linked to."""
        return () if self.watch.listener is None else self.watch.listener.peers()

    def result(self) -> Run:
        """All of it."""
        heard = sorted(self.heard, key=lambda seen: seen.stamp_ns)
        statuses = self.watch.statuses()
        machines = [item for item in statuses if item.kind == "model"]
        return Run(
            tuple(heard),
            tuple(self.violations),
            self.count,
            tuple(item.machine for item in machines if item.verdict in _UNKNOWN),
            tuple(self.broken),
            {item.machine: item.verdict for item in statuses if item.kind == "property"},
            tuple(self.unconfirmed),
        )


_UNKNOWN = ("inconclusive", "unseen")


def _complain(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
