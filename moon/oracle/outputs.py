"""What a machine may be doing that sent something: which hypotheses owed it, and what they are then."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from m2c.model.machine import OutputKind
from moon.oracle.bounds import Bounds
from moon.oracle.channels import Channels
from moon.oracle.program import Program
from moon.oracle.state import (
    ANY_CALL,
    Hypothesis,
    Obligation,
    TimerKey,
    adopt_goal,
    distinct,
    goal_called,
    with_goal_changed,
)
from moon.oracle.trace_events import TraceEvent, stamp_of
from moon.oracle.unknowns import Unknown, agree, filled_in, is_unknown, learned
from transports.actions.rules import Phase

_ENDS = (OutputKind.SUCCEED, OutputKind.ABORT, OutputKind.CANCEL)


class Outputs:
    """What a machine that sent something may be doing then.

    Args:
        program: the machine.
        channels: its channels.
        bounds: what is assumed.
        due_since: when (ns) what the machine takes at a time (ns) was due at the earliest.
    """

    def __init__(
        self,
        program: Program,
        channels: Channels,
        bounds: Bounds,
        due_since: Callable[[int], int],
    ) -> None:
        self._draws = program.draws
        self._types = channels.types
        self._bounds = bounds
        self._due_since = due_since
        self._early, self._late = bounds.skew, bounds.skew + bounds.deadline
        """An output is stamped by this much before and after the step that owes it (ns)."""

    def take(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The machine sent ``fact``: those of ``candidates`` that owe it next."""
        made: list[Hypothesis] = []
        for hypothesis in candidates:
            for place, expected in enumerate(hypothesis.owed):
                if self.is_owed(hypothesis, expected, fact):
                    found = [self.fulfilled(hypothesis, place, fact)]
                    slept = self.slept(hypothesis, expected.timer, fact.stamp)
                    if slept is not None:
                        found.append(self.fulfilled(slept, place, fact))
                    if expected.goal.__class__ is Unknown and fact.output is OutputKind.FEEDBACK:
                        found += _canceling(hypothesis, found, fact)
                    made += found
                if not expected.optional:
                    break
        return distinct(made)

    def is_owed(self, hypothesis: Hypothesis, owed: Obligation, fact: TraceEvent) -> bool:
        """Whether ``fact`` can be what ``hypothesis`` owes by ``owed``."""
        if owed.kind is not fact.output or owed.interface != fact.interface:
            return False
        if not owed.low - self._early <= fact.stamp <= owed.high + self._late:
            return False
        call, goal = owed.call, owed.goal
        if call is not None and call not in (fact.call, ANY_CALL):
            return False
        if goal is not None and not _is_goal(hypothesis, goal, fact):
            return False
        if fact.data is None and fact.output in _ENDS:
            return True  # a status shows that a goal has ended, not with what
        kind = self._types.get((owed.kind, owed.interface))
        return kind is None or agree(owed.data, fact.data, kind)

    def slept(self, hypothesis: Hypothesis, key: TimerKey | None, stamp: int) -> Hypothesis | None:
        """``hypothesis`` if the timer rang only just before ``stamp``, and was due again by then.

        Its node stood still: the times slept through are skipped (see ``Executor``). None: it was not due.
        """
        if key is None:
            return None
        made = [
            timer.not_before(stamp) if (timer.instance, timer.event) == key else timer
            for timer in hypothesis.timers
        ]
        if all(new is old for new, old in zip(made, hypothesis.timers, strict=True)):
            return None
        return hypothesis.with_timers(tuple(made))

    def fulfilled(self, hypothesis: Hypothesis, place: int, fact: TraceEvent) -> Hypothesis:
        """``hypothesis`` once what it owed at ``place`` was seen."""
        owed = hypothesis.owed[place]
        rest = hypothesis.with_owed(hypothesis.owed[place + 1 :])
        if owed.timer is not None:
            rest = self._phase_seen(rest, owed.timer, fact.stamp)
        if owed.call == ANY_CALL:
            asked = (owed.interface, fact.call)
            rest = rest.but(waiting=tuple(item for item in rest.waiting if item != asked))
        if owed.kind is OutputKind.SEND_GOAL:
            goals = tuple(
                goal.but(identifier=fact.goal)
                if not goal.served and goal.number == owed.goal and goal.interface == owed.interface
                else goal
                for goal in rest.goals
            )
            rest = rest.but(goals=goals)
        found: dict[int, tuple[Unknown, Any]] = {}
        if isinstance(owed.goal, Unknown) and fact.goal:
            known = goal_called(rest, owed.interface, fact.goal, served=True)
            if known is None:
                rest, known = adopt_goal(rest, owed.interface, fact.goal, True, Phase.RUNNING)
            found[id(owed.goal)] = (owed.goal, known.name)
        if owed.kind is OutputKind.ACCEPT_GOAL:
            rest = _acceptance_seen(rest, fact)
        elif owed.kind is OutputKind.REJECT_GOAL and isinstance(owed.goal, Unknown):
            rest = _rejection_seen(rest, fact)
        elif owed.kind in _ENDS:
            rest = self._end_seen(rest, owed, fact)
        if (self._draws or rest.free or rest.vague) and is_unknown(owed.data):
            learned(owed.data, fact.data, found)
        return _substituted(rest, found) if found else rest

    def _phase_seen(self, hypothesis: Hypothesis, key: TimerKey, stamp: int) -> Hypothesis:
        """A timer rang at ``stamp`` at the latest: its next time is within a period of that."""
        made = []
        for timer in hypothesis.timers:
            if (timer.instance, timer.event) == key:
                low = max(timer.low, self._due_since(stamp))
                high = max(
                    low, min(timer.high, stamp + timer.period + self._bounds.slack(timer.period))
                )
                made.append(timer.due(low, high))
            else:
                made.append(timer)
        return hypothesis.with_timers(tuple(made))

    def _end_seen(self, hypothesis: Hypothesis, owed: Obligation, fact: TraceEvent) -> Hypothesis:
        goals = []
        for goal in hypothesis.goals:
            same = goal.served and goal.id == fact.goal and goal.interface == owed.interface
            ended = {"seen": True, "phase": Phase.ENDED, "result": (owed.kind, owed.data)}
            goals.append(goal.but(**ended) if same else goal)
        return hypothesis.but(goals=tuple(goals))

    def take_status(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The status of all goals: those that have ended since are outputs."""
        found: list[Hypothesis] = []
        for hypothesis in candidates:
            current = [hypothesis]
            seen = {
                (goal.id, goal.result[0])
                for goal in hypothesis.goals
                if goal.served and goal.seen and goal.result and goal.interface == fact.interface
            }
            for goal_id, kind in fact.data:
                if (goal_id, kind) in seen:
                    continue
                current = [
                    made
                    for before in current
                    for made in self._goal_ended(before, fact, goal_id, kind)
                ]
            found += current
        return distinct(found)

    def _goal_ended(
        self, hypothesis: Hypothesis, fact: TraceEvent, goal_id: str, kind: OutputKind
    ) -> list[Hypothesis]:
        goal = goal_called(hypothesis, fact.interface, goal_id, served=True)
        if goal is None:
            # ended before the oracle looked, or just now by a machine of which little is known
            if not hypothesis.free or not hypothesis.owed:
                return [hypothesis]
        elif goal.seen:
            return [hypothesis] if goal.result is None or goal.result[0] is kind else []
        end = TraceEvent(fact.observation, fact.role, fact.interface, output=kind, goal=goal_id)
        paid = self.take([hypothesis], end)
        return [*paid, hypothesis] if goal is None else paid

    def take_result(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """A goal's result leaves: as the end itself, or long after it."""
        found: list[Hypothesis] = []
        kind = self._types.get((OutputKind.SUCCEED, fact.interface))
        for hypothesis in candidates:
            goal = goal_called(hypothesis, fact.interface, fact.goal, served=True)
            if goal is None and hypothesis.free:
                found += [*self.take([hypothesis], fact), hypothesis]
            elif goal is not None and goal.seen and goal.result is not None:
                if goal.result[0] is fact.output and agree(goal.result[1], fact.data, kind):
                    found.append(hypothesis)
            elif goal is not None:
                found += self.take([hypothesis], fact)
        return distinct(found)


def _acceptance_seen(hypothesis: Hypothesis, fact: TraceEvent) -> Hypothesis:
    """The server told the client when it accepted the goal: cancel requests up to some time mean that.

    It runs from then on, also where it was not known which goal was accepted.
    """
    stamp = stamp_of(fact.observation.data)
    goals = tuple(
        goal.but(stamp=stamp, phase=Phase.RUNNING if goal.phase is Phase.NEW else goal.phase)
        if goal.served and goal.id == fact.goal and goal.interface == fact.interface
        else goal
        for goal in hypothesis.goals
    )
    return hypothesis.but(goals=goals)


def _rejection_seen(hypothesis: Hypothesis, fact: TraceEvent) -> Hypothesis:
    """A goal was rejected of which it was not known which one it is: it is forgotten."""
    goal = goal_called(hypothesis, fact.interface, fact.goal, served=True)
    if goal is None:
        return hypothesis
    return hypothesis.but(goals=tuple(g for g in hypothesis.goals if g is not goal))


def _canceling(before: Hypothesis, found: list[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
    """``found``, where the feedback is of a goal that was not known ``before``, once that is to be cancelled.

    It may have been asked for before the oracle looked.
    """
    if goal_called(before, fact.interface, fact.goal, served=True) is not None:
        return []
    made = []
    for hypothesis in found:
        goal = goal_called(hypothesis, fact.interface, fact.goal, served=True)
        if goal is not None:
            made.append(with_goal_changed(hypothesis, goal, phase=Phase.CANCELING))
    return made


def _is_goal(hypothesis: Hypothesis, goal: Any, fact: TraceEvent) -> bool:
    """Whether ``fact`` can be about ``goal``, as ``Obligation.goal`` names it."""
    if isinstance(goal, Unknown):
        known = goal_called(hypothesis, fact.interface, fact.goal, served=True)
        return known is None or is_unknown(known.name) or goal.allows(known.name)
    return not isinstance(goal, str) or goal == fact.goal


def _substituted(hypothesis: Hypothesis, found: Mapping[int, tuple[Unknown, Any]]) -> Hypothesis:
    """``hypothesis`` with what was learnt of unknown values put in their place."""
    made = hypothesis.copy()
    made.instances = tuple(
        (state, tuple(filled_in(value, found) for value in data))
        for state, data in hypothesis.instances
    )
    made.owed = tuple(_owed_with(owed, found) for owed in hypothesis.owed)
    made.goals = tuple(
        goal.but(name=found[id(goal.name)][1]) if id(goal.name) in found else goal
        for goal in hypothesis.goals
    )
    return made


def _owed_with(owed: Obligation, found: Mapping[int, tuple[Unknown, Any]]) -> Obligation:
    if not is_unknown(owed.data) and not isinstance(owed.goal, Unknown):
        return owed
    made = owed.due(owed.low, owed.high)
    made.data, made.goal = filled_in(owed.data, found), filled_in(owed.goal, found)
    return made
