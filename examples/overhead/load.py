"""The load: the policy's process, which ticks the tree when it is told and says how long that took.

``python -m examples.overhead.load POLICY-FOLDER --listen ENDPOINT --wait-for NODE …``. Reads orders
from standard input, a JSON object a line, and answers each with one (:class:`Order`, :class:`Taken`).

The tree is ticked by the policy runner of a generated policy; what is added is a clock around each
call. It is the same whatever monitors.
"""

from __future__ import annotations

import argparse
import logging
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec

from examples.overhead.routes import rerouted
from m2c.launch.description import POLICY_FILE
from m2c.policy.program import Policy
from m2c.policy.runner import PolicyRunner
from transports.interface import CallOutcome, CallResult, Client, Message, Service, Topic, Transport
from transports.registry import connect

ROOT = "ROOT"
"""The series of whole ticks of the tree, as the paper's table calls it."""
LEVEL = "/BatteryComponent/level"
LEVEL_S = 0.5
"""It is told so often (``rate_hz`` of the battery's model)."""
READY_S = 60.0


class Order(msgspec.Struct, frozen=True):
    """What to do: ``warm_up`` ticks that are not measured, then ``ticks`` that are.

    Attributes:
        rate_hz: ticks of the tree a second; 0: the next one as soon as one has ended.
        rest: do not tick until the next order; else, and if no tick has failed, the tree is ticked
            each time that the battery has told its level, because the properties want the alarm rung.
        size: of an answer in bytes (``examples.overhead.echo``).
    """

    ticks: int
    rate_hz: float
    warm_up: int = 5
    rest: bool = False
    size: int = 0


class Taken(msgspec.Struct, frozen=True):
    """What one order took.

    Attributes:
        micros: per skill and for ROOT, how long each tick took. One that failed is among them.
        failures: per skill and for ROOT, how many ticks failed: no answer, or one that says that
            something behind it failed; of ROOT, those in which a skill failed or was not ticked.
        reasons: why, the first few.
        warm_up_failures: failures among the ticks that were not measured.
        seconds: from the first measured tick to the end of the last.
        processor_s: processor time of the policy's process in that time.
    """

    micros: dict[str, list[float]]
    failures: dict[str, int]
    reasons: list[str]
    warm_up_failures: int
    seconds: float
    processor_s: float


class Stopwatch:
    """Notes how long each call of a skill took, and which failed."""

    def __init__(self) -> None:
        self.micros: dict[str, list[float]] = {}
        self.failures: dict[str, int] = {}
        self.reasons: list[str] = []

    def note(self, name: str, micros: float, failure: str) -> None:
        """One tick of ``name``; ``failure``: why it counts as failed, "" if it does not."""
        self.micros.setdefault(name, []).append(micros)
        self.failures.setdefault(name, 0)
        if failure:
            self.failures[name] += 1
            if len(self.reasons) < 5:
                self.reasons.append(f"{name}: {failure}")


def carried_out(
    order: Order, tick: Callable[[Stopwatch], None], before_pause: Callable[[], None] = lambda: None
) -> Taken:
    """Carry out one order.

    Args:
        order: how many ticks, at which rate.
        tick: makes one, and notes it.
        before_pause: called where the next tick is not due yet.
    """
    watches = Stopwatch(), Stopwatch()
    pace = threading.Event()  # never set: what waits for the next period
    for watch, count in zip(watches, (order.warm_up, order.ticks), strict=True):
        began = due = time.perf_counter()
        processor = time.process_time()
        for _ in range(count):
            tick(watch)
            if order.rate_hz:
                due = max(due + 1 / order.rate_hz, time.perf_counter())
                pause = due - time.perf_counter()
                if pause > 0:
                    before_pause()
                    pace.wait(pause)
    warm_up, measured = watches
    return Taken(
        measured.micros,
        measured.failures,
        [*(f"in the warm-up: {reason}" for reason in warm_up.reasons), *measured.reasons],
        warm_up.failures.get(ROOT, 0),
        time.perf_counter() - began,
        time.process_time() - processor,
    )


