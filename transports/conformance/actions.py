"""What every transport must do with the goals of actions.

Every public function is a check.
"""

from __future__ import annotations

from transports.conformance.stage import (
    COUNTING,
    Number,
    Text,
    on,
    ready,
    refused,
    send_goal,
)
from transports.interface import (
    GoalHandle,
    GoalStatus,
)
from transports.networks import Network


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
    goal, _ = send_goal(network, client, 3)
    assert network.until(
        lambda: bool(goal.received) and goal.received[-1][0] is GoalStatus.SUCCEEDED
    ), f"the goal does not succeed: {goal.received}"
    expected = [("accepted",), *(("feedback", n) for n in range(3)), ("succeeded", "done")]
    assert goal.received == expected, f"the client received {goal.received}, not {expected}"


def a_goal_that_nobody_serves_fails_once(network: Network) -> None:
    """It is not answered: that is its end."""
    client = network.node("client")
    ready(network, client)
    goal, _ = send_goal(network, client, 1)
    assert network.until(lambda: bool(goal.received)), "a goal that nobody serves does not fail"
    assert [received[0] for received in goal.received] == ["failed"], f"it received {goal.received}"


def a_goal_can_be_rejected_or_aborted(network: Network) -> None:
    """A rejected goal receives nothing more; an aborted one gets its result."""
    server, client = network.node("server"), network.node("client")

    def serve(handle: GoalHandle) -> None:
        if handle.goal.value == 0:
            handle.reject()
        else:
            handle.accept()
            handle.abort(Text("tired"))

    on(network, server, lambda: server.serve_action(COUNTING, serve, lambda handle: None))
    ready(network, server, client)
    rejected, _ = send_goal(network, client, 0)
    aborted, _ = send_goal(network, client, 1)
    assert network.until(lambda: len(aborted.received) >= 2 and bool(rejected.received)), (
        f"the goals do not end: {rejected.received}, {aborted.received}"
    )
    assert rejected.received == [("rejected",)], f"a rejected goal received {rejected.received}"
    expected = [("accepted",), (GoalStatus.ABORTED, "tired")]
    assert aborted.received == expected, f"an aborted goal received {aborted.received}"


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
    first, caller = send_goal(network, client, 1)
    second, _ = send_goal(network, client, 2)
    assert network.until(lambda: bool(first.received) and bool(second.received)), (
        "no goal is accepted"
    )
    refused(network, server, lambda: handles[0].canceled(Text()), "a cancel nobody asked for")
    on(network, client, lambda: caller.cancel(first.id))
    assert network.until(lambda: len(first.received) == 2), f"it is not cancelled: {first.received}"
    assert first.received[1] == (GoalStatus.CANCELED, "stopped 1"), f"it received {first.received}"
    on(network, server, lambda: handles[1].succeed(Text("went on")))
    assert network.until(lambda: len(second.received) == 2), "the other goal does not go on"
    assert second.received[1] == (GoalStatus.SUCCEEDED, "went on"), f"it received {second.received}"
