"""All that a machine can have done: hypotheses and how they go on.

The rules are those of design section 6. An input or output stamped where the machine took or made it
is a fixed point; a message of a topic was taken at some time between its stamp and the latency bound
after it; timers are inputs that nobody publishes. Between two fixed points, every possible order of
what may have been taken is followed; equal hypotheses are merged. An output was owed next by some hypotheses;
the others are dropped (``Outputs``). Mostly only one thing can have happened, and nothing has to be searched
(``DeterministicSuccessor``).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import EventKind, Machine
from moon.oracle.beginnings import Beginnings
from moon.oracle.bounds import FEW_HYPOTHESES, FOREVER, LOOSE_STEPS, STEPS, Bounds, TooManyError
from moon.oracle.channels import Channels
from moon.oracle.deterministic import DeterministicSuccessor
from moon.oracle.inputs import Inputs
from moon.oracle.merging import is_exact, joined, place_of, vague
from moon.oracle.outputs import Outputs
from moon.oracle.program import Program
from moon.oracle.state import Hypothesis, distinct
from moon.oracle.successors import Successors
from moon.oracle.trace_events import Role, TraceEvent
from moon.wording import Wording


class Search:
    """The hypotheses of one machine.

    Args:
        machine: the model.
        library: its message types.
        channels: its channels.
        bounds: what is assumed.
        program: the machine, ready to be stepped, if it is already; oracles of many runs of it share one.

    Attributes:
        program: the machine, ready to be stepped.
        wording: how its values are shown to people.
        last: stamp of the last fixed point (ns); who judges sets it.
        successors: what a hypothesis is after one step of the machine.
        beginnings: the first hypotheses.
        inputs: what hypotheses are after an input that is stamped where it was taken.
        deterministic_successor: the same as the search without one, where only one thing can have happened.
    """

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary,
        channels: Channels,
        bounds: Bounds,
        program: Program | None = None,
    ) -> None:
        self.bounds = bounds
        self.wording = Wording(library)
        self.program = Program(machine, library) if program is None else program
        self.last = 0
        self._vague_since = 0
        self._vague_steps = 0
        """Steps tried with unknown data since then (ns): no more for a deadline than for one look."""
        self.successors = successors = Successors(self.program, channels, bounds)
        self.beginnings = Beginnings(successors, self.program, channels, bounds)
        self.inputs = Inputs(successors, self.program, channels)
        self._outputs = Outputs(self.program, channels, bounds, successors.due_since)
        self.deterministic_successor = DeterministicSuccessor(
            successors, self._outputs, self.program, channels
        )

    # --- from one event to the next -----------------------------------------------------------------

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
            found = self.inputs.take(candidates, fact)
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
        if len(found) > self.bounds.hypotheses:
            merged = self._explore_vaguely(found, stamp)
            if merged is None:
                raise TooManyError(_crowd(found))
            found = merged
        if len(found) == 1 and found[0].vague and is_exact(found[0]):
            found[0] = found[0].but(vague=0)
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

    # --- between fixed points ----------------------------------------------------------------------

    def timer_successors(self, hypothesis: Hypothesis, now: int) -> list[Hypothesis] | None:
        """What a timer makes of ``hypothesis`` that then owes an output, for one sent at ``now``.

        A short cut where nothing but timers can have brought the output about, and whatever they
        bring about has to be out before anything else is taken. None: ask ``reachable``.
        """
        if hypothesis.owed or hypothesis.pending or hypothesis.queue:
            return None
        made = list(self.successors.unobserved(hypothesis, now, self.last))
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
        if all(self.successors.is_still(hypothesis, now) for hypothesis in hypotheses):
            return hypotheses
        hypotheses = self._without_old(hypotheses)
        found = None if self._is_vague(hypotheses, now) else self._explore(hypotheses, now)
        if found is None:
            return self._loosely(hypotheses, now, due)
        found = [self._without_expired(h, due) for h in found]
        return [h for h in found if h.owed or self._has_taken(h, due)]

    def _loosely(self, hypotheses: list[Hypothesis], now: int, due: int) -> list[Hypothesis]:
        """As ``reachable``, where there are too many possibilities; TooManyError if there are even so."""
        found = None
        is_vague = self._is_vague(hypotheses, now)
        if not is_vague and any(hypothesis.pending for hypothesis in hypotheses):
            found = self._explore_loosely(hypotheses, now)
        if found is None:
            found = self._explore_vaguely(hypotheses, now)
        if found is None:
            raise TooManyError(_crowd(hypotheses))
        found = [self._without_expired(h, due) for h in found]
        return [h for h in found if h.owed or self._has_taken(h, due)]

    def _is_vague(self, hypotheses: list[Hypothesis], now: int) -> bool:
        """Whether there were too many possibilities a short time ago, or still are several."""
        for hypothesis in hypotheses:
            if hypothesis.vague:
                since = max([other.vague for other in hypotheses])
                return len(hypotheses) > 1 or now < since + self.bounds.deadline
        return False

    def passed(self, hypotheses: list[Hypothesis], now: int) -> list[Hypothesis]:
        """What can be so at ``now``, where nothing was seen since: all that was due has been taken.

        What may have been taken beyond that is left to :meth:`reachable`: it follows from these as well
        later. So a machine is followed with few hypotheses between two fixed points, however many
        messages are on their way to it.

        Args:
            hypotheses: what could be so before.
            now: all that happened until then was received (ns).
        """
        known: dict[Any, Hypothesis] = {}
        found: list[Hypothesis] = []
        if self._is_vague(hypotheses, now):
            looked = max(hypothesis.vague for hypothesis in hypotheses)
            if now < looked + self.bounds.latency:
                return hypotheses  # what is found by then is found by the next look, too
            return self._loosely(hypotheses, now, now)
        hypotheses = self._without_old(hypotheses)
        todo = list(hypotheses)
        while todo:
            hypothesis = _news(known, todo.pop())
            if hypothesis is None:
                continue
            if len(known) > self.bounds.hypotheses:
                return self._loosely(hypotheses, now, now)
            if hypothesis.owed or self._has_taken(hypothesis, now):
                found.append(hypothesis)
            else:
                todo.extend(self.successors.unobserved(hypothesis, now, self.last))
        return distinct(found)

    def _reduced(self, hypotheses: list[Hypothesis], now: int) -> list[Hypothesis]:
        """``hypotheses`` without those that others of them become by taking messages after ``now``.

        Not a message that is too old: who has it takes it no more.
        """
        hypotheses = distinct(self._without_old(hypotheses))
        left = {hypothesis.key(): hypothesis for hypothesis in hypotheses}
        seen: set[Any] = set()
        for hypothesis in sorted(hypotheses, key=lambda h: -len(h.pending)):
            first = hypothesis.key()
            if hypothesis.owed or not hypothesis.pending or first not in left or first in seen:
                continue
            todo = [hypothesis]
            while todo and len(seen) <= self.bounds.hypotheses:
                for made in self.successors.unobserved(todo.pop(), now, self.last):
                    key = made.key()
                    if key in seen or key == first or made.owed:
                        continue
                    seen.add(key)
                    todo.append(made)
                    follower = left.get(key)
                    if follower is not None and made.allows(follower):
                        del left[key]
        return list(left.values())

    @property
    def _old_ns(self) -> int:
        """A message stamped by then (ns) had to be taken long before the last fixed point."""
        return self._over_by(self.last - self.bounds.latency)

    def _without_old(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Without messages that are too old to be taken; none is taken while an output is owed."""
        limit, left = self._old_ns, []
        for hypothesis in hypotheses:
            pending = hypothesis.pending
            if hypothesis.owed or not pending or pending[0].stamp > limit:
                left.append(hypothesis)
            else:
                kept = tuple(fact for fact in pending if not _is_old(fact, limit))
                left.append(hypothesis.with_pending(kept))
        return left

    def _over_by(self, due: int) -> int:
        """A message stamped by then (ns) has been taken by ``due`` (ns), or is not."""
        return self.successors.over_by(due) - self.bounds.skew

    def _without_expired(self, hypothesis: Hypothesis, due: int) -> Hypothesis:
        """Messages that may be lost, once they were taken by then or never: both have been followed.

        Not while an output is owed: nothing is taken before that. Nor feedback that is kept until its goal
        is accepted: it is taken then.
        """
        if hypothesis.owed:
            return hypothesis
        limit = self._over_by(due)
        for timer in hypothesis.timers:
            if timer.high < limit and not timer.is_certain:
                left = [t for t in hypothesis.timers if t.high >= limit or t.is_certain]
                hypothesis = hypothesis.with_timers(tuple(left))
                break
        is_held = self.successors.is_held
        for fact in hypothesis.pending:
            if fact.stamp > limit:
                return hypothesis
            if fact.may_be_lost and not is_held(hypothesis, fact):
                break
        else:
            return hypothesis
        return hypothesis.with_pending(
            tuple(
                fact
                for fact in hypothesis.pending
                if not fact.may_be_lost or fact.stamp > limit or is_held(hypothesis, fact)
            )
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
        perhaps = self._perhaps(hypotheses)
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

    def _perhaps(self, hypotheses: list[Hypothesis]) -> tuple[TraceEvent, ...]:
        """The messages that are under way by any of ``hypotheses``, each perhaps taken already.

        Those that are so already, and had to be taken long before the last fixed point, are not.
        """
        limit = self._old_ns
        under_way = {
            id(fact.base): fact
            for hypothesis in hypotheses
            for fact in hypothesis.pending
            if not _is_old(fact, limit)
        }
        perhaps = [fact.as_may_be_lost() for fact in under_way.values()]
        return tuple(sorted(perhaps, key=lambda fact: fact.stamp))

    def _explore_vaguely(self, hypotheses: list[Hypothesis], now: int) -> list[Hypothesis] | None:
        """The same, with one hypothesis for all that differ in their data (``merging``)."""
        perhaps = self._perhaps(hypotheses)
        unknown = self.program.unknown_data()
        known: dict[Any, Hypothesis] = {}
        changed: dict[
            Any, None
        ] = {}  # first in, first out: what comes from one is joined before it goes on
        found = list(hypotheses)
        limit = self.bounds.hypotheses
        if not 0 <= now - self._vague_since < self.bounds.deadline:
            self._vague_since, self._vague_steps = now, 0
        while True:
            for each in found:
                made = vague(each, now).with_pending(perhaps)
                place = place_of(made)
                before = known.get(place)
                wide = made if before is None else joined(before, made, unknown)
                if wide is not None:
                    known[place] = wide
                    changed[place] = None
            self._vague_steps += len(found)
            if len(known) > limit or self._vague_steps > LOOSE_STEPS * limit:
                return None
            if not changed:
                return list(known.values())
            place = next(iter(changed))
            del changed[place]
            found = list(self._following(known[place], now))
            for each in found:
                each.moment = 0

    def _following(self, hypothesis: Hypothesis, now: int) -> Iterable[Hypothesis]:
        """What one thing more that happens before ``now``, and is not seen, makes of ``hypothesis``."""
        if hypothesis.owed:
            # no input is taken before the outputs of a step are out
            if all(owed.optional for owed in hypothesis.owed):
                return (hypothesis.with_owed(()),)
            return ()
        is_moved = hypothesis.pending or hypothesis.queue or hypothesis.timers
        if is_moved or self.successors.may_fail(hypothesis):
            return self.successors.unobserved(hypothesis, now, self.last)
        return ()

    def _has_taken(self, hypothesis: Hypothesis, due: int) -> bool:
        """Whether everything is taken that had to be by ``due``."""
        return self.successors.latest(hypothesis) > due

    def next_due(self, hypothesis: Hypothesis) -> int:
        """When time alone will say something about ``hypothesis``."""
        if hypothesis.owed and not hypothesis.owed[0].optional:
            return hypothesis.owed[0].high + self.bounds.deadline
        if not (hypothesis.pending or hypothesis.queue or hypothesis.timers):
            return FOREVER
        return self.successors.latest(hypothesis)


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


def _is_old(fact: TraceEvent, limit: int) -> bool:
    """Whether a message stamped by ``limit`` (ns) is not taken any more.

    Feedback is kept until its goal is accepted, however long that takes, and is taken then.
    """
    if fact.stamp > limit or not fact.may_be_lost:
        return False
    return fact.event is None or fact.event[0] is not EventKind.FEEDBACK


def _crowd(hypotheses: list[Hypothesis]) -> str:
    """Why there are too many possibilities: on which channel most messages are under way."""
    counts: dict[tuple[str, str], int] = {}
    for fact in max((hypothesis.pending for hypothesis in hypotheses), key=len, default=()):
        counts[fact.stream] = counts.get(fact.stream, 0) + 1
    if not counts:
        return ""
    (source, channel), count = max(counts.items(), key=lambda item: item[1])
    return f"too many possibilities to follow: {count} messages at once on {channel} from {source}"
