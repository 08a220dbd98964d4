"""What a fleet costs its monitor: observations a second, processor time, memory a robot, verdict latency.

The traffic is a lab tour at five ticks a second, recorded in virtual time. On Zenoh one process publishes it
in as many namespaces as there are robots, each at a moment of its own, and answers for their nodes; the
monitor is a process that does what ``moon monitor --fleet`` does. Without the wire, the judges of more robots
are handed the same traffic. At the end of a run answers are false, one of each skill: a verdict is late by
the time from the stamp of what violates the model to its arrival at a sink.

``python -m benchmarks.fleet`` takes five minutes; the machine should do nothing else.
"""

from __future__ import annotations

import contextlib
import gc
import heapq
import os
import signal
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import zenoh

from benchmarks.page import Row, command
from benchmarks.processes import ROOT, Child, free_endpoint, processor_s, ready, say
from benchmarks.sampling import quantile
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.fleet import robot as robot_module
from moon.fleet.choice import Shard, read_shard
from moon.fleet.fleet import Fleet
from moon.monitor.subject import monitored_of
from moon.oracle.bounds import Bounds
from moon.run import Run
from moon.sources.source import Outputs
from moon.verdict import Outcome, Verdict
from transports.interface import Answer, BlindSpot, Observation, ObservationKind
from transports.outbox import AT_MOST_S
from transports.service_events import (
    EVENT_SUFFIX,
    KIND_OF_EVENT,
    MESSAGE_TAKEN,
    TAKEN_SUFFIX,
    TYPE_SUFFIX,
    ServiceEvent,
    ServiceEventInfo,
)
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld
from transports.zenoh import connect
from transports.zenoh.names import own_key
from transports.zenoh.tokens import node_key
from transports.zenoh.wire import MEDIA_TYPE, attachment
from transports.zenoh_link.session import open_session

SYSTEM = ROOT / "examples/lab_tour/system.xml"
NS = 1_000_000_000
NOMINAL_S, FALSE_S = 14.0, 6.0
"""The tour without a fault, and then with some."""
JOINED_S = 3.0
"""The nodes of a robot are announced so long before anything happens."""
SETTLED_S = 4.0
"""What is measured begins so long after that."""
ON_ZENOH = (1, 10, 20, 30)
"""Robots."""
WITHOUT_THE_WIRE = (30, 100, 300, 1000)
STRANGERS = 1000
"""Namespaces in which nothing happens."""
VISITORS, AT_A_TIME, STAY_S = 2000, 50, 2.0
"""Robots that come and go, so many at a time, each for so long."""
KEPT_S = 0.5
"""The judges of those are freed so soon: usually it is half a minute."""


def load_system() -> System:
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    return system


# -- what is recorded --------------------------------------------------------------------------------


def recorded(system: System, seconds: float) -> tuple[int, list[Observation]]:
    """A tour of ``seconds``, and when it began (ns)."""
    heard: list[Observation] = []
    world = SimulatedWorld(1, Conditions(delay_s=(0.0, 0.002)))
    SimulatedTransport(world, "listener").tap([], heard.append)
    began_ns = world.now_ns
    SimulatedRun(compile_system(system), world).run(seconds)
    world.close()
    return began_ns, heard


def with_false_answers(began_ns: int, heard: Sequence[Observation]) -> list[Observation]:
    """One call of each skill that is ticked after the nominal time is answered by another status."""
    after_ns = began_ns + round(NOMINAL_S * NS)
    chosen: dict[str, tuple[str, int]] = {}
    changed = []
    for seen in heard:
        is_answer = seen.kind in (
            ObservationKind.RESPONSE_SENT,
            ObservationKind.RESPONSE_RECEIVED,
        )
        if is_answer and seen.channel.endswith("Skill/tick") and seen.stamp_ns > after_ns:
            call = (seen.client, seen.call)
            if seen.channel not in chosen:
                chosen[seen.channel] = call
                after_ns = seen.stamp_ns + NS // 2
            if chosen[seen.channel] == call:
                false = {**seen.data, "status": 0 if seen.data["status"] else 1}
                changed.append(msgspec.structs.replace(seen, data=false))
                continue
        changed.append(seen)
    return changed


