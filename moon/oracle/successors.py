"""Successors: what a hypothesis is after one step of the machine.

A step is the taking of one input. ``Successors`` finds those that nobody sees being taken: a message of a
topic, taken at some time between its stamp and the latency bound after it; a timer, which nobody publishes;
an event that the machine sent itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from m2c.language.datatypes import INT64
from m2c.language.durations import MAX_DELAY_S
from m2c.model.machine import EventKind, InterfaceKind, OutputKind
from moon.oracle.bounds import FOREVER, Bounds, TooManyError
from moon.oracle.calls import Call
from moon.oracle.channels import Channels
from moon.oracle.program import Program
from moon.oracle.state import (
    ANY_CALL,
    Hypothesis,
    Instances,
    Obligation,
    PendingTimer,
    QueuedEvent,
    TimerKey,
    add_goal,
    adopt_goal,
    change_goal,
    goal_allows,
    goal_called,
    goal_to_cancel,
    perhaps_cancel,
    served_goal,
)
from moon.oracle.steps import Delayed, Output, Step
from moon.oracle.trace_events import EventKey, TraceEvent
from moon.oracle.unknowns import Unknown, anything, like, unknown_of
from transports.actions.rules import Phase

_OF_GOALS = (EventKind.THREAD_START, EventKind.THREAD_FREE, EventKind.FEEDBACK)
_QUEUED = (EventKind.INTERNAL, EventKind.MESSAGE)
"""What a machine sends itself: messages are those that it publishes and alone takes of itself."""


class Occasion:
    """When a step is taken, and upon what.

    Attributes:
        low, high: between these times (ns).
        timer: the timer that rings, if it rings again and again.
        call: the call that asks for it, if one does.
    """

    __slots__ = ("call", "high", "low", "timer")

    def __init__(
        self, low: int, high: int, timer: TimerKey | None = None, call: Call | None = None
    ) -> None:
        self.low = low
        self.high = high
        self.timer = timer
        self.call = call


class Successors:
    """The steps of one machine and of its action threads. It keeps when the node stood still.

    Args:
        program: the machine.
        channels: its channels.
        bounds: what is assumed.
    """

    def __init__(self, program: Program, channels: Channels, bounds: Bounds) -> None:
        self._program = program
        self._parts = program.parts
        self._draws = program.draws
        self._channels = channels
        self._bounds = bounds
        self._silent_ns = self._acts_ns = 0
        self._asleep_ns = self._awake_ns = 0
        self.fails_unseen = False
        """Whether the node does not report that a call, or a goal, of its has failed."""

    # --- a node that stands still --------------------------------------------------------------------

    def was_silent(self, from_ns: int, until_ns: int) -> None:
        """The node did nothing between these times, and may have stood still for up to a deadline there.

        Nothing shows that, so it had to take what is certain to have been due. But it is not concluded that
        what it takes then was not due before.

        Args:
            from_ns: it did something then (ns).
            until_ns: and then again, more than a latency bound later.
        """
        self._silent_ns, self._acts_ns = from_ns, until_ns

    def stood_still(self, from_ns: int, until_ns: int) -> None:
        """The node stood still between these times: what was due is taken after them, in any order.

        It does not take that in the order in which it came: an executor may run its timers first, or take
        what arrived first.

        Args:
            from_ns: it did something then (ns).
            until_ns: and then again.
        """
        self._asleep_ns, self._awake_ns = from_ns, until_ns

    def taken_by(self, due: int) -> int:
        """By when (ns) is taken what was due then: a latency bound later, or after the node stood still."""
        by = due + self._bounds.latency
        if due < self._awake_ns and by > self._asleep_ns:
            return self._awake_ns + self._bounds.latency
        return by

    def over_by(self, now: int) -> int:
        """What was due by then (ns) has been taken by ``now``."""
        latency = self._bounds.latency
        if self._asleep_ns <= now < self._awake_ns + latency:
            return self._asleep_ns - latency
        return now - latency

    def due_since(self, now: int) -> int:
        """What is taken at ``now`` was due then (ns) at the earliest."""
        latency = self._bounds.latency
        if self._silent_ns <= now < self._acts_ns + latency:
            return max(self._silent_ns, now - self._bounds.deadline) - latency
        return now - latency

    # --- steps that nobody sees -------------------------------------------------------------------

    def unobserved(self, hypothesis: Hypothesis, now: int, since: int) -> Iterator[Hypothesis]:
        """What one more input, taken before ``now`` and seen by nobody, makes of ``hypothesis``.

        What had to be taken earlier than something else can have been is taken before it.

        Args:
            hypothesis: it owes nothing.
            now: stamp of the next fixed point (ns).
            since: stamp of the last fixed point (ns): what is taken is taken after it.
        """
        earliest = max(since, hypothesis.moment)
        latest = max(self.latest(hypothesis, certainly=True), since)
        if hypothesis.pending:
            streams = set()
            for place, fact in enumerate(hypothesis.pending):
                sent = fact.stamp - self._bounds.skew
                if sent >= now or sent > latest:
                    break
                if fact.stream in streams:
                    continue
                if not fact.may_be_lost:
                    streams.add(fact.stream)
                yield from self._message_taken(hypothesis, place, fact, max(sent, earliest), now)
        if hypothesis.queue:
            first = hypothesis.queue[0]
            if first.low < now and first.low <= latest:
                yield from self._event_taken(hypothesis, first, max(first.low, earliest), now)
        for place, timer in enumerate(hypothesis.timers):
            if timer.low <= min(now, latest) and self._matters(hypothesis, timer):
                if timer.period and self._is_behind(hypothesis, timer.low - timer.period):
                    continue
                low = max(timer.low, earliest)
                if not timer.is_certain and self.taken_by(timer.high) < low:
                    continue
                yield from self._timer_rung(hypothesis, place, timer, low, now)

        if earliest < now and self.may_fail(hypothesis):
            yield from self._failed(hypothesis, Occasion(earliest, now))

    def _failed(self, hypothesis: Hypothesis, when: Occasion) -> Iterator[Hypothesis]:
        """What one of its calls or goals makes of ``hypothesis`` if it fails."""
        state, _ = hypothesis.instances[0]
        for event in self._program.call_failures:
            is_open = hypothesis.free or self._channels.is_open(event[1])
            if is_open and self._parts[0].handles(state, event):
                yield from self.run(hypothesis, 0, event, None, {}, when)
        failures = self._program.goal_failures
        for event in failures.values() if hypothesis.free else ():  # of a goal of before
            if self._parts[0].handles(state, event):
                parts = {"goal_id": unknown_of(INT64)}
                yield from self.run(hypothesis, 0, event, None, parts, when)
        for goal in hypothesis.goals if failures else ():
            if not goal.served and goal.interface in failures:
                goals = tuple(other for other in hypothesis.goals if other is not goal)
                parts = {"goal_id": goal.name}
                over = hypothesis.but(goals=goals)
                yield from self.run(over, 0, failures[goal.interface], None, parts, when)

    def may_fail(self, hypothesis: Hypothesis) -> bool:
        """Whether one of its calls or goals may fail, and nobody sees that."""
        if not self.fails_unseen:
            return False
        if hypothesis.free or (hypothesis.goals and self._program.goal_failures):
            return True
        return any(self._channels.is_open(name) for _, name in self._program.call_failures)

    def _is_behind(self, hypothesis: Hypothesis, rang_ns: int) -> bool:
        """Whether a timer waits that was due before another one rang, at ``rang_ns`` or later.

        Whatever an executor prefers, it takes each timer that is due before it takes another one once more.
        """
        return any(
            timer.high < rang_ns and timer.is_certain and self._matters(hypothesis, timer)
            for timer in hypothesis.timers
        )

    def latest(self, hypothesis: Hypothesis, certainly: bool = False) -> int:
        """By when the next input has been taken; ``certainly``: of those it certainly gets."""
        earliest = FOREVER
        for fact in hypothesis.pending:
            if not (certainly and fact.may_be_lost) and not self.is_held(hypothesis, fact):
                earliest = fact.stamp + self._bounds.skew
                break  # the others are newer
        for event in hypothesis.queue:
            earliest = min(earliest, event.high)
        for timer in hypothesis.timers:
            if not timer.is_certain or timer.high >= earliest:
                continue
            if self._matters(hypothesis, timer):
                earliest = timer.high
        return FOREVER if earliest == FOREVER else self.taken_by(earliest)

    def is_held(self, hypothesis: Hypothesis, fact: TraceEvent) -> bool:
        """Whether ``fact`` is feedback that is kept until its goal is accepted."""
        if fact.event is None or fact.event[0] is not EventKind.FEEDBACK:
            return False
        goal = goal_called(hypothesis, fact.interface, fact.goal, served=False)
        return goal is not None and goal.phase is not Phase.RUNNING

    def with_kept_feedback(self, hypothesis: Hypothesis, interface: str, stamp: int) -> Hypothesis:
        """``hypothesis`` as a goal is accepted at ``stamp`` that was sent before the oracle looked.

        Its client may have kept any number of messages of feedback until then.
        """
        event = (EventKind.FEEDBACK, interface)
        if not self._program.changes_something(event):
            return hypothesis
        kept = PendingTimer(0, event, stamp, stamp, 0, anything(), "", True)
        return hypothesis.with_timers((*hypothesis.timers, kept))

    def _message_taken(
        self, hypothesis: Hypothesis, place: int, fact: TraceEvent, low: int, now: int
    ) -> Iterator[Hypothesis]:
        earlier = hypothesis.pending[:place]
        if any(item.stream == fact.stream for item in earlier):
            # these are perhaps taken, and now certainly: a stream keeps its order
            earlier = tuple(item for item in earlier if item.stream != fact.stream)
        rest = hypothesis.with_pending(earlier + hypothesis.pending[place + 1 :])
        assert fact.event is not None
        high = max(low, min(self.taken_by(fact.stamp), now))
        parts: dict[str, Any] = {}
        if fact.event[0] is EventKind.FEEDBACK:
            goal = goal_called(hypothesis, fact.interface, fact.goal, served=False)
            if goal is None:
                if hypothesis.free and not self._channels.was_sent(fact.goal):
                    rest_too, adopted = adopt_goal(
                        rest, fact.interface, fact.goal, False, Phase.RUNNING
                    )
                    parts = {"goal_id": adopted.name}
                    yield from self.run(
                        rest_too, 0, fact.event, fact.data, parts, Occasion(low, high)
                    )
                yield rest
                return
            if goal.phase is not Phase.RUNNING:
                return
            parts = {"goal_id": goal.name}
        if fact.may_be_lost:
            yield rest
        yield from self.run_everywhere(rest, fact.event, fact.data, parts, Occasion(low, high))

    def _event_taken(
        self, hypothesis: Hypothesis, event: QueuedEvent, low: int, now: int
    ) -> Iterator[Hypothesis]:
        rest = hypothesis.but(queue=hypothesis.queue[1:])
        high = max(low, min(self.taken_by(event.high), now))
        yield from self.run(
            rest, event.instance, event.event, event.message, event.parts, Occasion(low, high)
        )

    def _timer_rung(
        self, hypothesis: Hypothesis, place: int, timer: PendingTimer, low: int, now: int
    ) -> Iterator[Hypothesis]:
        by = self.taken_by(timer.high)
        high, most_ns = max(low, min(by, now)), by - timer.high
        others = hypothesis.timers[:place] + hypothesis.timers[place + 1 :]
        if timer.period:
            # ticks slept through are skipped, the phase is kept (see Executor)
            slack = self._bounds.slack(timer.period)
            latest = min(timer.high, now)
            if most_ns >= timer.period:
                latest = max(latest, high)
            following = timer.due(
                max(timer.low, self.due_since(low)) + timer.period - slack,
                latest + timer.period + slack,
            )
            others = (*hypothesis.timers[:place], following, *hypothesis.timers[place + 1 :])
        elif timer.perhaps:
            others = hypothesis.timers  # there may be another
        rest = hypothesis.with_timers(others)
        key = (timer.instance, timer.event) if timer.period else None
        parts = self._parts_of(timer.instance, timer.event)
        data = like(timer.data) if timer.perhaps and timer.data is not None else timer.data
        when = Occasion(low, high, timer=key)
        yield from self.run(rest, timer.instance, timer.event, data, parts, when)

    def _parts_of(self, instance: int, event: EventKey) -> dict[str, Any]:
        """What comes with an event that the machine may take by itself; of goals nothing is known."""
        kind, name = event
        if kind not in _OF_GOALS:
            return {"name": name}
        parts: dict[str, Any] = {"goal_id": unknown_of(INT64), "thread_id": unknown_of(INT64)}
        if kind is EventKind.THREAD_START:
            parts["thread_id"] = self._program.threads[instance - 1][1]
        return parts

    # --- one step -----------------------------------------------------------------------------------

    def run(
        self,
        hypothesis: Hypothesis,
        instance: int,
        event: EventKey,
        message: Any,
        parts: Mapping[str, Any],
        when: Occasion,
    ) -> Iterator[Hypothesis]:
        """Process ``event``: every outcome."""
        call = when.call
        for taken, step in self.take(hypothesis, instance, event, message, parts):
            made = hypothesis
            if taken or step.transition is not None:
                made = self.absorb(hypothesis, instance, step, when)
            if not taken and call is not None:
                # a request that the state discards is never answered
                asked = (event[1], call)
                waiting = tuple(item for item in made.waiting if item != asked)
                made = made.but(waiting=waiting)
            yield made

    def run_everywhere(
        self,
        hypothesis: Hypothesis,
        event: EventKey,
        message: Any,
        parts: Mapping[str, Any],
        when: Occasion,
    ) -> Iterable[Hypothesis]:
        """``event`` for the machine and then for each of its threads, as one piece of work."""
        found: Iterable[Hypothesis] = (hypothesis,)
        for instance in self._program.takers_of(event):
            found = [
                made
                for before in found
                for made in self.run(before, instance, event, message, parts, when)
            ]
        return found

    def take(
        self,
        hypothesis: Hypothesis,
        instance: int,
        event: EventKey,
        message: Any,
        parts: Mapping[str, Any],
    ) -> Iterable[tuple[bool, Step]]:
        """What one of its instances can do with ``event``: whether a transition took it, and the step."""
        state, data = hypothesis.instances[instance]
        symbolic = self._draws or hypothesis.free or hypothesis.vague > 0
        return self._parts[instance].take(state, data, event, message, parts, symbolic)

    def absorb(
        self,
        before: Hypothesis,
        instance: int,
        step: Step,
        when: Occasion,
        waiting: tuple[tuple[str, Call], ...] | None = None,
    ) -> Hypothesis:
        """``before`` after ``step`` of one of its instances; ``waiting``: the requests, if others."""
        instances, low, high = before.instances, when.low, when.high
        changed = (step.state, tuple(step.data))
        made = before.copy()
        if waiting is not None:
            made.waiting = waiting
        made.instances = (*instances[:instance], changed, *instances[instance + 1 :])
        made.moment = max(low, before.moment)
        if before.timers and step.state != instances[instance][0]:
            awakened = (self._awakened(before, made, item, low, high) for item in made.timers)
            made.timers = tuple([timer for timer in awakened if timer is not None])
        if step.scheduled:
            self._schedule(made, instance, step.scheduled, low, high)
        for output in step.outputs:
            self._owe(made, instances, instance, output, when)
        return made

    def _awakened(
        self, before: Hypothesis, made: Hypothesis, timer: PendingTimer, low: int, high: int
    ) -> PendingTimer | None:
        """A timer that a step makes matter: it may just have rung without effect, or not; None: it has."""
        if self._matters(before, timer) or not self._matters(made, timer):
            return timer
        if not timer.period:
            if self.taken_by(timer.high) < low:
                return None
            return timer.as_optional() if timer.low <= high else timer
        rings = timer.not_before(self.due_since(low))
        last = rings.high
        if rings.low <= high:  # the next is the one after all that may have rung by then
            next_ns = last + ((high - rings.low) // rings.period + 1) * rings.period
            last = min(next_ns, high + rings.period) + self._bounds.slack(rings.period)
        return rings.due(rings.low, max(last, rings.low))

    def _schedule(
        self,
        made: Hypothesis,
        instance: int,
        scheduled: list[Delayed | Output | str],
        low: int,
        high: int,
    ) -> None:
        timers = list(made.timers)
        for item in scheduled:
            if isinstance(item, str):
                timers = [a for a in timers if a.instance != instance or a.id != item or not item]
                continue
            if isinstance(item, Output):
                self._tell_part(made, instance, item, low, high)
                continue
            if isinstance(item.delay_s, Unknown) and not _is_bounded(item):
                # without a delay it is on its queue, and cannot be cancelled
                for until, identifier in ((FOREVER, item.id), (high, "")):
                    timers.append(
                        PendingTimer(
                            instance, item.event, low, until, 0, item.data, identifier, True
                        )
                    )
                continue
            least, most = _delays(item.delay_s)
            if item.event[0] in _QUEUED and most <= 0:
                parts = self._parts_of(instance, item.event)
                sent = QueuedEvent(instance, item.event, item.data, parts, low, high)
                made.queue = (*made.queue, sent)
                continue
            shortest, longest = round(least * 1e9), round(most * 1e9)
            if item.event[0] is EventKind.AFTER:
                timers = [a for a in timers if a.instance != instance or a.event != item.event]
            timers.append(
                PendingTimer(
                    instance,
                    item.event,
                    low + shortest - self._bounds.slack(shortest),
                    high + longest + self._bounds.slack(longest),
                    0,
                    item.data,
                    item.id,
                )
            )
        made.timers = tuple(timers)

    def _owe(
        self,
        made: Hypothesis,
        before: Instances,
        instance: int,
        output: Output,
        when: Occasion,
    ) -> None:
        """What an output of the model means: something to be seen, or something inside.

        ``before`` is what the machine was before the step.
        """
        kind, low, high = output.kind, when.low, when.high
        optional = False
        interface = output.interface
        goal: Any = None
        answers: Call | None = None
        match kind:
            case OutputKind.PUBLISH:
                interface = self._channels.name_of(InterfaceKind.PUBLISHER, interface)
            case OutputKind.REQUEST:
                interface = self._channels.name_of(InterfaceKind.CLIENT, interface)
            case OutputKind.RESPONSE:
                answers = _answered(made, interface, when.call)
                if answers is None:
                    if not made.free:
                        return  # no request waits: nothing leaves
                    answers, optional = ANY_CALL, not _surely_waits(made, interface)
            case OutputKind.SEND_GOAL:
                goal = add_goal(made, interface, "", served=False).number
            case OutputKind.SEND_CANCEL:
                found = goal_to_cancel(made, interface, output.goal)
                if found is None:
                    if not _may_name_any(made, output.goal):
                        return
                    perhaps_cancel(made, interface)
                    optional = True
                elif found.phase is Phase.NEW:
                    change_goal(made, found, cancel=True)
                    return
                else:
                    goal = found.id or None
            case (
                OutputKind.ACCEPT_GOAL
                | OutputKind.REJECT_GOAL
                | OutputKind.FEEDBACK
                | OutputKind.SUCCEED
                | OutputKind.ABORT
                | OutputKind.CANCEL
            ):
                served = served_goal(made, output)
                if served is None:
                    if not _may_name_any(made, output.goal):
                        return  # a goal that is not there: reported by the node, nothing leaves
                    goal, optional = output.goal if isinstance(output.goal, Unknown) else None, True
                elif not goal_allows(made, served, output):
                    return
                else:
                    goal = served.id
            case _:
                # of a thread: queued in its place; or a plugin's answer, inside the policy's process
                return
        if self._program.declared_channel(kind, output.interface) is None:
            return  # the channel is only known at run time
        made.owed = (
            *made.owed,
            Obligation(
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
                when.timer,
                (before,),
            ),
        )

    def _tell_part(
        self, made: Hypothesis, instance: int, output: Output, low: int, high: int
    ) -> None:
        """Queue what an output is to a thread, or to the machine around it."""
        if output.kind is OutputKind.START_THREAD:
            self._start_thread(made, output, low, high)
        else:
            self._free_thread(made, instance, output, low, high)

    def _start_thread(self, made: Hypothesis, output: Output, low: int, high: int) -> None:
        number = 0 if output.thread is None else output.thread
        if number.__class__ is Unknown:
            raise TooManyError(f"which thread of {output.interface} is started is not known")
        event = (EventKind.THREAD_START, output.interface)
        parts = {"goal_id": output.goal or 0, "thread_id": number}
        for instance in self._program.instances_of(output.interface, number):
            started = QueuedEvent(instance, event, output.fields, parts, low, high)
            made.queue = (*made.queue, started)

    def _free_thread(
        self, made: Hypothesis, instance: int, output: Output, low: int, high: int
    ) -> None:
        # what the model says is not asked: a thread names itself
        number = self._program.threads[instance - 1][1] if instance else 0
        parts = {"goal_id": output.goal or 0, "thread_id": number}
        event = (EventKind.THREAD_FREE, output.interface)
        made.queue = (*made.queue, QueuedEvent(0, event, None, parts, low, high))

    def _matters(self, hypothesis: Hypothesis, timer: PendingTimer) -> bool:
        state, _ = hypothesis.instances[timer.instance]
        return self._parts[timer.instance].handles(state, timer.event)

    def is_still(self, hypothesis: Hypothesis, now: int) -> bool:
        """Whether nothing can have been taken before ``now``."""
        if hypothesis.owed:
            return not all(owed.optional for owed in hypothesis.owed)
        if hypothesis.queue or hypothesis.pending or self.may_fail(hypothesis):
            return False
        return all(
            not (timer.low <= now and self._matters(hypothesis, timer))
            for timer in hypothesis.timers
        )

    def normalised(self, hypothesis: Hypothesis, now: int) -> Hypothesis:
        """Timers that nothing waits for, brought up to ``now``: those that rang without effect are over."""
        limit = self.due_since(now)
        timers = hypothesis.timers
        if not any(timer.high < limit for timer in timers):
            return hypothesis
        left: list[PendingTimer] = []
        for timer in timers:
            if timer.high >= limit or self._matters(hypothesis, timer):
                left.append(timer)
            elif timer.period:
                left.append(timer.not_before(limit))
        return hypothesis.with_timers(tuple(left))


def _is_bounded(item: Delayed) -> bool:
    """Whether a delay that is not known is one after which the event comes as a timer's does.

    Without a delay it would be on its queue, and could not be cancelled.
    """
    delay = item.delay_s
    is_range = not delay.anything and delay.high <= MAX_DELAY_S
    return is_range and (delay.low > 0 or not item.id)


def _delays(delay_s: Any) -> tuple[float, float]:
    """The shortest and the longest that ``delay_s`` can be, s."""
    return (
        (max(delay_s.low, 0), delay_s.high) if isinstance(delay_s, Unknown) else (delay_s, delay_s)
    )


def _may_name_any(made: Hypothesis, goal: Any) -> bool:
    """Whether ``goal``, which names no goal that is known, may name one all the same."""
    return made.free or (made.vague > 0 and goal.__class__ is Unknown)


def _answered(made: Hypothesis, interface: str, call: Call | None) -> Call | None:
    """Whose request a response answers: the one being processed, else the oldest; it is done.

    None where no request is known to wait, or where an older one may, of before its past is known.
    """
    waiting = made.waiting
    found = None
    if call is not None and (interface, call) in waiting:
        found = (interface, call)
    elif not made.free:
        found = next((item for item in waiting if item[0] == interface), None)
    if found is None:
        return None
    place = waiting.index(found)
    made.waiting = waiting[:place] + waiting[place + 1 :]
    return found[1]


def _surely_waits(made: Hypothesis, interface: str) -> bool:
    """Whether a request waits that no response owed by now answers, if an older one does not, too."""
    known = sum(name == interface for name, _ in made.waiting)
    owed = sum(
        item.call == ANY_CALL and item.interface == interface and not item.optional
        for item in made.owed
    )
    return known > owed
