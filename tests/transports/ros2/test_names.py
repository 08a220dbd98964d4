"""What is told of names without ROS 2 is what ROS 2 says itself."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from transports.conformance import DOUBLE, NUMBERS
from transports.interface import TransportError
from transports.ros_names import refusal

pytestmark = pytest.mark.ros2
LETTERS = st.sampled_from("aZ0_/ -é漢*$?#@~.{")


def is_taken(kind: str, name: str) -> bool:
    from rclpy.exceptions import NameValidationException
    from rclpy.validate_full_topic_name import validate_full_topic_name
    from rclpy.validate_node_name import validate_node_name

    try:
        if kind == "node":
            validate_node_name(name)
        else:
            validate_full_topic_name(name)
    except NameValidationException:
        return False
    return True


@given(
    st.sampled_from(["node", "topic"]), st.text(LETTERS, max_size=8), st.sampled_from([1, 200, 300])
)
def test_a_name_is_refused_if_and_only_if_ros2_refuses_it(kind: str, text: str, times: int) -> None:
    name = (text * times)[:300]
    name = name if kind == "node" else f"/{name}"
    found = refusal(kind, name)
    assert (found is None) is is_taken(kind, name)
    if found is not None and found[1]:
        assert is_taken(kind, found[1]) or len(found[1]) > 247


@pytest.mark.parametrize("declare", ["publisher", "subscribe", "serve", "client"])
def test_a_channel_that_ros2_does_not_take_is_an_error_of_the_transport(declare: str) -> None:
    from transports.ros2 import connect

    channel = NUMBERS if declare in ("publisher", "subscribe") else DOUBLE
    kind = "topic" if channel is NUMBERS else "service"
    wrong = msgspec.structs.replace(channel, name="/fill-level")
    handler = [] if declare in ("publisher", "client") else [lambda _: None]
    node = connect("one", {})
    try:
        with pytest.raises(TransportError) as raised:
            getattr(node, declare)(wrong, *handler)
    finally:
        node.close()
    assert str(raised.value) == (
        f"ROS 2 does not take the {kind} '/fill-level': it has `-`; a-z, A-Z, 0-9 and _ may be in it"
    )


@pytest.mark.parametrize(
    ("options", "prefix"),
    [
        ({}, ""),
        ({"namespace": "x"}, "/x"),
        ({"args": "-r __ns:=/x"}, "/x"),
        ({"args": "-r __ns:=/x/y -r __node:=other"}, "/x/y"),
        ({"args": "-r __ns:=/launched", "namespace": "x"}, "/launched"),
    ],
)
def test_every_channel_is_in_the_namespace_of_its_node(
    options: dict[str, str], prefix: str
) -> None:
    from transports.ros2 import connect

    node = connect("one", options)
    try:
        node.publisher(NUMBERS)
        node.subscribe(NUMBERS, lambda _: None)
        node.serve(DOUBLE, lambda _: None)
        node.client(DOUBLE)
        name, namespace = node.ros_node.get_name(), prefix or "/"
        by_node = [
            node.ros_node.get_publisher_names_and_types_by_node(name, namespace),
            node.ros_node.get_subscriber_names_and_types_by_node(name, namespace),
            node.ros_node.get_service_names_and_types_by_node(name, namespace),
            node.ros_node.get_client_names_and_types_by_node(name, namespace),
        ]
    finally:
        node.close()
    channels = [NUMBERS, NUMBERS, DOUBLE, DOUBLE]
    for channel, found in zip(channels, by_node, strict=True):
        assert f"{prefix}{channel.name}" in dict(found)
