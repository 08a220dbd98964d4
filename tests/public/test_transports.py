"""``transports.connect`` and ``transports.SimulatedWorld`` by themselves."""

from __future__ import annotations

import re

import pytest

import transports
from transports import SimulatedWorld, TransportError
from transports.simulated import SimulatedTransport


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


def test_each_simulated_connection_has_a_world_of_its_own() -> None:
    one = transports.connect("simulated", "node", {"seed": "1"})
    other = transports.connect("simulated", "node", {"seed": "2", "delay": "0.001..0.05"})
    assert isinstance(one, SimulatedTransport)
    assert isinstance(other, SimulatedTransport)
    assert (one.world.seed, other.world.seed) == (1, 2)
    assert other.world.conditions.delay_s == (0.001, 0.05)
    assert one.world.connect("second").world is one.world


@pytest.mark.parametrize(
    ("options", "refusal"),
    [
        ({"world": "w"}, "has no option 'world'; it has seed, delay, loss, duplication"),
        ({"seed": "one"}, "the simulated transport: invalid literal"),
        ({"loss": "2"}, "the simulated transport: loss is a probability, not 2"),
    ],
)
def test_a_wrong_option_of_the_simulated_transport_is_named(
    options: dict[str, str], refusal: str
) -> None:
    with pytest.raises(TransportError, match=re.escape(refusal)):
        transports.connect("simulated", "node", options)


def test_a_transport_that_is_not_there_is_named() -> None:
    with pytest.raises(TransportError, match="no transport `pigeon` is installed; installed: "):
        transports.connect("pigeon", "node", {})