def bursts(heard: Sequence[Observation]) -> list[list[Observation]]:
    """What is published together, as nodes report what they did in one burst."""
    found: list[list[Observation]] = []
    for seen in heard:
        if not found or seen.stamp_ns > found[-1][0].stamp_ns + AT_MOST_S * NS:
            found.append([])
        found[-1].append(seen)
    return found


# -- robots on Zenoh ---------------------------------------------------------------------------------


class Robots:
    """Publishes what was recorded in many namespaces."""

    def __init__(self, endpoint: str, count: int) -> None:
        system = load_system()
        self._began_ns, heard = recorded(system, NOMINAL_S + FALSE_S)
        self._heard = with_false_answers(self._began_ns, heard)
        self._session = open_session({"listen": endpoint})
        self._zid = str(self._session.info.zid())
        self._id = self._session.new_timestamp().get_id()
        self._spaces = [f"robots/r{number}" for number in range(count)]
        self._names = sorted({seen.source for seen in self._heard})
        self._orders: dict[str, Counter[str]] = {space: Counter() for space in self._spaces}
        self._bursts = bursts(self._heard)
        self._unsent: dict[str, int] = dict.fromkeys(self._spaces, 0)
        """Whatever has a stamp before was published."""
        self._declared: list[Any] = []
        self._publishers: dict[str, Any] = {}
        self._encodings: dict[str, zenoh.Encoding] = {}
        self._encode = msgspec.msgpack.Encoder().encode

    def _stamp(self, stamp_ns: int) -> zenoh.Timestamp:
        # to the nanosecond: a node's stamps grow, as what it sends is in order
        moment = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(stamp_ns // NS))
        text = f"{moment}.{stamp_ns % NS:09d}Z/{self._id}"
        return zenoh.Timestamp.parse_rfc3339(text)

    def _answer(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        space, _, rest = key.partition("/@m2c/answer/")
        name = rest.partition("/")[2]
        stamp = self._stamp(min(time.time_ns(), self._unsent[space] - 1))
        order = self._orders[space][name]
        with contextlib.suppress(zenoh.ZError):
            query.reply(key, b"", timestamp=stamp, attachment=attachment(0, order, name.encode()))
        query.drop()

    def run(self) -> None:
        count = len(self._spaces)
        start_ns = time.time_ns() + round(JOINED_S * NS)
        shifts = {}
        for number, space in enumerate(self._spaces):
            # ticks of all robots are spread over a period
            began_ns = start_ns + number * (NS // 5) // count
            shifts[space] = began_ns - self._began_ns
            for name in self._names:
                token = f"{space}/{node_key(self._zid, name, began_ns)}"
                self._declared.append(self._session.liveliness().declare_token(token))
        self._declared.append(
            self._session.declare_queryable(
                "robots/*/@m2c/answer/*/*",
                zenoh.handlers.Callback(self._answer, indirect=False),
                complete=True,
            )
        )
        for space, shift in shifts.items():
            self._unsent[space] = self._heard[0].stamp_ns + shift
        heap = [(self._bursts[0][-1].stamp_ns + shift, space, 0) for space, shift in shifts.items()]
        heapq.heapify(heap)
        late_ns = 0
        say({"began": start_ns})
        while heap:
            due_ns, space, place = heap[0]
            while (wait_ns := due_ns - time.time_ns()) > 0:
                time.sleep(wait_ns / NS)
            late_ns = max(late_ns, -wait_ns)
            shift = shifts[space]
            for seen in self._bursts[place]:
                self._publish(space, seen, seen.stamp_ns + shift)
            if place + 1 < len(self._bursts):
                following = self._bursts[place + 1]
                self._unsent[space] = following[0].stamp_ns + shift
                heapq.heapreplace(heap, (following[-1].stamp_ns + shift, space, place + 1))
            else:
                heapq.heappop(heap)
        say({"late_ms": late_ns / 1e6, "sent": len(self._heard) * count})

    def _publish(self, space: str, seen: Observation, stamp_ns: int) -> None:
        key = space + seen.channel
        type_name = seen.type_name
        if seen.kind is ObservationKind.MESSAGE:
            payload = self._encode(seen.data)
        else:
            is_taken = seen.kind is ObservationKind.MESSAGE_TAKEN
            event_type = MESSAGE_TAKEN if is_taken else KIND_OF_EVENT.index(seen.kind)
            info = ServiceEventInfo(event_type, stamp_ns, seen.client, seen.call)
            if is_taken:
                key, event = own_key(key + TAKEN_SUFFIX, seen.source), ServiceEvent(info)
            else:
                key += EVENT_SUFFIX
                if event_type in (0, 3):
                    key = own_key(key, seen.source)
                is_request = event_type in (0, 1)
                type_name = type_name.rpartition("_")[0] + TYPE_SUFFIX
                event = ServiceEvent(
                    info,
                    seen.data if is_request else None,
                    None if is_request else seen.data,
                    seen.error,
                )
            payload = self._encode(event)
        encoding = self._encodings.get(type_name)
        if encoding is None:
            encoding = self._encodings[type_name] = zenoh.Encoding(f"{MEDIA_TYPE};{type_name}")
        name = seen.source
        publisher = self._publishers.get(key)
        if (
            publisher is None
        ):  # declared, as nodes do: else each message is matched against all keys
            publisher = self._publishers[key] = self._session.declare_publisher(
                key, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
            )
        publisher.put(
            payload,
            # of events the monitor takes the stamp in their payload
            timestamp=self._stamp(stamp_ns) if seen.kind is ObservationKind.MESSAGE else None,
            attachment=attachment(seen.sequence, seen.order, name.encode()),
        )
        self._orders[space][name] = seen.order + 1


def run_strangers(endpoint: str, count: int) -> None:
    """A process that announces a node in each of ``count`` namespaces, in which nothing happens."""
    session = open_session({"endpoint": endpoint})
    zid = str(session.info.zid())
    kept = [
        session.liveliness().declare_token(f"robots/s{number}/{node_key(zid, 'policy', 1)}")
        for number in range(count)
    ]
    ready()
    signal.pause()
    del kept


class Visitors:
    """Robots that come, say something and go again, so many at a time."""

    def __init__(self, endpoint: str) -> None:
        self._session = open_session({"endpoint": endpoint})
        self._zid = str(self._session.info.zid())
        self._payload = msgspec.msgpack.encode({"data": 7})

    def visit(self, names: Sequence[str], seconds: float) -> None:
        tokens = [
            self._session.liveliness().declare_token(
                f"{name}/{node_key(self._zid, 'BatteryComponent', 1)}"
            )
            for name in names
        ]
        until_s, number = time.monotonic() + seconds, 0
        while time.monotonic() < until_s:
            time.sleep(0.1)
            for name in names:
                self._session.put(
                    f"{name}/BatteryComponent/level",
                    self._payload,
                    encoding=f"{MEDIA_TYPE};std_msgs/msg/Int32",
                    attachment=attachment(number, number, b"BatteryComponent"),
                )
            number += 1
        for token in tokens:
            token.undeclare()


def run_robots(endpoint: str, count: int) -> None:
    """A process that publishes the traffic of ``count`` robots when it is told to, once."""
    robots = Robots(endpoint, count)
    ready()
    sys.stdin.readline()
    robots.run()
    signal.pause()


# -- the monitor -------------------------------------------------------------------------------------


def resident_mib() -> float:
    """Memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGESIZE") / 2**20


class Lateness:
    """How late verdicts on violations are: a sink."""

    def __init__(self) -> None:
        self.ms: list[float] = []

    def take(self, verdict: Verdict) -> None:
        if verdict.outcome is Outcome.VIOLATED:
            self.ms.append((time.time_ns() - verdict.stamp_ns) / 1e6)


def run_monitor(endpoint: str, shard: str, kept_s: float = robot_module.KEPT_S) -> None:
    """A process that monitors a fleet, and says each second what that costs."""
    robot_module.KEPT_S = kept_s
    system = load_system()
    connection = connect("moon_monitor", {"endpoint": endpoint})
    lateness = Lateness()
    models = monitored_of(system, (), Bounds())
    fleet = Fleet(
        connection,
        "robots/*",
        models,
        Outputs([lateness], lambda sentence: print(sentence, flush=True)),
        read_shard(shard),
    )
    gc.freeze()
    before_mib = resident_mib()

    def end() -> None:
        summary = fleet.summary()
        say({"late_ms": lateness.ms, "problems": len(summary.problems)})
        connection.close()

    def tell() -> None:
        known = fleet.robots()
        robots = [robot for robot in known if robot.has_done_something]
        say(
            {
                "stamp": time.time_ns(),
                "known": len(known),
                "judged": sum(robot.is_judged for robot in robots),
                "threads": threading.active_count(),
                "received": sum(robot.received for robot in robots),
                "processor_s": time.process_time(),
                "mib": resident_mib() - before_mib,
                "robots": dict(Counter(robot.verdict for robot in robots)),
                "fine": sum(robot.status().fine for robot in robots),
            }
        )

    connection.every(0.5, fleet.look_around)
    connection.every(1.0, tell)
    fleet.start()
    ready()
    signal.signal(signal.SIGTERM, lambda *_: connection.post(end))
    connection.spin()


class Measured(msgspec.Struct, frozen=True):
    """One monitor of a fleet.

    Attributes:
        robots: that it judged.
        per_second: observations.
        share: of a processor, in the nominal time.
        mib: of memory, for each robot.
        late_ms: each verdict on a violation.
        conforming: robots of which that was the verdict at the end of the nominal time.
        problems: robots of which not all was received.
        threads: of the monitor's Python.
    """

    robots: int
    per_second: float
    share: float
    mib: float
    late_ms: list[float]
    conforming: int
    problems: int
    threads: int


def measured_on_zenoh(
    count: int, shards: Sequence[str] = ("1/1",), strangers: int = 0
) -> list[Measured]:
    """Monitors, one for each share, of a fleet of ``count`` robots beside ``strangers`` without traffic."""
    endpoint = free_endpoint()
    with contextlib.ExitStack() as stack:
        robots = stack.enter_context(Child.calling("robots", run_robots, endpoint, count))
        robots.answer()
        monitors = [
            stack.enter_context(Child.calling(f"monitor {shard}", run_monitor, endpoint, shard))
            for shard in shards
        ]
        for monitor in monitors:
            monitor.wait_for(lambda line: '"ready"' in line)
        if strangers:
            other = stack.enter_context(
                Child.calling("strangers", run_strangers, endpoint, strangers)
            )
            other.wait_for(lambda line: '"ready"' in line)
        before_s = processor_s(robots.pid)
        robots.tell("")
        began_ns = robots.answer()["began"]
        done = robots.answer(JOINED_S + NOMINAL_S + FALSE_S + 60.0)
        spent = (processor_s(robots.pid) - before_s) / (JOINED_S + NOMINAL_S + FALSE_S)
        print(
            f"{count} robots: {done['sent']} sent, at most {done['late_ms']:.0f} ms late, "
            f"{spent:.2f} of a processor; load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
        time.sleep(1.5)
        return [_measured(monitor, began_ns) for monitor in monitors]


def _measured(monitor: Child, began_ns: int) -> Measured:
    said = monitor.stop()
    *samples, end = [item for item in said if "stamp" in item or "late_ms" in item]
    from_ns = began_ns + round(SETTLED_S * NS)
    until_ns = began_ns + round(NOMINAL_S * NS)
    nominal = [item for item in samples if from_ns <= item["stamp"] <= until_ns]
    first, last = nominal[0], nominal[-1]
    seconds = (last["stamp"] - first["stamp"]) / NS
    count = sum(last["robots"].values())
    return Measured(
        count,
        (last["received"] - first["received"]) / seconds,
        (last["processor_s"] - first["processor_s"]) / seconds,
        samples[-1]["mib"] / max(count, 1),
        end["late_ms"],
        last["robots"].get("conforming", 0),
        end["problems"],
        samples[-1]["threads"],
    )


def come_and_go(count: int, at_a_time: int, seconds: float) -> list[Row]:
    """What a monitor takes before and after ``count`` robots came, did something for ``seconds`` and went."""
    endpoint = free_endpoint()
    with contextlib.ExitStack() as stack:
        waiting = stack.enter_context(Child.calling("robots", run_robots, endpoint, 0))
        waiting.wait_for(lambda line: '"ready"' in line)
        monitor = stack.enter_context(
            Child.calling("monitor", run_monitor, endpoint, "1/1", KEPT_S)
        )
        monitor.wait_for(lambda line: '"ready"' in line)
        visitors = Visitors(endpoint)
        at_rest = []
        for begin in range(-at_a_time, count, at_a_time):  # the first turn warms up
            names = [f"robots/v{number}" for number in range(begin, begin + at_a_time)]
            visitors.visit(names, seconds)
            if begin < 0 or begin + at_a_time >= count:
                at_rest.append(_at_rest(monitor))
        before, after = at_rest
    what = f"{count:,} robots that came and went, {at_a_time} at a time"
    return [
        Row(f"{what}: threads before", before["threads"], ""),
        Row(f"{what}: threads after", after["threads"], ""),
        Row(f"{what}: memory before", before["mib"], "MiB"),
        Row(f"{what}: memory after", after["mib"], "MiB"),
    ]


def _at_rest(monitor: Child) -> dict[str, Any]:
    """What it takes once nobody is judged any more."""
    from_ns = time.time_ns()
    while True:
        said: dict[str, Any] = monitor.answer(60.0)
        if said.get("stamp", 0) > from_ns and said["judged"] == 0:
            return said


# -- without the wire ----------------------------------------------------------------------------------


class Handed:
    """A connection to one robot, of which is handed what was recorded, in virtual time."""

    repair_s = 0.0
    is_complete = True

    def __init__(self, shift_ns: int) -> None:
        self.now = 0
        self.shift_ns = shift_ns
        self.place = 0
        self._handler: Callable[[Observation], None] = lambda seen: None
        self._due_ns = 0
        self._turn: Callable[[], None] | None = None
        self._posted: deque[Callable[[], None]] = deque()
        self._orders: Counter[str] = Counter()
        self.since_ns = 0
        self.changed: Callable[[str, bool], None] = lambda name, up: None

    def steady_ns(self) -> int:
        return self.now

    def now_ns(self) -> int:
        return self.now

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Handed:
        self._handler = handler
        return self

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        self.changed = handler

    def up_since(self, name: str) -> int:
        return self.since_ns

    def after(self, delay_s: float, handler: Callable[[], None]) -> Handed:
        self._due_ns, self._turn = self.now + round(delay_s * NS), handler
        return self

    def cancel(self) -> None:
        """Another turn is planned in place of the last one."""

    def post(self, handler: Callable[[], None]) -> None:
        self._posted.append(handler)

    def ask(self, node: str, answered: Callable[..., None], within_s: float = 1.0) -> None:
        answer = Answer(self.now, self._orders[node])
        self._posted.append(lambda: answered(answer))

    def is_contested(self, name: str) -> bool:
        return False

    def take_dropped(self) -> Sequence[tuple[str, str]]:
        return ()

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        return {}

    def problems(self) -> Sequence[str]:
        return ()

    def reach(self, until_ns: int) -> None:
        """Time passes."""
        while self._turn is not None and self._due_ns <= until_ns:
            turn, self._turn = self._turn, None
            self.now = max(self.now, self._due_ns)
            turn()
            while self._posted:
                self._posted.popleft()()
        self.now = until_ns

    def hand(self, seen: Observation) -> None:
        stamp_ns = seen.stamp_ns + self.shift_ns
        self.reach(stamp_ns)
        self._orders[seen.source] = seen.order + 1
        self._handler(msgspec.structs.replace(seen, stamp_ns=stamp_ns, received_ns=stamp_ns))
        while self._posted:
            self._posted.popleft()()


def measured_without(count: int) -> None:
    """Hand ``count`` robots' judges the nominal tour; say what it costs. In a process of its own."""
    system = load_system()
    began_ns, heard = recorded(system, NOMINAL_S)
    monitored = monitored_of(system, (), Bounds())
    names = sorted({seen.source for seen in heard})
    connections = [Handed(number * (NS // 5) // count) for number in range(count)]
    gc.collect()
    before_mib = resident_mib()
    watches = []
    for connection in connections:
        connection.now = connection.since_ns = began_ns + connection.shift_ns
        watch = Run(connection, monitored, Outputs())
        watch.start()
        for name in names:
            connection.changed(name, True)
        watches.append(watch)
    gc.freeze()
    heap = [(heard[0].stamp_ns + c.shift_ns, n) for n, c in enumerate(connections)]
    heapq.heapify(heap)
    spent_s = time.process_time()
    while heap:
        _, number = heap[0]
        connection = connections[number]
        connection.hand(heard[connection.place])
        connection.place += 1
        if connection.place < len(heard):
            due_ns = heard[connection.place].stamp_ns + connection.shift_ns
            heapq.heapreplace(heap, (due_ns, number))
        else:
            heapq.heappop(heap)
    spent_s = time.process_time() - spent_s
    say(
        {
            "received": len(heard) * count,
            "processor_s": spent_s,
            "share": spent_s / NOMINAL_S,
            "mib": (resident_mib() - before_mib) / count,
            "violations": sum(watch.violations for watch in watches),
        }
    )


# -- the figures ---------------------------------------------------------------------------------------


def rows(robots: int = 0) -> list[Row]:
    """What is shown; of ``robots`` on Zenoh only, unless that is 0."""
    found: list[Row] = []
    for count in (robots,) if robots else ON_ZENOH:
        found += _rows_of(f"{count} on Zenoh", measured_on_zenoh(count)[0])
    most = robots or ON_ZENOH[-1]
    shards = [str(Shard(number, 2)) for number in (1, 2)]
    for shard, measured in zip(shards, measured_on_zenoh(most, shards), strict=True):
        found += _rows_of(f"{most} on Zenoh, share {shard} ({measured.robots} robots)", measured)
    beside = measured_on_zenoh(most, strangers=STRANGERS)[0]
    found += _rows_of(f"{most} on Zenoh beside {STRANGERS:,} strangers", beside)
    found += come_and_go(VISITORS, AT_A_TIME, STAY_S)
    for count in () if robots else WITHOUT_THE_WIRE:
        with Child.calling("judges", measured_without, count) as child:
            said = child.answer(600.0)
        assert said["violations"] == 0
        what = f"{count} without the wire"
        speed = said["received"] / said["processor_s"]
        found.append(Row(f"{what}: judged", speed, "observations/s of a processor"))
        found.append(Row(f"{what}: at five ticks a second", said["share"], "processors"))
        found.append(Row(f"{what}: memory of a robot", said["mib"], "MiB"))
    return found


def _rows_of(what: str, measured: Measured) -> list[Row]:
    print(
        f"{what}: {measured.conforming} of {measured.robots} conform before the faults, not all received "
        f"of {measured.problems}, {len(measured.late_ms)} verdicts on violations",
        flush=True,
    )
    return [
        Row(f"{what}: received", measured.per_second, "observations/s"),
        Row(f"{what}: the monitor", measured.share, "processors"),
        Row(f"{what}: threads", measured.threads, ""),
        Row(f"{what}: memory of a robot", measured.mib, "MiB"),
        Row(f"{what}: verdict latency, p50", quantile(measured.late_ms, 0.5), "ms"),
        Row(f"{what}: verdict latency, p99", quantile(measured.late_ms, 0.99), "ms"),
    ]


if __name__ == "__main__":
    command(rows)
