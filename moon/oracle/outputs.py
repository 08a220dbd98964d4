"""Outputs: which hypotheses owed them, and what they tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from m2c.model.machine import OutputKind
from moon.oracle.goals import adopt, but, goal_called
from moon.oracle.hypothesis import (
    ANY_CALL,
    Hypothesis,
    Obligation,
    TimerKey,
    distinct,
)
from moon.oracle.inputs import Inputs
from moon.oracle.matching import agree, learned
from moon.oracle.trace_events import TraceEvent
from moon.oracle.unknowns import Unknown, is_unknown

_ENDS = (OutputKind.SUCCEED, OutputKind.ABORT, OutputKind.CANCEL)


class Outputs(Inputs):
    """What a machine that sent something may be doing then."""

    def take_output(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The machine sent ``fact``: those of ``candidates`` that owe it next."""
        made: list[Hypothesis] = []
        for hypothesis in candidates:
            for place, expected in enumerate(hypothesis.owed):
                if self._is(hypothesis, expected, fact):
                    made.append(self._paid(hypothesis, place, fact))
                if not expected.optional:
                    break
        return distinct(made)

    def _is(self, hypothesis: Hypothesis, owed: Obligation, fact: TraceEvent) -> bool:
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
            return True  # a status tells that a goal has ended, not with what
        kind = self._channels.types.get((owed.kind, owed.interface))
        return kind is None or agree(owed.data, fact.data, kind)

    def _paid(self, hypothesis: Hypothesis, place: int, fact: TraceEvent) -> Hypothesis:
        """``hypothesis`` once what it owed at ``place`` was seen."""
        owed = hypothesis.owed[place]
        rest = hypothesis.with_owed(hypothesis.owed[place + 1 :])
        if owed.alarm is not None:
            rest = self._phase_seen(rest, owed.alarm, fact.stamp)
        if owed.kind is OutputKind.SEND_GOAL:
            goals = tuple(
                goal.but(identifier=fact.goal)
                if not goal.served and goal.number == owed.goal and goal.interface == owed.interface
                else goal
                for goal in rest.goals
            )
            rest = but(rest, goals=goals)
        elif owed.kind in _ENDS:
            rest = self._end_seen(rest, owed, fact)
        found: dict[int, tuple[Unknown, Any]] = {}
        if (self._draws or rest.free) and is_unknown(owed.data):
            learned(owed.data, fact.data, found)
        if isinstance(owed.goal, Unknown) and fact.goal:
            known = goal_called(rest, fact.goal, served=True)
            if known is None:
                rest, known = adopt(rest, owed.interface, fact.goal, True, "running")
            found[id(owed.goal)] = (owed.goal, known.number)
        return _substituted(rest, found) if found else rest

    def _phase_seen(self, hypothesis: Hypothesis, key: TimerKey, stamp: int) -> Hypothesis:
        """A timer rang at ``stamp`` at the latest: its next time is within a period of that."""
        made = []
        for alarm in hypothesis.alarms:
            if (alarm.instance, alarm.event) == key:
                low = max(alarm.low, stamp - self.bounds.latency)
                high = max(low, min(alarm.high, stamp + alarm.period + self._slack(alarm.period)))
                made.append(alarm.due(low, high))
            else:
                made.append(alarm)
        return hypothesis.with_alarms(tuple(made))

    def _end_seen(self, hypothesis: Hypothesis, owed: Obligation, fact: TraceEvent) -> Hypothesis:
        goals = []
        for goal in hypothesis.goals:
            same = goal.served and goal.id == fact.goal and goal.interface == owed.interface
            goals.append(goal.but(seen=True, result=(owed.kind, owed.data)) if same else goal)
        return but(hypothesis, goals=tuple(goals))

    def take_status(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The status of all goals: those that have ended since are outputs."""
        found: list[Hypothesis] = []
        for hypothesis in candidates:
            current = [hypothesis]
            for goal_id, kind in fact.data:
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
        goal = goal_called(hypothesis, goal_id, served=True)
        if goal is None:
            # ended before the oracle looked, or just now by a machine of which little is known
            if not hypothesis.free or not hypothesis.owed:
                return [hypothesis]
        elif goal.seen:
            return [hypothesis] if goal.result is None or goal.result[0] is kind else []
        end = TraceEvent(fact.observation, fact.role, fact.interface, None, kind, None, goal_id)
        paid = self.take_output([hypothesis], end)
        return paid or ([hypothesis] if goal is None else [])

    def take_result(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """A goal's result leaves: as the end itself, or long after it."""
        found: list[Hypothesis] = []
        kind = self._channels.types.get((OutputKind.SUCCEED, fact.interface))
        for hypothesis in candidates:
            goal = goal_called(hypothesis, fact.goal, served=True)
            if goal is None and hypothesis.free:
                found += self.take_output([hypothesis], fact) or [hypothesis]
            elif goal is not None and goal.seen and goal.result is not None:
                if goal.result[0] is fact.output and agree(goal.result[1], fact.data, kind):
                    found.append(hypothesis)
            elif goal is not None:
                found += self.take_output([hypothesis], fact)
        return distinct(found)


def _is_goal(hypothesis: Hypothesis, goal: Any, fact: TraceEvent) -> bool:
    """Whether ``fact`` can be about ``goal``, as ``Obligation.goal`` names it."""
    if isinstance(goal, Unknown):
        known = goal_called(hypothesis, fact.goal, served=True)
        return known is None or goal.allows(known.number)
    return not isinstance(goal, str) or goal == fact.goal


def _substituted(hypothesis: Hypothesis, found: Mapping[int, tuple[Unknown, Any]]) -> Hypothesis:
    """``hypothesis`` with what was learnt of unknown values put in their place."""

    def put(value: Any) -> Any:
        if isinstance(value, Unknown):
            return found[id(value)][1] if id(value) in found else value
        if isinstance(value, dict):
            return {name: put(item) for name, item in value.items()}
        if isinstance(value, list):
            return [put(item) for item in value]
        return value

    made = but(hypothesis)
    made.instances = tuple(
        (state, tuple(put(value) for value in data)) for state, data in hypothesis.instances
    )
    made.owed = tuple(_owed_with(owed, put) for owed in hypothesis.owed)
    return made


def _owed_with(owed: Obligation, put: Any) -> Obligation:
    if not is_unknown(owed.data) and not isinstance(owed.goal, Unknown):
        return owed
    made = owed.due(owed.low, owed.high)
    made.data, made.goal = put(owed.data), put(owed.goal)
    return made
