"""How long after it happened a thing has been judged: the lab tour on Zenoh, a process for each node.

From the stamp of each input and output, where it was taken or made, to the moment when its oracle has
judged it; default bounds. Machines that take no topics are judged as soon as all was heard (decision
13); where a message of somebody else may still come in between, one latency bound later. What is judged
as time passes is seen up to 2 ms late.

Usage: ``python benchmarks/lag.py [--ticks N] [--busy N]``.
"""

from __future__ import annotations

import argparse
import heapq
import os
import signal
import statistics
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from loopback import busy, free_endpoint
from row import Row, publish

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.monitor.watch import SystemWatch
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from transports.interface import Observation, ObservationKind, Transport
from transports.zenoh import connect

SYSTEM = Path(__file__).parents[1] / "examples/lab_tour/system.xml"
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
        self._stamps: list[int] = []

    def look(self, now_ns: int, seen: Observation | None = None) -> None:
        """After ``seen``, or after a turn."""
        oracle, stamps = self.oracle, self._stamps
        if not oracle.is_synchronised:
            stamps.clear()
        elif seen is not None and self._is_of_machine(seen):
            heapq.heappush(stamps, seen.stamp_ns)
        while stamps and stamps[0] <= oracle.judged_until:
            self.lags_ms.append((now_ns - heapq.heappop(stamps)) / MS)

    def _is_of_machine(self, seen: Observation) -> bool:
        """Whether it is the machine's own doing, or a message that it gets."""
        if not self.oracle.concerns(seen.channel, seen.source, seen.kind):
            return False
        return seen.source == self.oracle.node or seen.kind is ObservationKind.MESSAGE


def measured(ticks: int) -> tuple[list[Looker], int]:
    """Watch one tour of ``ticks`` ticks; what was found, and how many violations."""
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    endpoint = free_endpoint()
    lookers: list[Looker] = []
    command = [sys.executable, "-m", "m2c.cli", "run", str(SYSTEM), "--endpoint", endpoint]
    command += ["--quiet", "--ticks", str(ticks), "--rate", str(RATE_HZ)]
    tour = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        connection = connect("monitor", {"endpoint": endpoint})
        try:
            violations = watched(connection, system, lookers, lambda: tour.poll() is not None)
        finally:
            connection.close()
    finally:
        if tour.poll() is None:
            os.killpg(tour.pid, signal.SIGINT)
        said = tour.communicate(timeout=30)[1]
    if tour.returncode:
        sys.exit(f"the tour ended with exit code {tour.returncode}: {said}")
    return lookers, violations


def watched(
    connection: Transport, system: System, lookers: list[Looker], is_over: Callable[[], bool]
) -> int:
    """Monitor ``system`` until ``is_over``, with ``lookers`` for its oracles; the violations."""
    watch = SystemWatch(connection, system, system.nodes, Bounds(), [], print)
    watch.start()
    lookers += [Looker(item) for item in watch.oracles().values() if isinstance(item, Oracle)]

    def look(seen: Observation | None = None) -> None:
        now_ns = connection.now_ns()
        for looker in lookers:
            looker.look(now_ns, seen)

    connection.tap([], look)
    connection.every(PERIOD_S, look)
    connection.spin(until=is_over)
    return watch.violations


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=300)
    parser.add_argument("--busy", type=int, default=0, help="processes that keep processors busy")
    options = parser.parse_args()
    with busy(options.busy):
        lookers, violations = measured(options.ticks)
    bound_ms = Bounds().latency / MS
    where = f", {options.busy} processes busy" if options.busy else ""
    rows = []
    for alone, what, most in (
        (True, "no concurrent input open", 5.0),
        (False, "topics of others taken", bound_ms + 10),
    ):
        lags = sorted(lag for looker in lookers if looker.alone is alone for lag in looker.lags_ms)
        median, p99 = statistics.median(lags), lags[int(len(lags) * 0.99)]
        machines = sum(looker.alone is alone for looker in lookers)
        print(f"{machines} machines, {what}: {len(lags)} things judged, median {median:.1f} ms, "
              f"p99 {p99:.1f} ms (target: median ≤ {most:g} ms)")  # fmt: skip
        rows.append(Row(f"from event to verdict, {what}, median{where}", median, "ms", most=most))
        rows.append(Row(f"the same, p99{where}", p99, "ms"))
    print(f"latency bound {bound_ms:g} ms; {violations} violations (a nominal run)")
    publish(rows)


if __name__ == "__main__":
    main()
