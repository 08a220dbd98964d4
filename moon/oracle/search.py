"""All that a machine can have done: hypotheses and how they go on.

The rules are those of design section 6. An input or output stamped where the machine took or made it
is a fixed point; a message of a topic was taken at some time between its stamp and the latency bound
after it; timers are inputs that nobody publishes. Between two fixed points, every possible order of
what may have been taken is followed; equal hypotheses are merged.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import ActionThread, EventKind, InterfaceKind, Machine, OutputKind
from moon.oracle.channels import Channels, Fact
from moon.oracle.hypothesis import (
    ANY_CALL,
    Alarm,
    AlarmKey,
    EventKey,
    Goal,
    Hypothesis,
    Owed,
    Posted,
    agree,
    learned,
)
from moon.oracle.steps import Delayed, MachineProgram, Output, Step
from moon.oracle.unknowns import Unknown, is_unknown

FOREVER = 1 << 62

_ENDS = {
    OutputKind.SUCCEED: "ended",
    OutputKind.ABORT: "ended",
    OutputKind.CANCEL: "ended",
}

KEPT_GOALS = 8
"""Ended goals are remembered for results that are asked for late."""


EXACT = 32
"""Up to so many hypotheses, each keeps its own messages under way."""


class Bounds(msgspec.Struct, frozen=True):
    """What is assumed of the middleware and the machines (all in ns).

    Attributes:
        latency: a message is taken, and an observation heard, within this time of its stamp.
        deadline: an output comes within this time of the step that owes it.
        skew: clocks of different machines differ by at most this.
        tolerance: a timer may ring by this, and 0.1 % of its delay, too early or too late.
        hypotheses: more of them at once are not followed: the verdict is inconclusive.
    """

    latency: int = 200_000_000
    deadline: int = 1_000_000_000
    skew: int = 0
    tolerance: int = 1_000_000
    hypotheses: int = 512


class TooManyError(Exception):
    """The hypothesis set is over its cap."""


class Search:
    """The hypotheses of one machine.

    Args:
        machine: the model.
        library: its message types.
        channels: its channels.
        bounds: what is assumed.
    """

    def __init__(
        self, machine: Machine, library: InterfaceLibrary, channels: Channels, bounds: Bounds
    ) -> None:
        self.machine = machine
        self.bounds = bounds
        self._channels = channels
        main = MachineProgram(machine, library)
        self.programs = [main]
        self._threads: list[tuple[ActionThread, int]] = []
        """For each instance after the first: its declaration and its number in it."""
        for thread in machine.threads:
            program = MachineProgram(thread.machine, library, machine)
            for number in range(thread.count):
                self.programs.append(program)
                self._threads.append((thread, number))
        rates = {
            interface.name: round(1e9 / interface.rate_hz)
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.TIMER and interface.rate_hz > 0
        }
        self._effective = {
            event
            for program in self.programs
            for state in program.states
            for event, transitions in state.by_event.items()
            if any(t.body is not None or t.targets for t in transitions)
        }
        self._draws = any(program.draws for program in self.programs)
        self._timers = [
            (instance, (EventKind.TIMER, name), period)
            for instance, program in enumerate(self.programs)
            for name, period in rates.items()
            if any(name in state.timers for state in program.states)
        ]
        self._channel_of = {
            (interface.kind, interface.name): interface.channel for interface in machine.interfaces
        }
        self.last = 0
        """Stamp of the last fixed point."""

    # --- beginnings --------------------------------------------------------------------------------

    def started(self, start: int, whole: bool = False) -> list[Hypothesis]:
        """The machine has just started, at ``start`` (ns); see ``Oracle.start`` for ``whole``."""
        slack = 0 if whole else self.bounds.latency
        alarms = tuple(
            Alarm(
                instance,
                event,
                start + (period - self._slack(period) if whole else 0),
                start + period + slack + self._slack(period),
                period,
            )
            for instance, event, period in self._timers
        )
        blank = tuple((program.initial, program.initial_data()) for program in self.programs)
        found = [Hypothesis(blank, alarms=alarms)]
        for instance in (*range(1, len(self.programs)), 0):
            grown: list[Hypothesis] = []
            for hypothesis in found:
                state, data = hypothesis.instances[instance]
                del state
                for _, step in self.programs[instance].start(data):
                    grown += self._absorb(hypothesis, instance, step, start, start + slack)
            found = grown
        if whole:
            return found
        made: dict[Any, Hypothesis] = {}
        for hypothesis in found:
            for first in range(len(hypothesis.owed) + 1):
                rest = hypothesis.with_owed(hypothesis.owed[first:])
                made[rest.key()] = rest
        return list(made.values())

    def anything(self, now: int, pending: tuple[Fact, ...]) -> list[Hypothesis]:
        """The machine is between two steps at ``now``, and nothing more is known of it."""
        self._channels.forget_goals()
        alarms = tuple(
            Alarm(instance, event, now - self.bounds.latency, now + period, period)
            for instance, event, period in self._timers
        )
        combinations: list[tuple[tuple[int, tuple[Any, ...]], ...]] = [()]
        for program in self.programs:
            data = program.unknown_data()
            combinations = [
                (*known, (index, data))
                for known in combinations
                for index, state in enumerate(program.machine.states)
                if not program.states[index].eventless or _can_rest(program, index)
                if state is not None
            ]
            if len(combinations) > self.bounds.hypotheses:
                raise TooManyError
        found = []
        for instances in combinations:
            delays = tuple(
                Alarm(
                    instance,
                    event,
                    now - self.bounds.latency,
                    now + round(delay * 1e9),
                    0,
                    None,
                    event[1],
                )
                for instance, (state, _) in enumerate(instances)
                for event, delay in self.programs[instance].states[state].delays
            )
            found.append(
                Hypothesis(instances, pending=pending, alarms=(*alarms, *delays), free=True)
            )
        return found

    def changes_something(self, event: EventKey | None) -> bool:
        """Whether ``event`` can make a difference to what is seen, in any state."""
        return event in self._effective

    # --- between fixed points ----------------------------------------------------------------------

    def reachable(self, hypotheses: list[Hypothesis], now: int, due: int) -> list[Hypothesis]:
        """All that can be so just before ``now``.

        Args:
            hypotheses: what could be so before.
            now: stamp of the next fixed point.
            due: what had to be taken by then has been taken.
        """
        if all(self._is_still(hypothesis, now) for hypothesis in hypotheses):
            return hypotheses
        found = self._explore(hypotheses, now, exactly=True)
        if found is None:
            found = self._explore(hypotheses, now, exactly=False)
        if found is None:
            raise TooManyError
        found = [self._without_expired(h, due) for h in found]
        return [h for h in found if h.owed or self._has_taken(h, due)]

    def _without_expired(self, hypothesis: Hypothesis, due: int) -> Hypothesis:
        """Messages that were perhaps taken, once they certainly are."""
        limit = due - self.bounds.latency - self.bounds.skew
        pending = hypothesis.pending
        if not any(fact.droppable and fact.stamp <= limit for fact in pending):
            return hypothesis
        return hypothesis.with_pending(
            tuple(fact for fact in pending if not fact.droppable or fact.stamp > limit)
        )

    def _explore(
        self, hypotheses: list[Hypothesis], now: int, exactly: bool
    ) -> list[Hypothesis] | None:
        """All orders of taking what may have been taken; None if there are too many.

        If not ``exactly``, hypotheses that differ in the messages under way only are joined: k
        messages of different sources can be taken in k! orders, yet leave few different states.
        """
        known: dict[Any, Hypothesis] = {}
        todo = list(hypotheses)
        limit = EXACT if exactly else self.bounds.hypotheses
        while todo:
            hypothesis = todo.pop()
            key = hypothesis.key() if exactly else hypothesis.core()
            before = known.get(key)
            if before is not None:
                wide = before.merged(hypothesis) if exactly else before.joined(hypothesis)
                if wide is None:
                    continue
                hypothesis = wide
            known[key] = hypothesis
            if len(known) > limit:
                return None
            if hypothesis.owed:
                # no input is taken before the outputs of a step are out
                if all(owed.optional for owed in hypothesis.owed):
                    todo.append(hypothesis.with_owed(()))
                continue
            if hypothesis.pending or hypothesis.posted or hypothesis.alarms:
                todo.extend(self._moves(hypothesis, now))
        return list(known.values())

    def _slack(self, duration: int) -> int:
        """By how much a timer and the stamps may disagree after ``duration`` (ns).

        Clocks are read with some granularity, and one that is being slewed runs up to 0.05 % too
        fast or too slow (RFC 5905, 11.3).
        """
        return duration // 1000 + self.bounds.tolerance

    def _is_still(self, hypothesis: Hypothesis, now: int) -> bool:
        """Whether nothing can have been taken before ``now``."""
        if hypothesis.owed:
            return not all(owed.optional for owed in hypothesis.owed)
        if hypothesis.posted or hypothesis.pending:
            return False
        return all(
            not (alarm.low <= now and self._matters(hypothesis, alarm))
            for alarm in hypothesis.alarms
        )

    def _moves(self, hypothesis: Hypothesis, now: int) -> Iterator[Hypothesis]:
        """What one more input, taken before ``now``, makes of ``hypothesis``.

        What had to be taken earlier than something else can have been is taken before it.
        """
        earliest = max(self.last, hypothesis.moment)
        latest = max(self._latest(hypothesis, certainly=True), self.last)
        if hypothesis.pending:
            lanes = set()
            for place, fact in enumerate(hypothesis.pending):
                sent = fact.stamp - self.bounds.skew
                if sent >= now or sent > latest:
                    break
                if fact.lane in lanes:
                    continue
                if not fact.droppable:
                    lanes.add(fact.lane)
                low = max(sent, earliest)
                yield from self._take_message(hypothesis, place, fact, low, now)
        if hypothesis.posted:
            posted = hypothesis.posted[0]
            if posted.low < now and posted.low <= latest:
                rest = self._but(hypothesis, posted=hypothesis.posted[1:])
                low = max(posted.low, earliest)
                high = max(low, min(posted.high + self.bounds.latency, now))
                yield from self.run(
                    rest, posted.instance, posted.event, posted.message, posted.parts, low, high
                )
        for place, alarm in enumerate(hypothesis.alarms):
            if alarm.low <= min(now, latest) and self._matters(hypothesis, alarm):
                yield from self._ring(hypothesis, place, alarm, max(alarm.low, earliest), now)

    def _latest(self, hypothesis: Hypothesis, certainly: bool = False) -> int:
        """By when the next input has been taken; ``certainly``: of those it certainly gets."""
        latency = self.bounds.latency
        latest = FOREVER
        for fact in hypothesis.pending:
            if certainly and fact.droppable:
                continue
            if fact.stamp + latency < latest and not self._is_held(hypothesis, fact):
                latest = fact.stamp + latency + self.bounds.skew
        for posted in hypothesis.posted:
            latest = min(latest, posted.high + latency)
        for alarm in hypothesis.alarms:
            if alarm.high + latency < latest and self._matters(hypothesis, alarm):
                latest = alarm.high + latency
        return latest

    def _is_held(self, hypothesis: Hypothesis, fact: Fact) -> bool:
        """Whether ``fact`` is feedback that is kept until its goal is accepted."""
        if fact.event is None or fact.event[0] is not EventKind.FEEDBACK:
            return False
        goal = _goal_called(hypothesis, fact.goal, served=False)
        return goal is not None and goal.phase != "running"

    def _take_message(
        self, hypothesis: Hypothesis, place: int, fact: Fact, low: int, now: int
    ) -> Iterator[Hypothesis]:
        earlier = hypothesis.pending[:place]
        if any(item.lane == fact.lane for item in earlier):
            # these are perhaps taken, and now certainly: a lane keeps its order
            earlier = tuple(item for item in earlier if item.lane != fact.lane)
        rest = hypothesis.with_pending(earlier + hypothesis.pending[place + 1 :])
        assert fact.event is not None
        high = max(low, min(fact.stamp + self.bounds.latency, now))
        parts: dict[str, Any] = {}
        if fact.event[0] is EventKind.FEEDBACK:
            goal = _goal_called(hypothesis, fact.goal, served=False)
            if goal is None:
                if hypothesis.free and not self._channels.was_sent(fact.goal):
                    rest_too, adopted = self._adopt(
                        rest, fact.interface, fact.goal, False, "running"
                    )
                    parts = {"goal_id": adopted.number}
                    yield from self.run(rest_too, 0, fact.event, fact.data, parts, low, high)
                yield rest
                return
            if goal.phase != "running":
                return
            parts = {"goal_id": goal.number}
        if fact.droppable:
            yield rest
        yield from self.run(rest, 0, fact.event, fact.data, parts, low, high)

    def _matters(self, hypothesis: Hypothesis, alarm: Alarm) -> bool:
        state, _ = hypothesis.instances[alarm.instance]
        return self.programs[alarm.instance].handles(state, alarm.event)

    def _ring(
        self, hypothesis: Hypothesis, place: int, alarm: Alarm, low: int, now: int
    ) -> Iterator[Hypothesis]:
        latency = self.bounds.latency
        high = max(low, min(alarm.high + latency, now))
        others = hypothesis.alarms[:place] + hypothesis.alarms[place + 1 :]
        if alarm.period:
            # ticks slept through are skipped, the phase is kept (see Executor)
            slack = self._slack(alarm.period)
            latest = min(alarm.high, now)
            if latency >= alarm.period:
                latest = max(latest, high)
            following = Alarm(
                alarm.instance,
                alarm.event,
                max(alarm.low, low - latency) + alarm.period - slack,
                latest + alarm.period + slack,
                alarm.period,
            )
            others = (*hypothesis.alarms[:place], following, *hypothesis.alarms[place + 1 :])
        rest = hypothesis.with_alarms(others)
        key = (alarm.instance, alarm.event) if alarm.period else None
        yield from self.run(
            rest, alarm.instance, alarm.event, alarm.data, {"name": alarm.event[1]}, low, high, key
        )

    def _has_taken(self, hypothesis: Hypothesis, due: int) -> bool:
        """Whether everything is taken that had to be by ``due``."""
        return self._latest(hypothesis) > due

    def next_due(self, hypothesis: Hypothesis) -> int:
        """When time alone will say something about ``hypothesis``."""
        if hypothesis.owed and not hypothesis.owed[0].optional:
            return hypothesis.owed[0].high + self.bounds.deadline
        return self._latest(hypothesis)

    def normalised(self, hypothesis: Hypothesis, now: int) -> Hypothesis:
        """Timers that nothing waits for, brought up to ``now``."""
        latency = self.bounds.latency
        alarms = hypothesis.alarms
        if not any(a.period and a.high + latency < now for a in alarms):
            return hypothesis
        made = []
        for alarm in alarms:
            if alarm.period and alarm.high + latency < now and not self._matters(hypothesis, alarm):
                missed = (now - latency - alarm.high) // alarm.period + 1
                made.append(
                    Alarm(
                        alarm.instance,
                        alarm.event,
                        alarm.low + missed * alarm.period,
                        alarm.high + missed * alarm.period,
                        alarm.period,
                    )
                )
            else:
                made.append(alarm)
        return hypothesis.with_alarms(tuple(made))

    def _awakened(
        self, before: Hypothesis, made: Hypothesis, alarm: Alarm, low: int, high: int
    ) -> Alarm:
        """A periodic timer that a step makes matter: it may just have rung unheard, or just not."""
        if not alarm.period or self._matters(before, alarm) or not self._matters(made, alarm):
            return alarm
        first, last, period = alarm.low, alarm.high, alarm.period
        latency = self.bounds.latency
        if last + latency < low:
            missed = (low - latency - last) // period + 1
            first, last = first + missed * period, last + missed * period
        if first <= high:
            last = min(last + period, high + period) + self._slack(period)
        return Alarm(alarm.instance, alarm.event, first, max(last, first), period)

    # --- fixed points ------------------------------------------------------------------------------

    def take_input(self, candidates: Iterable[Hypothesis], fact: Fact) -> list[Hypothesis]:
        """The machine took ``fact`` at its stamp; none of ``candidates`` owes anything for sure."""
        made: list[Hypothesis] = []
        for hypothesis in candidates:
            rest = hypothesis.with_owed(()) if hypothesis.owed else hypothesis
            made += self._input(self.normalised(rest, fact.stamp), fact)
        return _distinct(made)

    def _input(self, hypothesis: Hypothesis, fact: Fact) -> Iterator[Hypothesis]:
        event, stamp = fact.event, fact.stamp
        assert event is not None
        kind = event[0]
        match kind:
            case EventKind.REQUEST:
                waiting = (*hypothesis.waiting, (fact.interface, fact.call))
                asked = self._but(hypothesis, waiting=waiting)
                yield from self.run(asked, 0, event, fact.data, {}, stamp, stamp, call=fact.call)
            case EventKind.GOAL:
                yield from self._goal_input(hypothesis, fact)
            case EventKind.CANCEL:
                yield from self._cancel_input(hypothesis, fact)
            case EventKind.RESPONSE | EventKind.CALL_ERROR:
                yield from self.run(hypothesis, 0, event, fact.data, {}, stamp, stamp)
            case _:
                yield from self._goal_event(hypothesis, fact)

    def _goal_input(self, hypothesis: Hypothesis, fact: Fact) -> Iterator[Hypothesis]:
        if _goal_called(hypothesis, fact.goal, served=True) is not None:
            yield hypothesis  # a second goal of the same id: rejected before the machine hears it
            return
        grown, goal = self._adopt(hypothesis, fact.interface, fact.goal, True, "new")
        assert fact.event is not None
        parts = {"goal_id": goal.number}
        for taken, step in self._take(grown, 0, fact.event, fact.data, parts):
            for made in self._absorb(grown, 0, step, fact.stamp, fact.stamp):
                if taken:
                    yield made
                else:  # rejected by the node
                    yield self._reject(made, goal, fact)

    def _reject(self, hypothesis: Hypothesis, goal: Goal, fact: Fact) -> Hypothesis:
        position = self.machine.position
        owed = Owed(
            OutputKind.REJECT_GOAL,
            fact.interface,
            None,
            fact.stamp,
            fact.stamp,
            position,
            position,
            goal=goal.id,
        )
        goals = tuple(g for g in hypothesis.goals if g.number != goal.number or not g.served)
        return self._but(hypothesis, owed=(*hypothesis.owed, owed), goals=goals)

    def _cancel_input(self, hypothesis: Hypothesis, fact: Fact) -> Iterator[Hypothesis]:
        """See ``transports.actions``: which goals a cancel request means, and who hears of it."""
        from moon.oracle.channels import identifier

        info = fact.data
        wanted = identifier(info["goal_id"])
        named = any(info["goal_id"]["uuid"])
        timed = bool(info["stamp"]["sec"] or info["stamp"]["nanosec"])
        found = [hypothesis]
        goal = _goal_called(hypothesis, wanted, served=True)
        if named and goal is None and hypothesis.free:
            grown, goal = self._adopt(hypothesis, fact.interface, wanted, True, "running")
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
                changed = _changed(before, each, phase="canceling")
                following += self._everywhere(
                    changed,
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

    def _goal_event(self, hypothesis: Hypothesis, fact: Fact) -> Iterator[Hypothesis]:
        """What becomes of a goal that the machine sent."""
        event = fact.event
        assert event is not None
        goal = _goal_called(hypothesis, fact.goal, served=False)
        if goal is None:
            if not hypothesis.free or self._channels.was_sent(fact.goal):
                yield hypothesis  # not a goal of this machine's model, or one that has ended
                return
            hypothesis, goal = self._adopt(hypothesis, fact.interface, fact.goal, False, "sent")
        codes = {EventKind.SUCCEEDED: 4, EventKind.CANCELED: 5, EventKind.ABORTED: 6}
        parts: dict[str, Any] = {"goal_id": goal.number}
        if event[0] in codes:
            parts["code"] = codes[event[0]]
        if event[0] is EventKind.GOAL_ACCEPTED:
            changed = _changed(hypothesis, goal, phase="running", cancel=False)
            for made in self.run(changed, 0, event, fact.data, parts, fact.stamp, fact.stamp):
                yield self._cancel_now(made, goal, fact) if goal.cancel else made
            return
        goals = tuple(g for g in hypothesis.goals if g.served or g.number != goal.number)
        ended = self._but(hypothesis, goals=goals)
        yield from self.run(ended, 0, event, fact.data, parts, fact.stamp, fact.stamp)

    def _cancel_now(self, hypothesis: Hypothesis, goal: Goal, fact: Fact) -> Hypothesis:
        position = self.machine.position
        owed = Owed(
            OutputKind.SEND_CANCEL,
            goal.interface,
            None,
            fact.stamp,
            fact.stamp,
            position,
            position,
            goal=goal.id,
        )
        return self._but(hypothesis, owed=(*hypothesis.owed, owed))

    def take_output(self, candidates: Iterable[Hypothesis], fact: Fact) -> list[Hypothesis]:
        """The machine sent ``fact``: those of ``candidates`` that owe it next."""
        made: list[Hypothesis] = []
        for hypothesis in candidates:
            for place, expected in enumerate(hypothesis.owed):
                if self._is(hypothesis, expected, fact):
                    made.append(self._paid(hypothesis, place, fact))
                if not expected.optional:
                    break
        return _distinct(made)

    def _is(self, hypothesis: Hypothesis, owed: Owed, fact: Fact) -> bool:
        if owed.kind is not fact.output or owed.interface != fact.interface:
            return False
        skew = self.bounds.skew
        if not owed.low - skew <= fact.stamp <= owed.high + self.bounds.deadline + skew:
            return False
        if owed.call is not None and owed.call not in (fact.call, ANY_CALL):
            return False
        if isinstance(owed.goal, str) and owed.goal != fact.goal:
            return False
        if isinstance(owed.goal, Unknown):
            known = _goal_called(hypothesis, fact.goal, served=True)
            if known is not None and not owed.goal.allows(known.number):
                return False
        if fact.output in _ENDS and fact.data is None:
            return True  # a status tells that a goal has ended, not with what
        kind = self._channels.types.get((owed.kind, owed.interface))
        return kind is None or agree(owed.data, fact.data, kind)

    def _paid(self, hypothesis: Hypothesis, place: int, fact: Fact) -> Hypothesis:
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
            rest = self._but(rest, goals=goals)
        elif owed.kind in _ENDS:
            rest = self._end_seen(rest, owed, fact)
        found: dict[int, tuple[Unknown, Any]] = {}
        if (self._draws or rest.free) and is_unknown(owed.data):
            learned(owed.data, fact.data, found)
        if isinstance(owed.goal, Unknown) and fact.goal:
            known = _goal_called(rest, fact.goal, served=True)
            if known is None:
                rest, known = self._adopt(rest, owed.interface, fact.goal, True, "running")
            found[id(owed.goal)] = (owed.goal, known.number)
        return _substituted(rest, found) if found else rest

    def _phase_seen(self, hypothesis: Hypothesis, key: AlarmKey, stamp: int) -> Hypothesis:
        """A timer rang at ``stamp`` at the latest: its next time is within a period of that."""
        made = []
        for alarm in hypothesis.alarms:
            if (alarm.instance, alarm.event) == key:
                low = max(alarm.low, stamp - self.bounds.latency)
                high = max(low, min(alarm.high, stamp + alarm.period + self._slack(alarm.period)))
                made.append(Alarm(alarm.instance, alarm.event, low, high, alarm.period))
            else:
                made.append(alarm)
        return hypothesis.with_alarms(tuple(made))

    def _end_seen(self, hypothesis: Hypothesis, owed: Owed, fact: Fact) -> Hypothesis:
        goals = []
        for goal in hypothesis.goals:
            same = goal.served and goal.id == fact.goal and goal.interface == owed.interface
            goals.append(goal.but(seen=True, result=(owed.kind, owed.data)) if same else goal)
        return self._but(hypothesis, goals=tuple(goals))

    def take_status(self, candidates: Iterable[Hypothesis], fact: Fact) -> list[Hypothesis]:
        """The status of all goals: those that have ended since are outputs."""
        found: dict[Any, Hypothesis] = {}
        for hypothesis in candidates:
            current = [hypothesis]
            for goal_id, kind in fact.data:
                current = [
                    made
                    for before in current
                    for made in self._goal_ended(before, fact, goal_id, kind)
                ]
            for made in current:
                _put(found, made)
        return list(found.values())

    def _goal_ended(
        self, hypothesis: Hypothesis, fact: Fact, goal_id: str, kind: OutputKind
    ) -> list[Hypothesis]:
        goal = _goal_called(hypothesis, goal_id, served=True)
        if goal is None:
            # ended before the oracle looked, or just now by a machine of which little is known
            if not hypothesis.free or not hypothesis.owed:
                return [hypothesis]
        elif goal.seen:
            return [hypothesis] if goal.result is None or goal.result[0] is kind else []
        end = Fact(fact.observation, fact.role, fact.interface, None, kind, None, goal_id)
        paid = self.take_output([hypothesis], end)
        return paid or ([hypothesis] if goal is None else [])

    def take_result(self, candidates: Iterable[Hypothesis], fact: Fact) -> list[Hypothesis]:
        """A goal's result leaves: as the end itself, or long after it."""
        found: dict[Any, Hypothesis] = {}
        kind = self._channels.types.get((OutputKind.SUCCEED, fact.interface))
        for hypothesis in candidates:
            goal = _goal_called(hypothesis, fact.goal, served=True)
            if goal is None and hypothesis.free:
                for made in self.take_output([hypothesis], fact) or [hypothesis]:
                    _put(found, made)
            elif goal is not None and goal.seen and goal.result is not None:
                if goal.result[0] is fact.output and agree(goal.result[1], fact.data, kind):
                    _put(found, hypothesis)
            elif goal is not None:
                for made in self.take_output([hypothesis], fact):
                    _put(found, made)
        return list(found.values())

    # --- one step ----------------------------------------------------------------------------------

    def run(
        self,
        hypothesis: Hypothesis,
        instance: int,
        event: EventKey,
        message: Any,
        parts: Mapping[str, Any],
        low: int,
        high: int,
        alarm: AlarmKey | None = None,
        call: tuple[str, int] | None = None,
    ) -> Iterator[Hypothesis]:
        """Process ``event`` between ``low`` and ``high``: every outcome."""
        for taken, step in self._take(hypothesis, instance, event, message, parts):
            if not taken and call is not None:
                # a request that the state discards is never answered
                waiting = tuple(item for item in hypothesis.waiting if item[1] != call)
                yield self._but(hypothesis, waiting=waiting)
            elif not taken and not step.outputs and not step.scheduled:
                yield hypothesis
            else:
                yield from self._absorb(hypothesis, instance, step, low, high, alarm, call)

    def _take(
        self,
        hypothesis: Hypothesis,
        instance: int,
        event: EventKey,
        message: Any,
        parts: Mapping[str, Any],
    ) -> Iterable[tuple[bool, Step]]:
        state, data = hypothesis.instances[instance]
        symbolic = self._draws or hypothesis.free
        return self.programs[instance].take(state, data, event, message, parts, symbolic)

    def _absorb(
        self,
        before: Hypothesis,
        instance: int,
        step: Step,
        low: int,
        high: int,
        alarm: AlarmKey | None = None,
        call: tuple[str, int] | None = None,
    ) -> Iterator[Hypothesis]:
        """``before`` after ``step`` of one of its instances."""
        instances = before.instances
        changed = (step.state, tuple(step.data))
        made = Hypothesis(
            (*instances[:instance], changed, *instances[instance + 1 :]),
            before.owed,
            before.pending,
            before.posted,
            before.alarms,
            before.waiting,
            before.goals,
            before.counts,
            before.free,
            max(low, before.moment),
        )
        if before.alarms and step.state != instances[instance][0]:
            made.alarms = tuple(
                self._awakened(before, made, item, low, high) for item in made.alarms
            )
        if step.scheduled:
            self._schedule(made, instance, step.scheduled, low, high)
        for output in step.outputs:
            self._owe(made, instance, output, low, high, alarm, call)
        yield made

    def _schedule(
        self, made: Hypothesis, instance: int, scheduled: list[Delayed | str], low: int, high: int
    ) -> None:
        alarms = list(made.alarms)
        for item in scheduled:
            if isinstance(item, str):
                alarms = [a for a in alarms if a.instance != instance or a.id != item or not item]
                continue
            if isinstance(item.delay_s, Unknown):
                alarms.append(Alarm(instance, item.event, low, FOREVER, 0, item.data, item.id))
                continue
            if item.event[0] is EventKind.INTERNAL and item.delay_s <= 0:
                posted = Posted(instance, item.event, item.data, {"name": item.event[1]}, low, high)
                made.posted = (*made.posted, posted)
                continue
            delay = round(item.delay_s * 1e9)
            slack = self._slack(delay)
            if item.event[0] is EventKind.AFTER:
                alarms = [a for a in alarms if a.instance != instance or a.event != item.event]
            alarms.append(
                Alarm(
                    instance,
                    item.event,
                    low + delay - slack,
                    high + delay + slack,
                    0,
                    item.data,
                    item.id,
                )
            )
        made.alarms = tuple(alarms)

    def _owe(
        self,
        made: Hypothesis,
        instance: int,
        output: Output,
        low: int,
        high: int,
        alarm: AlarmKey | None,
        call: tuple[str, int] | None,
    ) -> None:
        """What an output of the model means: something to be seen, or something inside."""
        kind = output.kind
        optional = False
        interface = output.interface
        goal: Any = None
        answers: tuple[str, int] | None = None
        match kind:
            case OutputKind.PUBLISH:
                interface = self._channels.name_of(InterfaceKind.PUBLISHER, interface)
            case OutputKind.REQUEST:
                interface = self._channels.name_of(InterfaceKind.CLIENT, interface)
            case OutputKind.RESPONSE:
                answers = _answered(made, interface, call)
                if answers is None:
                    if not made.free:
                        return  # no request waits: nothing leaves
                    answers, optional = ANY_CALL, True
            case OutputKind.SEND_GOAL:
                _, sent = self._adopt_in_place(made, interface, "", False, "sent")
                goal = sent.number
            case OutputKind.SEND_CANCEL:
                found = self._goal_to_cancel(made, interface, output.goal)
                if found is None:
                    if not made.free:
                        return
                    optional = True
                elif found.phase == "sent":
                    _change(made, found, cancel=True)
                    return
                else:
                    goal = found.id
            case (
                OutputKind.ACCEPT_GOAL
                | OutputKind.REJECT_GOAL
                | OutputKind.FEEDBACK
                | OutputKind.SUCCEED
                | OutputKind.ABORT
                | OutputKind.CANCEL
            ):
                served = self._served_goal(made, output)
                if served is None:
                    if not made.free:
                        return  # a goal that is not there: reported by the node, nothing leaves
                    goal, optional = output.goal if isinstance(output.goal, Unknown) else None, True
                elif not _allowed(made, served, output):
                    return
                else:
                    goal = served.id
            case OutputKind.START_THREAD:
                self._start_thread(made, output, low, high)
                return
            case OutputKind.THREAD_FREE:
                self._free_thread(made, instance, output, low, high)
                return
            case _:
                return  # a behaviour-tree plugin's answer: inside the policy's process
        if self._channel_of.get((_INTERFACE_OF[kind], output.interface)) is None:
            return  # the channel is only known at run time
        made.owed = (
            *made.owed,
            Owed(
                kind,
                interface,
                output.fields,
                low,
                high,
                output.position,
                output.transition,
                answers,
                goal,
                optional,
                alarm,
            ),
        )

    def _start_thread(self, made: Hypothesis, output: Output, low: int, high: int) -> None:
        number = 0 if output.thread is None else output.thread
        for index, (thread, which) in enumerate(self._threads, 1):
            if thread.interface == output.interface and which == number:
                event = (EventKind.THREAD_START, output.interface)
                parts = {"goal_id": output.goal or 0, "thread_id": number}
                posted = Posted(index, event, output.fields, parts, low, high)
                made.posted = (*made.posted, posted)

    def _free_thread(
        self, made: Hypothesis, instance: int, output: Output, low: int, high: int
    ) -> None:
        number = self._threads[instance - 1][1] if instance else 0
        parts = {"goal_id": output.goal or 0, "thread_id": number}
        event = (EventKind.THREAD_FREE, output.interface)
        made.posted = (*made.posted, Posted(0, event, None, parts, low, high))

    # --- goals -------------------------------------------------------------------------------------

    def _adopt(
        self, hypothesis: Hypothesis, interface: str, goal_id: str, served: bool, phase: str
    ) -> tuple[Hypothesis, Goal]:
        grown = self._but(hypothesis)
        return self._adopt_in_place(grown, interface, goal_id, served, phase)

    def _adopt_in_place(
        self, made: Hypothesis, interface: str, goal_id: str, served: bool, phase: str
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

    def _goal_to_cancel(self, made: Hypothesis, interface: str, number: Any) -> Goal | None:
        sent = [g for g in made.goals if not g.served and g.interface == interface]
        if isinstance(number, Unknown):
            return None
        if not number:
            number = dict(made.counts).get((False, interface), 0)
        return next((g for g in sent if g.number == number), None)

    def _served_goal(self, made: Hypothesis, output: Output) -> Goal | None:
        for goal in made.goals:
            if goal.served and goal.interface == output.interface and goal.number == output.goal:
                return goal
        return None

    def channel_of_output(self, kind: OutputKind, interface: str) -> str:
        """The channel by which an output leaves, for messages to people."""
        return self._channel_of.get((_INTERFACE_OF[kind], interface)) or interface

    @staticmethod
    def _but(hypothesis: Hypothesis, **changes: Any) -> Hypothesis:
        fields = {
            "owed": hypothesis.owed,
            "pending": hypothesis.pending,
            "posted": hypothesis.posted,
            "alarms": hypothesis.alarms,
            "waiting": hypothesis.waiting,
            "goals": hypothesis.goals,
            "counts": hypothesis.counts,
            "free": hypothesis.free,
            "moment": hypothesis.moment,
            **changes,
        }
        return Hypothesis(hypothesis.instances, **fields)


_INTERFACE_OF = {
    OutputKind.PUBLISH: InterfaceKind.PUBLISHER,
    OutputKind.REQUEST: InterfaceKind.CLIENT,
    OutputKind.RESPONSE: InterfaceKind.SERVER,
    OutputKind.SEND_GOAL: InterfaceKind.ACTION_CLIENT,
    OutputKind.SEND_CANCEL: InterfaceKind.ACTION_CLIENT,
    OutputKind.ACCEPT_GOAL: InterfaceKind.ACTION_SERVER,
    OutputKind.REJECT_GOAL: InterfaceKind.ACTION_SERVER,
    OutputKind.FEEDBACK: InterfaceKind.ACTION_SERVER,
    OutputKind.SUCCEED: InterfaceKind.ACTION_SERVER,
    OutputKind.ABORT: InterfaceKind.ACTION_SERVER,
    OutputKind.CANCEL: InterfaceKind.ACTION_SERVER,
}


def _distinct(made: list[Hypothesis]) -> list[Hypothesis]:
    """Each hypothesis once."""
    if len(made) <= 1:
        return made
    found: dict[Any, Hypothesis] = {}
    for hypothesis in made:
        _put(found, hypothesis)
    return list(found.values())


def _put(found: dict[Any, Hypothesis], made: Hypothesis) -> None:
    key = made.key()
    before = found.get(key)
    found[key] = made if before is None else before.merged(made) or before


def _can_rest(program: MachineProgram, index: int) -> bool:
    """Whether a step can end in a state that has eventless transitions."""
    return all(t.condition is not None for t in program.states[index].eventless)


def _answered(
    made: Hypothesis, interface: str, call: tuple[str, int] | None
) -> tuple[str, int] | None:
    """Whose request a response answers: the one being processed, else the oldest; it is done."""
    waiting = made.waiting
    found = None
    if call is not None and (interface, call) in waiting:
        found = (interface, call)
    else:
        found = next((item for item in waiting if item[0] == interface), None)
    if found is None:
        return None
    place = waiting.index(found)
    made.waiting = waiting[:place] + waiting[place + 1 :]
    return found[1]


def _goal_called(hypothesis: Hypothesis, goal_id: str, served: bool) -> Goal | None:
    for goal in hypothesis.goals:
        if goal.served is served and goal.id == goal_id:
            return goal
    return None


def _allowed(made: Hypothesis, goal: Goal, output: Output) -> bool:
    """Whether the goal's state lets the output leave (see ``transports.actions``); it is changed."""
    running = goal.phase in ("running", "canceling")
    match output.kind:
        case OutputKind.ACCEPT_GOAL:
            if goal.phase != "new":
                return False
            _change(made, goal, phase="running")
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
            _change(made, goal, phase="ended", result=(kind, output.fields))
            return running and not refused


def _change(made: Hypothesis, goal: Goal, **changes: Any) -> None:
    made.goals = tuple(g.but(**changes) if g is goal else g for g in made.goals)


def _changed(hypothesis: Hypothesis, goal: Goal, **changes: Any) -> Hypothesis:
    made = Search._but(hypothesis)
    made.goals = tuple(
        g.but(**changes) if g.number == goal.number and g.served == goal.served else g
        for g in made.goals
    )
    return made


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

    made = Search._but(hypothesis)
    made.instances = tuple(
        (state, tuple(put(value) for value in data)) for state, data in hypothesis.instances
    )
    made.owed = tuple(_owed_with(owed, put) for owed in hypothesis.owed)
    return made


def _owed_with(owed: Owed, put: Any) -> Owed:
    if not is_unknown(owed.data) and not isinstance(owed.goal, Unknown):
        return owed
    return Owed(
        owed.kind,
        owed.interface,
        put(owed.data),
        owed.low,
        owed.high,
        owed.position,
        owed.transition,
        owed.call,
        put(owed.goal),
        owed.optional,
        owed.alarm,
    )
