"""What anybody on the ROS domain can send to nodes and taps: bytes that are refused, and said."""

from __future__ import annotations

import contextlib
import logging
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tests.transports.ros2.bare import Bare
from transports.conformance import DOUBLE, on
from transports.interface import Observation, Topic
from transports.networks import PATIENCE_S, ThreadedNetwork
from transports.payloads import PayloadError
from transports.ros2 import cdr, event_cdr, presence
from transports.ros2 import tap as tap_module

pytestmark = pytest.mark.ros2


class Int32Like(msgspec.Struct):
    """``std_msgs/msg/Int32``, and what has no type of ROS 2's."""

    data: int = 0


HEADER = b"\x00\x01\x00\x00"
CDR = st.one_of(
    st.binary(max_size=300),
    st.binary(max_size=300).map(lambda body: HEADER + body),
    st.binary(max_size=60).map(
        lambda body: b"\x00\x00\x00\x00" + body
    ),  # big endian: rclpy reads it
    st.lists(st.integers(0, 2**32 - 1), max_size=40).map(
        lambda words: HEADER + b"".join(word.to_bytes(4, "little") for word in words)
    ),
)
quickly = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


@quickly
@given(CDR)
@example(b"")
@example(HEADER + b"\xff\xff\xff\xff")
@example(HEADER + b"\x02\x00\x00\x00\xff\x00")
def test_bytes_are_a_message_or_refused(payload: bytes) -> None:
    from conformance.msg import Everything
    from diagnostic_msgs.msg import DiagnosticArray
    from std_msgs.msg import Empty, Int32MultiArray, String

    for ros in (String, Empty, Int32MultiArray, DiagnosticArray, Everything):
        with contextlib.suppress(cdr.CdrError):
            assert isinstance(cdr.reader(ros)(payload), dict)


@quickly
@given(CDR)
def test_bytes_are_an_event_of_a_service_or_refused(payload: bytes) -> None:
    from conformance.srv import Describe

    with contextlib.suppress(cdr.CdrError):
        assert isinstance(event_cdr.reader(Describe.Event)(payload), event_cdr.Event)


def string(text: bytes) -> bytes:
    return HEADER + (len(text) + 1).to_bytes(4, "little") + text + b"\0"


SAID = st.one_of(
    CDR,
    st.binary().map(string),
    st.builds(
        lambda **fields: string(msgspec.json.encode(fields)),
        node=st.one_of(st.just(""), st.just("x" * 999), st.text(max_size=9), st.integers()),
        since_ns=st.integers(-(2**70), 2**70),
        publishes=st.lists(st.text(max_size=5), max_size=5),
        endpoints=st.lists(st.one_of(st.text(max_size=9), st.just("0123abcd\n"), st.integers())),
    ),
)


@quickly
@given(SAID)
@example(b"")
@example(HEADER + b"\0\0\0\0")
@example(string(b"[" * 100_000))
@example(string(b'{"node":"x","taps":' + b"[" * 100_000))
@example(string(b'{"node":"x","endpoints":["0123abcd"]}'))
@example(string(msgspec.json.encode({"node": "x", "endpoints": ["0123abcd"] * 5000})))
def test_what_a_node_says_of_itself_is_read_or_refused(payload: bytes) -> None:
    with contextlib.suppress(PayloadError):
        found = presence.read_presence(payload)
        assert 0 < len(found.node) <= 255
        assert 0 <= found.since_ns < 2**63
        assert len(found.endpoints) <= presence.MOST_ENDPOINTS
        assert all(len(gid) == 16 for gid in found.gids(bytes(12)))


