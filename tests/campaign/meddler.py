"""A node of somebody else's that uses a system's actions as any ROS 2 client may: it asks for results late, and
has goals canceled that others have sent: one, all, or all that were accepted up to some time.
"""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Any

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import InterfaceKind, Machine
from tests.mutation.exercise import action_of
from transports.actions.parts import CancelRequest, GoalId, GoalInfo, Time, parts_of
from transports.interface import Action, Observation, ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld

NS = 10**9
NAME = "meddler"


class Meddler:
    """It is there at once, and acts some times a second.

    Args:
        world: where it is.
        machines: whose actions it uses.
        library: where types are found.
    """

    def __init__(
        self, world: SimulatedWorld, machines: Sequence[Machine], library: InterfaceLibrary
    ) -> None:
        self._world = world
        self._draw = Random(f"{world.seed} meddler")
        self._goals: list[tuple[str, list[int], int]] = []
        """Channel and id of each goal that was sent, and when (ns)."""
        actions: list[Action] = [
            action_of(interface, library)
            for machine in machines
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.ACTION_SERVER
        ]
        self._node = node = SimulatedTransport(world, NAME)
        self._clients = {
            action.name: (
                node.client(parts_of(action).cancel_goal),
                node.client(parts_of(action).get_result),
                parts_of(action).get_result.request,
            )
            for action in actions
        }
        world.witness(self._note)
        node.announce()
        if self._clients:
            node.after(self._draw.random(), self._act)

    def _note(self, seen: Observation) -> None:
        action, _, part = seen.channel.partition("/_action/")
        if part == "send_goal" and seen.kind is ObservationKind.REQUEST_RECEIVED:
            self._goals.append((action, list(seen.data["goal_id"]["uuid"]), seen.stamp_ns))

    def _act(self) -> None:
        draw = self._draw
        self._node.after(draw.choice((0.05, 0.3, 0.8)) * (0.5 + draw.random()), self._act)
        goals = [goal for goal in self._goals if goal[0] in self._clients]
        if not goals:
            return
        # of what was sent long ago, and of what is at work
        action, uuid, sent_ns = draw.choice(goals if draw.random() < 0.6 else goals[-2:])
        cancel, result, result_request = self._clients[action]
        if draw.random() < 0.6:
            request: Any = result_request(goal_id=GoalId(uuid))
            result.call(request, _forget, timeout_s=20.0)
            return
        stamp_ns = sent_ns + draw.choice((-NS // 2, 0, NS // 100, NS // 2))
        stamp = Time(*divmod(stamp_ns, NS)) if draw.random() < 0.7 else Time()
        chosen = GoalId(uuid) if draw.random() < 0.3 else GoalId()
        cancel.call(CancelRequest(GoalInfo(chosen, stamp)), _forget)


def _forget(_: object) -> None:
    """It does not mind how it ends."""
