"""How long after it happened a thing has been judged: the lab tour on Zenoh, a process for each node.

From the stamp of each input and output, where it was taken or made, to the moment when its oracle has
judged it; default bounds. All is judged as soon as its node has reported it (decisions 13 and 29), messages
of others when the node has reported to have taken them. What is judged as time passes is seen up to 2 ms
late.
"""

from __future__ import annotations

import contextlib
import functools
import heapq
import statistics
from collections.abc import Callable, Sequence
from typing import Any, cast

from benchmarks.page import Row, command
from benchmarks.processes import ROOT, Child, free_endpoint
from benchmarks.sampling import quantile
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.monitor.subject import Monitored
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.run import Run
from moon.sources.source import Outputs
from transports.interface import Connection, Observation, ObservationKind, Tap
from transports.zenoh import connect

SYSTEM = ROOT / "examples/lab_tour/system.xml"
MS = 1_000_000
RATE_HZ = 10.0
PERIOD_S = 0.002
"""How often is looked whether something was judged while nothing was heard."""


class Looker:
    """Looks at one oracle after each of the monitor's steps."""

    def __init__(self, oracle: Oracle) -> None:
        self.oracle = oracle
        self.alone = not oracle.judge.search.program.taken_topics()
        self.lags_ms: list[float] = []
        self.stamps: list[int] = []
        """Of what waits for its verdict: a heap."""

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether it is the machine's own doing, or a message that it gets."""
        if not self.oracle.concerns(channel, source, kind):
            return False
        return source == self.oracle.node or kind is ObservationKind.MESSAGE

    def look(self, now_ns: int) -> None:
        """What has been judged by now?"""
        oracle, stamps = self.oracle, self.stamps
        if not oracle.is_synchronised:
            stamps.clear()
        while stamps and stamps[0] <= oracle.judged_until:
            self.lags_ms.append((now_ns - heapq.heappop(stamps)) / MS)


class Looked:
    """A monitor's connection, of which is looked what it made of each thing that it heard."""

    def __init__(self, connection: Connection, look: Callable[[Observation], None]) -> None:
        self._connection = connection
        self._look = look

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection, name)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """The monitor's own tap: another one would double its work."""

        def hear(seen: Observation) -> None:
            handler(seen)
            self._look(seen)

        return self._connection.tap(channels, hear)


def watched(connection: Connection, system: System, tour: Child) -> tuple[list[Looker], int]:
    """Monitor the tour to its end, with lookers at the oracles; these, and how many violations."""
    lookers: list[Looker] = []

    @functools.cache  # looking is not to hold up the monitor
    def concerned(channel: str, source: str, kind: ObservationKind) -> list[Looker]:
        return [looker for looker in lookers if looker.concerns(channel, source, kind)]

    def look(seen: Observation | None = None) -> None:
        if seen is not None:
            for looker in concerned(seen.channel, seen.source, seen.kind):
                heapq.heappush(looker.stamps, seen.stamp_ns)
        for looker in lookers:
            if looker.stamps:
                looker.look(connection.now_ns())

    looked = cast(Connection, Looked(connection, look))
    watch = Run(looked, Monitored(system, system.nodes, (), Bounds()), Outputs(say=print))
    watch.start()
    lookers += [Looker(item) for item in watch.oracles().values() if isinstance(item, Oracle)]
    concerned.cache_clear()
    connection.every(PERIOD_S, look)
    connection.spin(until=lambda: tour.exit_code is not None)
    assert tour.exit_code == 0, tour.last_lines
    return lookers, watch.violations


def rows(ticks: int = 300) -> list[Row]:
    """What is shown, of so many ticks."""
    system, endpoint = load([SYSTEM], DiagnosticLog()), free_endpoint()
    assert system is not None
    words = ["-m", "m2c.cli", "run", str(SYSTEM), "--endpoint", endpoint]
    words += ["--quiet", "--ticks", str(ticks), "--rate", str(RATE_HZ)]
    with (
        Child("the tour", words) as tour,
        contextlib.closing(connect("monitor", {"endpoint": endpoint})) as connection,
    ):
        lookers, violations = watched(connection, system, tour)
    found = []
    for alone, what, most, most_p99 in (
        (True, "no concurrent input open", 5.0, None),
        (False, "topics of others taken", 10.0, 30.0),
    ):
        lags = [lag for looker in lookers if looker.alone is alone for lag in looker.lags_ms]
        name = f"from event to verdict, {what}, median"
        found.append(Row(name, statistics.median(lags), "ms", most=most))
        found.append(Row("the same, p99", quantile(lags, 0.99), "ms", most=most_p99))
    print(f"{violations} violations (a nominal run)")
    return found


if __name__ == "__main__":
    command(rows)
