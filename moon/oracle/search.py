"""All that a machine can have done: hypotheses and how they go on.

The rules are those of design section 6. An input or output stamped where the machine took or made it
is a fixed point; a message of a topic was taken at some time between its stamp and the latency bound
after it; timers are inputs that nobody publishes. Between two fixed points, every possible order of
what may have been taken is followed; equal hypotheses are merged.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Machine
from moon.oracle.bounds import (
    FEW_HYPOTHESES,
    FOREVER,
    LOOSE_STEPS,
    STEPS,
    Bounds,
    TooManyError,
)
from moon.oracle.compiling import StateProgram
from moon.oracle.deterministic_successor import DeterministicSuccessor
from moon.oracle.fixed_points import Inputs, Outputs
from moon.oracle.program import Program
from moon.oracle.state import Hypothesis, PendingTimer, distinct
from moon.oracle.successors import Successors
from moon.oracle.trace_events import Channels, Role, TraceEvent
from moon.wording import Wording


class Search:
    """The hypotheses of one machine.

    Args:
        machine: the model.
        library: its message types.
        channels: its channels.
        bounds: what is assumed.

    Attributes:
        program: the machine, ready to be stepped.
        wording: how its values are shown to people.
        last: stamp of the last fixed point (ns); who judges sets it.
    """

    def __init__(
        self, machine: Machine, library: InterfaceLibrary, channels: Channels, bounds: Bounds
    ) -> None:
        self.bounds = bounds
        self.wording = Wording(library)
        self.program = Program(machine, library)
        self.last = 0
        self._channels = channels
        self._successors = Successors(self.program, channels, bounds)
        self._inputs = Inputs(self._successors, self.program, channels)
        self._outputs = Outputs(self.program, channels, bounds)
        self._deterministic = DeterministicSuccessor(
            self._successors, self._outputs, self.program, channels
        )

    # --- beginnings --------------------------------------------------------------------------------

    def started(self, start: int, whole: bool = False) -> list[Hypothesis]:
        """The machine has just started, at ``start`` (ns); see ``Oracle.start`` for ``whole``."""
        slack = 0 if whole else self.bounds.latency
        timers = tuple(
            PendingTimer(
                instance,
                event,
                start + (period - self.bounds.slack(period) if whole else 0),
                start + period + slack + self.bounds.slack(period),
                period,
            )
            for instance, event, period in self.program.periodic
        )
        blank = tuple((program.initial, program.initial_data()) for program in self.program.parts)
        found = [Hypothesis(blank, timers=timers)]
        for instance in (*range(1, len(self.program.parts)), 0):
            grown: list[Hypothesis] = []
            for hypothesis in found:
                _, data = hypothesis.instances[instance]
                grown += [
                    self._successors.absorb(hypothesis, instance, step, start, start + slack)
                    for _, step in self.program.parts[instance].start(data)
                ]
            found = grown
        if whole:
            return found
        made: dict[Any, Hypothesis] = {}
        for hypothesis in found:
            for first in range(len(hypothesis.owed) + 1):
                rest = hypothesis.with_owed(hypothesis.owed[first:])
                made[rest.key()] = rest
        return list(made.values())

    def unconstrained_states(self, now: int, pending: tuple[TraceEvent, ...]) -> list[Hypothesis]:
        """The machine is between two steps at ``now``, and nothing more is known of it."""
        self._channels.forget_goals()
        timers = tuple(
            PendingTimer(instance, event, now - self.bounds.latency, now + period, period)
            for instance, event, period in self.program.periodic
        )
        combinations: list[tuple[tuple[int, tuple[Any, ...]], ...]] = [()]
        for program in self.program.parts:
            data = program.unknown_data()
            combinations = [
                (*known, (index, data))
                for known in combinations
                for index, state in enumerate(program.states)
                if _can_rest(state)
            ]
            if len(combinations) > self.bounds.hypotheses:
                raise TooManyError
        found = []
        for instances in combinations:
            delays = tuple(
                PendingTimer(
                    instance,
                    event,
                    now - self.bounds.latency,
                    now + round(delay * 1e9),
                    0,
                    None,
                    event[1],
                )
                for instance, (state, _) in enumerate(instances)
                for event, delay in self.program.parts[instance].states[state].delays
            )
            found.append(
                Hypothesis(instances, pending=pending, timers=(*timers, *delays), free=True)
            )
        return found

    # --- from one fact to the next -----------------------------------------------------------------

    def after(self, before: list[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """What can be so after ``fact``; empty if it cannot be."""
        stamp = fact.stamp
        if fact.role is Role.MESSAGE:
            if not self.program.changes_something(fact.event):
                return before
            self.check_pending(max(len(h.pending) for h in before) + 1, fact)
            return [h.with_pending((*h.pending, fact)) for h in before]
        if fact.role is Role.UNDECLARED:
            return []
        if fact.role is Role.RESULT and fact.output is None:
            return before  # somebody asks for a result: between transports
        if fact.role is Role.INPUT:
            candidates = [
                h
                for h in self.reachable(before, stamp, stamp)
                if all(owed.optional for owed in h.owed)
            ]
            found = self.take_input(candidates, fact)
        else:
            candidates = None
            if fact.role is Role.OUTPUT and len(before) == 1:
                candidates = self.timer_successors(before[0], stamp)
            if candidates is None:
                candidates = self.reachable(before, stamp, stamp - self.bounds.latency)
            if fact.role is Role.OUTPUT:
                found = self._outputs.take(candidates, fact)
            elif fact.role is Role.STATUS:
                found = self._outputs.take_status(candidates, fact)
            else:
                found = self._outputs.take_result(candidates, fact)
        self.last = stamp
        return found if len(found) <= FEW_HYPOTHESES else self._reduced(found, stamp)

    def check_pending(self, count: int, newest: TraceEvent) -> None:
        """TooManyError if ``count`` messages are under way: each makes one hypothesis more, or two."""
        most = self.bounds.hypotheses
        if count > most:
            source, channel = newest.stream
            within = f"{self.bounds.latency / 1e9:g} s"
            raise TooManyError(
                f"more than {most} messages within {within}, on {channel} from {source} too"
            )

    def deterministic_successor(
        self, hypothesis: Hypothesis, fact: TraceEvent
    ) -> Hypothesis | None:
        """What ``hypothesis``, the only one, is after ``fact``, where that is plain to see; else None.

        ``hypothesis`` itself is changed, as a rule: nobody else may hold it.
        """
        return self._deterministic.of(hypothesis, fact)

    def take_input(self, candidates: Iterable[Hypothesis], fact: TraceEvent) -> list[Hypothesis]:
        """The machine took ``fact`` at its stamp; none of ``candidates`` owes anything for sure."""
        return self._inputs.take(candidates, fact)

    def normalised(self, hypothesis: Hypothesis, now: int) -> Hypothesis:
        """``hypothesis`` with the timers that nothing waits for brought up to ``now`` (ns)."""
        return self._successors.normalised(hypothesis, now)

    # --- between fixed points ----------------------------------------------------------------------

    def timer_successors(self, hypothesis: Hypothesis, now: int) -> list[Hypothesis] | None:
        """What a timer makes of ``hypothesis`` that then owes an output, for one sent at ``now``.

        A short cut where nothing but timers can have brought the output about, and whatever they
        bring about has to be out before anything else is taken. None: ask ``reachable``.
        """
        if hypothesis.owed or hypothesis.pending or hypothesis.queue:
            return None
        made = list(self._successors.unobserved(hypothesis, now, self.last))
        if all(after.owed and not after.owed[0].optional for after in made):
            return made
        return None

    def reachable(self, hypotheses: list[Hypothesis], now: int, due: int) -> list[Hypothesis]:
        """All that can be so just before ``now``.

        Args:
            hypotheses: what could be so before.
            now: stamp of the next fixed point.
            due: what had to be taken by then has been taken.
        """
        if all(self._successors.is_still(hypothesis, now) for hypothesis in hypotheses):
            return hypotheses
        found = self._explore(hypotheses, now)
        if found is None:
            return self._loosely(hypotheses, now, due)
        found = [self._without_expired(h, due) for h in found]
        return [h for h in found if h.owed or self._has_taken(h, due)]

    def _loosely(self, hypotheses: list[Hypothesis], now: int, due: int) -> list[Hypothesis]:
        """As ``reachable``, where there are too many orders to be followed; TooManyError if even so."""
        found = self._explore_loosely(hypotheses, now)
        if found is None:
            raise TooManyError(_crowd(hypotheses))
        found = [self._without_expired(h, due) for h in found]
        return [h for h in found if h.owed or self._has_taken(h, due)]

    def passed(self, hypotheses: list[Hypothesis], now: int) -> list[Hypothesis]:
        """What can be so at ``now``, where nothing was seen since: all that was due has been taken.

        What may have been taken beyond that is left to :meth:`reachable`: it follows from these as well
        later. So a machine is followed with few hypotheses between two fixed points, however many
        messages are on their way to it.

        Args:
            hypotheses: what could be so before.
            now: all that happened until then has been heard (ns).
        """
        known: dict[Any, Hypothesis] = {}
        found: list[Hypothesis] = []
        todo = list(hypotheses)
        while todo:
            hypothesis = _news(known, self._without_expired(todo.pop(), now))
            if hypothesis is None:
                continue
            if len(known) > self.bounds.hypotheses:
                return self._loosely(hypotheses, now, now)
            if hypothesis.owed or self._has_taken(hypothesis, now):
                found.append(hypothesis)
            else:
                todo.extend(self._successors.unobserved(hypothesis, now, self.last))
        return distinct(found)

    def _reduced(self, hypotheses: list[Hypothesis], now: int) -> list[Hypothesis]:
        """``hypotheses`` without those that others of them become by taking messages after ``now``."""
        left = {hypothesis.key(): hypothesis for hypothesis in hypotheses}
        seen: set[Any] = set()
        for hypothesis in sorted(hypotheses, key=lambda h: -len(h.pending)):
            first = hypothesis.key()
            if hypothesis.owed or not hypothesis.pending or first not in left or first in seen:
                continue
            todo = [hypothesis]
            while todo and len(seen) <= self.bounds.hypotheses:
                for made in self._successors.unobserved(todo.pop(), now, self.last):
                    key = made.key()
                    if key in seen or key == first or made.owed:
                        continue
                    seen.add(key)
                    todo.append(made)
                    follower = left.get(key)
                    if follower is not None and made.allows(follower):
                        del left[key]
        return list(left.values())

    def _without_expired(self, hypothesis: Hypothesis, due: int) -> Hypothesis:
        """Messages that were perhaps taken, once they certainly are."""
        limit = due - self.bounds.latency - self.bounds.skew
        pending = hypothesis.pending
        for fact in pending:
            if fact.stamp > limit:
                return hypothesis
            if fact.may_be_lost:
                break
        else:
            return hypothesis
        return hypothesis.with_pending(
            tuple(fact for fact in pending if not fact.may_be_lost or fact.stamp > limit)
        )

    def _explore(self, hypotheses: list[Hypothesis], now: int) -> list[Hypothesis] | None:
        """All orders of taking what may have been taken; None if there are too many."""
        known: dict[Any, Hypothesis] = {}
        todo = list(hypotheses)
        limit = self.bounds.hypotheses
        tried = 0
        while todo:
            hypothesis = _news(known, todo.pop())
            if hypothesis is None:
                continue
            for made in self._following(hypothesis, now):
                tried += 1
                todo.append(made)
            if len(known) > limit or tried > STEPS * limit:
                return None
        return list(known.values())

    def _explore_loosely(self, hypotheses: list[Hypothesis], now: int) -> list[Hypothesis] | None:
        """The same, without the order in which messages were taken: each perhaps, at any time.

        k messages of several sources can be taken in up to k! orders, yet leave few different states.
        That allows more than was possible. None if there are too many all the same.
        """
        under_way = {id(fact.base): fact for h in hypotheses for fact in h.pending}
        perhaps = tuple(
            sorted((f.as_may_be_lost() for f in under_way.values()), key=lambda f: f.stamp)
        )
        known: dict[Any, Hypothesis] = {}
        todo = [hypothesis.with_pending(perhaps) for hypothesis in hypotheses]
        limit = self.bounds.hypotheses
        tried = 0
        while todo:
            hypothesis = _news(known, todo.pop())
            if hypothesis is None:
                continue
            for made in self._following(hypothesis, now):
                tried += 1
                loose = made.with_pending(perhaps)
                loose.moment = 0
                todo.append(loose)
            if len(known) > limit or tried > LOOSE_STEPS * limit:
                return None
        return list(known.values())

    def _following(self, hypothesis: Hypothesis, now: int) -> Iterable[Hypothesis]:
        """What one thing more that happens before ``now``, and is not seen, makes of ``hypothesis``."""
        if hypothesis.owed:
            # no input is taken before the outputs of a step are out
            if all(owed.optional for owed in hypothesis.owed):
                return (hypothesis.with_owed(()),)
            return ()
        if hypothesis.pending or hypothesis.queue or hypothesis.timers:
            return self._successors.unobserved(hypothesis, now, self.last)
        return ()

    def _has_taken(self, hypothesis: Hypothesis, due: int) -> bool:
        """Whether everything is taken that had to be by ``due``."""
        return self._successors.latest(hypothesis) > due

    def next_due(self, hypothesis: Hypothesis) -> int:
        """When time alone will say something about ``hypothesis``."""
        if hypothesis.owed and not hypothesis.owed[0].optional:
            return hypothesis.owed[0].high + self.bounds.deadline
        if not (hypothesis.pending or hypothesis.queue or hypothesis.timers):
            return FOREVER
        return self._successors.latest(hypothesis)


def _news(known: dict[Any, Hypothesis], made: Hypothesis) -> Hypothesis | None:
    """``made`` with the times ``known`` of its key, known from now on; None: it adds nothing."""
    key = made.key()
    before = known.get(key)
    if before is None:
        known[key] = made
        return made
    wide = before.merged(made)
    known[key] = before.also_from(made) if wide is None else wide
    return wide


def _crowd(hypotheses: list[Hypothesis]) -> str:
    """Why there are too many possibilities: on which channel most messages are under way."""
    counts: dict[tuple[str, str], int] = {}
    for fact in max((hypothesis.pending for hypothesis in hypotheses), key=len, default=()):
        counts[fact.stream] = counts.get(fact.stream, 0) + 1
    if not counts:
        return ""
    (source, channel), count = max(counts.items(), key=lambda item: item[1])
    return f"too many possibilities to follow: {count} messages at once on {channel} from {source}"


def _can_rest(state: StateProgram) -> bool:
    """Whether a step can end in ``state``: no eventless transition leaves it for sure."""
    return all(transition.condition is not None for transition in state.eventless)
