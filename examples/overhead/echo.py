"""A service whose answer is as large as asked for, and who calls it: what the size of messages does.

``python -m examples.overhead.echo serve`` and ``call``; a ``std_srvs/SetBool`` whose answer has a text.
"""

from __future__ import annotations

import argparse
import signal
import sys
import threading
import time
from collections.abc import Sequence

import msgspec

from examples.overhead.load import ROOT, Stopwatch, Taken
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


class EchoOrder(msgspec.Struct, frozen=True):
    """Calls to be made; each is answered with a text of ``size`` bytes."""

    ticks: int
    rate_hz: float
    warm_up: int
    size: int


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
        print('{"ready": true}', flush=True)
        for line in sys.stdin:
            order = msgspec.json.decode(line, type=EchoOrder)
            client = clients[order.size]
            watch, warm_up = Stopwatch(), Stopwatch()
            pace = threading.Event()
            due = began = time.perf_counter()
            processor = time.process_time()
            for number in range(-order.warm_up, order.ticks):
                if number == 0:
                    began, processor = time.perf_counter(), time.process_time()
                called = time.perf_counter_ns()
                result = client.call_and_wait(Ask(True))
                micros = (time.perf_counter_ns() - called) / 1e3
                (watch if number >= 0 else warm_up).note(ROOT, micros, why(result, order.size))
                if order.rate_hz:
                    due = max(due + 1 / order.rate_hz, time.perf_counter())
                    pace.wait(due - time.perf_counter())
            taken = Taken(
                watch.micros,
                watch.failures,
                [*warm_up.reasons, *watch.reasons],
                warm_up.failures.get(ROOT, 0),
                time.perf_counter() - began,
                time.process_time() - processor,
            )
            print(msgspec.json.encode(taken).decode(), flush=True)
    finally:
        transport.close()
    return 0


def why(result: CallResult, size: int) -> str:
    """Why a call counts as failed; "" if it does not."""
    if result.outcome is not CallOutcome.RESPONSE:
        return f"{result.outcome}: {result.error}"
    got = len(result.response.message)
    return "" if got == size else f"{got} bytes instead of {size}"


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
