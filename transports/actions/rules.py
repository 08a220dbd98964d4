"""What the goals of an action may do, and who hears of it: pure, so that a server and a judge decide alike.

The server (``transports.actions.server``) does what is stated here; the model oracle expects it. Sources:
https://design.ros2.org/articles/actions.html and ``action_msgs/srv/CancelGoal``.

A goal is ``NEW`` until it is accepted or rejected. One that is rejected is forgotten at once; of those that
have ended the newest ``KEPT_GOALS`` are kept, for clients that ask for a result late. A goal whose id is that
of one that is kept is rejected, and whoever executes goals does not hear of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import StrEnum

CANCEL_ACCEPTED, CANCEL_REJECTED, CANCEL_UNKNOWN, CANCEL_TERMINATED = 0, 1, 2, 3
"""action_msgs/srv/CancelGoal return codes."""

KEPT_GOALS = 64
"""So many goals that have ended are kept at the arrival of a further goal."""

Stamp = tuple[int, int]
"""When a goal was accepted: seconds and nanoseconds, as in ``builtin_interfaces/msg/Time``."""


class Phase(StrEnum):
    """Where a goal stands."""

    NEW = "new"
    RUNNING = "running"
    CANCELING = "canceling"
    ENDED = "ended"
    REJECTED = "rejected"


class Act(StrEnum):
    """What who executes a goal does with it."""

    ACCEPT = "accept"
    REJECT = "reject"
    FEEDBACK = "send feedback of"
    SUCCEED = "succeed"
    ABORT = "abort"
    CANCEL = "cancel"


_AFTER = {
    (Phase.NEW, Act.ACCEPT): Phase.RUNNING,
    (Phase.NEW, Act.REJECT): Phase.REJECTED,
    (Phase.RUNNING, Act.FEEDBACK): Phase.RUNNING,
    (Phase.RUNNING, Act.SUCCEED): Phase.ENDED,
    (Phase.RUNNING, Act.ABORT): Phase.ENDED,
    (Phase.CANCELING, Act.FEEDBACK): Phase.CANCELING,
    (Phase.CANCELING, Act.SUCCEED): Phase.ENDED,
    (Phase.CANCELING, Act.ABORT): Phase.ENDED,
    (Phase.CANCELING, Act.CANCEL): Phase.ENDED,
}


def after(phase: Phase, act: Act) -> Phase | None:
    """Where a goal stands after ``act``; None: ``phase`` does not allow it, and nothing happens."""
    return _AFTER.get((phase, act))


def forgotten(ended: Sequence[str]) -> Sequence[str]:
    """Which goals are forgotten as a further one arrives.

    Args:
        ended: ids of those that have ended, in the order in which they arrived.
    """
    return ended[: max(0, len(ended) - KEPT_GOALS)]


class ResultAnswer(StrEnum):
    """How a request for a goal's result is answered."""

    NO_SUCH_GOAL = "no such goal"
    AT_ITS_END = "once the goal has ended"
    NOW = "now"


def result_answer(phase: Phase | None) -> ResultAnswer:
    """How a request for the result of a goal is answered; None: the goal is not kept."""
    if phase is None or phase is Phase.REJECTED:
        return ResultAnswer.NO_SUCH_GOAL
    return ResultAnswer.NOW if phase is Phase.ENDED else ResultAnswer.AT_ITS_END


class CancelScope:
    """Which goals a cancel request means (action_msgs/srv/CancelGoal).

    An id without a stamp means that goal. A stamp means all goals accepted up to then, and the one with
    the id if there is an id. Neither means all goals.

    Args:
        goal_id: 32 hex digits; zeros: none.
        stamp: zeros: none.
    """

    def __init__(self, goal_id: str, stamp: Stamp) -> None:
        self.goal_id = goal_id if goal_id.strip("0") else ""
        self._limit = None if stamp == (0, 0) else stamp

    @property
    def is_one_goal(self) -> bool:
        """Whether it means no other goal than the one with its id."""
        return bool(self.goal_id) and self._limit is None

    def includes(self, goal_id: str, phase: Phase, stamp: Stamp | None) -> bool | None:
        """Whether it means a goal.

        Args:
            goal_id: of the goal.
            phase: where the goal stands.
            stamp: when it was accepted; None where that is not known.

        Returns:
            None where that depends on ``stamp``, which is not known.
        """
        if phase not in (Phase.RUNNING, Phase.CANCELING):
            return False
        if self.goal_id and goal_id == self.goal_id:
            return True
        if self.is_one_goal:
            return False
        if self._limit is None:
            return True
        return None if stamp is None else stamp <= self._limit

    def return_code(self, phases: Iterable[tuple[str, Phase]]) -> int:
        """The return code of the answer, where the server has goals of these ids and phases."""
        if not self.is_one_goal:
            return CANCEL_ACCEPTED
        phase = dict(phases).get(self.goal_id)
        if phase is None:
            return CANCEL_UNKNOWN
        if phase in (Phase.RUNNING, Phase.CANCELING):
            return CANCEL_ACCEPTED
        return CANCEL_TERMINATED if phase is Phase.ENDED else CANCEL_REJECTED
