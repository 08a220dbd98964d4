"""What every transport must do with the goals of actions.

Every public function is a check.
"""

from __future__ import annotations

from typing import Any

from transports.conformance.stage import (
    COUNTING,
    Goal,
    Number,
    Text,
    on,
    ready,
    refused,
)
from transports.interface import (
    GoalHandle,
    GoalStatus,
    Transport,
)
from transports.networks import PATIENCE_S, Network


def _send_goal(network: Network, node: Transport, value: int) -> tuple[Goal, Any]:
    goal = Goal()
    client = on(network, node, lambda: node.action_client(COUNTING))
    goal.id = on(network, node, lambda: client.send_goal(Number(value), goal.events(), PATIENCE_S))
    return goal, client


def a_goal_runs_from_acceptance_by_feedback_to_its_result(network: Network) -> None:
    """Accepted comes first, feedback in order, the result once."""
    server, client = network.node("server"), network.node("client")

    def serve(handle: GoalHandle) -> None:
        handle.accept()
        for value in range(handle.goal.value):
            handle.publish_feedback(Number(value))
        server.after(0.1, lambda: handle.succeed(Text("done")))

    on(network, server, lambda: server.serve_action(COUNTING, serve, lambda handle: None))
    # before it announces itself: the server is not ready for it then before it knows who gets feedback
    on(network, client, lambda: client.action_client(COUNTING))
    ready(network, server, client)
    goal, _ = _send_goal(network, client, 3)
    assert network.until(lambda: bool(goal.heard) and goal.heard[-1][0] is GoalStatus.SUCCEEDED), (
        f"the goal does not succeed: {goal.heard}"
    )
    expected = [("accepted",), *(("feedback", n) for n in range(3)), ("succeeded", "done")]
    assert goal.heard == expected, f"the client heard {goal.heard}, not {expected}"


def a_goal_can_be_rejected_or_aborted(network: Network) -> None:
    """A rejected goal hears nothing more; an aborted one gets its result."""
    server, client = network.node("server"), network.node("client")

    def serve(handle: GoalHandle) -> None:
        if handle.goal.value == 0:
            handle.reject()
        else:
            handle.accept()
            handle.abort(Text("tired"))

    on(network, server, lambda: server.serve_action(COUNTING, serve, lambda handle: None))
    ready(network, server, client)
    rejected, _ = _send_goal(network, client, 0)
    aborted, _ = _send_goal(network, client, 1)
    assert network.until(lambda: len(aborted.heard) >= 2 and bool(rejected.heard)), (
        f"the goals do not end: {rejected.heard}, {aborted.heard}"
    )
    assert rejected.heard == [("rejected",)], f"a rejected goal heard {rejected.heard}"
    expected = [("accepted",), (GoalStatus.ABORTED, "tired")]
    assert aborted.heard == expected, f"an aborted goal heard {aborted.heard}"


def a_cancel_request_reaches_the_goal_it_names(network: Network) -> None:
    """Of two goals the one that is cancelled ends as canceled; the other goes on."""
    server, client = network.node("server"), network.node("client")
    handles: list[GoalHandle] = []

    def serve(handle: GoalHandle) -> None:
        handles.append(handle)
        handle.accept()

    def cancel(handle: GoalHandle) -> None:
        handle.canceled(Text(f"stopped {handle.goal.value}"))

    on(network, server, lambda: server.serve_action(COUNTING, serve, cancel))
    ready(network, server, client)
    first, caller = _send_goal(network, client, 1)
    second, _ = _send_goal(network, client, 2)
    assert network.until(lambda: bool(first.heard) and bool(second.heard)), "no goal is accepted"
    refused(network, server, lambda: handles[0].canceled(Text()), "a cancel nobody asked for")
    on(network, client, lambda: caller.cancel(first.id))
    assert network.until(lambda: len(first.heard) == 2), f"it is not cancelled: {first.heard}"
    assert first.heard[1] == (GoalStatus.CANCELED, "stopped 1"), f"it heard {first.heard}"
    on(network, server, lambda: handles[1].succeed(Text("went on")))
    assert network.until(lambda: len(second.heard) == 2), "the other goal does not go on"
    assert second.heard[1] == (GoalStatus.SUCCEEDED, "went on"), f"it heard {second.heard}"
