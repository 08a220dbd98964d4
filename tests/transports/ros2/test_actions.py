"""Actions between the ROS 2 transport and ordinary rclpy nodes."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from tests.transports.ros2.bare import Bare
from transports.conformance import (
    COUNTING,
    Goal,
    Number,
    Text,
    on,
    ready,
)
from transports.conformance.stage import send_goal
from transports.interface import (
    GoalHandle,
    GoalStatus,
)
from transports.networks import PATIENCE_S, ThreadedNetwork

pytestmark = pytest.mark.ros2

FEEDBACK = COUNTING.name + "/_action/feedback"


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
    # which says nothing of whether the server knows who gets feedback
    assert network.until(lambda: server.ros_node.count_subscribers(FEEDBACK) == 1)
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
    assert network.until(lambda: bare.node.count_subscribers(FEEDBACK) == 1)
    for part in (client._send_goal, client._get_result, client._cancel_goal):
        assert network.until(part.declared.service_is_ready)

    def send(goal: Number) -> Goal:
        sent = Goal()
        sent.id = on(network, node, lambda: client.send_goal(goal, sent.events(), PATIENCE_S))
        return sent

    done, rejected, waits = send(Number(1)), send(Number(-1)), send(Number(1, "wait"))
    assert network.until(lambda: len(done.received) == 3)
    assert done.received[0] == ("accepted",)
    assert sorted(done.received[1:], key=str) == [("feedback", 7), (GoalStatus.SUCCEEDED, "done")]
    assert network.until(lambda: rejected.received == [("rejected",)])
    assert network.until(lambda: ("feedback", 7) in waits.received)
    on(network, node, lambda: client.cancel(waits.id))
    assert network.until(lambda: (GoalStatus.CANCELED, "stopped") in waits.received)
    served.destroy()


def test_a_goal_fails_with_its_server_though_another_has_taken_its_place(
    network: ThreadedNetwork,
) -> None:
    """As of a node that is killed and started again, before DDS's lease has ended."""
    client, first, second = (network.node(name) for name in ("client", "first", "second"))
    kept: list[GoalHandle] = []

    def serve(handle: GoalHandle) -> None:
        kept.append(handle)
        handle.accept()

    on(network, first, lambda: first.serve_action(COUNTING, serve, lambda handle: None))
    ready(network, first, client)
    goal, _ = send_goal(network, client, 1)
    assert network.until(lambda: goal.received == [("accepted",)])
    on(network, second, lambda: second.serve_action(COUNTING, serve, lambda handle: None))
    ready(network, second, client)
    service = COUNTING.name + "/_action/get_result"
    assert network.until(lambda: client.ros_node.count_services(service) == 2)
    first.close()
    assert network.until(lambda: len(goal.received) > 1), "the goal does not end"
    assert [received[0] for received in goal.received] == ["accepted", "failed"]
    later, _ = send_goal(network, client, 1)
    assert network.until(lambda: later.received == [("accepted",)]), later.received
