"""How long after it happened a thing has been judged: the lab tour on Zenoh, a process for each node.

From the stamp of each input and output, where it was taken or made, to the moment when its oracle has
judged it; default bounds. Machines that take no topics are judged as soon as all was heard (decision
13); where a message of somebody else may still come in between, one latency bound later. What is judged
as time passes is seen up to 2 ms late.
"""

from __future__ import annotations

import contextlib
import heapq
import statistics
from collections.abc import Callable, Sequence
from typing import Any, cast

from benchmarks.page import Row, command
from benchmarks.processes import ROOT, Child, free_endpoint
from benchmarks.processes import busy as kept_busy
from benchmarks.sampling import quantile
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.monitor.watch import SystemWatch
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from transports.interface import Observation, ObservationKind, Tap, Transport
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
        self.alone = not oracle.channels.hears_others
        self.lags_ms: list[float] = []
        self.stamps: list[int] = []
        """Of what waits for its verdict: a heap."""

    def concerns(self, seen: Observation) -> bool:
        """Whether it is the machine's own doing, or a message that it gets."""
        if not self.oracle.concerns(seen.channel, seen.source, seen.kind):
            return False
        return seen.source == self.oracle.node or seen.kind is ObservationKind.MESSAGE

    def look(self, now_ns: int) -> None:
        """What has been judged by now?"""
        oracle, stamps = self.oracle, self.stamps
        if not oracle.is_synchronised:
            stamps.clear()
        while stamps and stamps[0] <= oracle.judged_until:
            self.lags_ms.append((now_ns - heapq.heappop(stamps)) / MS)


class Lookers:
    """Looks at those oracles only that have something to judge: looking is not to hold up the monitor."""

    def __init__(self) -> None:
        self.all: list[Looker] = []
        self._concerned: dict[tuple[str, str, ObservationKind], list[Looker]] = {}

    def look(self, now_ns: int, seen: Observation | None = None) -> None:
        """After ``seen``, or after a turn."""
        if seen is not None:
            key = (seen.channel, seen.source, seen.kind)
            if (concerned := self._concerned.get(key)) is None:
                concerned = [looker for looker in self.all if looker.concerns(seen)]
                if self.all:
                    self._concerned[key] = concerned
            for looker in concerned:
                heapq.heappush(looker.stamps, seen.stamp_ns)
        for looker in self.all:
            if looker.stamps:
                looker.look(now_ns)


class Looked:
    """A monitor's connection, of which is looked what it made of each thing that it heard."""

    def __init__(self, connection: Transport, look: Callable[[Observation], None]) -> None:
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


def measured(ticks: int) -> tuple[list[Looker], int]:
    """Watch one tour of ``ticks`` ticks; what was found, and how many violations."""
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    endpoint = free_endpoint()
    lookers = Lookers()
    words = ["-m", "m2c.cli", "run", str(SYSTEM), "--endpoint", endpoint]
    words += ["--quiet", "--ticks", str(ticks), "--rate", str(RATE_HZ)]
    with (
        Child("the tour", words) as tour,
        contextlib.closing(connect("monitor", {"endpoint": endpoint})) as connection,
    ):
        violations = watched(connection, system, lookers, lambda: tour.exit_code is not None)
        assert tour.exit_code == 0, tour.last_lines
    return lookers.all, violations


def watched(
    connection: Transport, system: System, lookers: Lookers, is_over: Callable[[], bool]
) -> int:
    """Monitor ``system`` until ``is_over``, with ``lookers`` for its oracles; the violations."""

    def look(seen: Observation | None = None) -> None:
        lookers.look(connection.now_ns(), seen)

    watch = SystemWatch(
        cast(Transport, Looked(connection, look)), system, system.nodes, Bounds(), [], print
    )
    watch.start()
    oracles = watch.oracles().values()
    lookers.all += [Looker(item) for item in oracles if isinstance(item, Oracle)]
    connection.every(PERIOD_S, look)
    connection.spin(until=is_over)
    return watch.violations


def rows(ticks: int = 300, busy: int = 0) -> list[Row]:
    """What is shown, of so many ticks; ``busy`` processes keep processors busy meanwhile."""
    with kept_busy(busy):
        lookers, violations = measured(ticks)
    bound_ms = Bounds().latency / MS
    where = f", {busy} processes busy" if busy else ""
    found = []
    for alone, what, most in (
        (True, "no concurrent input open", 5.0),
        (False, "topics of others taken", bound_ms + 10),
    ):
        lags = [lag for looker in lookers if looker.alone is alone for lag in looker.lags_ms]
        what = f"from event to verdict, {what}, median{where}"
        found.append(Row(what, statistics.median(lags), "ms", most=most))
        found.append(Row(f"the same, p99{where}", quantile(lags, 0.99), "ms"))
    print(f"latency bound {bound_ms:g} ms; {violations} violations (a nominal run)")
    return found


if __name__ == "__main__":
    command(rows)
