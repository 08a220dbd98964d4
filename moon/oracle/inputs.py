"""Inputs that are stamped where the machine took them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from m2c.model.machine import EventKind, OutputKind
from moon.oracle.goals import adopt, but, changed, goal_called
from moon.oracle.hypothesis import EventKey, Goal, Hypothesis, Obligation, distinct
from moon.oracle.readers import identifier
from moon.oracle.running import Running
from moon.oracle.trace_events import TraceEvent


class Inputs(Running):
    """What a machine that took an input may be doing then."""

    def take_input(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The machine took ``fact`` at its stamp; none of ``candidates`` owes anything for sure."""
        made: list[Hypothesis] = []
        for hypothesis in candidates:
            rest = hypothesis.with_owed(()) if hypothesis.owed else hypothesis
            made += self._input(self.normalised(rest, fact.stamp), fact)
        return distinct(made)

    def _input(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        event, stamp = fact.event, fact.stamp
        assert event is not None
        kind = event[0]
        match kind:
            case EventKind.REQUEST:
                waiting = (*hypothesis.waiting, (fact.interface, fact.call))
                asked = but(hypothesis, waiting=waiting)
                yield from self.run(asked, 0, event, fact.data, {}, stamp, stamp, call=fact.call)
            case EventKind.GOAL:
                yield from self._goal_input(hypothesis, fact)
            case EventKind.CANCEL:
                yield from self._cancel_input(hypothesis, fact)
            case EventKind.RESPONSE | EventKind.CALL_ERROR:
                yield from self.run(hypothesis, 0, event, fact.data, {}, stamp, stamp)
            case EventKind.MESSAGE:
                yield from self.run(hypothesis, 0, event, fact.data, {}, stamp, stamp)
            case _:
                yield from self._goal_event(hypothesis, fact)

    def _goal_input(self, hypothesis: Hypothesis, fact: TraceEvent) -> Iterator[Hypothesis]:
        if goal_called(hypothesis, fact.goal, served=True) is not None:
            yield hypothesis  # a second goal of the same id: rejected before the machine hears it
            return
        grown, goal = adopt(hypothesis, fact.interface, fact.goal, True, "new")
        assert fact.event is not None
        parts = {"goal_id": goal.number}
        for taken, step in self._take(grown, 0, fact.event, fact.data, parts):
            made = self._absorb(grown, 0, step, fact.stamp, fact.stamp)
            # what no transition takes is rejected by the node
            yield made if taken else self._reject(made, goal, fact)

    def _reject(self, hypothesis: Hypothesis, goal: Goal, fact: TraceEvent) -> Hypothesis:
        goals = tuple(g for g in hypothesis.goals if g.number != goal.number or not g.served)
        rejected = but(hypothesis, goals=goals)
        return self._owing(rejected, OutputKind.REJECT_GOAL, goal, fact)

    def _owing(
        self, hypothesis: Hypothesis, kind: OutputKind, goal: Goal, fact: TraceEvent
    ) -> Hypothesis:
        """``hypothesis`` with something more to be sent about ``goal``, by the node and not by a
        statement of the model.
        """
        place = self.machine.position
        owed = Obligation(
            kind, goal.interface, None, fact.stamp, fact.stamp, place, place, goal=goal.id
        )
        return but(hypothesis, owed=(*hypothesis.owed, owed))

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
        for instance in range(len(self.programs)):
            found = [
                made
                for before in found
                for made in self.run(before, instance, event, None, parts, stamp, stamp)
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
            for made in self.run(accepted, 0, event, fact.data, parts, fact.stamp, fact.stamp):
                cancel = OutputKind.SEND_CANCEL
                yield self._owing(made, cancel, goal, fact) if goal.cancel else made
            return
        goals = tuple(g for g in hypothesis.goals if g.served or g.number != goal.number)
        ended = but(hypothesis, goals=goals)
        yield from self.run(ended, 0, event, fact.data, parts, fact.stamp, fact.stamp)
