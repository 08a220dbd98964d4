"""What a tick costs: policy → skill → answer, between two processes over loopback.

Three figures of one run, taken in turns so that the machine's moods hit all of them alike:

* bare: a Zenoh get answered by a Zenoh queryable, no code of ours (channels, one reader each);
* untapped: ``Client.call_and_wait`` to a served service, typed request and response;
* tapped: the same, with a tap in a third process that hears all four events of each call.

Usage: ``python benchmarks/tick.py [--seconds S] [--rate HZ]``. Prints medians and ratios.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection

import msgspec
import zenoh
from loopback import free_endpoint, spinning
from row import Row, publish, slower

from transports.interface import CallOutcome, Client, Observation, Service
from transports.zenoh import connect
from transports.zenoh.session import open_session

BARE_KEY = "bare/tick"
BLOCKS = 5


class TickRequest(msgspec.Struct):
    pass


class TickResponse(msgspec.Struct):
    status: int = 0
    is_ok: bool = False


TICK = Service(
    "/BatteryLevelSkill/tick", "bt_interfaces/srv/TickCondition", TickRequest, TickResponse
)


def serve_bare(endpoint: str, ready: Connection) -> None:
    session = open_session({"endpoint": endpoint})
    queryable = session.declare_queryable(BARE_KEY, complete=True)
    ready.send(True)
    answer = msgspec.msgpack.encode(TickResponse(1, True))
    for query in queryable:
        query.reply(BARE_KEY, answer)
        query.drop()


def serve_ours(endpoint: str, ready: Connection) -> None:
    transport = connect("skill", {"endpoint": endpoint})
    transport.serve(TICK, lambda request: request.respond(TickResponse(1, True)))
    transport.announce()
    ready.send(True)
    transport.spin()


def run_tap(endpoint: str, pipe: Connection) -> None:
    transport = connect("tap", {"endpoint": endpoint})
    heard = 0

    def hear(_: Observation) -> None:
        nonlocal heard
        heard += 1

    tap = None
    with spinning(transport):
        while pipe.recv():
            if tap is None:
                tap = transport.tap([], hear)
            else:
                tap.close()
                tap = None
            pipe.send(heard)


def timed(action: Callable[[], None], into: list[float]) -> None:
    start = time.perf_counter()
    action()
    into.append((time.perf_counter() - start) * 1e6)


def show(name: str, figures: list[float]) -> float:
    figures.sort()
    median = statistics.median(figures)
    p99 = figures[int(len(figures) * 0.99)]
    print(f"  {name:<10} p50 {median:7.1f} µs   p99 {p99:7.1f} µs   ({len(figures)} calls)")
    return median


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="per block and figure")
    parser.add_argument("--rate", type=float, default=100.0, help="ticks per second")
    arguments = parser.parse_args()

    endpoint = free_endpoint()
    transport = connect("policy", {"listen": endpoint})
    with (
        spinning(transport),
        contextlib.closing(open_session({"endpoint": endpoint})) as bare,
        children(endpoint, serve_bare, serve_ours, run_tap) as pipes,
    ):
        for pipe in pipes[:2]:
            pipe.recv()
        transport.wait_for_nodes(["skill"], 10)
        client = transport.client(TICK)
        rows = compare(bare, client, pipes[2], arguments.rate, arguments.seconds / BLOCKS)
        pipes[2].send(False)
    publish(rows)


@contextlib.contextmanager
def children(
    endpoint: str, *targets: Callable[[str, Connection], None]
) -> Iterator[list[Connection]]:
    """Meanwhile each of ``targets`` runs in a process of its own, at the other end of a pipe."""
    context = multiprocessing.get_context("spawn")
    running, pipes = [], []
    try:
        for target in targets:
            here, there = context.Pipe()
            child = context.Process(target=target, args=(endpoint, there), daemon=True)
            child.start()
            running.append(child)
            pipes.append(here)
        yield pipes
    finally:
        for child in running:
            child.terminate()
            child.join()


def compare(
    bare: zenoh.Session, client: Client, tap: Connection, rate_hz: float, block_s: float
) -> list[Row]:
    """Ticks of each kind in turns, at ``rate_hz`` and as fast as they go."""
    payload = msgspec.msgpack.encode(TickRequest())
    request = TickRequest()

    def call_bare() -> None:
        for reply in bare.get(BARE_KEY, payload=payload, timeout=5.0):
            assert reply.ok is not None

    def call_ours() -> None:
        assert client.call_and_wait(request).outcome is CallOutcome.RESPONSE

    for _ in range(300):
        call_bare()
        call_ours()
    rows: list[Row] = []
    for label, period_s in (
        (f"at {rate_hz:g} ticks/s", 1 / rate_hz),
        ("saturated", 0.0),
    ):
        figures: dict[str, list[float]] = {"bare": [], "untapped": [], "tapped": []}
        heard = 0
        for block in range(2 * BLOCKS):
            tapped = bool(block % 2)
            end = time.monotonic() + block_s
            due = time.monotonic()
            pace = threading.Event()
            while time.monotonic() < end:
                timed(call_bare, figures["bare"])
                if period_s:
                    pace.wait(max(due + period_s / 2 - time.monotonic(), 0))
                timed(call_ours, figures["tapped" if tapped else "untapped"])
                if period_s:
                    due += period_s
                    pace.wait(max(due - time.monotonic(), 0))
            tap.send(True)
            heard = tap.recv()
            until = time.monotonic() + 5  # a block must not be half tapped
            while client.events.heard == tapped and time.monotonic() < until:
                pace.wait(0.01)
        print(f"{label}:")
        median = {name: show(name, values) for name, values in figures.items()}
        rows += [
            slower(
                f"a tick {label}, p50",
                median["untapped"],
                "µs",
                "Zenoh's get and queryable",
                median["bare"],
                1.6,
            ),
            slower(
                f"the same tapped {label}",
                median["tapped"],
                "µs",
                "untapped",
                median["untapped"],
                1.15 if period_s else None,
            ),
        ]
        print(f"  untapped / bare     {median['untapped'] / median['bare']:.2f}   (target ≤ 1.60)")
        print(
            f"  tapped / untapped   {median['tapped'] / median['untapped']:.2f}   (target ≤ 1.15 at 100/s)"
        )
        print(f"  heard by the tap    {heard} events so far")
    return rows


if __name__ == "__main__":
    main()
