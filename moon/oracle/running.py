"""One step of a machine: what a hypothesis is after it, and what it owes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import ActionThread, EventKind, InterfaceKind, Machine, OutputKind
from m2c.model.scopes import interface_kind_of
from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.channels import Channels
from moon.oracle.goals import (
    adopt_in_place,
    allowed,
    but,
    change,
    goal_to_cancel,
    served_goal,
)
from moon.oracle.hypothesis import (
    ANY_CALL,
    EventKey,
    Hypothesis,
    Instances,
    Obligation,
    PendingTimer,
    QueuedEvent,
    TimerKey,
)
from moon.oracle.step import Delayed, Output, Step
from moon.oracle.steps import MachineProgram
from moon.oracle.unknowns import Unknown
from moon.wording import Wording


class Running:
    """Steps of one machine and of its action threads.

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
        self.library = library
        self.wording = Wording(library)
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
        self.certain = not self._draws and not main.chooses
        """Whether a step of the machine has one outcome, where all values are known."""
        self._timers = [
            (instance, (EventKind.TIMER, name), period)
            for instance, program in enumerate(self.programs)
            for name, period in rates.items()
            if any(name in state.timers for state in program.states)
        ]
        self._channel_of: dict[tuple[InterfaceKind | None, str], str | None] = {
            (interface.kind, interface.name): interface.channel for interface in machine.interfaces
        }
        self._early, self._late = bounds.skew, bounds.skew + bounds.deadline
        """An output is stamped by this much before and after the step that owes it (ns)."""
        self.last = 0
        """Stamp of the last fixed point."""

    def run(
        self,
        hypothesis: Hypothesis,
        instance: int,
        event: EventKey,
        message: Any,
        parts: Mapping[str, Any],
        low: int,
        high: int,
        alarm: TimerKey | None = None,
        call: tuple[str, int] | None = None,
    ) -> Iterator[Hypothesis]:
        """Process ``event`` between ``low`` and ``high``: every outcome."""
        for taken, step in self._take(hypothesis, instance, event, message, parts):
            if not taken and call is not None:
                # a request that the state discards is never answered
                waiting = tuple(item for item in hypothesis.waiting if item[1] != call)
                yield but(hypothesis, waiting=waiting)
            elif not taken and not step.outputs and not step.scheduled:
                yield hypothesis
            else:
                yield self._absorb(hypothesis, instance, step, low, high, alarm, call)

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
        alarm: TimerKey | None = None,
        call: tuple[str, int] | None = None,
        waiting: tuple[tuple[str, tuple[str, int]], ...] | None = None,
    ) -> Hypothesis:
        """``before`` after ``step`` of one of its instances; ``waiting``: the requests, if others."""
        instances = before.instances
        changed = (step.state, tuple(step.data))
        made = before.copy()
        if waiting is not None:
            made.waiting = waiting
        made.instances = (*instances[:instance], changed, *instances[instance + 1 :])
        made.moment = max(low, before.moment)
        if before.alarms and step.state != instances[instance][0]:
            made.alarms = tuple(
                self._awakened(before, made, item, low, high) for item in made.alarms
            )
        if step.scheduled:
            self._schedule(made, instance, step.scheduled, low, high)
        for output in step.outputs:
            self._owe(made, instances, instance, output, low, high, alarm, call)
        return made

    def _awakened(
        self, before: Hypothesis, made: Hypothesis, alarm: PendingTimer, low: int, high: int
    ) -> PendingTimer:
        """A periodic timer that a step makes matter: it may just have rung unheard, or just not."""
        if not alarm.period or self._matters(before, alarm) or not self._matters(made, alarm):
            return alarm
        rings = alarm.not_before(low - self.bounds.latency)
        last = rings.high
        if rings.low <= high:
            last = min(last, high) + rings.period + self._slack(rings.period)
        return rings.due(rings.low, max(last, rings.low))

    def _schedule(
        self, made: Hypothesis, instance: int, scheduled: list[Delayed | str], low: int, high: int
    ) -> None:
        alarms = list(made.alarms)
        for item in scheduled:
            if isinstance(item, str):
                alarms = [a for a in alarms if a.instance != instance or a.id != item or not item]
                continue
            if isinstance(item.delay_s, Unknown):
                alarms.append(
                    PendingTimer(instance, item.event, low, FOREVER, 0, item.data, item.id)
                )
                continue
            if item.event[0] is EventKind.INTERNAL and item.delay_s <= 0:
                posted = QueuedEvent(
                    instance, item.event, item.data, {"name": item.event[1]}, low, high
                )
                made.posted = (*made.posted, posted)
                continue
            delay = round(item.delay_s * 1e9)
            slack = self._slack(delay)
            if item.event[0] is EventKind.AFTER:
                alarms = [a for a in alarms if a.instance != instance or a.event != item.event]
            alarms.append(
                PendingTimer(
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
        before: Instances,
        instance: int,
        output: Output,
        low: int,
        high: int,
        alarm: TimerKey | None,
        call: tuple[str, int] | None,
    ) -> None:
        """What an output of the model means: something to be seen, or something inside.

        ``before`` is what the machine was before the step.
        """
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
                _, sent = adopt_in_place(made, interface, "", False, "sent")
                goal = sent.number
            case OutputKind.SEND_CANCEL:
                found = goal_to_cancel(made, interface, output.goal)
                if found is None:
                    if not made.free:
                        return
                    optional = True
                elif found.phase == "sent":
                    change(made, found, cancel=True)
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
                served = served_goal(made, output)
                if served is None:
                    if not made.free:
                        return  # a goal that is not there: reported by the node, nothing leaves
                    goal, optional = output.goal if isinstance(output.goal, Unknown) else None, True
                elif not allowed(made, served, output):
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
        if self._channel_of.get((interface_kind_of(kind), output.interface)) is None:
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
                alarm,
                (before,),
            ),
        )

    def _start_thread(self, made: Hypothesis, output: Output, low: int, high: int) -> None:
        number = 0 if output.thread is None else output.thread
        for index, (thread, which) in enumerate(self._threads, 1):
            if thread.interface == output.interface and which == number:
                event = (EventKind.THREAD_START, output.interface)
                parts = {"goal_id": output.goal or 0, "thread_id": number}
                posted = QueuedEvent(index, event, output.fields, parts, low, high)
                made.posted = (*made.posted, posted)

    def _free_thread(
        self, made: Hypothesis, instance: int, output: Output, low: int, high: int
    ) -> None:
        number = self._threads[instance - 1][1] if instance else 0
        parts = {"goal_id": output.goal or 0, "thread_id": number}
        event = (EventKind.THREAD_FREE, output.interface)
        made.posted = (*made.posted, QueuedEvent(0, event, None, parts, low, high))

    def _matters(self, hypothesis: Hypothesis, alarm: PendingTimer) -> bool:
        state, _ = hypothesis.instances[alarm.instance]
        return self.programs[alarm.instance].handles(state, alarm.event)

    def is_still(self, hypothesis: Hypothesis, now: int) -> bool:
        """Whether nothing can have been taken before ``now``."""
        if hypothesis.owed:
            return not all(owed.optional for owed in hypothesis.owed)
        if hypothesis.posted or hypothesis.pending:
            return False
        return all(
            not (alarm.low <= now and self._matters(hypothesis, alarm))
            for alarm in hypothesis.alarms
        )

    def normalised(self, hypothesis: Hypothesis, now: int) -> Hypothesis:
        """Timers that nothing waits for, brought up to ``now``."""
        latency = self.bounds.latency
        alarms = hypothesis.alarms
        if not any(a.period and a.high + latency < now for a in alarms):
            return hypothesis
        return hypothesis.with_alarms(
            tuple(
                alarm
                if not alarm.period or self._matters(hypothesis, alarm)
                else alarm.not_before(now - latency)
                for alarm in alarms
            )
        )

    def _slack(self, duration: int) -> int:
        """By how much a timer and the stamps may disagree after ``duration`` (ns).

        Clocks are read with some granularity, and one that is being slewed runs up to 0.05 % too
        fast or too slow (RFC 5905, 11.3).
        """
        return duration // 1000 + self.bounds.tolerance

    def taken_topics(self) -> frozenset[str]:
        """Channels of others whose messages can make a difference to what is seen."""
        found = set()
        for kind, ending, event in (
            (InterfaceKind.SUBSCRIBER, "", EventKind.MESSAGE),
            (InterfaceKind.ACTION_CLIENT, "/_action/feedback", EventKind.FEEDBACK),
        ):
            for interface in self.machine.interfaces:
                channel = interface.channel
                if (
                    interface.kind is kind
                    and channel
                    and (event, interface.name) in self._effective
                ):
                    found.add(channel + ending)
        return frozenset(found)

    @property
    def takes_feedback(self) -> bool:
        """Whether feedback of goals can make a difference to what is seen: its node does not report when."""
        return any(event[0] is EventKind.FEEDBACK for event in self._effective)

    def changes_something(self, event: EventKey | None) -> bool:
        """Whether ``event`` can make a difference to what is seen, in any state."""
        return event in self._effective

    def channel_of_output(self, kind: OutputKind, interface: str) -> str:
        """The channel by which an output leaves, for messages to people."""
        return self._channel_of.get((interface_kind_of(kind), interface)) or interface


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
