"""What a transport must do when a server ends, if its middleware knows.

Every public function is a check.
"""

from __future__ import annotations

from transports.conformance.stage import COUNTING, on, ready, send_goal
from transports.interface import CallOutcome, GoalHandle
from transports.networks import Network


def a_goal_whose_server_ends_fails_once(network: Network) -> None:
    """Its client learns that no result will come, whether it was accepted or not, and nothing else."""
    server, client = network.node("server"), network.node("client")
    kept: list[GoalHandle] = []

    def serve(handle: GoalHandle) -> None:
        kept.append(handle)
        if handle.goal.value:
            handle.accept()

    on(network, server, lambda: server.serve_action(COUNTING, serve, lambda handle: None))
    ready(network, server, client)
    accepted, _ = send_goal(network, client, 1)
    unanswered, _ = send_goal(network, client, 0)
    assert network.until(lambda: bool(accepted.received) and len(kept) == 2), "no goal arrives"
    server.close()
    goals = (accepted, unanswered)
    assert network.until(
        lambda: all(goal.received and goal.received[-1][0] == "failed" for goal in goals)
    ), f"the goals do not fail: {accepted.received}, {unanswered.received}"
    for goal, before in ((accepted, [("accepted",)]), (unanswered, [])):
        assert goal.received[:-1] == before, f"the client received {goal.received}"
        outcome = goal.received[-1][1].outcome
        assert outcome is not CallOutcome.RESPONSE, f"a goal that failed ended with {outcome}"
