"""Fixed points: what a hypothesis is after an input or an output that is stamped where it happened.

``Inputs`` are requests, goals and what becomes of calls: the machine took them at their stamps. ``Outputs``
are what it sent: some hypotheses owed it next, the others die.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from m2c.model.diagnostics import Position
from m2c.model.machine import EventKind, OutputKind
from moon.oracle.bounds import Bounds
from moon.oracle.program import Program
from moon.oracle.state import (
    ANY_CALL,
    Goal,
    Hypothesis,
    Obligation,
    TimerKey,
    adopt,
    changed,
    distinct,
    goal_called,
)
from moon.oracle.successors import Successors
from moon.oracle.trace_events import Channels, EventKey, TraceEvent, identifier
from moon.oracle.unknowns import Unknown, agree, is_unknown, learned

_ENDS = (OutputKind.SUCCEED, OutputKind.ABORT, OutputKind.CANCEL)


class Inputs:
    """What a machine that took an input may be doing then.

    Args:
        successors: its steps.
        program: the machine.
        channels: its channels.
    """

    def __init__(self, successors: Successors, program: Program, channels: Channels) -> None:
        self._successors = successors
        self._instances = len(program.parts)
        self._place: Position = program.machine.position
        self._channels = channels

    def take(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The machine took ``fact`` at its stamp; none of ``candidates`` owes anything for sure."""
        made: list[Hypothesis] = []
        for hypothesis in candidates:
            rest = hypothesis.with_owed(()) if hypothesis.owed else hypothesis
            made += self._after(self._successors.normalised(rest, fact.stamp), fact)
        return distinct(made)

    def _after(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        event, stamp = fact.event, fact.stamp
        assert event is not None
        kind = event[0]
        match kind:
            case EventKind.REQUEST:
                waiting = (*hypothesis.waiting, (fact.interface, fact.call))
                asked = hypothesis.but(waiting=waiting)
                yield from self._successors.run(
                    asked, 0, event, fact.data, {}, stamp, stamp, call=fact.call
                )
            case EventKind.GOAL:
                yield from self._goal_input(hypothesis, fact)
            case EventKind.CANCEL:
                yield from self._cancel_input(hypothesis, fact)
            case EventKind.RESPONSE | EventKind.CALL_ERROR | EventKind.MESSAGE:
                yield from self._successors.run(hypothesis, 0, event, fact.data, {}, stamp, stamp)
            case _:
                yield from self._goal_event(hypothesis, fact)

    def _goal_input(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        if goal_called(hypothesis, fact.goal, served=True) is not None:
            yield hypothesis  # a second goal of the same id: rejected before the machine hears it
            return
        grown, goal = adopt(hypothesis, fact.interface, fact.goal, True, "new")
        assert fact.event is not None
        parts = {"goal_id": goal.number}
        for taken, step in self._successors.take(grown, 0, fact.event, fact.data, parts):
            made = self._successors.absorb(grown, 0, step, fact.stamp, fact.stamp)
            # what no transition takes is rejected by the node
            yield made if taken else self._reject(made, goal, fact)

    def _reject(self, hypothesis: Hypothesis, goal: Goal, fact: TraceEvent) -> Hypothesis:
        goals = tuple(g for g in hypothesis.goals if g.number != goal.number or not g.served)
        rejected = hypothesis.but(goals=goals)
        return self._owing(rejected, OutputKind.REJECT_GOAL, goal, fact)

    def _owing(
        self, hypothesis: Hypothesis, kind: OutputKind, goal: Goal, fact: TraceEvent
    ) -> Hypothesis:
        """``hypothesis`` with something more to be sent about ``goal``, by the node and not by a
        statement of the model.
        """
        place = self._place
        owed = Obligation(
            kind, goal.interface, None, fact.stamp, fact.stamp, place, place, goal=goal.id
        )
        return hypothesis.but(owed=(*hypothesis.owed, owed))

    def _cancel_input(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        """See ``transports.actions``: which goals a cancel request means, and who hears of it."""
        info = fact.data
        wanted = identifier(info["goal_id"])
        named = any(info["goal_id"]["uuid"])
        timed = bool(info["stamp"]["sec"] or info["stamp"]["nanosec"])
        found = [hypothesis]
        goal = goal_called(hypothesis, wanted, served=True)
        if named and goal is None and hypothesis.free:
            grown, goal = adopt(hypothesis, fact.interface, wanted, True, "running")
            found = [hypothesis, grown]
        if named and not timed:
            chosen = [] if goal is None else [goal]
        else:
            chosen = [g for g in hypothesis.goals if g.served and g.interface == fact.interface]
        for each in chosen:
            if each.phase != "running":
                continue
            following: list[Hypothesis] = []
            for before in found:
                if all(g.number != each.number or not g.served for g in before.goals):
                    following.append(before)
                    continue
                canceling = changed(before, each, phase="canceling")
                following += self._everywhere(
                    canceling,
                    (EventKind.CANCEL, fact.interface),
                    {"goal_id": each.number},
                    fact.stamp,
                )
            found = following
        yield from found

    def _everywhere(
        self, hypothesis: Hypothesis, event: EventKey, parts: Mapping[str, Any], stamp: int
    ) -> list[Hypothesis]:
        """``event`` for the machine and then for each of its threads, as one piece of work."""
        found = [hypothesis]
        for instance in range(self._instances):
            found = [
                made
                for before in found
                for made in self._successors.run(before, instance, event, None, parts, stamp, stamp)
            ]
        return found

    def _goal_event(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        """What becomes of a goal that the machine sent."""
        event = fact.event
        assert event is not None
        goal = goal_called(hypothesis, fact.goal, served=False)
        if goal is None:
            if not hypothesis.free or self._channels.was_sent(fact.goal):
                yield hypothesis  # not a goal of this machine's model, or one that has ended
                return
            hypothesis, goal = adopt(hypothesis, fact.interface, fact.goal, False, "sent")
        codes = {EventKind.SUCCEEDED: 4, EventKind.CANCELED: 5, EventKind.ABORTED: 6}
        parts: dict[str, Any] = {"goal_id": goal.number}
        if event[0] in codes:
            parts["code"] = codes[event[0]]
        if event[0] is EventKind.GOAL_ACCEPTED:
            accepted = changed(hypothesis, goal, phase="running", cancel=False)
            for made in self._successors.run(
                accepted, 0, event, fact.data, parts, fact.stamp, fact.stamp
            ):
                cancel = OutputKind.SEND_CANCEL
                yield self._owing(made, cancel, goal, fact) if goal.cancel else made
            return
        goals = tuple(g for g in hypothesis.goals if g.served or g.number != goal.number)
        ended = hypothesis.but(goals=goals)
        yield from self._successors.run(ended, 0, event, fact.data, parts, fact.stamp, fact.stamp)


class Outputs:
    """What a machine that sent something may be doing then.

    Args:
        program: the machine.
        channels: its channels.
        bounds: what is assumed.
    """

    def __init__(self, program: Program, channels: Channels, bounds: Bounds) -> None:
        self._draws = program.draws
        self._types = channels.types
        self._bounds = bounds
        self._early, self._late = bounds.skew, bounds.skew + bounds.deadline
        """An output is stamped by this much before and after the step that owes it (ns)."""

    def take(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The machine sent ``fact``: those of ``candidates`` that owe it next."""
        made: list[Hypothesis] = []
        for hypothesis in candidates:
            for place, expected in enumerate(hypothesis.owed):
                if self.is_owed(hypothesis, expected, fact):
                    made.append(self.settled(hypothesis, place, fact))
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
            return True  # a status tells that a goal has ended, not with what
        kind = self._types.get((owed.kind, owed.interface))
        return kind is None or agree(owed.data, fact.data, kind)

    def settled(self, hypothesis: Hypothesis, place: int, fact: TraceEvent) -> Hypothesis:
        """``hypothesis`` once what it owed at ``place`` was seen."""
        owed = hypothesis.owed[place]
        rest = hypothesis.with_owed(hypothesis.owed[place + 1 :])
        if owed.timer is not None:
            rest = self._phase_seen(rest, owed.timer, fact.stamp)
        if owed.kind is OutputKind.SEND_GOAL:
            goals = tuple(
                goal.but(identifier=fact.goal)
                if not goal.served and goal.number == owed.goal and goal.interface == owed.interface
                else goal
                for goal in rest.goals
            )
            rest = rest.but(goals=goals)
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
        for timer in hypothesis.timers:
            if (timer.instance, timer.event) == key:
                low = max(timer.low, stamp - self._bounds.latency)
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
            goals.append(goal.but(seen=True, result=(owed.kind, owed.data)) if same else goal)
        return hypothesis.but(goals=tuple(goals))

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
        paid = self.take([hypothesis], end)
        return paid or ([hypothesis] if goal is None else [])

    def take_result(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """A goal's result leaves: as the end itself, or long after it."""
        found: list[Hypothesis] = []
        kind = self._types.get((OutputKind.SUCCEED, fact.interface))
        for hypothesis in candidates:
            goal = goal_called(hypothesis, fact.goal, served=True)
            if goal is None and hypothesis.free:
                found += self.take([hypothesis], fact) or [hypothesis]
            elif goal is not None and goal.seen and goal.result is not None:
                if goal.result[0] is fact.output and agree(goal.result[1], fact.data, kind):
                    found.append(hypothesis)
            elif goal is not None:
                found += self.take([hypothesis], fact)
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

    made = hypothesis.copy()
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
