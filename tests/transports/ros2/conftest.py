"""Fixtures of the tests on ROS 2: a domain of one's own, our nodes, one of rclpy's."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.transports import ros2_network
from tests.transports.ros2.bare import Bare
from tests.transports.shared_memory import left_over, segments
from transports.networks import ThreadedNetwork


@pytest.fixture(scope="module", autouse=True)
def domain() -> Iterator[int]:
    ros2_network.load(ros2_network.built())
    with ros2_network.own_domain() as number:
        before = segments()
        yield number
        assert not left_over(before)


@pytest.fixture
def network() -> Iterator[ThreadedNetwork]:
    made = ros2_network.network()
    yield made
    made.close()


@pytest.fixture
def bare() -> Iterator[Bare]:
    made = Bare("bare")
    yield made
    made.close()


@pytest.fixture(params=["told", "wait set"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> type:
    """The test runs twice: rcl tells our nodes of arrivals, and wait sets do. The class that is used."""
    from transports.ros2.arrivals import Arrivals
    from transports.ros2.executor import WAIT_SET
    from transports.ros2.wait_set import WaitSetArrivals

    if request.param == "told":
        monkeypatch.delenv(WAIT_SET, raising=False)
        return Arrivals
    monkeypatch.setenv(WAIT_SET, "1")
    return WaitSetArrivals
