"""The clock of a simulation, and namespaces, on ROS 2."""

from __future__ import annotations

from typing import Any

import pytest

from tests.transports.ros2.bare import Bare
from transports.conformance import (
    DOUBLE,
    NUMBERS,
    Ask,
    Number,
    on,
    ready,
)
from transports.interface import (
    CallResult,
    Observation,
)
from transports.networks import ThreadedNetwork, spinning

pytestmark = pytest.mark.ros2


def test_a_namespace_keeps_systems_apart(network: ThreadedNetwork) -> None:
    from transports.ros2 import connect

    inside = [connect(name, {"namespace": "cell"}) for name in ("one", "two")]
    outside = network.node("outside")
    with spinning(*inside):
        heard: list[int] = []
        taps: list[Observation] = []
        foreign: list[Any] = []
        on(
            network,
            inside[1],
            lambda: inside[1].subscribe(NUMBERS, lambda m: heard.append(m.value)),
        )
        on(network, inside[1], lambda: inside[1].tap([NUMBERS.name], taps.append))
        on(network, outside, lambda: outside.subscribe(NUMBERS, foreign.append))
        publisher = on(network, inside[0], lambda: inside[0].publisher(NUMBERS))
        ready(network, *inside)
        on(network, inside[0], lambda: publisher.publish(Number(5)))
        assert network.until(lambda: bool(heard) and bool(taps))
        assert heard == [5]
        assert taps[0].channel == NUMBERS.name
        assert not foreign


def test_timers_follow_a_simulation_and_calls_do_not(network: ThreadedNetwork, bare: Bare) -> None:
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    from transports.ros2 import connect

    clock = bare.node.create_publisher(Clock, "/clock", 10)
    node = connect("simulated", {"use_sim_time": "true"})
    with spinning(node):
        assert network.until(lambda: clock.get_subscription_count() == 1)

        def tell(seconds: float) -> None:
            def told() -> bool:
                clock.publish(Clock(clock=Time(sec=int(seconds))))  # best effort: it may be lost
                return node.now_ns() == int(seconds) * 10**9

            assert network.until(told)

        tell(1000.0)
        fired: list[float] = []
        on(network, node, lambda: node.after(10.0, lambda: fired.append(node.now_ns() / 1e9)))
        on(network, node, lambda: node.every(4.0, lambda: fired.append(-node.now_ns() / 1e9)))
        tell(1003.0)
        on(network, node, lambda: None)
        assert fired == []
        tell(1004.0)
        assert network.until(lambda: fired == [-1004.0])
        tell(1010.0)
        assert network.until(lambda: sorted(fired) == [-1010.0, -1004.0, 1010.0])
        # The simulation stands still; a call that nobody answers ends all the same.
        results: list[CallResult] = []
        client = on(network, node, lambda: node.client(DOUBLE))
        on(network, node, lambda: client.call(Ask(1), results.append, 0.1))
        assert network.until(lambda: bool(results))
