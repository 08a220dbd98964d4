"""One network of properties that begin together, with everything that lives while it runs."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from heapq import heappush
from typing import Any

import msgspec

from moon.properties.binding import ANY_CHANNEL, Group, bind, handler_source
from moon.properties.compiler import BEGINNING, Program, compile_network
from moon.properties.doubt import Doubt, read_state, state_form, write_state
from moon.properties.known import KnownValues
from moon.properties.network import Network, build_network
from moon.properties.predicates import ENVIRONMENT, UNKNOWN_ERRORS, why_unknown
from moon.properties.property import Port, Property
from moon.properties.rules import NEVER, stays_false
from moon.properties.snapshot import Snapshot
from moon.properties.verdict import Status, Verdict
from moon.properties.witness import Change, explain
from transports.interface import Observation

REMEMBERED_CHANGES = 1024
"""Changes kept per predicate to explain a violation; older ones make a witness incomplete."""
_TRY_EVERY = 32
"""Observations between two looks at whether a doubt has resolved itself."""


class TimeOrderError(ValueError):
    """An observation is older than what was already decided, or its stamp is no time."""


class UnknownAtom(Exception):
    """A handler met a predicate without a value; nothing has changed yet."""


class Cell:
    """Monitors properties that begin at the same instant.

    They begin when every state they use has been observed (or has an initial value): before, nothing
    is known that a verdict could rest on.
    """

    def __init__(self, properties: Sequence[Property], ports: Sequence[Port]) -> None:
        self.names = tuple(item.name for item in properties)
        self._formulas = [item.formula for item in properties]
        self.binding = bind(self._formulas, ports)
        self._network = build_network(self._formulas)
        nodes = enumerate(self._network.nodes)
        self._index = {node.text: number for number, node in nodes if node.kind == "atom"}
        self._logs: dict[str, deque[Change]] = {
            text: deque(maxlen=REMEMBERED_CHANGES) for text in self._index
        }
        self.started = -1
        self.sealed = -1
        self._doubt: Doubt | None = None
        self._doubt_now = -1
        self._until_try = _TRY_EVERY
        self._known = KnownValues(self.binding)
        self._lost = ""
        self._reported = -1
        self._program = self._compile()
        self.changed = self._program.changed
        self.handlers = self._program.handlers
        self.heap = self._program.heap
        self.final = [stays_false(self._network, root) for root in self._network.roots]
        waiting = ", ".join(sorted(self._known.waiting))
        first = Verdict(
            Status.INCONCLUSIVE,
            reason=f"waiting for the first observation of {waiting}" if waiting else "not started",
        )
        self.verdicts = [first for _ in self.names]

    def _compile(self) -> Program:
        binding, index = self.binding, self._index
        used = [text for text in binding.atoms if text in index]
        groups = [
            msgspec.structs.replace(group, atoms=tuple(t for t in group.atoms if t in index))
            for group in binding.groups
        ]
        environment: dict[str, Any] = {
            **ENVIRONMENT,
            **{"UNKNOWN": UNKNOWN_ERRORS, "Unknown": UnknownAtom, "check": self.check},
            **{f"log{index[text]}": self._logs[text].append for text in used},
        }
        return compile_network(
            self._network,
            [index[text] for text in used if text in binding.events],
            {f"{group.name}_cone": [index[t] for t in group.atoms] for group in groups},
            "\n".join(handler_source(group, binding, index) for group in groups),
            [f"X{place}" for place in range(len(binding.ports))],
            environment,
        )

    def check(self, stamp: Any, now: int) -> None:
        """Raise TimeOrderError if ``stamp`` is no time or has passed."""
        if stamp.__class__ is not int or stamp < 0:
            raise TimeOrderError(f"{stamp!r} is not a stamp in ns")
        if stamp < now or stamp <= self.sealed:
            known = max(now, self.sealed)
            raise TimeOrderError(f"an observation of {stamp} ns is too late at {known} ns")

    @property
    def now(self) -> int:
        """The instant that the network is at; -1 before it began."""
        if self._doubt is not None:
            return self._doubt_now
        now: int = self._program.clock()
        return now

    def next_deadline(self) -> int:
        """The earliest instant at which something can change by itself, or ``NEVER``."""
        if self.started < 0:
            return NEVER
        if self._doubt is not None:
            return self._doubt.next_deadline()
        return self.heap[0][0]

    # -- taking observations in ---------------------------------------------------------------

    def observe(self, handler: Any, group: Group, seen: Observation) -> list[tuple[str, Verdict]]:
        """Take an observation of ``group`` in; the verdicts that changed."""
        found = self.catch_up(seen.stamp_ns - 1) if self.started >= 0 else []
        if self._doubt is None and self.started >= 0:
            try:
                handler(seen.stamp_ns, seen.data, seen)
            except UnknownAtom:
                self._doubtful()
            else:
                return found + self.report()
        self._observe_slowly(group, seen)
        return found + self.report()

    @property
    def plain(self) -> bool:
        """Whether the compiled handlers may be called directly."""
        return self._doubt is None and self.started >= 0

    def _observe_slowly(self, group: Group, seen: Observation) -> None:
        stamp = seen.stamp_ns
        self.check(stamp, self.now if self.started >= 0 else self._doubt_now)
        if group.kinds and group.kinds[0].startswith("response") and seen.error:
            return
        self._doubt_now = stamp
        for port in group.ports:
            if not port.event:
                self._known.take(port, seen.data)
        if self.started < 0:
            if self._known.waiting:
                return
            self.begin(stamp, seen, group.atoms)
        if self._doubt is None:
            try:
                self.handlers[group.name](stamp, seen.data, seen)
            except UnknownAtom:
                self._doubtful()
            else:
                return
        assert self._doubt is not None
        values: dict[str, bool | None] = {}
        for text in group.atoms:
            if text not in self._index:
                continue
            if text in self.binding.events:
                if (value := self._happens(text, seen.data)) is not False:
                    values[text] = value
            else:
                values[text] = self._known.judge(text, self._doubt.unknown)
        for text, value in values.items():
            if value is not None:
                self._logs[text].append((stamp, value, seen))
            if text in self.binding.events and value:
                self._logs[text].append((stamp + 1, False, None))
        self._doubt.observe(stamp, values)
        self._resolve(stamp, force=any(value is not None for value in values.values()))

    def _happens(self, name: str, data: Any) -> bool | None:
        try:
            return self.binding.conditions[name](data)
        except UNKNOWN_ERRORS as error:
            self._lost = f"whether `{name}` happened is not known: {why_unknown(error)}"
            return None

    # -- beginning, time, loss ----------------------------------------------------------------

    def begin(self, stamp: int, seen: Observation | None = None, texts: Sequence[str] = ()) -> None:
        """Begin at ``stamp`` with the values known so far; the first step is still to be made.

        ``seen`` is what brought the values of the predicates ``texts``.
        """
        self.started = stamp
        for text in self._index:
            if text in self.binding.events:
                # so that a witness knows it did not happen before
                self._logs[text].append((stamp, False, None))
        values: dict[str, bool] = {}
        for text in self._index:
            if text in self.binding.events:
                continue
            try:
                values[text] = self._known.holds(text)
            except UNKNOWN_ERRORS:
                self._doubtful()
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
            if self._known.waiting:
                self._doubt_now = self.sealed = now
                return []
            self.begin(now)
        found = self.catch_up(now)
        if self._doubt is None:
            self._program.settle(now)
        else:
            self._doubt.settle(now)
            self._doubt_now = now
            self._resolve(now, force=False)
        self.sealed = now
        return found + self.report()

    def catch_up(self, until: int) -> list[tuple[str, Verdict]]:
        """Make the changes that are due up to ``until`` one by one; the verdicts that they change.

        A formula may be false for an instant only: between two of these nothing changes.
        """
        found: list[tuple[str, Verdict]] = []
        if self._doubt is None:
            while (instant := self.heap[0][0]) <= until:
                self._program.settle(instant)
                if self.changed:
                    found += self.report()
            return found
        while (instant := self._doubt.next_deadline()) <= until:
            self._doubt.settle(instant)
            self._doubt_now = instant
            found += self.report()
        return found

    def lose(self, channel: str, start: int, end: int) -> list[tuple[str, Verdict]]:
        """Messages of ``channel`` stamped in ``[start, end)`` were lost; the verdicts that changed."""
        texts = [
            text
            for group in self.binding.groups
            if group.channel in (channel, ANY_CHANNEL)
            for text in group.atoms
            if text in self._index
        ]
        if not texts or self.started < 0:
            return []
        found = self.catch_up(start - 1)  # what was false later may not have been
        if self._doubt is None:
            self._program.settle(end)
            self._doubtful()
        else:
            self._doubt.settle(end)
        assert self._doubt is not None
        self._doubt_now = end
        self._lost = f"messages on {channel} were missed"
        self._doubt.lose(texts, start, end)
        states = [text for text in texts if text not in self.binding.events]
        self._doubt.unknown.update(dict.fromkeys(states, self._lost))
        self._doubt.observe(end, dict.fromkeys(states))
        return found + self.report()

    def _doubtful(self) -> None:
        """Go on with the best and the worst of what is not known."""
        doubt = self._doubt = Doubt(self._formulas, self.binding.events, self._network)
        fresh = self._program.read()["now"] < 0
        now = self.started if fresh else self._program.read()["now"]
        read = self._program.read()
        self._doubt_now = now
        atoms: dict[str, bool | None] = {}
        if not fresh:
            self._known.take_from_handlers(read)
        for text, index in self._index.items():
            events = text in self.binding.events
            if events or not fresh:
                atoms[text] = read[f"p{index}"]
            else:
                atoms[text] = self._known.judge(text, doubt.unknown)
        doubt.enter({} if fresh else read_state(self._network, self._program), atoms, now)
        if not fresh:
            doubt.step(now)
        self._until_try = _TRY_EVERY

    def _resolve(self, now: int, force: bool) -> None:
        """Go back to one network if nothing is in doubt any more."""
        self._until_try -= 1
        assert self._doubt is not None
        if self._doubt.unknown or not (force or self._until_try <= 0):
            return
        self._until_try = _TRY_EVERY
        states = self._doubt.resolved(now)
        if states is None:
            return
        pulses = [text for text in self.binding.events if self._logs.get(text)]
        active = [text for text in pulses if self._logs[text][-1][0] == now + 1]
        atoms = {
            f"p{self._index[text]}": self._known.holds(text)
            for text in self._index
            if text not in self.binding.events
        }
        atoms.update({f"p{self._index[text]}": text in active for text in pulses})
        self._program.write({**self._known.of_handlers(), **atoms})
        write_state(self._network, self._program, states, now)
        for text in active:
            self._logs[text].pop()
            heappush(self._program.heap, (now + 1, self._index[text]))
        self._doubt = None
        self._program.step(now)
        # what was last reported came from the doubt
        self.changed.extend(range(len(self.names)))

    # -- going back ---------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """Everything that a later :meth:`restore` needs."""
        doubt = self._doubt
        return Snapshot(
            networks=tuple(program.snapshot() for program in self._programs()),
            doubt=doubt,
            unknown=dict(doubt.unknown) if doubt is not None else {},
            scalars=(self.started, self.sealed, self._doubt_now, self._until_try, self._reported),
            lost=self._lost,
            values=dict(self._known.values),
            waiting=frozenset(self._known.waiting),
            verdicts=tuple(self.verdicts),
            logs={text: tuple(log) for text, log in self._logs.items()},
            forms=tuple(
                state_form(network, program, self.now)
                for network, program in zip(self._networks(), self._programs(), strict=True)
            ),
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to ``snapshot``."""
        self._doubt = snapshot.doubt
        if self._doubt is not None:
            self._doubt.unknown = dict(snapshot.unknown)
        for program, state in zip(self._programs(), snapshot.networks, strict=True):
            program.go_back(state)
        scalars = snapshot.scalars
        self.started, self.sealed, self._doubt_now, self._until_try, self._reported = scalars
        self._lost = snapshot.lost
        self._known.values = dict(snapshot.values)
        self._known.waiting = set(snapshot.waiting)
        self.verdicts = list(snapshot.verdicts)
        for text, changes in snapshot.logs.items():
            self._logs[text].clear()
            self._logs[text].extend(changes)

    def _networks(self) -> list[Network]:
        split = [self._doubt.network] * 2 if self._doubt is not None else []
        return [self._network, *split]

    def _programs(self) -> list[Program]:
        found = [self._program]
        if self._doubt is not None:
            found += [self._doubt.best, self._doubt.worst]
        return found

    # -- verdicts -----------------------------------------------------------------------------

    def report(self) -> list[tuple[str, Verdict]]:
        """The verdicts that changed since the last call."""
        if self.started < 0:
            return []
        if self._doubt is None:
            numbers: Sequence[int] = sorted(set(self.changed)) or ()
            self.changed.clear()
            if any(verdict.status is Status.INCONCLUSIVE for verdict in self.verdicts):
                numbers = range(len(self.names))
            results: Sequence[bool | None] = self._program.values()
        else:
            numbers = range(len(self.names))
            results = self._doubt.results()
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

    def _verdict(self, number: int, status: Status, now: int) -> Verdict:
        if status is Status.TRUE:
            return Verdict(status, now)
        if status is Status.INCONCLUSIVE:
            assert self._doubt is not None
            reasons = list(dict.fromkeys(self._doubt.unknown.values())) or [self._lost]
            return Verdict(status, now, reason="; ".join(reasons))
        # changes are made one by one: until just before, the verdict was the one said last
        true_at = now - 1 if self.verdicts[number].since_ns >= 0 else -1
        witness = explain(
            self._formulas[number], self._logs, self.started, now, self._reported, true_at
        )
        at = witness.at_ns
        return Verdict(status, at, final=self.final[number], witness=witness)
