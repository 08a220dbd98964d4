"""Every transport of this repository against the conformance suite."""

from __future__ import annotations

import socket
from collections.abc import Sequence

import pytest

from tests.transports.networks import SimulatedNetwork, nodes_beside
from transports.conformance import CHECKS, CHECKS_OF_ENDS, Check
from transports.interface import Connection
from transports.networks import ThreadedNetwork
from transports.simulated import Conditions
from transports.zenoh import connect

BAD_WEATHER = Conditions(
    delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.02), busy_s=(0.0, 0.0005), loss=0.3
)
"""Reliable channels stay complete and ordered in it."""

every_check = pytest.mark.parametrize(
    "check", CHECKS + CHECKS_OF_ENDS, ids=lambda check: check.__name__
)


@pytest.mark.zenoh
@every_check
def test_zenoh(check: Check) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"

    def join(name: str, others: Sequence[Connection]) -> Connection:
        return connect(name, {"endpoint" if others else "listen": endpoint})

    network = ThreadedNetwork(join)
    try:
        check(network)
    finally:
        network.close()


@pytest.mark.zenoh
@every_check
def test_zenoh_on_one_session(check: Check) -> None:
    with nodes_beside(connect("owner", {})) as network:
        check(network)


@every_check
@pytest.mark.parametrize("conditions", [None, BAD_WEATHER], ids=["fair", "bad weather"])
@pytest.mark.parametrize("seed", range(3))
def test_simulated(check: Check, conditions: Conditions | None, seed: int) -> None:
    network = SimulatedNetwork(seed, conditions)
    try:
        check(network)
    finally:
        network.close()
