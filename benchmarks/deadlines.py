"""How soon after its deadline a response that never comes is reported, on Zenoh with default bounds.

A process asks again and again; every
other answer comes in the last moments before its deadline, the rest not in time. Prints how late the
monitor said so, and how often it accused an answer that was in time. ``--busy`` keeps so many
processors busy meanwhile.
"""

from __future__ import annotations

import contextlib
import random
import statistics

import msgspec

from benchmarks.page import Row, command
from benchmarks.processes import Child, free_endpoint
from benchmarks.processes import busy as kept_busy
from moon.monitor.properties import PropertyWatch
from moon.monitor.reading import no_system
from moon.monitor.watch import SystemWatch
from moon.oracle.bounds import Bounds
from moon.properties.property import Port, Property
from moon.properties.syntax import parse_formula
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, Topic, Transport
from transports.zenoh import connect

MS = 1_000_000
DEADLINE_NS = 300 * MS
CLOSE_NS = 40 * MS
"""Answers in time come this long before their deadline at most."""
PERIOD_S = 0.5
FORMULA = "not((not {answered}) since[300ms:] {asked})"


class Empty(msgspec.Struct):
    __type_name__ = "std_msgs/msg/Empty"


def topic(name: str) -> Topic:
    return Topic(f"/{name}", "std_msgs/msg/Empty", Empty)


def ask(endpoint: str, count: int) -> None:
    """The asking process."""
    node = connect("asker", {"endpoint": endpoint})
    asked, answered = (node.publisher(topic(name)) for name in ("asked", "answered"))
    choice = random.Random(1)
    left = [count]

    def once() -> None:
        if not left[0]:
            return
        left[0] -= 1
        asked.publish(Empty())
        in_time = left[0] % 2
        wait_ns = (
            DEADLINE_NS - choice.randint(2 * MS, CLOSE_NS) if in_time else DEADLINE_NS * 4 // 3
        )
        node.after(wait_ns / 1e9, lambda: answered.publish(Empty()))

    node.after(1.0, lambda: node.every(PERIOD_S, once))
    node.after(2.0 + (count + 1) * PERIOD_S, node.close)
    node.spin()


class Judge:
    """What was heard and what was said."""

    def __init__(self, connection: Transport) -> None:
        self.connection = connection
        self.asked: list[int] = []
        self.answered: list[int] = []
        self.lags: list[int] = []
        self.said: list[tuple[int, Verdict]] = []

    def hear(self, seen: Observation) -> None:
        """What the monitor's tap hears, too."""
        self.lags.append(seen.received_ns - seen.stamp_ns)
        (self.asked if seen.channel == "/asked" else self.answered).append(seen.stamp_ns)

    def take(self, verdict: Verdict) -> None:
        """A verdict of the monitor."""
        self.said.append((self.connection.now_ns(), verdict))


def rows(count: int = 40, busy: int = 0) -> list[Row]:
    """What is shown, of so many questions; ``busy`` processes keep processors busy meanwhile."""
    endpoint = free_endpoint()
    connection = connect("monitor", {"listen": endpoint})
    judge = Judge(connection)
    ports = (Port("asked", "/asked", event=True), Port("answered", "/answered", event=True))
    bounds = Bounds()
    watch = PropertyWatch([Property("answers", parse_formula(FORMULA), ports)], bounds.latency)
    system = no_system()
    monitor = SystemWatch(connection, system, (), bounds, [judge], print, watch)
    with contextlib.closing(connection), Child.calling("the asker", ask, endpoint, count) as asker:
        monitor.start()
        connection.tap(["/asked", "/answered"], judge.hear)
        with kept_busy(busy):
            connection.spin(until=lambda: asker.exit_code is not None)
    return report(judge, busy)


def report(judge: Judge, busy: int) -> list[Row]:
    late = [
        asked
        for asked in judge.asked
        if not any(0 <= answer - asked <= DEADLINE_NS for answer in judge.answered)
    ]
    due = {asked + DEADLINE_NS for asked in late}
    broken = [(now, said) for now, said in judge.said if said.outcome is Outcome.VIOLATED]
    delays = [(now - said.stamp_ns) / MS for now, said in broken if said.stamp_ns in due]
    wrong = [said for _, said in broken if said.stamp_ns not in due]
    tightest = min(
        (DEADLINE_NS - (answer - asked)) / MS
        for asked in judge.asked
        for answer in judge.answered
        if 0 <= answer - asked <= DEADLINE_NS
    )
    print(
        f"{len(judge.asked)} questions, {len(late)} not answered in time"
        + (f", {busy} processes keep the processors busy" if busy else "")
        + f"; {len(delays)} said; answers in time down to {tightest:.1f} ms before the deadline"
    )
    where = f", {busy} processes busy" if busy else ""
    what = f"a missing answer, from its deadline to the verdict, median{where}"
    most, lag_ms = None if busy else 50.0, max(judge.lags) / MS
    peer = "longest lag of a message"
    return [
        Row(what, statistics.median(delays), "ms", peer, lag_ms, most=most),
        Row(f"the same, longest{where}", max(delays), "ms"),
        Row(f"answers in time that were accused{where}", len(wrong), "", most=0.0),
    ]


if __name__ == "__main__":
    command(rows)
