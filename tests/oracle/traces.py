"""Random traces of a machine: what it can have done.

A conforming trace is made by running the machine (by :mod:`tests.oracle.steps`) in a small world:
messages reach it after a delay shorter than the latency bound, in order per channel and source;
requests are taken as they come; calls are answered after a while. :mod:`tests.oracle.changes` makes
perturbed traces: one of these with something changed, or the trace of a mutant of the machine.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from random import Random
from typing import Any

import msgspec

from m2c.model.machine import Event, EventKind, InterfaceKind, Machine, OutputKind
from tests.oracle.steps import Call, Configuration, Outcome, Output, Stepper, Timer
from transports.interface import Observation, ObservationKind

MS = 1_000_000
US = 1_000
LATENCY_NS = 200 * MS
DEADLINE_NS = 1000 * MS
TOLERANCE_NS = 10 * MS

LAST_TAKE_NS = 700 * MS
"""Everything is heard well before a deadline can be over…"""
LAST_STAMP_NS = 790 * MS
LONG_AFTER_NS = 2400 * MS
"""…or judged when every deadline is: what is between the two is a matter of taste."""

MANY = 8
"""Observations after which a run is cut short: the reference tries all orders."""


class Trace(msgspec.Struct, frozen=True):
    """What was heard until ``end_ns``, in the order of the stamps."""

    observations: tuple[Observation, ...]
    end_ns: int


def conforming(machine: Machine, draw: Random) -> Trace:
    """The trace of one run of ``machine``; EndlessLoopError if it has one."""
    return _World(machine, draw).run()


# -- the world ------------------------------------------------------------------------------------


class _Arrival(msgspec.Struct, frozen=True):
    """An input on its way; ``stamp_ns`` is None if the machine stamps it when it takes it."""

    event: Event
    channel: str
    data: Any
    stamp_ns: int | None = None
    source: str = ""
    call: Call = Call()


class _World:
    def __init__(self, machine: Machine, draw: Random) -> None:
        self._machine = machine
        self._stepper = Stepper(machine)
        self._draw = draw
        self._numbers = itertools.count()
        self._coming: list[tuple[int, int, _Arrival | Timer]] = []
        self._awaited: list[Timer] = []
        self._heard: list[Observation] = []
        self._calls: dict[str, Iterator[int]] = {}
        """The numbers of the calls to each service: two may have the same, as on ROS 2."""
        self._last_of: dict[tuple[str, str], int] = {}
        self._now = 0

    def run(self) -> Trace:
        self._plan()
        configuration = self._enter(self._draw.choice(self._stepper.start()))
        self._await(configuration)
        has_timer = any(item.kind is InterfaceKind.TIMER for item in self._machine.interfaces)
        cut = has_timer or self._draw.random() < 0.3
        while self._coming:
            due, _, arrival = heapq.heappop(self._coming)
            if isinstance(arrival, Timer) and not any(arrival is it for it in configuration.timers):
                continue  # it was cancelled
            if due > LAST_TAKE_NS or len(self._heard) >= MANY:
                cut = True
                heapq.heappush(self._coming, (due, next(self._numbers), arrival))
                break
            self._now = max(due, self._now)
            configuration = self._take(configuration, arrival)
            self._await(configuration)
        end_ns = self._now + US if cut else LONG_AFTER_NS
        for _, _, arrival in self._coming:  # published, and not yet taken
            if isinstance(arrival, Timer) or arrival.stamp_ns is None:
                continue
            if arrival.stamp_ns < end_ns:
                self._hear(arrival)
        return Trace(numbered(self._heard), end_ns)

    def _plan(self) -> None:
        now = self._draw.randint(5, 60) * MS
        ends = [item for item in self._machine.interfaces if item.kind in _HEARD]
        for _ in range(self._draw.choice((1, 2, 3, 3, 4, 4, 5)) if ends else 0):
            end = self._draw.choice(ends)
            data: dict[str, Any]
            if end.kind is InterfaceKind.SUBSCRIBER:
                event = Event(EventKind.MESSAGE, end.name)
                data = {"data": self._draw.randint(0, 3)}
                arrival = _Arrival(
                    event, end.channel or "", data, now, self._draw.choice(("left", "right"))
                )
                self._send(arrival, now)
            else:
                event = Event(EventKind.REQUEST, end.name)
                data = {"value": self._draw.randint(0, 3)}
                call = self._call("policy", end.channel or "")
                self._push(now, _Arrival(event, end.channel or "", data, call=call))
            now += self._draw.choice((0, 1, 3, 30, 90, 150, 210, 260)) * MS
            now += self._draw.randint(0, 900) * US
        for timer in self._machine.interfaces:
            if timer.kind is InterfaceKind.TIMER:
                period_ns = round(1_000_000_000 / timer.rate_hz)
                for nominal_ns in range(period_ns, LAST_TAKE_NS + period_ns, period_ns):
                    jitter = self._draw.randint(-TOLERANCE_NS + US, TOLERANCE_NS - MS)
                    jitter += self._draw.choice((0, 0, 0, 80 * MS, 180 * MS))
                    event = Event(EventKind.TIMER, timer.name)
                    self._push(nominal_ns + jitter, _Arrival(event, "", None))

    def _send(self, arrival: _Arrival, stamp_ns: int) -> None:
        """A message arrives later than it was sent, and not before its forerunner."""
        key = (arrival.channel, arrival.source)
        delay_ns = self._draw.choice((1 * US, 1 * MS, 40 * MS, 120 * MS, 198 * MS))
        due = max(stamp_ns + delay_ns, self._last_of.get(key, 0) + 1)
        self._last_of[key] = due
        self._push(due, arrival)

    def _await(self, configuration: Configuration) -> None:
        """What has begun to be delayed will come."""
        for timer in configuration.timers:
            if not any(timer is other for other in self._awaited):
                self._awaited.append(timer)
                off_ns = self._draw.randint(-TOLERANCE_NS + MS, TOLERANCE_NS - MS)
                late_ns = self._draw.choice((0, 0, 0, 80 * MS, 180 * MS))
                self._push(timer.began[0] + timer.delay_ns + off_ns + late_ns, timer)

    def _push(self, due: int, arrival: _Arrival | Timer) -> None:
        heapq.heappush(self._coming, (due, next(self._numbers), arrival))

    def _take(self, before: Configuration, arrival: _Arrival | Timer) -> Configuration:
        now = self._now, self._now
        if isinstance(arrival, Timer):
            return self._enter(self._draw.choice(self._stepper.ring(before, arrival, now)))
        if arrival.event.kind is not EventKind.TIMER:
            self._hear(arrival)
        now = self._now, self._now
        outcomes = self._stepper.take(before, arrival.event, arrival.data, arrival.call, now)
        return self._enter(self._draw.choice(outcomes))

    def _hear(self, arrival: _Arrival) -> None:
        match arrival.event.kind:
            case EventKind.MESSAGE:
                assert arrival.stamp_ns is not None
                self._observe(ObservationKind.MESSAGE, arrival, arrival.stamp_ns, arrival.source)
            case EventKind.REQUEST:
                self._now += 1 * US
                self._observe(
                    ObservationKind.REQUEST_RECEIVED, arrival, self._now, self._machine.name
                )
            case EventKind.RESPONSE | EventKind.CALL_ERROR:
                self._now += 1 * US
                self._observe(
                    ObservationKind.RESPONSE_RECEIVED, arrival, self._now, self._machine.name
                )

    def _observe(
        self, kind: ObservationKind, arrival: _Arrival, stamp_ns: int, source: str
    ) -> None:
        failed = arrival.event.kind is EventKind.CALL_ERROR
        self._heard.append(
            observation(
                kind,
                arrival.channel,
                arrival.data,
                stamp_ns,
                source,
                arrival.call,
                "timeout: no answer" if failed else "",
            )
        )

    def _enter(self, outcome: Outcome) -> Configuration:
        """The machine is in a new configuration; what it sent leaves, microseconds apart."""
        configuration, sent = outcome
        for output in sent:
            self._now += self._draw.randint(1, 50) * US
            call = output.call or Call()
            if output.kind is OutputKind.REQUEST:
                call = self._call(self._machine.name, output.channel)
                self._answer(output, call)
            self._heard.append(
                observation(
                    SENT[output.kind],
                    output.channel,
                    filled(output),
                    self._now,
                    self._machine.name,
                    call,
                )
            )
        self._now += 1 * US
        return configuration

    def _call(self, client: str, channel: str) -> Call:
        return Call(client, next(self._calls.setdefault(channel, itertools.count(1))))

    def _answer(self, output: Output, call: Call) -> None:
        due = self._now + self._draw.choice((1, 20, 150, 400)) * MS
        name = next(
            item.name
            for item in self._machine.interfaces
            if item.kind is InterfaceKind.CLIENT and item.channel == output.channel
        )
        if self._draw.random() < 0.2:
            event, data = Event(EventKind.CALL_ERROR, name), None
        else:
            event = Event(EventKind.RESPONSE, name)
            data = {"value": self._draw.randint(0, 3), "ok": self._draw.random() < 0.5}
        self._push(due, _Arrival(event, output.channel, data, call=call))


_HEARD = (InterfaceKind.SUBSCRIBER, InterfaceKind.SERVER)
SENT = {
    OutputKind.PUBLISH: ObservationKind.MESSAGE,
    OutputKind.REQUEST: ObservationKind.REQUEST_SENT,
    OutputKind.RESPONSE: ObservationKind.RESPONSE_SENT,
}
_ZERO: dict[OutputKind, dict[str, Any]] = {
    OutputKind.PUBLISH: {"data": 0},
    OutputKind.REQUEST: {"value": 0},
    OutputKind.RESPONSE: {"value": 0, "ok": False},
}


def filled(output: Output) -> dict[str, Any]:
    """The whole message: fields that the model does not set are zero."""
    return {**_ZERO[output.kind], **output.data}


_TYPES = {
    ObservationKind.MESSAGE: "std_msgs/msg/Int32",
    ObservationKind.REQUEST_RECEIVED: "probe_interfaces/srv/Ask_Request",
    ObservationKind.REQUEST_SENT: "probe_interfaces/srv/Ask_Request",
    ObservationKind.RESPONSE_RECEIVED: "probe_interfaces/srv/Ask_Response",
    ObservationKind.RESPONSE_SENT: "probe_interfaces/srv/Ask_Response",
}


def observation(
    kind: ObservationKind,
    channel: str,
    data: Any,
    stamp_ns: int,
    source: str,
    call: Call,
    error: str = "",
) -> Observation:
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel=channel,
        kind=kind,
        type_name=_TYPES[kind],
        data=data,
        source=source,
        client=call.client,
        call=call.number,
        error=error,
    )


def numbered(heard: list[Observation]) -> tuple[Observation, ...]:
    """In the order of the stamps, with sequence numbers that have no gaps: nothing was lost."""
    counts: dict[tuple[str, str], int] = {}
    found = []
    for item in sorted(heard, key=lambda item: item.stamp_ns):
        key = (item.source, item.channel)
        found.append(msgspec.structs.replace(item, sequence=counts.get(key, 0)))
        counts[key] = counts.get(key, 0) + 1
    return tuple(found)
