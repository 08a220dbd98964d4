"""The goals of a hypothesis: what they allow, how they change."""

from __future__ import annotations

from typing import Any

from m2c.model.machine import OutputKind
from moon.oracle.compiling import Output
from moon.oracle.state import Goal, Hypothesis
from moon.oracle.unknowns import Unknown

KEPT_GOALS = 8
"""Ended goals are remembered for results that are asked for late."""


def goal_called(hypothesis: Hypothesis, goal_id: str, served: bool) -> Goal | None:
    """The goal with this id, served or sent."""
    for goal in hypothesis.goals:
        if goal.served is served and goal.id == goal_id:
            return goal
    return None


def allowed(made: Hypothesis, goal: Goal, output: Output) -> bool:
    """Whether the goal's state lets the output leave (see ``transports.actions``); it is changed."""
    running = goal.phase in ("running", "canceling")
    match output.kind:
        case OutputKind.ACCEPT_GOAL:
            if goal.phase != "new":
                return False
            change(made, goal, phase="running")
            return True
        case OutputKind.REJECT_GOAL:
            if goal.phase == "new":
                made.goals = tuple(g for g in made.goals if g is not goal)
                return True
            return False
        case OutputKind.FEEDBACK:
            return running
        case kind:
            if goal.phase == "ended":
                return False
            refused = kind is OutputKind.CANCEL and goal.phase == "running"
            change(made, goal, phase="ended", result=(kind, output.fields))
            return running and not refused


def change(made: Hypothesis, goal: Goal, **changes: Any) -> None:
    """Change ``goal`` of a hypothesis that is being made."""
    made.goals = tuple(g.but(**changes) if g is goal else g for g in made.goals)


def changed(hypothesis: Hypothesis, goal: Goal, **changes: Any) -> Hypothesis:
    """``hypothesis`` with ``goal`` changed."""
    made = hypothesis.copy()
    made.goals = tuple(
        g.but(**changes) if g.number == goal.number and g.served == goal.served else g
        for g in made.goals
    )
    return made


def adopt(
    hypothesis: Hypothesis, interface: str, goal_id: str, served: bool, phase: str
) -> tuple[Hypothesis, Goal]:
    """``hypothesis`` with a further goal."""
    return adopt_in_place(hypothesis.copy(), interface, goal_id, served, phase)


def adopt_in_place(
    made: Hypothesis, interface: str, goal_id: str, served: bool, phase: str
) -> tuple[Hypothesis, Goal]:
    """A further goal, numbered as the node numbers them."""
    counts = dict(made.counts)
    number = counts.get((served, interface), 0) + 1
    counts[served, interface] = number
    goal = Goal(interface, served, number, goal_id, phase)
    made.counts = tuple(sorted(counts.items()))
    ended = [g for g in made.goals if g.phase == "ended"]
    forgotten = set(map(id, ended[: max(0, len(ended) - KEPT_GOALS)]))
    made.goals = (*(g for g in made.goals if id(g) not in forgotten), goal)
    return made, goal


def goal_to_cancel(made: Hypothesis, interface: str, number: Any) -> Goal | None:
    """The goal that a cancel request means; without a number, the last one sent."""
    sent = [g for g in made.goals if not g.served and g.interface == interface]
    if isinstance(number, Unknown):
        return None
    if not number:
        number = dict(made.counts).get((False, interface), 0)
    return next((g for g in sent if g.number == number), None)


def served_goal(made: Hypothesis, output: Output) -> Goal | None:
    """The goal that an output of the machine names."""
    for goal in made.goals:
        if goal.served and goal.interface == output.interface and goal.number == output.goal:
            return goal
    return None
