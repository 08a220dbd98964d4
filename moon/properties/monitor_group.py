"""One network of properties that begin together, with everything that lives while it runs."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from heapq import heappush
from typing import Any, NamedTuple

import msgspec

from moon.properties.compiler import BEGINNING, CompiledNetwork
from moon.properties.group_plan import GroupPlan
from moon.properties.network import NEVER, state_names
from moon.properties.predicates import (
    ANY_CHANNEL,
    ENVIRONMENT,
    UNKNOWN_ERRORS,
    KnownValues,
    PortGroup,
    why_unknown,
)
from moon.properties.property import Status, Verdict
from moon.properties.three_valued import Gap, Gaps, ThreeValued, normal, read_state, write_state
from moon.properties.witness import Change, explain
from transports.interface import Observation

REMEMBERED_CHANGES = 1024
"""Changes kept per predicate to explain a violation; older ones make a witness incomplete."""
_TRY_EVERY = 32
"""Observations between two looks at whether three-valued evaluation can end."""


class UnknownAtom(Exception):
    """A handler met a predicate without a value; nothing has changed yet."""


class Snapshot(NamedTuple):  # not msgspec's: mypyc would leave out the module
    """Where a group of monitors stands: what it takes to go back there, or to go on from there elsewhere."""

    networks: tuple[tuple[dict[str, Any], list[tuple[int, int]]], ...]
    three_valued: ThreeValued | None
    unknown: dict[str, str]
    scalars: tuple[int, int, int, int, int]
    began: int
    lost: tuple[tuple[str, str], ...]
    lost_ports: dict[str, str]
    coming: tuple[Gap, ...]
    open: dict[str, tuple[int, str]]
    values: dict[str, Any]
    waiting: frozenset[str]
    unseen: frozenset[str]
    missed: frozenset[str]
    verdicts: tuple[Verdict, ...]
    logs: dict[str, tuple[Change, ...]]


class MonitorGroup:
    """Monitors properties that begin at the same instant.

    They begin when every state they use has been observed (or has an initial value): before, nothing
    is known that a verdict could rest on. What happened before is remembered all the same, as far as it was
    observed: three-valued, as not all states are known yet. A state has no value before its first message:
    if none of it can have been missed, nothing that rests on such states alone has happened by that. Only
    whether a formula was false before is not asked.
    """

    def __init__(self, plan: GroupPlan, remembered: int = REMEMBERED_CHANGES) -> None:
        self._plan = plan
        self.names = plan.names
        self._formulas = plan.formulas
        self.binding = plan.binding
        self._network = plan.network
        self._remembers = plan.remembers
        self._counts_time = plan.counts_time
        self._index = plan.index
        self._users = plan.users
        self._texts = plan.texts
        self.final = plan.final
        self._logs: dict[str, deque[Change]] = {
            text: deque(maxlen=remembered) for text in self._index
        }
        self.started = -1
        self.sealed = -1
        self._three_valued: ThreeValued | None = None
        """The two runs while something is unknown."""
        self._runs: ThreeValued | None = None
        """The same, kept: to make them takes longer than most losses last."""
        self.reached = -1
        """The latest instant before the beginning, and in three-valued evaluation."""
        self._until_try = _TRY_EVERY
        self._known = KnownValues(self.binding)
        self._gaps = Gaps()
        self._lost: dict[str, str] = {}
        """What was last lost of each predicate, in words; the newest is last."""
        self._reported = -1
        self._program = self._new_program()
        self.changed = self._program.changed
        self.handlers = self._program.handlers
        self.heap = self._program.heap
        waiting = ", ".join(sorted(self._known.waiting))
        first = Verdict(
            Status.INCONCLUSIVE,
            reason=f"waiting for the first observation of {waiting}" if waiting else "not started",
        )
        self.verdicts = [first for _ in self.names]

    def _new_program(self) -> CompiledNetwork:
        logs = {f"log{self._index[text]}": self._logs[text].append for text in self._plan.used}
        return self._plan.code.program(
            {**ENVIRONMENT, "UNKNOWN": UNKNOWN_ERRORS, "Unknown": UnknownAtom, **logs}
        )

    @property
    def now(self) -> int:
        """The instant that the network is at; -1 before it began."""
        if self._three_valued is not None:
            return self.reached
        now: int = self._program.clock()
        return now

    def next_deadline(self) -> int:
        """The earliest instant at which something can change by itself, or ``NEVER``."""
        return NEVER if self.started < 0 else self._next_instant()

    def _next_instant(self) -> int:
        """The next instant at which something is to be evaluated, or ``NEVER``."""
        if self._three_valued is not None:
            return min(self._three_valued.next_deadline(), self._gaps.next_ns)
        return self.heap[0][0]

    # -- taking observations in ---------------------------------------------------------------

    @property
    def plain(self) -> bool:
        """Whether the compiled handlers take observations in."""
        return self._three_valued is None and self.started >= 0

    def observe(self, group: PortGroup, seen: Observation) -> list[tuple[str, Verdict]]:
        """Take an observation of ``group`` in that its handler cannot; the verdicts that changed.

        That is: before the beginning, in three-valued evaluation, and where the handler has just met
        a predicate without a value, so that three-valued evaluation begins.
        """
        stamp = seen.stamp_ns
        found: list[tuple[str, Verdict]] = []
        if self.started < 0:
            self._look_back(stamp, group)
        if self.started >= 0 or self._three_valued is not None:
            found = self.catch_up(stamp - 1)
            if self._three_valued is None:
                self._enter_three_valued()
        if group.kinds and group.kinds[0].startswith("response") and seen.error:
            return found
        self.reached = stamp
        values = self._pass_gaps(stamp)
        unseen = self._known.unseen
        settled = self._known.settled() if unseen else frozenset()
        for port in group.ports:
            if not port.event:
                self._known.take(port, seen.data)
        # a state that counts since the start may have had its first value since then
        has_no_past = not self._counts_time and unseen != self._known.unseen
        if self._three_valued is not None and has_no_past:
            # of others something may have happened, and what rests on both depends on which came first
            known = self._known.settled() - settled
            self._three_valued.not_yet(known, stamp - 1)
            for text in known:
                self._note_lost(text, _before_first(text))
        if self.started < 0 and self._known.waiting:
            if self._three_valued is None:
                self._known.lose(self._open(group))
                return found
        elif self.started < 0:
            self.begin(stamp, seen, group.atoms)
            if self._three_valued is None:
                try:
                    self.handlers[group.name](stamp, seen.data, seen)
                except UnknownAtom:
                    self._enter_three_valued()
                else:
                    return self.report()
        return found + self._evaluate(group, seen, values)

    def _evaluate(
        self, group: PortGroup, seen: Observation, values: dict[str, bool | None]
    ) -> list[tuple[str, Verdict]]:
        """Three-valued evaluation of an observation; ``values`` are what losses have changed by then."""
        assert self._three_valued is not None
        stamp = seen.stamp_ns
        opened = [text for text, value in values.items() if value is None]
        observed: dict[str, bool | None] = {}
        for text in group.atoms:
            if text not in self._index:
                continue
            if text in self.binding.events:
                if (value := self._happens(text, seen.data)) is not False:
                    observed[text] = value
            else:
                observed[text] = self._known.judge(text, self._three_valued.unknown)
        values.update(observed)
        self._log(stamp, values, seen)
        gaps = self._gaps.open
        self._three_valued.observe(stamp, values, gaps, missing=bool(gaps), opened=opened)
        missed = self._open(group)
        if not missed:
            self._resolve(stamp, force=any(value is not None for value in observed.values()))
            return self.report()
        # it was so when it was observed, and who knows for how long
        found = self.report()
        values = self._unknown(missed)
        self._log(stamp, values, None)
        self._three_valued.observe(stamp, values, self._gaps.open)
        return found + self.report()

    def _log(self, stamp: int, values: Mapping[str, bool | None], seen: Observation | None) -> None:
        """Remember the predicates' ``values`` from ``stamp`` on, for witnesses."""
        for text, value in values.items():
            self._logs[text].append((stamp, value, seen if value is not None else None))
            if text in self.binding.events and value and text not in self._gaps.open:
                self._logs[text].append((stamp + 1, False, None))

    def _happens(self, name: str, data: Any) -> bool | None:
        try:
            return self.binding.conditions[name](data)
        except UNKNOWN_ERRORS as error:
            self._note_lost(name, f"whether `{name}` happened is not known: {why_unknown(error)}")
            return None

    def _note_lost(self, text: str, why: str) -> None:
        self._lost.pop(text, None)
        self._lost[text] = why

    # -- beginning, time, loss ----------------------------------------------------------------

    def begin(self, stamp: int, seen: Observation | None = None, texts: Sequence[str] = ()) -> None:
        """Begin at ``stamp`` with the values known so far; the first step is still to be made.

        ``seen`` is what brought the values of the predicates ``texts``.
        """
        self.started = stamp
        if self._three_valued is not None:
            self._three_valued.forget_obligations()
            return
        for text in self._index:
            if text in self.binding.events:
                # so that a witness knows it did not happen before
                value = None if text in self._gaps.open else False
                self._logs[text].append((stamp, value, None))
        if not self._gaps.is_empty:
            self._enter_three_valued()
            return
        values: dict[str, bool] = {}
        for text in self._index:
            if text in self.binding.events:
                continue
            try:
                values[text] = self._known.holds(text)
            except UNKNOWN_ERRORS:
                self._enter_three_valued()
                return
        for text, value in values.items():
            self._program.put[self._index[text]](value)
            self._logs[text].append((stamp, value, seen if text in texts else None))
        self._program.write(self._known.of_handlers())
        heappush(self._program.heap, (stamp, BEGINNING))

    def can_begin(self) -> bool:
        """Whether every state is known, so that time itself may begin."""
        return not self._known.waiting

    def advance(self, now: int) -> list[tuple[str, Verdict]]:
        """Make every change that is due up to ``now``; the verdicts that changed on the way."""
        if self.started < 0:
            self._look_back(now)
            is_early = self._three_valued is not None
            if self._known.waiting:
                if self._three_valued is not None:
                    self.catch_up(now)
                    self._three_valued.settle(now)
                self.reached = self.sealed = now
                return []
            if is_early:
                self.catch_up(now - 1)
            self.begin(now)
            if self._three_valued is not None and is_early:
                self._three_valued.step(now)
        found = self.catch_up(now)
        if self._three_valued is None:
            self._program.settle(now)
        else:
            self._three_valued.settle(now)
            self.reached = now
            self._resolve(now, force=False)
        self.sealed = now
        return found + self.report()

    def catch_up(self, until: int) -> list[tuple[str, Verdict]]:
        """Make the changes that are due up to ``until`` one by one; the verdicts that they change.

        A formula may be false for an instant only: between two of these nothing changes.
        """
        found: list[tuple[str, Verdict]] = []
        if self._three_valued is None:
            while (instant := self.heap[0][0]) <= until:
                self._program.settle(instant)
                if self.changed:
                    found += self.report()
            return found
        while (instant := self._next_instant()) <= until:
            values = self._pass_gaps(instant)
            if values:
                self._log(instant, values, None)
                self._three_valued.observe(instant, values, self._gaps.open)
            else:
                self._three_valued.settle(instant)
            self.reached = instant
            found += self.report()
        return found

    def lose(self, channel: str, start: int, end: int) -> list[tuple[str, Verdict]]:
        """Messages of ``channel`` stamped in ``[start, end)`` were lost; the verdicts that changed.

        What has passed already is looked at again: the verdict that stands is replaced unless it is of
        an instant before ``start``, or holds whatever was lost; that also a final one is not spared is
        the price of a loss that is reported after it.
        """
        names = [
            port.name
            for group in self.binding.groups
            if group.channel in (channel, ANY_CHANNEL)
            for port in group.ports
        ]
        if not names or start >= end:
            return []
        why = f"messages on {channel} were missed"
        for name in names:
            for text in self._users[name]:
                self._note_lost(text, why)
        self._gaps.add(names, start, end, why)
        if self._three_valued is None and self.started < 0:
            if self.reached < 0:
                return []  # nothing is remembered yet
            self._enter_three_valued(self.reached)
        elif self._three_valued is None:
            self._enter_three_valued()
        now = self.now
        if start > now:
            return []
        assert self._three_valued is not None
        texts = [text for name in names for text in self._users[name]]
        for text in texts:
            log = self._logs[text]
            while log and log[-1][0] >= start:
                log.pop()
            log.append((max(start, self.started), None, None))
            if text in self.binding.events and end <= now and text not in self._gaps.open:
                log.append((now + 1, False, None))
        self._three_valued.lose(texts, start, now)
        self._three_valued.observe(now, self._pass_gaps(now), self._gaps.open)
        for number, value in enumerate(self._three_valued.results()):
            verdict = self.verdicts[number]
            constant = self._network.nodes[self._network.roots[number]].kind == "constant"
            if verdict.since_ns >= start and value is not False and not constant:
                self.verdicts[number] = msgspec.structs.replace(verdict, final=False)
        return self.report()

    def _look_back(self, now: int, group: PortGroup | None = None) -> None:
        """Something happens at ``now``, before the beginning: it is remembered if it may matter."""
        if self._three_valued is not None:
            return
        is_to_remember = self._counts_time and not self.can_begin()
        if group is not None and self._remembers:  # what makes it begin is not from before
            is_to_remember |= not self._known.waiting <= {port.name for port in group.ports}
        if self._gaps.is_empty and not is_to_remember:
            return
        first = self.reached
        if first < 0:
            lost = [start for start, _, _, _ in self._gaps.coming]
            first = min(now, *lost) if lost else now
        self._enter_three_valued(first)

    def _pass_gaps(self, now: int) -> dict[str, bool | None]:
        """The time is ``now``: the values of predicates that became unknown, or known, by that."""
        begun, closed = self._gaps.pass_to(now)
        if self.started < 0:
            self._known.lose(begun)
        if self._three_valued is None:
            return {}
        values = self._unknown(
            {
                name: reason
                for name, reason in begun.items()
                if name not in self.binding.events or name in self._gaps.open
            }
        )
        for name in closed:
            if name in self.binding.events and name not in begun and name in self._index:
                values[name] = False
                self._three_valued.unknown.pop(name, None)
        return values

    def _unknown(self, names: Mapping[str, str]) -> dict[str, bool | None]:
        """The ports ``names`` may have any value from now on, for that reason: what is unknown by that."""
        self._known.lose(names)
        assert self._three_valued is not None
        values: dict[str, bool | None] = {}
        for name, reason in names.items():
            for text in self._users[name]:
                self._three_valued.unknown[text] = reason
                values[text] = None
        return values

    def _open(self, group: PortGroup) -> dict[str, str]:
        """The ports of ``group`` that a lost message may set now, and why."""
        gaps = self._gaps.open
        return {port.name: gaps[port.name][1] for port in group.ports if port.name in gaps}

    def _enter_three_valued(self, first: int = -1) -> None:
        """Go on with the best and the worst of what is not known.

        ``first``: where the formulas have not begun, the first instant that is remembered.
        """
        began = self.started if first < 0 else first
        runs = self._three_valued = self._two_runs()
        runs.reset(began)
        read = self._program.read()
        fresh = read["now"] < 0
        now = began if fresh else read["now"]
        self.reached = now
        atoms: dict[str, bool | None] = {}
        if fresh:
            self._known.lose(self._gaps.pass_to(now)[0])
        else:
            self._known.take_from_handlers(read)
        for text, index in self._index.items():
            if text in self._gaps.open:
                atoms[text], runs.unknown[text] = None, self._gaps.open[text][1]
            elif text in self.binding.events or not fresh:
                atoms[text] = read[f"p{index}"]
            else:
                atoms[text] = self._known.judge(text, runs.unknown)
        states = {} if fresh else read_state(self._network, self._program)
        runs.enter(states, atoms, now, read["met"])
        if fresh:
            self._log(now, {t: v for t, v in atoms.items() if t not in self.binding.events}, None)
            runs.begin(now)
        else:
            runs.step(now)
            for text in self.binding.events:  # nobody else remembers that they end
                if atoms.get(text):
                    self._logs[text].append((now + 1, False, None))
        self._until_try = _TRY_EVERY

    def _resolve(self, now: int, force: bool) -> None:
        """Go back to one network if nothing is unknown any more, nor rests on what was."""
        self._until_try -= 1
        runs = self._three_valued
        assert runs is not None
        if (
            self.started < 0
            or runs.unknown
            or not (force or self._until_try <= 0)
            or not self._gaps.is_empty
        ):
            return
        self._until_try = _TRY_EVERY
        states = runs.resolved(now)
        if states is None or (atoms := runs.atoms()) is None:
            return
        self._program.write(
            {
                **self._known.of_handlers(),
                **{f"p{index}": atoms[text] for text, index in self._index.items()},
                "met": runs.met,
            }
        )
        write_state(self._network, self._program, states, now)
        for text in self.binding.events:
            if atoms.get(text):
                if self._logs[text] and self._logs[text][-1][0] > now:
                    self._logs[text].pop()
                heappush(self._program.heap, (now + 1, self._index[text]))
        self._three_valued = None
        self._program.step(now)
        # what was last reported came from three-valued evaluation
        self.changed.extend(range(len(self.names)))

    # -- going back ---------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """Everything that a later :meth:`restore` needs."""
        runs = self._three_valued
        return Snapshot(
            networks=tuple(program.snapshot() for program in self._programs()),
            three_valued=runs,
            unknown=dict(runs.unknown) if runs is not None else {},
            scalars=(self.started, self.sealed, self.reached, self._until_try, self._reported),
            began=runs.began if runs is not None else -1,
            lost=tuple(self._lost.items()),
            lost_ports=dict(self._known.lost),
            coming=tuple(self._gaps.coming),
            open=dict(self._gaps.open),
            values=dict(self._known.values),
            waiting=frozenset(self._known.waiting),
            unseen=self._known.unseen,
            missed=self._known.missed,
            verdicts=tuple(self.verdicts),
            logs={text: tuple(log) for text, log in self._logs.items()},
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to ``snapshot``."""
        self._three_valued = None
        if snapshot.three_valued is not None:
            self._three_valued = self._two_runs()
            self._three_valued.unknown = dict(snapshot.unknown)
            self._three_valued.began_at(snapshot.began)
        for program, state in zip(self._programs(), snapshot.networks, strict=True):
            program.go_back(state)
        scalars = snapshot.scalars
        self.started, self.sealed, self.reached, self._until_try, self._reported = scalars
        self._lost = dict(snapshot.lost)
        self._known.lost = dict(snapshot.lost_ports)
        self._gaps.coming, self._gaps.open = list(snapshot.coming), dict(snapshot.open)
        self._known.values = dict(snapshot.values)
        self._known.waiting = set(snapshot.waiting)
        self._known.unseen, self._known.missed = snapshot.unseen, snapshot.missed
        self.verdicts = list(snapshot.verdicts)
        for text, changes in snapshot.logs.items():
            self._logs[text].clear()
            self._logs[text].extend(changes)

    def form(self, horizon_ns: int) -> tuple[Any, ...]:
        """What tells it from others of its properties, whatever is observed from now on; hashable.

        Args:
            horizon_ns: no loss is reported that began longer ago.
        """
        runs, now = self._three_valued, self.now
        if runs is None:
            read = self._program.read()
            kept = [read[f"X{place}"] for place in range(len(self.binding.ports))]
            pairs = [(self._network, self._program)]
        else:
            kept = list(self._known.values.items())
            pairs = [(runs.network, runs.best), (runs.network, runs.worst)]
        found: list[Any] = [runs is None, now, self.started, repr(kept)]
        for network, program in pairs:
            read = program.read()
            for index, node in enumerate(network.nodes):
                if node.kind == "atom":
                    found.append(read[f"p{index}"])
                elif node.kind in ("once", "since"):
                    names = state_names(index, node)
                    found.append(normal(node, [read[name] for name in names], now))
            ends = [
                due
                for due in program.heap
                if due[0] < NEVER and (due[1] < 0 or network.nodes[due[1]].kind == "atom")
            ]
            met: int = read["met"]
            found += [tuple(sorted(ends)), met if met >= now - horizon_ns else -1]
        found += [(verdict.status, verdict.final) for verdict in self.verdicts]
        found += [tuple(sorted(self._known.waiting)), tuple(sorted(self._known.lost))]
        found += [tuple(sorted(self._known.unseen)), tuple(sorted(self._known.missed))]
        found += [tuple(self._gaps.coming), tuple(sorted(self._gaps.open.items()))]
        if runs is not None:
            found += [tuple(sorted(runs.unknown)), runs.began]
        return tuple(found)

    def _two_runs(self) -> ThreeValued:
        if self._runs is None:
            self._runs = ThreeValued(self._plan.split)
        return self._runs

    def _programs(self) -> list[CompiledNetwork]:
        found = [self._program]
        if self._three_valued is not None:
            found += [self._three_valued.best, self._three_valued.worst]
        return found

    # -- verdicts -----------------------------------------------------------------------------

    def report(self) -> list[tuple[str, Verdict]]:
        """The verdicts that changed since the last call."""
        if self.started < 0:
            return []
        if self._three_valued is None:
            numbers: Sequence[int] = sorted(set(self.changed)) or ()
            self.changed.clear()
            if any(verdict.status is Status.INCONCLUSIVE for verdict in self.verdicts):
                numbers = range(len(self.names))
            results: Sequence[bool | None] = self._program.values()
        else:
            numbers = range(len(self.names))
            results = self._three_valued.results()
            self.changed.clear()
        found = []
        now = self.now
        for number in numbers:
            before = self.verdicts[number]
            if before.final:
                continue
            status = {True: Status.TRUE, False: Status.FALSE, None: Status.INCONCLUSIVE}[
                results[number]
            ]
            if status is before.status and before.since_ns >= 0:
                continue
            self.verdicts[number] = after = self._verdict(number, status, now)
            found.append((self.names[number], after))
        self._reported = now
        return found

    def _why_unknown(self, number: int, unknown: Mapping[str, str]) -> str:
        """Why the property ``number`` is not known; ``unknown``: why each predicate of all is not."""
        texts = self._texts[number]
        now = [why for text, why in unknown.items() if text in texts]
        before = [why for text, why in self._lost.items() if text in texts]
        return "; ".join(dict.fromkeys(now or before[-1:]))

    def _verdict(self, number: int, status: Status, now: int) -> Verdict:
        if status is Status.TRUE:
            return Verdict(status, now)
        if status is Status.INCONCLUSIVE:
            assert self._three_valued is not None
            return Verdict(
                status, now, reason=self._why_unknown(number, self._three_valued.unknown)
            )
        # changes are made one by one: until just before, the verdict was the one reported last
        true_at = now - 1 if self.verdicts[number].since_ns >= 0 else -1
        witness = explain(
            self._formulas[number], self._logs, self.started, now, self._reported, true_at
        )
        at = witness.at_ns
        return Verdict(status, at, final=self.final[number], witness=witness)


def _before_first(text: str) -> str:
    """Why nothing can be said of the predicate ``text`` for the time before a state in it had a value."""
    return f"what `{text}` was before its first message is not known; an initial value of its port says it"
