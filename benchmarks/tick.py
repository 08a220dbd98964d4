"""What a tick costs: policy → skill → answer, between two processes over loopback, on Zenoh and on ROS 2.

In turns of one run, so that the machine's moods hit all of them alike:

* bare: without any code of ours: a Zenoh get answered by a queryable (channels, one reader each); rclpy's
  service, client and SingleThreadedExecutor, the caller waiting on a thread of its own as the policy does;
* untapped: ``Client.call_and_wait`` to a served service, typed request and response;
* tapped: the same, with a tap in a third process that hears all four events of each call.

Usage: ``python -m benchmarks.tick [--transport zenoh|ros2] [--seconds S] [--rounds N]``.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import msgspec

from benchmarks.page import Row, publish
from benchmarks.processes import Child, free_endpoint, spinning
from benchmarks.sampling import distribution, ratio, rounds
from transports.interface import CallOutcome, Service
from transports.registry import connect

BARE_KEY = "bare/tick"
PEERS = {"zenoh": "Zenoh's get and queryable", "ros2": "rclpy's service and client"}
NAMES = {"zenoh": "Zenoh", "ros2": "ROS 2"}
MOST = {"zenoh": 1.6, "ros2": 1.5}
MOST_TAPPED = {("zenoh", 100.0): 1.15, ("ros2", 10.0): 1.1}
RATES = {"zenoh": (100.0, 0.0), "ros2": (10.0, 100.0, 0.0)}
"""Ticks a second; 0: the next one as soon as one has ended."""
READY_S = 30.0
WARM_UP = 50


class Ask(msgspec.Struct):
    __type_name__ = "std_srvs/srv/SetBool_Request"
    data: bool = False


class Answer(msgspec.Struct):
    __type_name__ = "std_srvs/srv/SetBool_Response"
    success: bool = False
    message: str = ""


TICK = Service("/benchmark/tick", "std_srvs/srv/SetBool", Ask, Answer)


class Order(msgspec.Struct):
    """Calls for ``seconds``, so many a second."""

    rate_hz: float
    seconds: float


# -- processes: each says that it is ready, and ends by SIGTERM --------------------------------------


def ready() -> None:
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    print('{"ready": true}', flush=True)
    ended.wait()


@contextlib.contextmanager
def rclpy_node(name: str) -> Iterator[Any]:
    """A node whose executor spins on a thread."""
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    rclpy.init()
    node = rclpy.create_node(name)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with contextlib.suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield node
    finally:
        rclpy.shutdown()
        thread.join()


def serve_bare(name: str, options: dict[str, str]) -> None:
    if name == "zenoh":
        from transports.zenoh.session import open_session

        answer = msgspec.msgpack.encode(Answer(True))
        with contextlib.closing(open_session(options)) as session:
            queryable = session.declare_queryable(BARE_KEY, complete=True)

            def reply() -> None:
                for query in queryable:
                    query.reply(BARE_KEY, answer)
                    query.drop()

            threading.Thread(target=reply, daemon=True).start()
            ready()
        return
    from std_srvs.srv import SetBool

    def respond(request: Any, response: Any) -> Any:
        response.success = request.data
        return response

    with rclpy_node("bare_server") as node:
        node.create_service(SetBool, "/benchmark/bare", respond)
        ready()


def serve(name: str, options: dict[str, str]) -> None:
    transport = connect(name, "server", options)
    transport.serve(TICK, lambda request: request.respond(Answer(request.data.data)))
    transport.announce()
    with spinning(transport):
        ready()


def listen(name: str, options: dict[str, str]) -> None:
    """A tap; at its end it says how much it heard."""
    transport = connect(name, "listener", options)
    heard = [0]

    def hear(_: object) -> None:
        heard[0] += 1

    tap = transport.tap([], hear)
    transport.announce()
    linked = threading.Event()
    transport.every(
        0.05, lambda: linked.set() if {"server", "client"} <= set(tap.peers()) else None
    )
    with spinning(transport):
        assert linked.wait(READY_S), tap.peers()
        ready()
    print(msgspec.json.encode({"heard": heard[0]}).decode(), flush=True)


def call_bare(name: str, options: dict[str, str]) -> None:
    from std_srvs.srv import SetBool

    with rclpy_node("bare_client") as node:
        client = node.create_client(SetBool, "/benchmark/bare")
        assert client.wait_for_service(READY_S)

        def once() -> None:
            assert client.call(SetBool.Request(data=True), READY_S).success

        answer_orders({"bare": once})


def call(name: str, options: dict[str, str]) -> None:
    """On Zenoh bare calls alternate with ours, in one process: caches are then as cold for both."""
    transport = connect(name, "client", options)
    client = transport.client(TICK)
    transport.announce()

    def once() -> None:
        assert client.call_and_wait(Ask(True), READY_S).outcome is CallOutcome.RESPONSE

    with contextlib.ExitStack() as stack:
        stack.enter_context(spinning(transport))
        assert not transport.wait_for_nodes(["server"], READY_S)
        calls = {"ours": once}
        if name == "zenoh":
            from transports.zenoh.session import open_session

            payload = msgspec.msgpack.encode(Ask(True))
            session = stack.enter_context(contextlib.closing(open_session(options)))

            def get() -> None:
                replies = []
                while not replies:  # none: the two have not met yet
                    replies = list(session.get(BARE_KEY, payload=payload, timeout=READY_S))
                assert replies[0].ok is not None

            calls = {"bare": get, **calls}
        answer_orders(calls)


def answer_orders(calls: dict[str, Callable[[], None]]) -> None:
    """How long each call took, in µs, by its name; they alternate."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    for once in list(calls.values()) * WARM_UP:
        once()
    print('{"ready": true}', flush=True)
    pause = threading.Event()
    for line in sys.stdin:
        order = msgspec.json.decode(line, type=Order)
        taken: dict[str, list[float]] = {name: [] for name in calls}
        due = time.perf_counter()
        end = due + order.seconds
        while due < end:
            for name, once in calls.items():
                began = time.perf_counter()
                once()
                taken[name].append((time.perf_counter() - began) * 1e6)
                now = time.perf_counter()
                due = max(due + 1 / order.rate_hz / len(calls), now) if order.rate_hz else now
                if due > now:
                    pause.wait(due - now)
        print(msgspec.json.encode(taken).decode(), flush=True)


