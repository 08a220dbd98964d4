"""What a tick costs: policy → skill → answer, between two processes over loopback, on Zenoh and on ROS 2.

In turns of one run, so that the machine's moods hit all of them alike:

* bare: without any code of ours: a Zenoh get answered by a queryable (channels, one reader each); rclpy's
  service, client and SingleThreadedExecutor, the caller waiting on a thread of its own as the policy does;
* untapped: ``Client.call_and_wait`` to a served service, typed request and response;
* tapped: the same, with a tap in a third process that hears all four events of each call.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections.abc import Callable, Iterator
from typing import Any, Literal

import msgspec

from benchmarks.page import Row, command
from benchmarks.processes import READY_S, Child, until_ended
from benchmarks.sampling import distribution, ratio, rounds
from benchmarks.ticking import (
    CLIENT,
    NAMES,
    SERVER,
    WHOLE,
    Answer,
    Ask,
    Middleware,
    Order,
    Stopwatch,
    answer_orders,
    at_rate,
    called,
    echo,
    listeners,
    middleware,
    ordered,
    serve,
    spun,
    why_no_echo,
)
from transports.registry import connect

BARE = "bare/tick"
PEERS = {"zenoh": "Zenoh's get and queryable", "ros2": "rclpy's service and client"}
MOST = {"zenoh": 1.6, "ros2": 1.5}
MOST_TAPPED = {("zenoh", 100.0): 1.15, ("ros2", 10.0): 1.1}
RATES = {"zenoh": (100.0, 0.0), "ros2": (10.0, 100.0, 0.0)}
"""Ticks a second; 0: the next one as soon as one has ended."""
SATURATED = 1000
"""Ticks that count as a second's, saturated."""


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


def serve_zenoh(options: dict[str, str]) -> None:
    from transports.zenoh.session import open_session

    answer = msgspec.msgpack.encode(Answer(True))
    with contextlib.closing(open_session(options)) as session:
        queryable = session.declare_queryable(BARE, complete=True)

        def reply() -> None:
            for query in queryable:
                query.reply(BARE, answer)
                query.drop()

        threading.Thread(target=reply, daemon=True).start()
        until_ended()


def call_zenoh(listening: dict[str, str], options: dict[str, str]) -> None:
    """Bare calls alternate with ours, in one process: caches are then as cold for both."""
    from transports.zenoh.session import open_session

    transport = connect("zenoh", CLIENT, listening)
    client = transport.client(echo(0))
    spun(transport, [SERVER])
    payload = msgspec.msgpack.encode(Ask(True))
    with contextlib.closing(transport), contextlib.closing(open_session(options)) as session:

        def bare(watch: Stopwatch) -> None:
            def get() -> Any:
                replies: list[Any] = []
                while not replies:  # none: the two have not met yet
                    replies = list(session.get(BARE, payload=payload, timeout=READY_S))
                return replies[0]

            watch.time(get, lambda got: "" if got.ok else "no answer", BARE)

        def ours(watch: Stopwatch) -> None:
            watch.time(lambda: client.call_and_wait(Ask(True)), lambda got: why_no_echo(got, 0))

        turns = itertools.cycle((bare, ours))
        answer_orders(lambda _, watch: next(turns)(watch))


def serve_ros2() -> None:
    from std_srvs.srv import SetBool

    def respond(request: Any, response: Any) -> Any:
        response.success = request.data
        return response

    with rclpy_node("bare_server") as node:
        node.create_service(SetBool, "/benchmark/bare", respond)
        until_ended()


def call_ros2() -> None:
    from std_srvs.srv import SetBool

    with rclpy_node("bare_client") as node:
        client = node.create_client(SetBool, "/benchmark/bare")
        assert client.wait_for_service(READY_S)
        answer_orders(
            lambda _, watch: watch.time(
                lambda: client.call(SetBool.Request(data=True), READY_S),
                lambda got: "" if got.success else "no answer",
                BARE,
            )
        )


def started(stack: contextlib.ExitStack, transport: str) -> tuple[Middleware, dict[str, Child]]:
    """Where they meet, and who calls in which mode; all of them run until the end of ``stack``."""
    where = stack.enter_context(middleware(transport))

    def child(role: Callable[..., None], *arguments: object) -> Child:
        variables = where.environment
        return stack.enter_context(Child.calling("bare", role, *arguments, environment=variables))

    if transport == "zenoh":
        caller = child(call_zenoh, where.options("listen"), where.options())
        child(serve, transport, where.options(), [0]).answer()
        child(serve_zenoh, where.options()).answer()
        caller.answer()
        return where, {"untapped": caller, "tapped": caller}
    ours = called(stack, where, [0])
    child(serve_ros2).answer()
    bare = child(call_ros2)
    bare.answer()
    return where, {BARE: bare, "untapped": ours, "tapped": ours}


def measure(transport: str, seconds: float, count: int) -> list[Row]:
    """Rows of one transport; ``seconds`` of each mode and rate, in ``count`` rounds."""
    taken: dict[tuple[str, float], list[list[float]]] = {}
    with contextlib.ExitStack() as stack:
        where, callers = started(stack, transport)
        turns = [(mode, rate_hz) for mode in callers for rate_hz in RATES[transport]]
        alternating = 1 if BARE in callers else 2
        for _, (mode, rate_hz) in rounds(turns, count, seed=1):
            with contextlib.ExitStack() as turn:
                taps = listeners(turn, where, [SERVER, CLIENT], int(mode == "tapped"))
                ticks = max(round((rate_hz or SATURATED) * seconds / count), 2)
                order = Order(ticks * alternating, rate_hz * alternating, warm_up=20)
                found = ordered(callers[mode], order)
                assert not found.reasons, found.reasons
                taken.setdefault((mode, rate_hz), []).append(
                    found.micros[BARE if mode == BARE else WHOLE]
                )
                if mode == "untapped" and BARE in found.micros:
                    taken.setdefault((BARE, rate_hz), []).append(found.micros[BARE])
                assert all(tap.ask({})["heard"] for tap in taps), "the tap heard nothing"
    rows = []
    for rate_hz in RATES[transport]:
        how = f"{NAMES[transport]}{' at' if rate_hz else ''} {at_rate(rate_hz)}"
        most = MOST_TAPPED.get((transport, rate_hz))
        for what, top, bottom, peer, limit in (
            (f"a tick on {how}, p50", "untapped", BARE, PEERS[transport], MOST[transport]),
            ("the same tapped", "tapped", "untapped", "untapped", most),
        ):
            own, theirs = taken[top, rate_hz], taken[bottom, rate_hz]
            p50, peers = (distribution(part).p50.value for part in (own, theirs))
            rows.append(Row(what, p50, "µs", peer, peers, ratio(own, theirs).value, most=limit))
    return rows


def rows(
    transport: Literal["both", "zenoh", "ros2"] = "both", seconds: float = 5.0, rounds: int = 5
) -> list[Row]:
    """What is shown; ``seconds`` of each mode and rate."""
    wanted = PEERS if transport == "both" else (transport,)
    return [row for name in wanted for row in measure(name, seconds, rounds)]


if __name__ == "__main__":
    command(rows)
