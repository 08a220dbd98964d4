"""``transports.connect`` and ``transports.SimulatedWorld`` by themselves."""

from __future__ import annotations

import pytest

import transports
from transports import SimulatedWorld, TransportError


def test_the_installed_transports_are_named() -> None:
    assert {"ros2", "simulated", "zenoh"} <= set(transports.available())


def test_a_world_connects_nodes_each_once() -> None:
    world = SimulatedWorld(seed=1)
    first, second = world.connect("first"), world.connect("second")
    assert (first.node, second.node) == ("first", "second")
    assert first.now_ns() == second.now_ns()
    with pytest.raises(TransportError, match="first"):
        world.connect("first")
    world.close()


def test_nodes_of_two_worlds_do_not_meet() -> None:
    one, other = SimulatedWorld(), SimulatedWorld()
    one.connect("node")
    other.connect("node")
    one.run_for(1.0)
    assert one.now_ns - other.now_ns == 10**9


def test_a_transport_that_is_not_there_is_named() -> None:
    with pytest.raises(TransportError, match="no transport `pigeon` is installed; installed: "):
        transports.connect("pigeon", "node", {})
