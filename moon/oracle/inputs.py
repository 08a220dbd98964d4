"""What a machine may be doing that took an input which is stamped where it is taken.

Those are requests, goals, what becomes of calls, and messages that the node reports to have taken.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from m2c.diagnostics import Position
from m2c.model.machine import EventKind, OutputKind
from moon.oracle.bounds import TooManyError
from moon.oracle.channels import Channels
from moon.oracle.program import Program
from moon.oracle.state import (
    Goal,
    Hypothesis,
    Obligation,
    add_goal,
    adopt_goal,
    distinct,
    goal_called,
    perhaps_cancel,
    with_goal_changed,
)
from moon.oracle.successors import Occasion, Successors
from moon.oracle.trace_events import TraceEvent, identifier, stamp_of
from transports.actions.rules import CancelScope, Phase


class Inputs:
    """What a machine that took an input may be doing then.

    Args:
        successors: its steps.
        program: the machine.
        channels: its channels.
    """

    def __init__(self, successors: Successors, program: Program, channels: Channels) -> None:
        self._successors = successors
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
                    asked, 0, event, fact.data, {}, Occasion(stamp, stamp, call=fact.call)
                )
            case EventKind.GOAL:
                yield from self._goal_input(hypothesis, fact)
            case EventKind.CANCEL:
                yield from self._cancel_input(hypothesis, fact)
            case EventKind.MESSAGE:
                yield from self._successors.run_everywhere(
                    hypothesis, event, fact.data, {}, Occasion(stamp, stamp)
                )
            case EventKind.FEEDBACK:
                yield from self._feedback_input(hypothesis, fact)
            case EventKind.RESPONSE | EventKind.CALL_ERROR:
                yield from self._successors.run(
                    hypothesis, 0, event, fact.data, {}, Occasion(stamp, stamp)
                )
            case _:
                yield from self._goal_event(hypothesis, fact)

    def _goal_input(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        known = goal_called(hypothesis, fact.interface, fact.goal, served=True)
        if known is not None:
            yield self._owing(hypothesis, OutputKind.REJECT_GOAL, known, fact)
            return
        grown = hypothesis.copy()
        goal = add_goal(grown, fact.interface, fact.goal, served=True)
        assert fact.event is not None
        parts = {"goal_id": goal.name}
        for taken, step in self._successors.take(grown, 0, fact.event, fact.data, parts):
            made = self._successors.absorb(grown, 0, step, Occasion(fact.stamp, fact.stamp))
            # what no transition takes, and nothing has answered, is rejected by the node
            yield made if taken or goal not in made.goals else self._reject(made, goal, fact)

    def _reject(self, hypothesis: Hypothesis, goal: Goal, fact: TraceEvent) -> Hypothesis:
        goals = tuple(g for g in hypothesis.goals if not g.is_same(goal))
        rejected = hypothesis.but(goals=goals)
        return self._owing(rejected, OutputKind.REJECT_GOAL, goal, fact)

    def _owing(
        self,
        hypothesis: Hypothesis,
        kind: OutputKind,
        goal: Goal,
        fact: TraceEvent,
        optional: bool = False,
    ) -> Hypothesis:
        """``hypothesis`` with something more to be sent about ``goal``, by the node and not by a
        statement of the model.
        """
        place = self._place
        owed = Obligation(
            *(kind, goal.interface, None, fact.stamp, fact.stamp, place, place),
            goal=goal.id or None,
            optional=optional,
        )
        return hypothesis.but(owed=(*hypothesis.owed, owed))

    def _cancel_input(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        """See ``transports.actions.rules``: which goals a cancel request means, and who hears of it."""
        scope = CancelScope(identifier(fact.data["goal_id"]), stamp_of(fact.data))
        found, name = [hypothesis], fact.interface
        if hypothesis.free:
            if not scope.is_one_goal:
                raise TooManyError(
                    f"a cancel request on {name} for goals from before it was observed"
                )
            if goal_called(hypothesis, name, scope.goal_id, served=True) is None:
                found.append(adopt_goal(hypothesis, name, scope.goal_id, True, Phase.RUNNING)[0])
        for known in found:
            for chosen in _chosen(known, name, scope):
                yield from self._canceled(known, chosen, fact)

    def _canceled(
        self, hypothesis: Hypothesis, chosen: Sequence[Goal], fact: TraceEvent
    ) -> Iterable[Hypothesis]:
        """``hypothesis`` once ``chosen`` are to be canceled: all of them are, then each is told."""
        goals = tuple(
            goal.but(phase=Phase.CANCELING) if goal in chosen else goal for goal in hypothesis.goals
        )
        found: list[Hypothesis] = [hypothesis.but(goals=goals)]
        for goal in chosen:
            following: list[Hypothesis] = []
            for before in found:
                if not any(g.is_same(goal) and g.phase is Phase.CANCELING for g in before.goals):
                    following.append(before)  # what was told of another goal has ended this one
                    continue
                following += self._successors.run_everywhere(
                    before,
                    (EventKind.CANCEL, fact.interface),
                    None,
                    {"goal_id": goal.name},
                    Occasion(fact.stamp, fact.stamp),
                )
            found = following
        return found

    def _feedback_input(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        """Feedback is taken at once, or kept until its goal is accepted; of other goals it is nothing."""
        event, stamp = fact.event, fact.stamp
        assert event is not None
        found = [hypothesis]
        is_known = goal_called(hypothesis, fact.interface, fact.goal, served=False) is not None
        if hypothesis.free and not is_known and not self._channels.was_sent(fact.goal):
            # if it is kept, it is what may have been kept once the goal is accepted (``_goal_event``)
            adopted, _ = adopt_goal(hypothesis, fact.interface, fact.goal, False, Phase.RUNNING)
            found.append(adopted)
        for known in found:
            goal = goal_called(known, fact.interface, fact.goal, served=False)
            if goal is None:
                yield known
            elif goal.phase is Phase.RUNNING:
                parts = {"goal_id": goal.name}
                yield from self._successors.run_everywhere(
                    known, event, fact.data, parts, Occasion(stamp, stamp)
                )
            else:
                yield known.with_pending((*known.pending, fact))

    def _goal_event(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        """What becomes of a goal that the machine sent."""
        event = fact.event
        assert event is not None
        goal = goal_called(hypothesis, fact.interface, fact.goal, served=False)
        is_older = goal is None
        if goal is None:
            if not hypothesis.free or self._channels.was_sent(fact.goal):
                yield hypothesis  # not a goal of this machine's model, or one that has ended
                return
            hypothesis, goal = adopt_goal(hypothesis, fact.interface, fact.goal, False, Phase.NEW)
            perhaps_cancel(hypothesis, fact.interface)
            goal = next(known for known in hypothesis.goals if known.is_same(goal))
        codes = {EventKind.SUCCEEDED: 4, EventKind.CANCELED: 5, EventKind.ABORTED: 6}
        parts: dict[str, Any] = {"goal_id": goal.name}
        if event[0] in codes:
            parts["code"] = codes[event[0]]
        if event[0] is EventKind.GOAL_ACCEPTED:
            accepted = with_goal_changed(hypothesis, goal, phase=Phase.RUNNING, cancel=False)
            if is_older:
                accepted = self._successors.with_kept_feedback(accepted, fact.interface, fact.stamp)
            for made in self._successors.run(
                accepted, 0, event, fact.data, parts, Occasion(fact.stamp, fact.stamp)
            ):
                cancel, is_perhaps = OutputKind.SEND_CANCEL, goal.cancel is None
                is_due = is_perhaps or goal.cancel
                yield self._owing(made, cancel, goal, fact, is_perhaps) if is_due else made
            return
        goals = tuple(g for g in hypothesis.goals if not g.is_same(goal))
        ended = hypothesis.but(goals=goals)
        yield from self._successors.run(
            ended, 0, event, fact.data, parts, Occasion(fact.stamp, fact.stamp)
        )


def _chosen(hypothesis: Hypothesis, interface: str, scope: CancelScope) -> list[tuple[Goal, ...]]:
    """The running goals that a cancel request means: each possibility, as far as is known."""
    found: list[tuple[Goal, ...]] = [()]
    for goal in hypothesis.goals:
        if not goal.served or goal.interface != interface or goal.phase is not Phase.RUNNING:
            continue
        included = scope.includes(goal.id, goal.phase, goal.stamp)
        if included is True:
            found = [(*goals, goal) for goals in found]
        elif included is None:
            found += [(*goals, goal) for goals in found]
    return found
