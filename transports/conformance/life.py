"""What every transport must do with timers, threads, and nodes that come and go.

Every public function is a check.
"""

from __future__ import annotations

import threading
from functools import partial
from typing import Any

from transports.conformance.stage import (
    DOUBLE,
    NUMBERS,
    Answer,
    Ask,
    Number,
    calls,
    on,
    ready,
    refused,
)
from transports.interface import (
    CallOutcome,
    Timer,
)
from transports.networks import PATIENCE_S, Network


def timers_fire_no_earlier_than_asked_and_stop_when_cancelled(network: Network) -> None:
    """``every`` repeats, ``after`` fires once, a cancelled timer not at all."""
    node = network.node("node")
    stamps: list[int] = []
    fired: list[str] = []
    timers: list[Timer] = []
    began = node.now_ns()

    def start() -> None:
        node.after(0.02, lambda: fired.append("cancelled")).cancel()
        node.after(0.05, lambda: fired.append("once"))
        timers.append(node.every(0.02, tick))

    def tick() -> None:
        stamps.append(node.now_ns() - began)
        if len(stamps) == 10:
            timers[0].cancel()
            node.after(0.05, lambda: fired.append("end"))

    on(network, node, start)
    assert network.until(lambda: "end" in fired), f"the timers fired {len(stamps)} times, {fired}"
    assert fired == ["once", "end"], f"fired: {fired}"
    assert len(stamps) == 10, f"a cancelled periodic timer fired {len(stamps)} times"
    early = [n for n, stamp in enumerate(stamps, 1) if stamp < n * 20e6 - 2e6]
    assert not early, f"firings {early} came too early: {stamps}"


def callbacks_run_one_at_a_time(network: Network) -> None:
    """Messages, requests, timers and posted work share one executor."""
    node, other = network.node("node"), network.node("other")
    busy = threading.Lock()
    seen: set[str] = set()
    overlaps: list[str] = []
    threads: set[int] = set()

    def work(kind: str) -> None:
        if not busy.acquire(blocking=False):
            overlaps.append(kind)
            return
        threads.add(threading.get_ident())
        sum(range(2000))
        seen.add(kind)
        busy.release()

    def serve(request: Any) -> None:
        work("request")
        request.respond(Answer(0))

    on(network, node, lambda: node.subscribe(NUMBERS, lambda _: work("message")))
    on(network, node, lambda: node.serve(DOUBLE, serve))
    publisher = on(network, other, lambda: other.publisher(NUMBERS))
    ready(network, node, other)
    timer = on(network, node, lambda: node.every(0.001, lambda: work("timer")))
    for value in range(50):
        other.post(partial(publisher.publish, Number(value)))
        node.post(lambda: work("posted"))
    results = calls(network, other, range(50))
    assert network.until(lambda: len(results) == 50 and len(seen) == 4), f"only {seen} ran"
    on(network, node, timer.cancel)
    assert not overlaps, f"{overlaps} ran while something else did"
    assert len(threads) == 1, f"callbacks ran on {len(threads)} threads"


def a_node_is_up_once_it_is_announced_and_down_once_it_is_closed(network: Network) -> None:
    """``wait_for_nodes`` and ``watch_nodes`` agree."""
    watcher, node = network.node("watcher"), network.node("node")
    changes: list[tuple[str, bool]] = []
    on(network, watcher, lambda: watcher.watch_nodes(lambda *change: changes.append(change)))
    missing = network.caller(lambda: watcher.wait_for_nodes(["node"], 0.05))()
    assert list(missing) == ["node"], "a node that is not announced counts as up"
    ready(network, watcher, node)
    assert network.until(lambda: ("node", True) in changes), "nobody is notified that it is up"
    node.close()
    assert network.until(lambda: ("node", False) in changes), "nobody is notified that it is gone"


def closing_while_busy_ends_everything(network: Network) -> None:
    """A waiting caller returns, timers stop, and closing again does nothing."""
    server, client = network.node("server"), network.node("client")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    ready(network, server, client)
    on(network, client, lambda: client.every(0.001, lambda: None))
    caller = on(network, client, lambda: client.client(DOUBLE))
    value = network.caller(lambda: caller.call_and_wait(Ask(1), 10 * PATIENCE_S))
    assert network.until(lambda: bool(kept)), "the request does not arrive"
    client.close()
    result = value()
    assert result.outcome is not CallOutcome.RESPONSE, f"the call ended: {result}"
    client.close()


def a_node_beside_another_has_a_life_of_its_own(network: Network) -> None:
    """It has its name and its liveliness for itself, and ends with the other at the latest."""
    watcher, node = network.node("watcher"), network.node("node")
    changes: list[tuple[str, bool]] = []
    on(network, watcher, lambda: watcher.watch_nodes(lambda *change: changes.append(change)))
    first, second = node.beside("first"), node.beside("second")
    for other in (first, second):
        other.announce()
    ready(network, watcher, node)
    assert network.until(lambda: {("first", True), ("second", True)} <= set(changes)), (
        f"nobody is notified that they are up: {changes}"
    )
    refused(network, node, lambda: node.beside("first"), "a second node of one name beside another")
    first.close()
    assert network.until(lambda: ("first", False) in changes), "nobody is notified that it is gone"
    assert not {("node", False), ("second", False)} & set(changes), "others went away with it"
    node.close()
    assert network.until(lambda: {("node", False), ("second", False)} <= set(changes)), (
        f"who ends has left somebody beside it: {changes}"
    )
    second.close()