ROLES = {
    "serve-bare": serve_bare,
    "serve": serve,
    "listen": listen,
    "call-bare": call_bare,
    "call": call,
}


# -- the measurement --------------------------------------------------------------------------------


def measure(name: str, seconds: float, count: int) -> list[Row]:
    """Rows of one transport; ``seconds`` of each mode and rate, in ``count`` rounds."""
    options = {"endpoint": free_endpoint()} if name == "zenoh" else {}
    taken: dict[tuple[str, float], list[list[float]]] = {}

    def started(role: str, options: dict[str, str]) -> Child:
        arguments = ["--role", role, "--transport", name, "--options"]
        encoded = msgspec.json.encode(options).decode()
        child = Child(role, ["-m", "benchmarks.tick", *arguments, encoded])
        child.answer()
        return child

    with contextlib.ExitStack() as stack:
        # who comes first is where the others meet
        first = {"listen": options["endpoint"]} if options else {}
        stack.enter_context(started("serve", first))
        stack.enter_context(started("serve-bare", options))
        roles = {"call": ("untapped", "tapped")} | ({} if options else {"call-bare": ("bare",)})
        callers: dict[str, Child] = {}
        for role, modes in roles.items():
            callers |= dict.fromkeys(modes, stack.enter_context(started(role, options)))
        turns = [(mode, rate_hz) for mode in callers for rate_hz in RATES[name]]
        for _, (mode, rate_hz) in rounds(turns, count, seed=1):
            with contextlib.ExitStack() as turn:
                tap = turn.enter_context(started("listen", options)) if mode == "tapped" else None
                order = msgspec.to_builtins(Order(rate_hz, seconds / count))
                found = callers[mode].ask(order, seconds + READY_S)
                taken.setdefault((mode, rate_hz), []).append(found.get("ours") or found["bare"])
                if mode == "untapped" and "bare" in found:
                    taken.setdefault(("bare", rate_hz), []).append(found["bare"])
                assert tap is None or tap.stop()[-1]["heard"], "the tap heard nothing"
    rows = []
    for rate_hz in RATES[name]:
        how = f"{NAMES[name]} at {rate_hz:g} ticks/s" if rate_hz else f"{NAMES[name]} saturated"
        most = MOST_TAPPED.get((name, rate_hz))
        for what, top, bottom, peer, limit in (
            (f"a tick on {how}, p50", "untapped", "bare", PEERS[name], MOST[name]),
            ("the same tapped", "tapped", "untapped", "untapped", most),
        ):
            ours, theirs = taken[top, rate_hz], taken[bottom, rate_hz]
            values = [distribution(part).p50.value for part in (ours, theirs)]
            rows.append(
                Row(what, values[0], "µs", peer, values[1], ratio(ours, theirs).value, most=limit)
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transport", choices=("zenoh", "ros2"), action="append")
    parser.add_argument("--seconds", type=float, default=5.0, help="of each mode and rate")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--role", choices=tuple(ROLES), help=argparse.SUPPRESS)
    parser.add_argument("--options", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    wanted = chosen.transport or ["zenoh", "ros2"]
    if chosen.role:
        ROLES[chosen.role](wanted[0], msgspec.json.decode(chosen.options))
        return
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    publish([row for name in wanted for row in measure(name, chosen.seconds, chosen.rounds)])


if __name__ == "__main__":
    main()