def test_nobody_dies_of_what_anybody_publishes(
    network: ThreadedNetwork, bare: Bare, caplog: pytest.LogCaptureFixture
) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import Int32, String

    caplog.set_level(logging.WARNING)
    ours = Topic("/ours", "m2c/msg/Number", Int32Like)
    numbers = Topic("/number", "std_msgs/msg/Int32", Int32Like)
    got: list[Any] = []
    heard: list[Observation] = []
    node = network.node("node")

    def declare() -> None:
        for topic in (ours, numbers):
            node.subscribe(topic, got.append)
        node.serve(DOUBLE, lambda request: None)
        node.announce()

    on(network, node, declare)
    tapper = network.node("tapper")
    tap = on(network, tapper, lambda: tapper.tap([], heard.append))
    transient_local = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    evil = [b"", b"\xff" * 40, HEADER, HEADER + b"\xff" * 4, string(b"\xff"), string(b"[" * 50_000)]
    deep = '{"m2c_type":"m2c/msg/Number","message":' + "[" * 50_000
    texts = ["", "{}", deep, '{"m2c_type":"x/msg/Y","message":{}}', '{"node":""}', '{"node":7}']
    for name, ros, profile in (
        ("/ours", String, 100),
        ("/number", Int32, 100),
        ("/_m2c/nodes", String, transient_local),
        ("/_m2c/call_errors", String, transient_local),
    ):
        publisher = bare.node.create_publisher(ros, name, profile)
        assert network.until(lambda publisher=publisher: publisher.get_subscription_count() >= 2)
        for payload in evil:
            publisher.publish(payload[:8] if ros is Int32 else payload)  # what it has room for
        for text in texts if ros is String else ():
            publisher.publish(String(data=text))
        last = String(data='{"m2c_type":"m2c/msg/Number","message":{"data":7}}')
        publisher.publish(Int32(data=7) if ros is Int32 else last)
    assert network.until(lambda: got.count(Int32Like(7)) == 2)
    assert network.until(lambda: node._refusals.total >= 10 and tapper._refusals.total >= 3)
    assert network.until(lambda: {"/ours", "/number"} <= {seen.channel for seen in heard})
    for each in (node, tapper):
        ran: list[int] = []
        each.post(lambda ran=ran: ran.append(1))
        assert network.until(lambda ran=ran: ran)
    assert network.until(lambda: any("could not decode" in text for text in tap.problems()))
    late = network.node("late")  # who comes now is told of it at once
    on(network, late, late.announce)
    assert late.wait_for_nodes(["node", "late"], PATIENCE_S) == []
    assert caplog.text.count("/ours: message from an unnamed node dropped") == 1


def test_nobody_dies_of_a_parameter_of_no_type(network: ThreadedNetwork, bare: Bare) -> None:
    from rcl_interfaces.msg import Parameter, ParameterValue
    from rcl_interfaces.srv import SetParameters

    node = network.node("victim")
    client = bare.node.create_client(SetParameters, "/victim/set_parameters")
    assert network.until(client.service_is_ready)
    wrong = Parameter(name="x", value=ParameterValue(type=77))
    client.call_async(SetParameters.Request(parameters=[wrong]))
    assert network.until(lambda: node._refusals.count("victim/set_parameters") == 1)
    right = Parameter(name="x", value=ParameterValue(type=4, string_value="y"))
    answer = client.call_async(SetParameters.Request(parameters=[right]))
    assert network.until(answer.done)


def test_who_takes_the_name_of_a_node_is_found_out(network: ThreadedNetwork) -> None:
    from std_msgs.msg import Int32

    numbers = Topic("/number", "std_msgs/msg/Int32", Int32Like)
    node = network.node("adder")
    publisher = on(network, node, lambda: node.publisher(numbers))
    on(network, node, node.announce)
    heard: list[Observation] = []
    tapper = network.node("tapper")
    tap = on(network, tapper, lambda: tapper.tap(["/number"], heard.append))
    assert tapper.wait_for_nodes(["adder"], PATIENCE_S) == []
    impostor = Bare("adder")
    try:
        forged = impostor.node.create_publisher(Int32, "/number", 10)
        assert network.until(lambda: forged.get_subscription_count() == 1)
        forged.publish(Int32(data=1))
        assert network.until(lambda: len(heard) == 1)
        publisher.publish(Int32Like(2))
        assert network.until(lambda: len(heard) == 2)
        assert [(seen.source, seen.sequence, seen.data["data"]) for seen in heard] == [
            ("", -1, 1),
            ("adder", 0, 2),
        ]
        (said,) = (text for text in tap.problems() if "another participant" in text)
        assert said.startswith("1 message in the name of adder, but sent by another participant")
    finally:
        impostor.close()


def test_a_node_that_is_announced_twice_is_contested(network: ThreadedNetwork) -> None:
    node = network.node("adder")
    on(network, node, node.announce)
    tapper = network.node("tapper")
    tapper.watch_nodes(lambda name, up: None)
    tap = on(network, tapper, lambda: tapper.tap([], lambda seen: None))
    assert network.until(lambda: tapper.up_since("adder"))
    assert not tap.is_contested("adder")
    twin = network.node("adder")
    on(network, twin, twin.announce)
    assert network.until(lambda: tap.is_contested("adder"))
    assert tapper.up_since("adder") == 0  # it is not taken for one that has started again
    said = "several nodes claim to be adder: which of them is the node is not known"
    assert said in tap.problems()
    twin.close()
    assert network.until(lambda: said not in tap.problems())
    assert tap.is_contested("adder")  # what the twin has sent may still be on its way


