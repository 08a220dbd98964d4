"""Beginnings: with which hypotheses a machine begins, as it starts or in the middle of a run."""

from __future__ import annotations

from typing import Any

from m2c.language.datatypes import Structure
from m2c.model.machine import EventKind, OutputKind
from moon.oracle.bounds import FOREVER, Bounds, TooManyError
from moon.oracle.channels import Channels
from moon.oracle.compiling import StateProgram
from moon.oracle.program import Program
from moon.oracle.state import Hypothesis, PendingTimer, put_in
from moon.oracle.successors import Occasion, Successors
from moon.oracle.trace_events import EventKey, TraceEvent
from moon.oracle.unknowns import Unknown, anything

_WITHOUT_MESSAGE = (EventKind.TIMER, EventKind.AFTER, EventKind.CALL_ERROR)
_SENT_AS = {
    EventKind.MESSAGE: OutputKind.PUBLISH,
    EventKind.REQUEST: OutputKind.REQUEST,
    EventKind.RESPONSE: OutputKind.RESPONSE,
}
"""What others send as one of these outputs is such an input."""


class Beginnings:
    """The hypotheses with which a machine begins, as it starts or in the middle of a run.

    Args:
        successors: its steps.
        program: the machine.
        channels: its channels.
        bounds: what is assumed.
    """

    def __init__(
        self, successors: Successors, program: Program, channels: Channels, bounds: Bounds
    ) -> None:
        self._successors = successors
        self._program = program
        self._parts = program.parts
        self._channels = channels
        self._bounds = bounds

    def started(self, start: int, whole: bool = False, earliest: int = FOREVER) -> list[Hypothesis]:
        """The machine has just started, at ``start`` (ns); see ``Oracle.start``."""
        slack = 0 if whole else self._bounds.latency
        timers = tuple(
            PendingTimer(
                instance,
                event,
                start + period - self._bounds.slack(period) if whole else min(earliest, start),
                start + period + slack + self._bounds.slack(period),
                period,
            )
            for instance, event, period in self._program.periodic
        )
        blank = tuple((program.initial, program.initial_data()) for program in self._parts)
        found = [Hypothesis(blank, timers=timers)]
        for instance in (*range(1, len(self._parts)), 0):
            grown: list[Hypothesis] = []
            by_then = Occasion(min(earliest, start), start + slack)
            for hypothesis in found:
                _, data = hypothesis.instances[instance]
                grown += [
                    self._successors.absorb(hypothesis, instance, step, by_then)
                    for _, step in self._parts[instance].start(data)
                ]
            found = grown
        if whole:
            return found
        made: dict[Any, Hypothesis] = {}
        for hypothesis in found:
            for first in range(len(hypothesis.owed) + 1):
                rest = hypothesis.with_owed(hypothesis.owed[first:])
                put_in(made, rest)
        return list(made.values())

    def unconstrained_states(self, now: int, pending: tuple[TraceEvent, ...]) -> list[Hypothesis]:
        """The machine is between two steps at ``now``, and nothing more is known of it."""
        self._channels.forget_goals()
        earliest = self._successors.due_since(now)
        timers = tuple(
            PendingTimer(instance, event, earliest, self._until(now, period), period)
            for instance, event, period in self._program.periodic
        )
        # what it sent itself before may come until its delay has passed: how often it did is not known
        sent = tuple(
            PendingTimer(
                *(instance, event, earliest, self._sent_until(now, delay_s), 0),
                anything() if has_data else None,
                identifier,
                True,
            )
            for (instance, event, identifier, has_data), delay_s in self._program.sent_to_itself
        )
        combinations: list[tuple[tuple[int, tuple[Any, ...]], ...]] = [()]
        for program in self._parts:
            data = program.unknown_data()
            combinations = [
                (*known, (index, data))
                for known in combinations
                for index, state in enumerate(program.states)
                if _can_rest(state)
            ]
            if len(combinations) > self._bounds.hypotheses:
                raise TooManyError
        found = []
        for instances in combinations:
            delays = tuple(
                PendingTimer(
                    instance,
                    event,
                    earliest,
                    self._until(now, round(delay * 1e9)),
                    0,
                    None,
                    event[1],
                )
                for instance, (state, _) in enumerate(instances)
                for event, delay in self._parts[instance].states[state].pending
            )
            found.append(
                Hypothesis(instances, pending=pending, timers=(*timers, *sent, *delays), free=True)
            )
        return found

    def _sent_until(self, now: int, delay_s: float | None) -> int:
        """Until when (ns) what was sent by ``now`` with this delay is due; None: that is not known."""
        return FOREVER if delay_s is None else self._until(now, round(delay_s * 1e9))

    def _until(self, now: int, delay: int) -> int:
        """Until when (ns) what was begun by ``now``, and takes ``delay`` (ns), is due."""
        return now + delay + self._bounds.slack(delay)

    def unfinished_steps(self, now: int, pending: tuple[TraceEvent, ...]) -> list[Hypothesis]:
        """At any moment: the machine is between two steps at ``now``, or has sent a part of what one owes.

        Raises:
            TooManyError: there are too many possibilities; also, of a machine with actions.
        """
        resting = self.unconstrained_states(now, pending)
        found = {hypothesis.key(): hypothesis for hypothesis in resting}
        earliest = now - self._bounds.deadline
        for hypothesis in resting:
            if len(hypothesis.instances) > 1:
                raise TooManyError
            state, _ = hypothesis.instances[0]
            for event in self._parts[0].events_in(state):
                message = self._unknown_message(event)
                for after in self._successors.run(
                    hypothesis, 0, event, message, {}, Occasion(earliest, now)
                ):
                    for first in range(len(after.owed)):
                        rest = after.with_owed(after.owed[first:])
                        put_in(found, rest)
                    if len(found) > self._bounds.hypotheses:
                        raise TooManyError
        return list(found.values())

    def _unknown_message(self, event: EventKey) -> dict[str, Unknown] | None:
        """What ``event`` brings, of which nothing is known; TooManyError for goals, which have a past."""
        kind, name = event
        if kind in _WITHOUT_MESSAGE:
            return None
        output = _SENT_AS.get(kind)
        if output is None:
            raise TooManyError
        structure = self._channels.types.get((output, name))
        if not isinstance(structure, Structure):
            raise TooManyError
        return {field: anything() for field, _ in structure.fields}


def _can_rest(state: StateProgram) -> bool:
    """Whether a step can end in ``state``: no eventless transition leaves it for sure."""
    return all(transition.condition is not None for transition in state.eventless)
