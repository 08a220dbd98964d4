"""The load: the policy's process, which ticks the tree when it is told and says how long that took.

The tree is ticked by the policy runner of a generated policy; what is added is a clock around each
call. It is the same whatever monitors.
"""

from __future__ import annotations

import itertools
import logging
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.processes import READY_S, ready, say
from benchmarks.ticking import WHOLE, Order, Stopwatch, Taken, carried_out, spun
from examples.overhead.routes import rerouted
from m2c.launch.description import POLICY_FILE
from m2c.policy.program import Policy
from m2c.policy.runner import PolicyRunner
from transports.interface import CallOutcome, CallResult, Client, Message, Service, Topic, Transport
from transports.registry import connect
from transports.work_queue import WorkQueue

LEVEL_S = 0.5
"""The battery's level is told so often (``rate_hz`` of its model)."""


class TimedClient:
    """A client of a tick service, with a clock around each call."""

    def __init__(self, client: Client, name: str, load: Load) -> None:
        self._client = client
        self._name = name
        self._load = load

    def call_and_wait(self, request: Message, timeout_s: float = 5.0) -> CallResult:
        """Call, and note how long it took."""
        return self._load.stopwatch.time(
            lambda: self._client.call_and_wait(request, timeout_s), why_failed, self._name
        )


def why_failed(result: CallResult) -> str:
    """Why a tick counts as failed; "" if it does not."""
    if result.outcome is not CallOutcome.RESPONSE:
        return f"{result.outcome}: {result.error}"
    return "" if result.response.is_ok else "answered that it could not do what it should"


class Load:
    """The policy's connection, as the policy runner needs it; its clients have clocks.

    Args:
        transport: the policy's connection.
        policy: the policy, as generated.
    """

    def __init__(self, transport: Transport, policy: Policy) -> None:
        self.stopwatch = Stopwatch()
        self._transport = transport
        self._names = {leaf.tick: leaf.name for leaf in policy.leaves}
        self._runner = PolicyRunner(self, policy, tick_timeout_s=5.0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def client(self, service: Service) -> Any:
        """A client with a clock."""
        return TimedClient(self._transport.client(service), self._names[service.name], self)

    def tick(self, watch: Stopwatch) -> None:
        """One tick of the tree."""
        self.stopwatch = watch
        called = {name: len(watch.micros.get(name, ())) for name in self._names.values()}
        failed = sum(watch.failures.values()) - watch.failures.get(WHOLE, 0)
        began = time.perf_counter_ns()
        self._runner.tick()
        micros = (time.perf_counter_ns() - began) / 1e3
        left_out = [name for name, n in called.items() if len(watch.micros.get(name, ())) == n]
        why = f"not ticked: {', '.join(left_out)}" if left_out else ""
        if sum(watch.failures.values()) - watch.failures.get(WHOLE, 0) > failed:
            why = "a skill failed"
        watch.note(WHOLE, micros, why)

    def run(self, order: Order) -> Taken:
        """Carry out one order; what the runner does behind a tick is done in its pauses."""
        return carried_out(order, self.tick, self._transport.tick_complete)


def tick_tree(
    folder: str,
    transport_name: str,
    options: Mapping[str, str],
    names: Sequence[str],
    through_the_middle: bool,
) -> None:
    """Tick as told until standard input ends.

    Args:
        folder: of the generated policy.
        transport_name: of the policy's connection.
        options: of the policy's connection.
        names: nodes to wait for.
        through_the_middle: tick by way of the monitor.
    """
    logging.basicConfig(level=logging.CRITICAL)  # failures are counted and told, not logged
    policy = msgspec.json.decode((Path(folder) / POLICY_FILE).read_bytes(), type=Policy)
    if through_the_middle:
        leaves = tuple(msgspec.structs.replace(x, tick=rerouted(x.tick)) for x in policy.leaves)
        policy = msgspec.structs.replace(policy, leaves=leaves)
    transport = connect(transport_name, "policy", dict(options))
    try:
        events: WorkQueue[str | None] = WorkQueue()
        level = Topic("/BatteryComponent/level", "std_msgs/msg/Int32", Int32)
        transport.subscribe(level, lambda _: events.put(_LEVEL))
        load = Load(transport, policy)
        spun(transport, names)
        threading.Thread(target=_read_orders, args=(events,), daemon=True).start()
        ready()
        rests, parts = True, phases()
        while (event := events.get()) is not None:
            if event != _LEVEL:
                order = msgspec.json.decode(event, type=Order)
                # who has just come must hear that the battery is low before an alarm is rung
                begins = not order.ticks or _into_next_level(events, next(parts))
                taken = load.run(order) if begins else None
                rests = order.rest or taken is None or any(taken.failures.values())
                say(taken)
            elif not rests:
                load.run(Order(1, 0.0, 0))
    finally:
        transport.close()


_LEVEL = "level"
"""The event that the battery has told its level; the others are orders, and None the end of them."""


def _read_orders(events: WorkQueue[str | None]) -> None:
    for line in sys.stdin:
        events.put(line)
    events.put(None)


def _into_next_level(events: WorkQueue[str | None], part: float) -> bool:
    """Wait for a level that is told from now on, and for a ``part`` of the time to the one behind it;
    whether there was one (else the end has come).
    """
    while not events.empty():
        if events.get() is None:
            return False
    told = events.get(timeout=READY_S) == _LEVEL
    if told:
        threading.Event().wait(part * LEVEL_S)
    return told


def phases() -> Iterator[float]:
    """Where between two levels an order begins, as a part of their period: anywhere, evenly.

    A tree ticked once a second is in step with what is told twice a second: an order that began at a level
    would have each of its ticks delayed by whoever else hears that. The multiples of the golden ratio, modulo
    1, are even (Knuth, The Art of Computer Programming, volume 3, section 6.4, theorem S).
    """
    return (number * (5**0.5 - 1) / 2 % 1.0 for number in itertools.count(1))


class Int32(msgspec.Struct):
    """``std_msgs/msg/Int32``."""

    __type_name__ = "std_msgs/msg/Int32"
    data: int = 0
