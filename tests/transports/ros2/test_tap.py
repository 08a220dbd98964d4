"""The tap of the ROS 2 transport hears any graph."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from m2c.policy.runner import TICKS, LeafTick, TreeTick
from tests.transports.ros2.bare import Bare
from transports.conformance import (
    COUNTING,
    DOUBLE,
    Number,
    on,
    ready,
)
from transports.interface import (
    BlindSpot,
    BlindSpotKind,
    Connection,
    Observation,
    ObservationKind,
    TransportError,
)
from transports.networks import PATIENCE_S, ThreadedNetwork
from transports.service_events import KIND_OF_EVENT

pytestmark = pytest.mark.ros2


def tapped(
    network: ThreadedNetwork, globs: list[str] | None = None, known: str = ""
) -> tuple[Connection, Any, list[Observation]]:
    """A tap, begun when the graph tells that the node "bare" publishes the topic ``known``."""
    listener = network.node("listener")
    publishing = listener.ros_node.get_publishers_info_by_topic
    assert network.until(
        lambda: not known or [info.node_name for info in publishing(known)] == ["bare"]
    )
    heard: list[Observation] = []
    tap = on(network, listener, lambda: listener.tap(globs or [], heard.append))
    return listener, tap, heard


@pytest.mark.parametrize("reliable", [True, False])
@pytest.mark.parametrize("durable", [True, False])
@pytest.mark.parametrize("name", ["/seen", "/_hidden/seen"])
def test_a_tap_hears_an_ordinary_publisher_in_whatever_qos_it_has(
    network: ThreadedNetwork, bare: Bare, reliable: bool, durable: bool, name: str
) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
    from std_msgs.msg import Int32

    profile = QoSProfile(
        depth=10,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )
    publisher = bare.node.create_publisher(Int32, name, profile)
    if durable:
        publisher.publish(Int32(data=1))
    _, _, heard = tapped(network, known=name)

    def reached() -> bool:
        if not (durable and reliable):  # only these are kept for who comes late
            publisher.publish(Int32(data=1))
        return bool(heard)

    assert network.until(reached)
    first = heard[0]
    assert (first.channel, first.kind, first.type_name, first.data, first.source) == (
        name,
        ObservationKind.MESSAGE,
        "std_msgs/msg/Int32",
        {"data": 1},
        "bare",
    )
    assert first.sequence >= 0
    assert 0 < first.stamp_ns <= first.received_ns


def test_a_best_effort_publisher_that_comes_later_is_heard_too(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from rclpy.qos import qos_profile_sensor_data
    from std_msgs.msg import Int32

    first = bare.node.create_publisher(Int32, "/seen", 10)
    _, _, heard = tapped(network, ["/seen"])
    assert network.until(lambda: first.get_subscription_count() == 1)
    second = bare.node.create_publisher(Int32, "/seen", qos_profile_sensor_data)

    def reached() -> bool:
        second.publish(Int32(data=2))
        return bool(heard)

    assert network.until(reached)
    assert heard[0].data == {"data": 2}


def gone_after_it_was_heard(network: ThreadedNetwork, bare: Bare) -> tuple[Any, list[Observation]]:
    """A tap, and what it hears, after ``bare`` published /seen as Int32, and no longer does."""
    from std_msgs.msg import Empty, Int32

    first = bare.node.create_publisher(Int32, "/seen", 10)
    _, tap, heard = tapped(network)
    assert network.until(lambda: first.get_subscription_count() == 1)
    bare.node.destroy_publisher(first)
    # who hears what came after that has looked at the graph since
    marker = bare.node.create_publisher(Empty, "/marker", 10)
    assert network.until(lambda: marker.get_subscription_count() == 1)
    return tap, heard


def test_a_publisher_that_comes_back_with_another_qos_is_heard(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from rclpy.qos import qos_profile_sensor_data
    from std_msgs.msg import Int32

    tap, heard = gone_after_it_was_heard(network, bare)
    second = bare.node.create_publisher(Int32, "/seen", qos_profile_sensor_data)

    def reached() -> bool:
        second.publish(Int32(data=2))
        return any(seen.channel == "/seen" for seen in heard)

    assert network.until(reached)
    assert not any("/seen" in problem for problem in tap.problems())


def test_a_publisher_that_comes_back_with_another_type_is_named(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from std_msgs.msg import Int64

    tap, _ = gone_after_it_was_heard(network, bare)
    other = Bare("other")  # the first one can no more have the topic as another type than a tap can
    try:
        other.node.create_publisher(Int64, "/seen", 10)
        said = "/seen is not received any more: it is published as std_msgs/msg/Int64 now"
        assert network.until(lambda: any(said in problem for problem in tap.problems()))
    finally:
        other.close()


def test_a_service_without_introspection_is_named_and_heard_once_it_has_it(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from conformance.srv import Double
    from rclpy.qos import qos_profile_services_default
    from rclpy.service_introspection import ServiceIntrospectionState

    def double(request: Any, response: Any) -> Any:
        response.value = 2 * request.value
        return response

    service = bare.node.create_service(Double, DOUBLE.name, double)
    client = bare.node.create_client(Double, DOUBLE.name)
    assert client.wait_for_service(PATIENCE_S)
    _, tap, heard = tapped(network)
    assert network.until(
        lambda: any(
            text.startswith(
                f"calls on {DOUBLE.name} are not received: it has no service introspection"
            )
            and "ServiceIntrospectionState.CONTENTS" in text
            for text in tap.problems()
        )
    )
    assert len(tap.problems()) == 1, tap.problems()
    assert set(tap.blind_spots()) == {BlindSpot(BlindSpotKind.NOT_RECEIVED, DOUBLE.name)}
    for end in (service, client):
        end.configure_introspection(
            bare.node.get_clock(), qos_profile_services_default, ServiceIntrospectionState.CONTENTS
        )

    def all_heard() -> bool:
        answered = client.call_async(Double.Request(value=4))
        assert network.until(answered.done)
        return {o.kind for o in heard} == set(KIND_OF_EVENT)

    assert network.until(all_heard)
    assert {o.source for o in heard} == {o.client for o in heard} == {"bare"}
    assert not tap.problems()
    assert not tap.blind_spots()


@pytest.mark.parametrize("shown", ["server", "client", "namesake", "both clients"])
def test_calls_are_received_if_one_of_their_ends_shows_them(
    network: ThreadedNetwork, bare: Bare, shown: str
) -> None:
    from conformance.srv import Double
    from rclpy.qos import qos_profile_services_default
    from rclpy.service_introspection import ServiceIntrospectionState

    def show(end: Any) -> None:
        clock, usual = bare.node.get_clock(), qos_profile_services_default
        end.configure_introspection(clock, usual, ServiceIntrospectionState.CONTENTS)

    service = bare.node.create_service(Double, DOUBLE.name, lambda request, response: response)
    names = ["one", "one" if shown == "namesake" else "other"]
    callers = [Bare(name) for name in names]
    try:
        clients = [caller.node.create_client(Double, DOUBLE.name) for caller in callers]
        ends = {"server": [service], "both clients": clients}.get(shown, clients[:1])
        for end in ends:
            show(end)
        _, tap, heard = tapped(network)
        for client in clients:
            assert client.wait_for_service(PATIENCE_S)
        if ends == clients[:1]:
            kind, name = BlindSpotKind.NOT_RECEIVED, DOUBLE.name
            unseen = {BlindSpot(kind, name, "bare"), BlindSpot(kind, name, names[1])}
            assert network.until(lambda: tap.blind_spots().keys() == unseen)
            return

        def all_heard() -> bool:
            answered = [client.call_async(Double.Request(value=4)) for client in clients]
            assert network.until(lambda: all(one.done() for one in answered))
            return {one.client for one in heard} == {"one", "other"}

        assert network.until(all_heard)
        assert not tap.blind_spots()
    finally:
        for caller in callers:
            caller.close()


def test_a_tap_says_that_a_client_has_left_before_it_was_answered(
    network: ThreadedNetwork, bare: Bare
) -> None:
    """The server answers, and rcl shows nothing of that: nobody would get it."""
    from conformance.srv import Double
    from rclpy.qos import qos_profile_services_default
    from rclpy.service_introspection import ServiceIntrospectionState

    may_answer = threading.Event()

    def double(request: Any, response: Any) -> Any:
        assert may_answer.wait(PATIENCE_S)
        return response

    service = bare.node.create_service(Double, DOUBLE.name, double)
    service.configure_introspection(
        bare.node.get_clock(), qos_profile_services_default, ServiceIntrospectionState.CONTENTS
    )
    try:
        client = bare.node.create_client(Double, DOUBLE.name)
        assert client.wait_for_service(PATIENCE_S)
        _, tap, heard = tapped(network)
        assert network.until(lambda: tap.is_complete)
        client.call_async(Double.Request(value=4))
        assert network.until(lambda: ObservationKind.REQUEST_RECEIVED in {o.kind for o in heard})
        assert not tap.blind_spots()
        bare.node.destroy_client(client)
        assert network.until(lambda: {it.channel for it in tap.blind_spots()} == {DOUBLE.name})
        assert network.until(lambda: not tap.blind_spots())
    finally:
        may_answer.set()


@pytest.mark.parametrize(
    ("offered", "asked_for", "why"),
    [
        ("RELIABLE VOLATILE", "RELIABLE VOLATILE", ""),
        ("RELIABLE TRANSIENT_LOCAL", "RELIABLE VOLATILE", ""),
        ("RELIABLE VOLATILE", "BEST_EFFORT VOLATILE", "may be dropped"),
        ("BEST_EFFORT VOLATILE", "RELIABLE VOLATILE", "is not received"),
        ("RELIABLE TRANSIENT_LOCAL", "RELIABLE TRANSIENT_LOCAL", "may be old"),
    ],
)
def test_a_tap_says_who_may_not_take_what_is_published(
    network: ThreadedNetwork, bare: Bare, offered: str, asked_for: str, why: str
) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
    from std_msgs.msg import Int32

    def profile(policies: str) -> QoSProfile:
        reliability, durability = policies.split()
        return QoSProfile(
            depth=10,
            reliability=ReliabilityPolicy[reliability],
            durability=DurabilityPolicy[durability],
        )

    # a topic that shows when the tap has looked at both
    bare.node.create_subscription(
        Int32, "/last", lambda message: None, profile("BEST_EFFORT VOLATILE")
    )
    bare.node.create_subscription(Int32, "/first", lambda message: None, profile(asked_for))
    bare.node.create_publisher(Int32, "/first", profile(offered))
    bare.node.create_publisher(Int32, "/last", 10)
    _, tap, _ = tapped(network)
    first, last = (
        BlindSpot(BlindSpotKind.MAY_NOT_BE_TAKEN, topic, "bare") for topic in ("/first", "/last")
    )
    assert network.until(lambda: last in tap.blind_spots())
    assert why in tap.blind_spots().get(first, "")
    assert (first in tap.blind_spots()) == bool(why)


@pytest.mark.parametrize("clock", ["/clock", "/simulation/clock"])
def test_a_tap_says_who_has_the_time_of_a_simulation(
    network: ThreadedNetwork, bare: Bare, clock: str
) -> None:
    from rclpy.parameter import Parameter
    from rosgraph_msgs.msg import Clock

    _, tap, _ = tapped(network)
    other = Bare("other")
    try:
        assert network.until(lambda: "other" in tap.peers())
        assert tap.blind_spots() == {}
        if clock == "/clock":
            bare.node.set_parameters([Parameter("use_sim_time", value=True)])
        else:  # as it is remapped
            bare.node.create_subscription(Clock, clock, lambda message: None, 10)
        assert network.until(lambda: bool(tap.blind_spots()))
        said = f"bare has its time from {clock}, which may stand still or be faster"
        assert tap.blind_spots() == {BlindSpot(BlindSpotKind.OTHER_TIME, "", "bare"): said}
    finally:
        other.close()


def test_a_service_whose_events_have_the_time_of_a_simulation_is_not_heard(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from conformance.srv import Double
    from rclpy.clock import Clock
    from rclpy.clock_type import ClockType
    from rclpy.qos import qos_profile_services_default
    from rclpy.service_introspection import ServiceIntrospectionState

    service = bare.node.create_service(Double, DOUBLE.name, lambda request, response: response)
    client = bare.node.create_client(Double, DOUBLE.name)
    assert client.wait_for_service(PATIENCE_S)
    _, tap, heard = tapped(network)

    def stamp_by(clock: Clock) -> int:
        for end in (service, client):
            end.configure_introspection(
                clock, qos_profile_services_default, ServiceIntrospectionState.CONTENTS
            )
        before = len(heard)

        def is_heard() -> bool:
            answered = client.call_async(Double.Request(value=4))
            assert network.until(answered.done)
            return len(heard) > before

        assert network.until(is_heard)
        return len(heard)

    said = f"the events of {DOUBLE.name} are stamped by another clock than the time of day"
    stamp_by(Clock(clock_type=ClockType.SYSTEM_TIME))
    assert not tap.blind_spots()
    stamp_by(Clock(clock_type=ClockType.STEADY_TIME))
    assert tap.blind_spots()[BlindSpot(BlindSpotKind.NOT_RECEIVED, DOUBLE.name)].startswith(said)
    assert any(text.startswith(said) for text in tap.problems())


def test_of_an_ordinary_action_server_a_tap_says_that_its_goals_are_not_heard(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from conformance.action import Count
    from rclpy.action import ActionServer

    served = ActionServer(bare.node, Count, COUNTING.name, lambda handle: Count.Result())
    _, tap, _ = tapped(network, [COUNTING.name])
    assert network.until(
        lambda: any(
            text.startswith(f"goals of {COUNTING.name} are not received") for text in tap.problems()
        )
    )
    assert len(tap.problems()) == 1
    served.destroy()


def test_events_without_contents_are_told_apart(network: ThreadedNetwork, bare: Bare) -> None:
    from conformance.srv import Double
    from rclpy.qos import qos_profile_services_default
    from rclpy.service_introspection import ServiceIntrospectionState

    service = bare.node.create_service(Double, DOUBLE.name, lambda request, response: response)
    service.configure_introspection(
        bare.node.get_clock(), qos_profile_services_default, ServiceIntrospectionState.METADATA
    )
    client = bare.node.create_client(Double, DOUBLE.name)
    assert client.wait_for_service(PATIENCE_S)
    _, tap, heard = tapped(network)

    def some_heard() -> bool:
        answered = client.call_async(Double.Request(value=4))
        assert network.until(answered.done)
        return bool(heard)

    assert network.until(some_heard)
    assert heard[0].data is None
    assert any("carry no contents" in text for text in tap.problems())


def test_what_the_tools_tell_each_other_travels_without_a_ros_type(
    network: ThreadedNetwork,
) -> None:
    source, sink = network.node("source"), network.node("sink")
    ticks = [TreeTick(1, "RUNNING", [LeafTick("Battery", "SUCCESS", 1.5)]), TreeTick(2)]
    heard: list[TreeTick] = []
    listener, _, observations = tapped(network)
    on(network, sink, lambda: sink.subscribe(TICKS, heard.append))
    publisher = on(network, source, lambda: source.publisher(TICKS))
    ready(network, source, sink, listener)
    on(network, source, lambda: [publisher.publish(tick) for tick in ticks])
    assert network.until(lambda: heard == ticks)
    assert network.until(lambda: bool(observations) and observations[-1].data["tick"] == 2)
    assert observations[-1].type_name == TreeTick.__type_name__
    with pytest.raises(TransportError, match="expected a message of type m2c/msg/TreeTick"):
        on(network, source, lambda: publisher.publish(Number()))


def test_a_tap_is_complete_when_it_hears_those_who_were_there(
    network: ThreadedNetwork, bare: Bare, monkeypatch: pytest.MonkeyPatch
) -> None:
    from std_msgs.msg import Int32

    from transports.ros2 import tap as taps

    monkeypatch.setattr(taps, "_ALONE_S", 5.0)  # also where this process is held up
    publisher = bare.node.create_publisher(Int32, "/there", 10)
    _, tap, heard = tapped(network)
    assert not tap.is_complete
    assert network.until(lambda: tap.is_complete)
    assert publisher.get_subscription_count() == 1
    publisher.publish(Int32(data=3))
    assert network.until(lambda: [seen.data for seen in heard] == [{"data": 3}])


def test_a_tap_waits_for_nothing_that_its_own_node_sends(
    network: ThreadedNetwork, bare: Bare, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A monitor publishes its verdicts: those who start after it would wait for them."""
    from std_msgs.msg import Int32

    from transports.ros2 import tap as taps

    monkeypatch.setattr(taps, "_DISCOVERY_S", 60.0)
    listener, tap, heard = tapped(network)
    publisher = on(network, listener, lambda: listener.publisher(TICKS))
    ready(network, listener)

    def is_heard() -> bool:
        on(network, listener, lambda: publisher.publish(TreeTick(1)))
        return bool(heard)

    assert network.until(is_heard)
    assert network.until(lambda: tap.is_complete)
    another = bare.node.create_publisher(Int32, "/there", 10)
    assert network.until(lambda: another.get_subscription_count() == 1)
    assert network.until(lambda: not tap.is_complete)


