"""What a tick costs: policy → skill → answer, between two processes over loopback, on Zenoh and on ROS 2.

In turns of one run, so that the machine's moods hit all of them alike:

* bare: without any code of ours: a Zenoh get answered by a queryable (channels, one reader each); rclpy's
  service, client and SingleThreadedExecutor, the caller waiting on a thread of its own as the policy does;
* untapped: ``Client.call_and_wait`` to a served service, typed request and response;
* tapped: the same, with a tap in a third process that hears all four events of each call.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import threading
from collections.abc import Callable, Iterator
from typing import Any, Literal

import msgspec

from benchmarks.page import Row, beside, command
from benchmarks.processes import READY_S, Child, say, spin_until_ended, until_ended
from benchmarks.sampling import measured
from benchmarks.ticking import (
    NAMES,
    WHOLE,
    Middleware,
    Order,
    Stopwatch,
    answer_orders,
    at_rate,
    middleware,
    ordered,
    spun,
)
from transports.interface import CallOutcome, CallResult, Observation, Request, Service
from transports.registry import connect

SERVER, CLIENT = "echo_server", "echo_client"
BARE = "bare/tick"
PEERS = {"zenoh": "Zenoh's get and queryable", "ros2": "rclpy's service and client"}
MOST = {"zenoh": 1.6, "ros2": 1.5}
MOST_TAPPED = {("zenoh", 100.0): 1.15, ("ros2", 10.0): 1.1}
RATES = {"zenoh": (100.0, 0.0), "ros2": (10.0, 100.0, 0.0)}
"""Ticks a second; 0: the next one as soon as one has ended."""
SATURATED = 1000
"""Ticks that count as a second's, saturated."""


# -- ours: a service, who calls it, and a tap, each a process ---------------------------------------


class Ask(msgspec.Struct):
    """``std_srvs/srv/SetBool_Request``."""

    __type_name__ = "std_srvs/srv/SetBool_Request"
    data: bool = False


class Answer(msgspec.Struct):
    """``std_srvs/srv/SetBool_Response``."""

    __type_name__ = "std_srvs/srv/SetBool_Response"
    success: bool = False
    message: str = ""


ECHO = Service("/echo", "std_srvs/srv/SetBool", Ask, Answer)


def serve(transport_name: str, options: dict[str, str]) -> None:
    """Answer until SIGTERM."""
    transport = connect(transport_name, SERVER, options)

    def respond(request: Request) -> None:
        request.respond(Answer(True))

    transport.serve(ECHO, respond)
    transport.announce()
    say({"ready": True})
    spin_until_ended(transport)


def call(transport_name: str, options: dict[str, str]) -> None:
    """Call as told until standard input ends."""
    transport = connect(transport_name, CLIENT, options)
    client = transport.client(ECHO)
    spun(transport, [SERVER])
    with contextlib.closing(transport):
        answer_orders(lambda watch: watch.time(lambda: client.call_and_wait(Ask(True)), why_failed))


def why_failed(result: CallResult) -> str:
    """Why a call counts as failed; "" if it does not."""
    return "" if result.outcome is CallOutcome.RESPONSE else f"{result.outcome}: {result.error}"


def listen(transport_name: str, options: dict[str, str]) -> None:
    """Tap everything, and count: each line on standard input is answered with what was heard so far.

    Says that it is ready once it is linked to both.
    """
    transport = connect(transport_name, "listener", options)
    heard = itertools.count()
    waiting = [{"ready": True}]

    def hear(_: Observation) -> None:
        next(heard)

    tap = transport.tap([], hear)

    def look() -> None:
        if waiting and {SERVER, CLIENT} <= set(tap.peers()):
            say(waiting.pop())

    transport.every(0.05, look)
    spin_until_ended(transport, lambda: say({"heard": next(heard)}))


# -- bare -------------------------------------------------------------------------------------------


