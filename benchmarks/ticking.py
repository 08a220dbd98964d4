"""Ticks at a rate: who makes them, and where they meet the others.

A process that makes ticks reads orders from standard input, a JSON object a line, and answers each with one
(:class:`Order`, :class:`Taken`). What a tick is differs: of a tree, or a call.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import msgspec

from benchmarks.processes import READY_S, ROOT, Child, free_endpoint, ready, say
from transports.interface import Connection

Result = TypeVar("Result")

NAMES = {"zenoh": "Zenoh", "ros2": "ROS 2"}
WHOLE = "ROOT"
"""The series of whole ticks, as the paper's table calls that of the tree."""
INTERFACES = ROOT / "examples/lab_tour/interfaces"
ORDER_S = 120.0
"""Beyond its own time, an order may take this long to be carried out."""


def at_rate(rate_hz: float) -> str:
    """A rate of ticks, as people write it."""
    return f"{rate_hz:g} tick{'' if rate_hz == 1 else 's'}/s" if rate_hz else "saturated"


# -- where they meet --------------------------------------------------------------------------------


class Middleware(msgspec.Struct, frozen=True):
    """Where one set of processes meets.

    Attributes:
        transport: ``zenoh`` or ``ros2``.
        endpoint: of Zenoh; one of the processes listens there.
        environment: variables of all its processes.
    """

    transport: str
    endpoint: str = ""
    environment: dict[str, str] = {}

    def arguments(self) -> list[str]:
        """By which a command finds it."""
        where = ["--endpoint", self.endpoint] if self.endpoint else []
        return ["--transport", self.transport, *where]

    def options(self, how: str = "endpoint") -> dict[str, str]:
        """By which ``connect`` finds it; ``how`` is "listen" where the others meet."""
        return {how: self.endpoint} if self.endpoint else {}


class MiddlewareMissingError(Exception):
    """A transport cannot be used here; the text says why and what would help."""


@contextlib.contextmanager
def middleware(transport: str) -> Iterator[Middleware]:
    """A Zenoh endpoint or a ROS domain of its own, on loopback only.

    Raises:
        MiddlewareMissingError: ROS 2 is not installed.
    """
    if transport == "zenoh":
        yield Middleware(transport, free_endpoint())
        return
    base = ros_environment()
    from domain_coordinator import domain_id

    numbers = iter(range(os.getpid(), os.getpid() + 10_000))
    with domain_id(lambda: next(numbers) % 100 + 1) as number:
        yield Middleware(transport, environment={**base, "ROS_DOMAIN_ID": str(number)})


def ros_environment() -> dict[str, str]:
    """What processes on ROS 2 need; the interface packages are built the first time (20 s).

    Raises:
        MiddlewareMissingError: ROS 2 is not installed, or the packages cannot be built.
    """
    from m2c.rosidl.build import InterfaceBuildError, build_interfaces

    if importlib.util.find_spec("rclpy") is None:
        raise MiddlewareMissingError("ROS 2 is not installed: pip install '.[ros2]'")
    try:
        install = build_interfaces([INTERFACES], ROOT / "build/interfaces")
    except InterfaceBuildError as error:
        raise MiddlewareMissingError(str(error)) from error
    paths = ("PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH")
    kept = {name: os.environ[name] for name in paths if name in os.environ}
    quiet = {"ROS_LOCALHOST_ONLY": "1", "RCUTILS_LOGGING_SEVERITY": "ERROR"}
    return {**install.environment(kept), **quiet}


# -- ticks ------------------------------------------------------------------------------------------


class Order(msgspec.Struct, frozen=True):
    """What to do: ``warm_up`` ticks that are not measured, then ``ticks`` that are.

    Attributes:
        rate_hz: ticks a second; 0: the next one as soon as one has ended.
        rest: of the tree: do not tick until the next order; else, and if no tick has failed, it is ticked
            each time that the battery has told its level, because the properties want the alarm rung.
    """

    ticks: int
    rate_hz: float
    warm_up: int = 5
    rest: bool = False


class Taken(msgspec.Struct, frozen=True):
    """What one order took.

    Attributes:
        micros: by series (skills, and ``WHOLE``), how long each tick took. One that failed is among them.
        failures: by series, how many ticks failed: no answer, or one that says that something behind it
            failed; of whole ticks, those in which a skill failed or was not ticked.
        reasons: why, the first few.
        warm_up_failures: failures among the ticks that were not measured.
        seconds: from the first measured tick to the end of the last.
    """

    micros: dict[str, list[float]]
    failures: dict[str, int]
    reasons: list[str]
    warm_up_failures: int
    seconds: float


class Stopwatch:
    """Notes how long each tick took, and which failed."""

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

    def time(
        self, call: Callable[[], Result], why: Callable[[Result], str], name: str = WHOLE
    ) -> Result:
        """Make one call, and note it."""
        began = time.perf_counter_ns()
        result = call()
        self.note(name, (time.perf_counter_ns() - began) / 1e3, why(result))
        return result


def carried_out(
    order: Order,
    tick: Callable[[Stopwatch], object],
    before_pause: Callable[[], None] = lambda: None,
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
        warm_up.failures.get(WHOLE, 0),
        time.perf_counter() - began,
    )


def answer_orders(tick: Callable[[Stopwatch], object]) -> None:
    """Carry out each order on standard input until it ends; says that it is ready before."""
    ready()
    for line in sys.stdin:
        order = msgspec.json.decode(line, type=Order)
        say(carried_out(order, tick))


def ordered(child: Child, order: Order) -> Taken:
    """Have ``child`` carry out an order.

    Raises:
        ChildError: it is gone.
    """
    expected = (order.ticks + order.warm_up) / order.rate_hz if order.rate_hz else 0.0
    return msgspec.convert(child.ask(msgspec.to_builtins(order), expected + ORDER_S), Taken)


def spun(transport: Connection, names: Sequence[str], within_s: float = READY_S) -> None:
    """Spin ``transport`` in a thread, and wait for nodes; ends this process if one is not up."""
    threading.Thread(target=transport.spin, daemon=True).start()
    transport.announce()
    if missing := transport.wait_for_nodes(names, within_s):
        transport.close()
        sys.exit(f"not up: {', '.join(missing)}")