def test_who_has_no_name_yet_holds_up_the_others_for_a_moment_only(
    network: ThreadedNetwork, bare: Bare, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A monitor's time goes on meanwhile, and it would take what waits for what did not come."""
    from std_msgs.msg import Int32

    from transports.ros2 import tap
    from transports.ros2.graph import Graph

    is_named = False
    find = Graph.publisher_of

    def found(graph: Graph, topic: str, gid: bytes) -> str:
        return find(graph, topic, gid) if is_named or topic != "/nameless" else ""

    monkeypatch.setattr(Graph, "publisher_of", found)
    monkeypatch.setattr(tap, "_NEVER_NAMED_S", 1000.0)
    monkeypatch.setattr(tap, "_DISCOVERY_S", 0.0)
    nameless = bare.node.create_publisher(Int32, "/nameless", 10)
    named = bare.node.create_publisher(Int32, "/named", 10)
    _, _, heard = tapped(network, known="/nameless")

    def both_are_heard() -> bool:
        nameless.publish(Int32(data=1))
        named.publish(Int32(data=2))
        return {seen.channel for seen in heard} == {"/nameless", "/named"}

    assert network.until(both_are_heard)
    assert {seen.source for seen in heard if seen.channel == "/nameless"} == {""}
    is_named = True
    nameless.publish(Int32(data=3))
    assert network.until(lambda: any(seen.data == {"data": 3} for seen in heard))
    (last,) = [seen for seen in heard if seen.data == {"data": 3}]
    assert last.source == "bare"


def test_a_message_on_a_topic_that_is_named_as_those_of_events_is_a_message(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from std_msgs.msg import Int32

    publisher = bare.node.create_publisher(Int32, "/x/_service_event", 10)
    _, _, heard = tapped(network)

    def is_heard() -> bool:
        publisher.publish(Int32(data=1))
        return bool(heard)

    assert network.until(is_heard)
    assert (heard[0].kind, heard[0].data) == (ObservationKind.MESSAGE, {"data": 1})


def test_all_events_of_a_call_have_one_client_whenever_its_name_is_told() -> None:
    from transports.ros2 import observing

    class Told:
        """A graph that is told the name of a client."""

        name = ""

        def client_of(self, service: str, gid: bytes) -> str:
            return self.name

    graph = Told()
    notes = observing.Notes(graph, None, "")
    one, other = b"\x01" * 16, b"\x02" * 16
    asked = notes.caller("/double", one, 1)
    assert asked != notes.caller("/double", other, 1)
    graph.name = "policy"
    assert notes.caller("/double", one, 1) == asked
    assert notes.caller("/double", one, 2) == "policy"
    graph.name = ""
    for call in range(observing._KEPT_CALLS + 1):
        notes.caller("/double", other, call)
    graph.name = "policy"
    assert notes.caller("/double", one, 1) == "policy"


def test_a_node_that_announces_itself_has_a_name_before_the_graph_tells_it(
    network: ThreadedNetwork,
) -> None:
    listener = network.node("listener")
    graph = listener._graph
    gid = bytes(range(16))
    assert graph.publisher_of("/none", gid) == ""
    other = gid[:12] + b"\x09\x08\x07\x06"
    graph.learn_node("policy", gid[:12], {gid})
    assert graph.publisher_of("/none", gid) == "policy"
    assert graph.client_of("/none", other) == ""  # of another node of its process, perhaps
    graph.learn_node("alone", gid[:12], ())
    assert graph.client_of("/none", other) == "alone"
