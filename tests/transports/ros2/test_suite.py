"""The ROS 2 transport against the conformance suite, with real Fast DDS on loopback."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.transports.networks import nodes_beside
from transports.conformance import CHECKS, CHECKS_OF_ENDS, Check
from transports.interface import Connection
from transports.networks import ThreadedNetwork

pytestmark = pytest.mark.ros2


@pytest.mark.timeout(300)
@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("check", CHECKS + CHECKS_OF_ENDS, ids=lambda check: check.__name__)
def test_ros2(check: Check, network: ThreadedNetwork) -> None:
    check(network)


@pytest.mark.timeout(300)
@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("check", CHECKS + CHECKS_OF_ENDS, ids=lambda check: check.__name__)
def test_ros2_in_one_context(check: Check) -> None:
    from transports.ros2 import connect

    owner = connect("owner", {})

    def join(name: str) -> Connection:
        is_beside = name != "misled"  # it has a topic as another type; DDS allows a participant one
        return owner.beside(name) if is_beside else connect(name, {})

    with nodes_beside(owner, join) as network:
        check(network)


def test_without_rclpy_the_transport_says_what_to_install() -> None:
    code = (
        "import sys\n"
        "sys.modules['rclpy'] = None\n"
        "from transports.registry import connect\n"
        "from transports.interface import TransportError\n"
        "try:\n"
        "    connect('ros2', 'node', {})\n"
        "except TransportError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert "the transport `ros2`" in done.stdout
    assert "pip install 'm2c-moon[ros2]'" in done.stdout
    assert "/opt/ros/jazzy/setup.bash" in done.stdout
