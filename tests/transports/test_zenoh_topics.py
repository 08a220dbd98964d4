"""Topics on Zenoh: bad payloads, transient local messages, names."""

import logging
import threading

import msgspec
import pytest

from tests.transports.zenoh_network import WAIT_S, Inbox, linked, peer
from transports.interface import (
    Topic,
    TransportError,
)
from transports.zenoh import names, wire

pytestmark = pytest.mark.zenoh


@pytest.mark.parametrize(
    ("payload", "type_name", "complaint"),
    [
        (b"\x81\xa4da", "std_msgs/msg/Int32", "Input data was truncated"),
        (
            msgspec.msgpack.encode({"data": "x"}),
            "std_msgs/msg/Int32",
            "Expected `int`, got `str` - at `$.data`",
        ),
        (
            msgspec.msgpack.encode({"data": 1}),
            "std_msgs/msg/Int64",
            "expected type std_msgs/msg/Int32, got std_msgs/msg/Int64",
        ),
        (b"\x91" * 100_000, "std_msgs/msg/Int32", "Expected `object`, got `array`"),
    ],
)
def test_a_bad_payload_is_reported_and_dropped_and_the_node_lives(
    network, caplog, payload, type_name, complaint
):
    node = network.node("node")
    heard = Inbox()
    node.subscribe(peer.COUNT, heard)
    intruder = linked(network.bare(), "adder/count")
    with caplog.at_level(logging.WARNING, "transports.zenoh"):
        intruder.put(
            payload,
            encoding=f"application/msgpack;{type_name}",
            attachment=wire.attachment(0, 0, b"intruder"),
        )
        intruder.put(msgspec.msgpack.encode({"data": 7}))
        assert heard.wait() == [peer.Number(7)]
    assert caplog.messages == [f"/adder/count: message from intruder dropped: {complaint}"]


def test_a_transient_local_topic_gives_the_last_message_to_who_comes_late(network):
    topic = Topic("/map", "std_msgs/msg/Int32", peer.Number, transient_local=True)
    publisher = network.node("mapper").publisher(topic)
    publisher.publish(peer.Number(1))
    publisher.publish(peer.Number(2))
    heard = Inbox()
    network.node("late").subscribe(topic, heard)
    assert heard.wait() == [peer.Number(2)]
    publisher.publish(peer.Number(3))
    assert heard.wait(2) == [peer.Number(2), peer.Number(3)]


@pytest.mark.parametrize(
    ("channel", "fault"),
    [
        ("relative", "it must start with '/'"),
        ("/a//b", "it has an empty part"),
        ("/a/", "it has an empty part"),
        ("/a/*", "'*' is not allowed in it"),
        ("/a?b", "'?' is not allowed in it"),
        ("/@a", "a part may not start with '@'"),
    ],
)
def test_a_channel_that_zenoh_cannot_name_is_refused(channel, fault):
    with pytest.raises(TransportError) as error:
        names.key_of(channel)
    assert str(error.value) == f"channel {channel!r} cannot be named on Zenoh: {fault}"


def test_a_message_of_another_type_cannot_be_published(network):
    publisher = network.node("node").publisher(peer.COUNT)
    with pytest.raises(TransportError) as error:
        publisher.publish(peer.AddRequest())
    assert str(error.value) == ("expected a message of type std_msgs/msg/Int32, got AddRequest")


class Text(msgspec.Struct):
    """``std_msgs/msg/String``."""

    __type_name__ = "std_msgs/msg/String"
    data: str = ""


def test_a_node_closes_while_another_of_its_threads_publishes(network):
    talker, listener = network.node("talker"), network.node("listener")
    topic = Topic("/talker/text", Text.__type_name__, Text)
    heard = Inbox()
    listener.subscribe(topic, heard)
    publisher = talker.publisher(topic)

    def talk():
        try:
            while True:
                publisher.publish(Text("x" * 200_000))
        except TransportError:
            return  # closed

    talking = threading.Thread(target=talk)
    talking.start()
    heard.wait(1)
    talker.close()
    talking.join(WAIT_S)
    assert not talking.is_alive()