class TimedClient:
    """A client of a tick service, with a clock around each call."""

    def __init__(self, client: Client, name: str, load: Load) -> None:
        self._client = client
        self._name = name
        self._load = load

    def call_and_wait(self, request: Message, timeout_s: float = 5.0) -> CallResult:
        """Call, and note how long it took."""
        began = time.perf_counter_ns()
        result = self._client.call_and_wait(request, timeout_s)
        micros = (time.perf_counter_ns() - began) / 1e3
        self._load.stopwatch.note(self._name, micros, why_failed(result))
        return result


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
        tick_timeout_s: how long a skill may take to answer.
    """

    def __init__(self, transport: Transport, policy: Policy, tick_timeout_s: float = 5.0) -> None:
        self.stopwatch = Stopwatch()
        self._transport = transport
        self._names = {leaf.tick: leaf.name for leaf in policy.leaves}
        self._runner = PolicyRunner(self, policy, tick_timeout_s=tick_timeout_s)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def client(self, service: Service) -> Any:
        """A client with a clock."""
        return TimedClient(self._transport.client(service), self._names[service.name], self)

    def _tick(self) -> None:
        """One tick of the tree."""
        watch = self.stopwatch
        called = {name: len(watch.micros.get(name, ())) for name in self._names.values()}
        failed = sum(watch.failures.values()) - watch.failures.get(ROOT, 0)
        began = time.perf_counter_ns()
        self._runner.tick()
        micros = (time.perf_counter_ns() - began) / 1e3
        left_out = [name for name, n in called.items() if len(watch.micros.get(name, ())) == n]
        why = f"not ticked: {', '.join(left_out)}" if left_out else ""
        if sum(watch.failures.values()) - watch.failures.get(ROOT, 0) > failed:
            why = "a skill failed"
        watch.note(ROOT, micros, why)

    def run(self, order: Order) -> Taken:
        """Carry out one order."""

        def tick(watch: Stopwatch) -> None:
            self.stopwatch = watch
            self._tick()

        return carried_out(
            order, tick, self._transport.tick_complete
        )  # as the runner does behind a tick


def main(arguments: Sequence[str] | None = None) -> int:
    """Tick as told until standard input ends."""
    parser = argparse.ArgumentParser(description="Tick the tree when told, and say what it took.")
    parser.add_argument("folder", type=Path, help="of the generated policy: has policy.json")
    parser.add_argument("--transport", default="zenoh")
    parser.add_argument("--listen", default="", help="zenoh: where the nodes meet")
    parser.add_argument("--wait-for", action="append", default=[], metavar="NODE")
    parser.add_argument("--rerouted", action="store_true", help="tick by way of the monitor")
    parser.add_argument("--tick-timeout", type=float, default=5.0)
    chosen = parser.parse_args(arguments)
    logging.basicConfig(level=logging.CRITICAL)  # failures are counted and told, not logged
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    policy = msgspec.json.decode((chosen.folder / POLICY_FILE).read_bytes(), type=Policy)
    if chosen.rerouted:
        leaves = tuple(msgspec.structs.replace(x, tick=rerouted(x.tick)) for x in policy.leaves)
        policy = msgspec.structs.replace(policy, leaves=leaves)
    transport = connect(
        chosen.transport, "policy", {"listen": chosen.listen} if chosen.listen else {}
    )
    spinner = threading.Thread(target=transport.spin, daemon=True)
    try:
        events: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        transport.subscribe(level_topic(), lambda _: events.put(_LEVEL))
        load = Load(transport, policy, chosen.tick_timeout)
        spinner.start()
        transport.announce()
        missing = transport.wait_for_nodes(chosen.wait_for, READY_S)
        if missing:
            print(f"not up: {', '.join(missing)}", file=sys.stderr)
            return 2
        threading.Thread(target=_read_orders, args=(events,), daemon=True).start()
        print('{"ready": true}', flush=True)
        rests, parts = True, phases()
        while (event := events.get()) is not None:
            if event != _LEVEL:
                order = msgspec.json.decode(event, type=Order)
                # who has just come must hear that the battery is low before an alarm is rung
                begins = not order.ticks or _into_next_level(events, next(parts))
                taken = load.run(order) if begins else None
                rests = order.rest or taken is None or any(taken.failures.values())
                print(msgspec.json.encode(taken).decode(), flush=True)
            elif not rests:
                load.run(Order(1, 0.0, 0))
    finally:
        transport.close()
    return 0


_LEVEL = "level"
"""The event that the battery has told its level; the others are orders, and None the end of them."""


def answer_orders(carry_out: Callable[[Order], Taken]) -> None:
    """Answer each order on standard input until it ends; says that it is ready before."""
    print('{"ready": true}', flush=True)
    for line in sys.stdin:
        taken = carry_out(msgspec.json.decode(line, type=Order))
        print(msgspec.json.encode(taken).decode(), flush=True)


def _read_orders(events: queue.SimpleQueue[str | None]) -> None:
    for line in sys.stdin:
        events.put(line)
    events.put(None)


def _into_next_level(events: queue.SimpleQueue[str | None], part: float) -> bool:
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
    """Where between two levels an order begins, as a part of their period.

    A tree ticked once a second is in step with what is told twice a second, for as long as an order
    lasts: one that began at a level would have each of its ticks delayed by whoever else hears that.
    So orders begin anywhere, evenly: the multiples of the golden ratio, modulo 1 (Knuth, The Art of
    Computer Programming, volume 3, section 6.4, theorem S).
    """
    part = 0.0
    while True:
        part = (part + _GOLDEN) % 1.0
        yield part


_GOLDEN = (5**0.5 - 1) / 2


def level_topic() -> Topic:
    """The battery's level."""
    return Topic(LEVEL, "std_msgs/msg/Int32", Int32)


class Int32(msgspec.Struct):
    """``std_msgs/msg/Int32``."""

    __type_name__ = "std_msgs/msg/Int32"
    data: int = 0


if __name__ == "__main__":
    sys.exit(main())
