"""What the ROS 2 transport adds to a tick: beside rclpy itself, and with a tap that hears all of it.

Usage: ``python benchmarks/ros2.py [--seconds N] [--rounds N]``. Two processes on loopback, a
``std_srvs/SetBool`` service, the caller waits on a thread of its own while its node spins. *bare*: rclpy's
own service, client and SingleThreadedExecutor. *events*: the same with service introspection switched on,
as the transport has it. *untapped*: ``Client.call_and_wait`` to a served service of the transport. *tapped*:
the same with a tap in a third process. The runs take turns.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec
from row import publish, slower

from transports.interface import CallOutcome, Service

NAME = "/benchmark/tick"
MODES = ("bare", "events", "untapped", "tapped")
RATES = {"at 10 ticks/s": 0.1, "at 100 ticks/s": 0.01, "saturated": 0.0}
READY_S = 30.0
WARM_UP = 20
EVENTS = 4
"""Of a call: sent and received, twice."""


class Ask(msgspec.Struct):
    __type_name__ = "std_srvs/srv/SetBool_Request"
    data: bool = False


class Answer(msgspec.Struct):
    __type_name__ = "std_srvs/srv/SetBool_Response"
    success: bool = False
    message: str = ""


TICK = Service(NAME, "std_srvs/srv/SetBool", Ask, Answer)


def bare_node(name: str) -> tuple[Any, Callable[[], None]]:
    """A node whose executor spins on a thread, and what ends both."""
    import rclpy
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    rclpy.init()
    node = rclpy.create_node(name)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        try:
            executor.spin()
        except ExternalShutdownException:
            return

    thread = threading.Thread(target=spin)
    thread.start()

    def end() -> None:
        rclpy.shutdown()
        thread.join()

    return node, end


def introspect(node: Any, end: Any) -> None:
    from rclpy.qos import QoSProfile
    from rclpy.service_introspection import ServiceIntrospectionState

    end.configure_introspection(
        node.get_clock(), QoSProfile(depth=1000), ServiceIntrospectionState.CONTENTS
    )


def serve(mode: str, ready: Any, stop: Any) -> None:
    """The server's process."""
    if mode in ("bare", "events"):
        from std_srvs.srv import SetBool

        def answer(request: Any, response: Any) -> Any:
            response.success = request.data
            return response

        node, end = bare_node("server")
        service = node.create_service(SetBool, NAME, answer)
        if mode == "events":
            introspect(node, service)
        ready.set()
        stop.wait()
        end()
        return
    from transports.ros2 import connect

    transport = connect("server", {})
    transport.serve(TICK, lambda request: request.respond(Answer(request.data.data)))
    transport.announce()
    ready.set()
    threading.Thread(target=transport.spin).start()
    stop.wait()
    transport.close()


def listen(ready: Any, stop: Any, heard: Any) -> None:
    """The tap's process; ``stop`` comes with the number of calls that were made."""
    from transports.ros2 import connect

    transport = connect("listener", {})
    changed = threading.Condition()
    count = 0

    def observe(_: object) -> None:
        nonlocal count
        with changed:
            count += 1
            changed.notify()

    tap = transport.tap([NAME], observe)
    transport.announce()
    ready.set()
    threading.Thread(target=transport.spin).start()
    stop.wait()
    with changed:  # what is still on its way
        changed.wait_for(lambda: count >= EVENTS * heard.value, READY_S)
    missed = tap.problems()
    transport.close()
    print(
        f"the tap heard {count} of {EVENTS * heard.value} events; {'; '.join(missed) or 'all well'}"
    )
    heard.value = count


