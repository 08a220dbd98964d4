"""Services between the ROS 2 transport and ordinary rclpy nodes."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest

from tests.transports.ros2.bare import Bare
from transports.conformance import (
    DOUBLE,
    Answer,
    Ask,
    a_call_that_nobody_serves_is_stamped_when_it_was_made,
    on,
)
from transports.interface import (
    CallOutcome,
    CallResult,
)
from transports.networks import PATIENCE_S, ThreadedNetwork
from transports.ros2 import services

pytestmark = pytest.mark.ros2


def test_an_ordinary_client_gets_a_deferred_answer(network: ThreadedNetwork, bare: Bare) -> None:
    from conformance.srv import Double

    server = network.node("server")
    names: list[str] = []

    def answer(request: Any) -> None:
        names.append(request.client)
        request.respond(Answer(2 * request.data.value))

    def answer_later(request: Any) -> None:
        server.after(0.1, lambda: answer(request))

    on(network, server, lambda: server.serve(DOUBLE, answer_later))
    client = bare.node.create_client(Double, DOUBLE.name)
    assert client.wait_for_service(PATIENCE_S)
    asks = partial(
        server.ros_node.get_publishers_info_by_topic, f"rq{DOUBLE.name}Request", no_mangle=True
    )
    assert network.until(lambda: [info.node_name for info in asks()] == ["bare"])
    futures = [client.call_async(Double.Request(value=value)) for value in range(5)]
    assert network.until(lambda: all(future.done() for future in futures))
    assert [future.result().value for future in futures] == [0, 2, 4, 6, 8]
    assert names == ["bare"] * 5


def test_an_ordinary_server_answers(network: ThreadedNetwork, bare: Bare) -> None:
    from conformance.srv import Double

    def double(request: Any, response: Any) -> Any:
        response.value = 2 * request.value
        return response

    bare.node.create_service(Double, DOUBLE.name, double)
    node = network.node("client")
    client = on(network, node, lambda: node.client(DOUBLE))
    assert network.until(client.declared.service_is_ready)
    result = network.caller(lambda: client.call_and_wait(Ask(21), PATIENCE_S))()
    assert result == CallResult(CallOutcome.RESPONSE, Answer(42))


def test_a_node_looks_for_servers_from_its_first_call_on(
    network: ThreadedNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However old it is: a node may find a server seconds after others have, as DDS announces again."""
    node = network.node("client")
    with monkeypatch.context() as old:
        old.setattr(services, "LOOK_S", 0.0)
        client = on(network, node, lambda: node.client(DOUBLE))
    waiting = network.caller(lambda: client.call_and_wait(Ask(21), 10 * PATIENCE_S))
    server = network.node("server")
    on(
        network,
        server,
        lambda: server.serve(DOUBLE, lambda r: r.respond(Answer(2 * r.data.value))),
    )
    assert waiting() == CallResult(CallOutcome.RESPONSE, Answer(42))


def test_a_call_that_is_given_up_at_once_is_stamped_when_it_was_made(
    network: ThreadedNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(services, "LOOK_S", 0.0)
    a_call_that_nobody_serves_is_stamped_when_it_was_made(network)


def test_a_call_whose_server_goes_away_ends_as_unavailable(network: ThreadedNetwork) -> None:
    server, node = network.node("server"), network.node("client")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    client = on(network, node, lambda: node.client(DOUBLE))
    assert network.until(client.declared.service_is_ready)
    waiting = network.caller(lambda: client.call_and_wait(Ask(1), 10 * PATIENCE_S))
    assert network.until(lambda: bool(kept))
    server.close()
    assert waiting().outcome is CallOutcome.UNAVAILABLE
