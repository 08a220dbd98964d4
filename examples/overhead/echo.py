"""A service whose answer is as large as asked for, and who calls it: what the size of messages does.

``python -m examples.overhead.echo serve`` and ``call``; a ``std_srvs/SetBool`` whose answer has a text.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import threading
import time
from collections.abc import Sequence

import msgspec

from benchmarks.processes import Child
from examples.overhead.load import ROOT, Order, Stopwatch, Taken, answer_orders, carried_out
from examples.overhead.plant import Middleware
from transports.interface import CallOutcome, CallResult, Request, Service
from transports.registry import connect

SERVER, CLIENT = "echo_server", "echo_client"
READY_S = 60.0


class Ask(msgspec.Struct):
    """``std_srvs/srv/SetBool_Request``."""

    __type_name__ = "std_srvs/srv/SetBool_Request"
    data: bool = False


class Answer(msgspec.Struct):
    """``std_srvs/srv/SetBool_Response``."""

    __type_name__ = "std_srvs/srv/SetBool_Response"
    success: bool = False
    message: str = ""


ECHO = "/echo"


def service(size: int) -> Service:
    """The one whose answers have ``size`` bytes."""
    return Service(f"{ECHO}{size}", "std_srvs/srv/SetBool", Ask, Answer)


def serve(transport_name: str, options: dict[str, str], sizes: Sequence[int]) -> None:
    """Answer until SIGTERM."""
    transport = connect(transport_name, SERVER, options)
    signal.signal(signal.SIGTERM, lambda *_: transport.post(transport.close))

    def answering(size: int) -> None:
        answer = Answer(True, "x" * size)

        def handle(request: Request) -> None:
            request.respond(answer)

        transport.serve(service(size), handle)

    for size in sizes:
        answering(size)
    transport.announce()
    print('{"ready": true}', flush=True)
    transport.spin()
    transport.close()


def call(transport_name: str, options: dict[str, str], sizes: Sequence[int]) -> int:
    """Call as told until standard input ends."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    transport = connect(transport_name, CLIENT, options)
    threading.Thread(target=transport.spin, daemon=True).start()
    try:
        clients = {size: transport.client(service(size)) for size in sizes}
        transport.announce()
        if transport.wait_for_nodes([SERVER], READY_S):
            print("the server is not up", file=sys.stderr)
            return 2

        def carry_out(order: Order) -> Taken:
            def tick(watch: Stopwatch) -> None:
                called = time.perf_counter_ns()
                result = clients[order.size].call_and_wait(Ask(True))
                watch.note(ROOT, (time.perf_counter_ns() - called) / 1e3, why(result, order.size))

            return carried_out(order, tick)

        answer_orders(carry_out)
    finally:
        transport.close()
    return 0


def why(result: CallResult, size: int) -> str:
    """Why a call counts as failed; "" if it does not."""
    if result.outcome is not CallOutcome.RESPONSE:
        return f"{result.outcome}: {result.error}"
    got = len(result.response.message)
    return "" if got == size else f"{got} bytes instead of {size}"


def start(stack: contextlib.ExitStack, where: Middleware, sizes: Sequence[int]) -> Child:
    """A running server, until the end of ``stack``, and who calls it."""
    command = ["-m", "examples.overhead.echo"]
    words = [word for size in sizes for word in ("--size", str(size))]
    listen = ["--listen", where.endpoint] if where.endpoint else []
    arguments = [*command, "call", "--transport", where.transport, *listen, *words]
    caller = stack.enter_context(Child("the caller", arguments, where.environment))
    arguments = [*command, "serve", *where.arguments(), *words]
    stack.enter_context(Child("the server", arguments, where.environment)).answer()
    caller.answer()
    return caller


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="A service with answers of several sizes.")
    parser.add_argument("command", choices=("serve", "call"))
    parser.add_argument("--transport", default="zenoh")
    parser.add_argument("--endpoint", default="")
    parser.add_argument("--listen", default="")
    parser.add_argument("--size", type=int, action="append", required=True)
    chosen = parser.parse_args(arguments)
    options = {
        name: value
        for name, value in (("endpoint", chosen.endpoint), ("listen", chosen.listen))
        if value
    }
    if chosen.command == "serve":
        serve(chosen.transport, options, chosen.size)
        return 0
    return call(chosen.transport, options, chosen.size)


if __name__ == "__main__":
    sys.exit(main())