def caller(mode: str) -> tuple[Callable[[], None], Callable[[], None]]:
    """One call, and what ends the caller's node."""
    if mode in ("bare", "events"):
        from std_srvs.srv import SetBool

        node, end = bare_node("client")
        client = node.create_client(SetBool, NAME)
        if mode == "events":
            introspect(node, client)
        assert client.wait_for_service(READY_S)
        request = SetBool.Request(data=True)

        def call() -> None:
            assert client.call(request, READY_S).success

        return call, end
    from transports.ros2 import connect

    transport = connect("client", {})
    caller = transport.client(TICK)
    transport.announce()
    threading.Thread(target=transport.spin).start()
    names = ["server", "listener"] if mode == "tapped" else ["server"]
    assert not transport.wait_for_nodes(names, READY_S)

    def call_over_transport() -> None:
        result = caller.call_and_wait(Ask(True), READY_S)
        assert result.outcome is CallOutcome.RESPONSE, result

    return call_over_transport, transport.close


def measure(mode: str, period_s: float, seconds: float, results: Any) -> None:
    """The client's process: how long each call took, in µs."""
    call, end = caller(mode)
    for _ in range(WARM_UP):
        call()
    taken = []
    pause = threading.Event()
    begin = time.perf_counter()
    due = begin
    while due < begin + seconds:
        started = time.perf_counter()
        call()
        taken.append((time.perf_counter() - started) * 1e6)
        due = max(due + period_s, time.perf_counter()) if not period_s else due + period_s
        pause.wait(max(0.0, due - time.perf_counter()))
    end()
    results.put(taken)


def run(mode: str, period_s: float, seconds: float) -> list[float]:
    """One run in processes of its own."""
    spawn = multiprocessing.get_context("spawn")
    stop, heard = spawn.Event(), spawn.Value("i", 0)
    results = spawn.Queue()
    readies = [spawn.Event(), spawn.Event()]
    processes = [spawn.Process(target=serve, args=(mode, readies[0], stop))]
    if mode == "tapped":
        processes.append(spawn.Process(target=listen, args=(readies[1], stop, heard)))
    client = spawn.Process(target=measure, args=(mode, period_s, seconds, results))
    for process, ready in zip(processes, readies, strict=False):
        process.start()
        assert ready.wait(READY_S)
    client.start()
    taken: list[float] = results.get(timeout=seconds + 2 * READY_S)
    client.join(READY_S)
    heard.value = WARM_UP + len(taken)
    stop.set()
    for process in processes:
        process.join(READY_S)
    assert mode != "tapped" or heard.value, "the tap heard nothing"
    return taken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="length of one run")
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    print(f"{'':<20}" + "".join(f"{rate:>18}" for rate in RATES))
    medians: dict[tuple[str, str], float] = {}
    for rate, period_s in RATES.items():
        taken: dict[str, list[float]] = {mode: [] for mode in MODES}
        for _ in range(arguments.rounds):
            for mode in MODES:
                taken[mode] += run(mode, period_s, arguments.seconds)
        for mode in MODES:
            medians[mode, rate] = statistics.median(taken[mode])
    for mode in MODES:
        cells = "".join(f"{medians[mode, rate]:>15.0f} µs" for rate in RATES)
        print(f"{mode + ', p50':<20}{cells}")
    for top, bottom, target in (
        ("untapped", "bare", "≤ 1.50"),
        ("untapped", "events", ""),
        ("tapped", "untapped", "≤ 1.10 at 10/s"),
    ):
        ratios = "".join(f"{medians[top, rate] / medians[bottom, rate]:>18.2f}" for rate in RATES)
        print(f"{top + ' / ' + bottom:<20}{ratios}   {target}")
    publish(
        [
            slower(
                f"{what} {rate}, p50",
                medians[top, rate],
                "µs",
                peer,
                medians[bottom, rate],
                most if top == "untapped" or rate == "at 10 ticks/s" else None,
            )
            for rate in RATES
            for what, top, bottom, peer, most in (
                ("a tick", "untapped", "bare", "rclpy's service and client", 1.5),
                ("the same tapped", "tapped", "untapped", "untapped", 1.1),
            )
        ]
    )


if __name__ == "__main__":
    main()