def serve_zenoh(options: dict[str, str]) -> None:
    from transports.zenoh_link.session import open_session

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
    from transports.zenoh_link.session import open_session

    transport = connect("zenoh", CLIENT, listening)
    client = transport.client(ECHO)
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
            watch.time(lambda: client.call_and_wait(Ask(True)), why_failed)

        turns = itertools.cycle((bare, ours))

        def tick(watch: Stopwatch) -> None:
            next(turns)(watch)

        answer_orders(tick)


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
            lambda watch: watch.time(
                lambda: client.call(SetBool.Request(data=True), READY_S),
                lambda got: "" if got.success else "no answer",
                BARE,
            )
        )


# -- in turns ---------------------------------------------------------------------------------------


def started(
    stack: contextlib.ExitStack, where: Middleware, role: Callable[..., None], *arguments: object
) -> Child:
    """A process that plays ``role`` until the end of ``stack``."""
    name = role.__name__.replace("_", " ")
    return stack.enter_context(Child.calling(name, role, *arguments, environment=where.environment))


def callers(stack: contextlib.ExitStack, where: Middleware) -> dict[str, Child]:
    """Who calls, bare and ours; they and the servers run until the end of ``stack``."""
    transport, options = where.transport, where.options()
    if transport == "zenoh":
        both = started(stack, where, call_zenoh, where.options("listen"), options)
        started(stack, where, serve, transport, options).answer()
        started(stack, where, serve_zenoh, options).answer()
        both.answer()
        return {"untapped": both, "tapped": both}
    ours = started(stack, where, call, transport, options)
    started(stack, where, serve, transport, options).answer()
    started(stack, where, serve_ros2).answer()
    bare = started(stack, where, call_ros2)
    ours.answer()
    bare.answer()
    return {BARE: bare, "untapped": ours, "tapped": ours}


def measure(transport: str, seconds: float, count: int) -> list[Row]:
    """Rows of one transport; ``seconds`` of each mode and rate, in ``count`` rounds."""
    with contextlib.ExitStack() as stack:
        where = stack.enter_context(middleware(transport))
        asked = callers(stack, where)
        alternating = 1 if BARE in asked else 2

        def turn(mode: str, rate_hz: float) -> dict[str, list[float]]:
            with contextlib.ExitStack() as own:
                taps = []
                if mode == "tapped":
                    taps.append(started(own, where, listen, transport, where.options()))
                    taps[0].answer()
                ticks = max(round((rate_hz or SATURATED) * seconds / count), 2)
                order = Order(ticks * alternating, rate_hz * alternating, warm_up=20)
                found = ordered(asked[mode], order)
                assert not found.reasons, found.reasons
                assert all(tap.ask({})["heard"] for tap in taps), "the tap heard nothing"
                return found.micros

        rates = RATES[transport]
        turns = {(m, rate): functools.partial(turn, m, rate) for m in asked for rate in rates}
        taken = measured(turns, count)
    rows = []
    for rate_hz in rates:
        untapped, tapped = (
            [micros[WHOLE] for micros in taken[mode, rate_hz]] for mode in ("untapped", "tapped")
        )
        bare = [micros[BARE] for micros in taken[next(iter(asked)), rate_hz]]
        what = f"a tick on {NAMES[transport]}{' at' if rate_hz else ''} {at_rate(rate_hz)}, p50"
        rows.append(beside(what, "µs", untapped, PEERS[transport], bare, most=MOST[transport]))
        most = MOST_TAPPED.get((transport, rate_hz))
        rows.append(beside("the same tapped", "µs", tapped, "untapped", untapped, most=most))
    return rows


def rows(
    transport: Literal["both", "zenoh", "ros2"] = "both", seconds: float = 5.0, rounds: int = 5
) -> list[Row]:
    """What is shown; ``seconds`` of each mode and rate."""
    wanted = PEERS if transport == "both" else (transport,)
    return [row for name in wanted for row in measure(name, seconds, rounds)]


if __name__ == "__main__":
    command(rows)
