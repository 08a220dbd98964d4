"""The ROS 2 transport beside ordinary rclpy nodes, which know nothing of it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from m2c.policy.runner import TICKS, LeafTick, TreeTick
from tests.transports import ros2_network
from transports.conformance import (
    COUNTING,
    DOUBLE,
    LATCHED,
    NUMBERS,
    Answer,
    Ask,
    Goal,
    Number,
    Text,
    on,
    ready,
)
from transports.interface import (
    CallOutcome,
    CallResult,
    GoalHandle,
    GoalStatus,
    Observation,
    ObservationKind,
    Reliability,
    Topic,
    Transport,
    TransportError,
)
from transports.networks import PATIENCE_S, ThreadedNetwork

pytestmark = pytest.mark.ros2


class Bare:
    """An rclpy node as anybody writes it, spinning on a thread."""

    def __init__(self, name: str, namespace: str = "") -> None:
        import rclpy
        from rclpy.context import Context
        from rclpy.executors import MultiThreadedExecutor

        self.context = Context()
        self.context.init(args=[])
        self.node = rclpy.create_node(name, context=self.context, namespace=namespace or None)
        self.executor = MultiThreadedExecutor(2, context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin)
        self.thread.start()

    def _spin(self) -> None:
        from rclpy.executors import ExternalShutdownException

        try:
            self.executor.spin()
        except ExternalShutdownException:
            return

    def close(self) -> None:
        self.executor.shutdown()
        self.thread.join(PATIENCE_S)
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module", autouse=True)
def domain() -> Iterator[int]:
    ros2_network.load(ros2_network.built())
    with ros2_network.own_domain() as number:
        yield number


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


# --- services -------------------------------------------------------------------------------------


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
    result = network.caller(lambda: client.call_and_wait(Ask(21), PATIENCE_S))()
    assert result == CallResult(CallOutcome.RESPONSE, Answer(42))


def test_a_call_whose_server_goes_away_ends_as_unavailable(network: ThreadedNetwork) -> None:
    server, node = network.node("server"), network.node("client")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    client = on(network, node, lambda: node.client(DOUBLE))
    waiting = network.caller(lambda: client.call_and_wait(Ask(1), 10 * PATIENCE_S))
    assert network.until(lambda: bool(kept))
    server.close()
    assert waiting().outcome is CallOutcome.UNAVAILABLE


# --- actions --------------------------------------------------------------------------------------


def test_an_ordinary_action_client_gets_feedback_and_results_and_can_cancel(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from action_msgs.msg import GoalStatus as Codes
    from conformance.action import Count
    from rclpy.action import ActionClient

    server = network.node("server")

    def serve(handle: GoalHandle) -> None:
        handle.accept()
        if handle.goal.text == "wait":
            return
        for value in range(handle.goal.value):
            handle.publish_feedback(Number(value))
        server.after(0.2, lambda: handle.succeed(Text("counted")))

    on(
        network,
        server,
        lambda: server.serve_action(COUNTING, serve, lambda h: h.canceled(Text("stopped"))),
    )
    client = ActionClient(bare.node, Count, COUNTING.name)
    assert client.wait_for_server(PATIENCE_S)
    heard: list[int] = []

    def send(goal: Any) -> Any:
        sent = client.send_goal_async(goal, lambda message: heard.append(message.feedback.value))
        assert network.until(sent.done)
        assert sent.result().accepted
        return sent.result()

    ended = send(Count.Goal(value=3)).get_result_async()
    assert network.until(ended.done)
    assert ended.result().status == Codes.STATUS_SUCCEEDED
    assert ended.result().result.text == "counted"
    assert network.until(lambda: len(heard) == 3)
    assert heard == [0, 1, 2]

    goal = send(Count.Goal(text="wait"))
    ended = goal.get_result_async()
    canceled = goal.cancel_goal_async()
    assert network.until(lambda: ended.done() and canceled.done())
    assert len(canceled.result().goals_canceling) == 1
    assert ended.result().status == Codes.STATUS_CANCELED
    assert ended.result().result.text == "stopped"
    client.destroy()


def test_an_ordinary_action_server_serves_goals_and_cancels(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from conformance.action import Count
    from rclpy.action import ActionServer, CancelResponse, GoalResponse

    stop = threading.Event()

    def execute(handle: Any) -> Any:
        handle.publish_feedback(Count.Feedback(value=7))
        if handle.request.text == "wait":
            assert stop.wait(PATIENCE_S)
            handle.canceled()
            return Count.Result(text="stopped")
        handle.succeed()
        return Count.Result(text="done")

    def cancel(handle: Any) -> Any:
        stop.set()
        return CancelResponse.ACCEPT

    served = ActionServer(
        bare.node,
        Count,
        COUNTING.name,
        execute,
        goal_callback=lambda goal: GoalResponse.REJECT if goal.value < 0 else GoalResponse.ACCEPT,
        cancel_callback=cancel,
    )
    node = network.node("client")
    client = on(network, node, lambda: node.action_client(COUNTING))

    def send(goal: Number) -> Goal:
        sent = Goal()
        sent.id = on(network, node, lambda: client.send_goal(goal, sent.events(), PATIENCE_S))
        return sent

    done, rejected, waits = send(Number(1)), send(Number(-1)), send(Number(1, "wait"))
    assert network.until(lambda: len(done.heard) == 3)
    assert done.heard[0] == ("accepted",)
    assert sorted(done.heard[1:], key=str) == [("feedback", 7), (GoalStatus.SUCCEEDED, "done")]
    assert network.until(lambda: rejected.heard == [("rejected",)])
    assert network.until(lambda: ("feedback", 7) in waits.heard)
    on(network, node, lambda: client.cancel(waits.id))
    assert network.until(lambda: (GoalStatus.CANCELED, "stopped") in waits.heard)
    served.destroy()


# --- the tap --------------------------------------------------------------------------------------


def tapped(
    network: ThreadedNetwork, globs: list[str] | None = None
) -> tuple[Transport, Any, list[Observation]]:
    listener = network.node("listener")
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
    _, _, heard = tapped(network)

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
            text.startswith(f"{DOUBLE.name} has no service introspection: its calls are not heard")
            and "ServiceIntrospectionState.CONTENTS" in text
            for text in tap.problems()
        )
    )
    assert len(tap.problems()) == 1, tap.problems()
    for end in (service, client):
        end.configure_introspection(
            bare.node.get_clock(), qos_profile_services_default, ServiceIntrospectionState.CONTENTS
        )

    def all_heard() -> bool:
        answered = client.call_async(Double.Request(value=4))
        assert network.until(answered.done)
        return {o.kind for o in heard} == set(ObservationKind) - {ObservationKind.MESSAGE}

    assert network.until(all_heard)
    assert {o.source for o in heard} == {o.client for o in heard} == {"bare"}
    assert not tap.problems()


def test_of_an_ordinary_action_server_a_tap_says_that_its_goals_are_not_heard(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from conformance.action import Count
    from rclpy.action import ActionServer

    served = ActionServer(bare.node, Count, COUNTING.name, lambda handle: Count.Result())
    _, tap, _ = tapped(network, [COUNTING.name])
    assert network.until(
        lambda: any(
            text.startswith(f"the goals of {COUNTING.name} are not heard")
            for text in tap.problems()
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


def test_a_namespace_keeps_systems_apart(network: ThreadedNetwork) -> None:
    from transports.ros2 import connect

    inside = [connect(name, {"namespace": "cell"}) for name in ("one", "two")]
    outside = network.node("outside")
    threads = [threading.Thread(target=node.spin) for node in inside]
    for thread in threads:
        thread.start()
    try:
        heard: list[int] = []
        taps: list[Observation] = []
        foreign: list[Any] = []
        on(
            network,
            inside[1],
            lambda: inside[1].subscribe(NUMBERS, lambda m: heard.append(m.value)),
        )
        on(network, inside[1], lambda: inside[1].tap([NUMBERS.name], taps.append))
        on(network, outside, lambda: outside.subscribe(NUMBERS, foreign.append))
        publisher = on(network, inside[0], lambda: inside[0].publisher(NUMBERS))
        ready(network, *inside)
        on(network, inside[0], lambda: publisher.publish(Number(5)))
        assert network.until(lambda: bool(heard) and bool(taps))
        assert heard == [5]
        assert taps[0].channel == NUMBERS.name
        assert not foreign
    finally:
        for node in inside:
            node.close()
        for thread in threads:
            thread.join(PATIENCE_S)


# --- time -----------------------------------------------------------------------------------------


def test_timers_follow_a_simulation_and_calls_do_not(network: ThreadedNetwork, bare: Bare) -> None:
    from builtin_interfaces.msg import Time
    from rosgraph_msgs.msg import Clock

    from transports.ros2 import connect

    clock = bare.node.create_publisher(Clock, "/clock", 10)
    node = connect("simulated", {"use_sim_time": "true"})
    thread = threading.Thread(target=node.spin)
    thread.start()
    try:
        assert network.until(lambda: clock.get_subscription_count() == 1)

        def tell(seconds: float) -> None:
            def told() -> bool:
                clock.publish(Clock(clock=Time(sec=int(seconds))))  # best effort: it may be lost
                return node.now_ns() == int(seconds) * 10**9

            assert network.until(told)

        tell(1000.0)
        fired: list[float] = []
        on(network, node, lambda: node.after(10.0, lambda: fired.append(node.now_ns() / 1e9)))
        on(network, node, lambda: node.every(4.0, lambda: fired.append(-node.now_ns() / 1e9)))
        tell(1003.0)
        on(network, node, lambda: None)
        assert fired == []
        tell(1004.0)
        assert network.until(lambda: fired == [-1004.0])
        tell(1010.0)
        assert network.until(lambda: sorted(fired) == [-1010.0, -1004.0, 1010.0])
        # The simulation stands still; a call that nobody answers ends all the same.
        results: list[CallResult] = []
        client = on(network, node, lambda: node.client(DOUBLE))
        on(network, node, lambda: client.call(Ask(1), results.append, 0.1))
        assert network.until(lambda: bool(results))
    finally:
        node.close()
        thread.join(PATIENCE_S)


# --- what cannot work is said ---------------------------------------------------------------------


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
    bare.node.create_publisher(RosNumber, LATCHED.name, 10)
    node = network.node("node")
    on(network, node, lambda: node.subscribe(NUMBERS, lambda message: None))
    on(network, node, lambda: node.subscribe(LATCHED, lambda message: None))
    assert says(
        network,
        reports,
        f"{NUMBERS.name}: node cannot hear bare",
        "reliable reliability is asked for, best effort is offered",
    )
    assert says(
        network,
        reports,
        f"{LATCHED.name}: node cannot hear bare",
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
        lambda: node.publisher(LATCHED),
        lambda: node.subscribe(LATCHED, lambda message: None),
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
