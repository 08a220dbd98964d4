"""What cannot work on ROS 2 is said, in one clear message each."""

from __future__ import annotations

import logging
from typing import Any

import pytest

from tests.transports.ros2.bare import Bare
from transports.conformance import (
    DOUBLE,
    NUMBERS,
    TRANSIENT_LOCAL,
    Answer,
    Ask,
    Number,
    Text,
    on,
)
from transports.interface import (
    CallOutcome,
    CallResult,
    Reliability,
    Topic,
    TransportError,
)
from transports.networks import PATIENCE_S, ThreadedNetwork

pytestmark = pytest.mark.ros2


def says(network: ThreadedNetwork, caplog: pytest.LogCaptureFixture, *parts: str) -> bool:
    return network.until(
        lambda: any(all(part in record.getMessage() for part in parts) for record in caplog.records)
    )


@pytest.fixture
def reports(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.WARNING, "transports.ros2")
    return caplog


def test_qos_that_does_not_match_is_reported(
    network: ThreadedNetwork, bare: Bare, reports: pytest.LogCaptureFixture
) -> None:
    from conformance.msg import Number as RosNumber
    from rclpy.qos import qos_profile_sensor_data

    bare.node.create_publisher(RosNumber, NUMBERS.name, qos_profile_sensor_data)
    bare.node.create_publisher(RosNumber, TRANSIENT_LOCAL.name, 10)
    node = network.node("node")
    on(network, node, lambda: node.subscribe(NUMBERS, lambda message: None))
    on(network, node, lambda: node.subscribe(TRANSIENT_LOCAL, lambda message: None))
    assert says(
        network,
        reports,
        f"{NUMBERS.name}: node cannot receive from bare",
        "reliable reliability is asked for, best effort is offered",
    )
    assert says(
        network,
        reports,
        f"{TRANSIENT_LOCAL.name}: node cannot receive from bare",
        "transient local durability is asked for, volatile is offered",
    )


def test_a_best_effort_topic_hears_a_best_effort_publisher(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from conformance.msg import Number as RosNumber
    from rclpy.qos import qos_profile_sensor_data

    publisher = bare.node.create_publisher(RosNumber, NUMBERS.name, qos_profile_sensor_data)
    node = network.node("node")
    topic = Topic(NUMBERS.name, Number.__type_name__, Number, Reliability.BEST_EFFORT)
    heard: list[Number] = []
    on(network, node, lambda: node.subscribe(topic, heard.append))

    def reached() -> bool:
        publisher.publish(RosNumber(value=3, text="x"))
        return bool(heard)

    assert network.until(reached)
    assert heard[0] == Number(3, "x")


def test_another_type_in_the_graph_is_reported(
    network: ThreadedNetwork, bare: Bare, reports: pytest.LogCaptureFixture
) -> None:
    from conformance.msg import Text as RosText
    from std_srvs.srv import Trigger

    bare.node.create_publisher(RosText, NUMBERS.name, 10)
    bare.node.create_service(Trigger, DOUBLE.name, lambda request, response: response)
    node = network.node("node")
    on(network, node, lambda: node.subscribe(NUMBERS, lambda message: None))
    on(network, node, lambda: node.client(DOUBLE))
    assert says(
        network,
        reports,
        f"{NUMBERS.name}: this node has it as conformance/msg/Number, but it is published by bare "
        "as conformance/msg/Text",
    )
    assert says(
        network,
        reports,
        f"{DOUBLE.name}: this node calls it as conformance/srv/Double, but it is served as "
        "std_srvs/srv/Trigger",
    )


def test_two_servers_are_reported(
    network: ThreadedNetwork, reports: pytest.LogCaptureFixture
) -> None:
    nodes = [network.node(name) for name in ("first", "second")]
    for node in nodes:
        on(network, node, lambda node=node: node.serve(DOUBLE, lambda request: None))
    assert says(network, reports, f"two nodes serve {DOUBLE.name}: first and second")


def test_two_nodes_of_one_name_are_reported(
    network: ThreadedNetwork, reports: pytest.LogCaptureFixture
) -> None:
    for _ in range(2):
        node = network.node("twin")
        on(network, node, node.announce)
    assert says(network, reports, "two nodes are named twin")


def test_one_topic_has_one_type_in_a_node(network: ThreadedNetwork) -> None:
    node = network.node("node")
    on(network, node, lambda: node.subscribe(NUMBERS, lambda message: None))
    other = Topic(NUMBERS.name, Text.__type_name__, Text)
    with pytest.raises(TransportError, match="one type per topic in a node"):
        on(network, node, lambda: node.publisher(other))


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("node", {"endpoint": "tcp/127.0.0.1:1"}, "has no option 'endpoint'; it has domain"),
        ("node", {"domain": "233"}, "domain '233': expected a number from 0 to 232"),
        ("node", {"domain": "x"}, "domain 'x'"),
        ("node", {"use_sim_time": "yes"}, "use_sim_time 'yes': expected true or false"),
        ("node", {"namespace": "a b"}, "ROS 2 does not take the name /a b/node"),
        ("no-de", {}, "ROS 2 does not take the name /no-de"),
        ("node", {"args": "-p 'x"}, "No closing quotation"),
        ("node", {"args": "--nonsense"}, "cannot start a ROS 2 node"),
        ("", {}, "a node needs a name"),
    ],
    ids=str,
)
def test_a_bad_option_or_name_is_one_clear_error(
    name: str, options: dict[str, str], said: str
) -> None:
    from transports.ros2 import connect

    with pytest.raises(TransportError) as refused:
        connect(name, options)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_closed_node_says_so(network: ThreadedNetwork) -> None:
    server, node = network.node("server"), network.node("node")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    client = on(network, node, lambda: node.client(DOUBLE))
    publisher = on(network, node, lambda: node.publisher(NUMBERS))
    assert network.until(client.declared.service_is_ready)
    results: list[CallResult] = []
    on(network, node, lambda: [client.call(Ask(n), results.append) for n in range(2)])
    assert network.until(lambda: len(kept) == 2)
    server.close()
    node.close()
    for late in (
        lambda: kept[0].respond(Answer(1)),
        lambda: kept[1].fail("too late"),
        lambda: publisher.publish(Number(1)),
        lambda: client.call(Ask(1), results.append),
        lambda: node.publisher(TRANSIENT_LOCAL),
        lambda: node.subscribe(TRANSIENT_LOCAL, lambda message: None),
        lambda: node.serve(DOUBLE, kept.append),
        lambda: node.client(DOUBLE),
        lambda: node.tap([], lambda observation: None),
        node.announce,
    ):
        with pytest.raises(TransportError):
            late()
    assert client.call_and_wait(Ask(1)).outcome is CallOutcome.UNAVAILABLE
    assert node.wait_for_nodes(["server"], PATIENCE_S) == ["server"]
    node.spin()
    node.post(lambda: None)
    assert node.node == "node"


def test_a_topic_whose_package_is_missing_is_refused_with_how_to_build_it(
    network: ThreadedNetwork,
) -> None:
    node = network.node("node")
    topic = Topic("/door", "door_interfaces/msg/Door", Number)
    with pytest.raises(TransportError, match=r"`door_interfaces`.*m2c interfaces build"):
        on(network, node, lambda: node.publisher(topic))