@contextlib.contextmanager
def ordinary(name: str, namespace: str = "") -> Iterator[tuple[Bare, Any]]:
    """A node that does not announce itself, and a publisher of /number."""
    from std_msgs.msg import Int32

    node = Bare(name, namespace)
    try:
        yield node, node.node.create_publisher(Int32, "/number", 10)
    finally:
        node.close()


def publish(network: ThreadedNetwork, publisher: Any, number: int, heard: list[Observation]) -> str:
    """Who published ``number``, as a tap has it."""
    from std_msgs.msg import Int32

    assert network.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Int32(data=number))
    found: list[str] = []

    def is_heard() -> bool:
        found[:] = [seen.source for seen in heard if seen.data["data"] == number]
        return bool(found)

    assert network.until(is_heard)
    return found[0]


def test_a_node_of_another_namespace_goes_by_its_name_while_no_other_has_it(
    network: ThreadedNetwork,
) -> None:
    heard: list[Observation] = []
    tapper = network.node("tapper")
    tap = on(network, tapper, lambda: tapper.tap(["/number"], heard.append))
    with ordinary("adder", "/other") as (_, elsewhere):
        assert publish(network, elsewhere, 1, heard) == "adder"
        assert "adder" in tap.peers()
        with ordinary("adder") as (_, here):
            assert publish(network, here, 2, heard) == "adder"
            assert tap.is_contested("adder")  # who sent the first was another one
            assert publish(network, elsewhere, 3, heard) == "/other/adder"
            assert {"adder", "/other/adder"} <= set(tap.peers())
            with ordinary("adder", "/third") as (_, third):
                assert publish(network, third, 4, heard) == "/third/adder"
                assert publish(network, here, 5, heard) == "adder"


def test_of_two_nodes_of_one_name_in_other_namespaces_neither_is_the_node(
    network: ThreadedNetwork,
) -> None:
    heard: list[Observation] = []
    tapper = network.node("tapper")
    on(network, tapper, lambda: tapper.tap(["/number"], heard.append))
    with ordinary("adder", "/a") as (_, one), ordinary("adder", "/b/c") as (_, two):
        assert network.until(lambda: publish(network, two, len(heard), heard) == "/b/c/adder")
        assert publish(network, one, 1000, heard) == "/a/adder"


TWIN = """
import sys
import rclpy

rclpy.init()
node = rclpy.create_node("adder")
sys.stdin.read()
node.destroy_node()
rclpy.shutdown()
"""


def test_of_two_nodes_that_nobody_announces_and_that_have_one_name_nothing_is_concluded(
    network: ThreadedNetwork,
) -> None:
    heard: list[Observation] = []
    tapper = network.node("tapper")
    tap = on(network, tapper, lambda: tapper.tap(["/number"], heard.append))
    said = "several nodes claim to be adder: which of them is the node is not known"
    with ordinary("adder") as (_, one):
        assert publish(network, one, 1, heard) == "adder"
        assert not tap.is_contested("adder")
        # rcl has one publisher of /rosout for all nodes of a name in a process
        with subprocess.Popen([sys.executable, "-c", TWIN], stdin=subprocess.PIPE) as twin:
            try:
                assert network.until(lambda: tap.is_contested("adder"))
                assert said in tap.problems()
            finally:
                twin.communicate(timeout=PATIENCE_S)
        assert network.until(lambda: said not in tap.problems())
        assert tap.is_contested("adder")


def test_of_a_topic_with_large_messages_few_are_kept(
    network: ThreadedNetwork, bare: Bare, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from std_msgs.msg import String

    monkeypatch.setattr(tap_module, "MOST_KEPT_BYTES", 1_000_000)
    monkeypatch.setattr(tap_module, "MOST_TURN_BYTES", 150_000)
    heard: list[str] = []
    tapper = network.node("tapper")
    profile = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = bare.node.create_publisher(String, "/large", profile)
    publisher.publish(String(data="first " + "x" * 100_000))
    tap: Any = on(
        network,
        tapper,
        lambda: tapper.tap(["/large"], lambda seen: heard.append(seen.data["data"])),
    )
    assert network.until(lambda: [text[:5] for text in heard] == ["first"])
    assert network.until(lambda: tap._tapped["/large"].profile.depth == 9)
    assert network.until(lambda: tap._tapped["/large"].subscription is not None)
    for number in range(30):
        publisher.publish(String(data=f"{number:05}" + "x" * 100_000))
    assert network.until(lambda: heard[-1].startswith("00029"))
    texts = [text[:5] for text in heard]
    assert texts == sorted(
        set(texts), key=lambda text: (text != "first", text)
    )  # none of them twice
    missed = 31 - len(heard)
    assert not missed or f"missed {missed} message" in str(tap.problems())
