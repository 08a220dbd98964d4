"""Why a formula is false: the observations and the spans of time that make it so.

From the remembered changes of the predicates the signals of all sub-formulas are computed again
(:class:`Signals`); then the reasons are followed downwards from the instant at which the formula
became false, one reason where one is enough: one false operand of an ``and``, one instant for a
``once``, the whole window for its absence.

Two branches may so give two facts for what one explains. A fact is dropped if the others make the
formula false whatever else had been observed: that is, if it is false even where every value that they
leave open is taken the way that helps it most.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from moon.properties.formula import (
    And,
    Constant,
    Formula,
    Interval,
    Not,
    Once,
    Predicate,
    Since,
    operands,
    predicates,
    reduced,
)
from moon.properties.property import Fact, Witness
from transports.interface import Observation

Change = tuple[int, bool | None, Observation | None]
"""(instant, new value, or None where it became unknown, the observation that brought it)."""
Signal = list[tuple[int, int]]
"""Where something holds: sorted, disjoint intervals ``[first, end)`` of ticks."""
NOWHERE: Signal = []
"""Of a predicate of which nothing is known; never changed."""
MOST_FACTS = 64
"""With more facts nothing is dropped: it would take longer than it is worth."""


def horizon(formula: Formula) -> int | None:
    """How far back (ticks) ``formula``, which is reduced, looks from an instant; None: to the start."""
    inner = [horizon(item) for item in operands(formula)]
    if any(reach is None for reach in inner):
        return None
    deepest = max((reach for reach in inner if reach is not None), default=0)
    if isinstance(formula, Once | Since):
        upper = formula.interval.upper
        return None if upper is None else deepest + upper + 1
    return deepest


def explain(
    formula: Formula,
    logs: Mapping[str, Iterable[Change]],
    start: int,
    now: int,
    not_before: int = -1,
    true_at: int = -1,
) -> Witness:
    """The witness of ``formula`` being false at ``now``.

    Args:
        formula: what is false.
        logs: the predicates' changes, oldest first; of those that can make no difference there is none, and
            nothing is known of them.
        start: when monitoring began.
        now: the instant (ns).
        not_before: an instant at which it was not false yet: nothing that it did not see matters.
        true_at: an instant at which it was not false. (A value that was replaced at its very own stamp
            counts, and leaves no trace in the signals.)
    """
    reasoned = reduced(formula)
    reach = horizon(reasoned)
    if reach is not None and not_before >= 0:
        start = max(start, not_before - reach)
    changes = {text: _between(logs.get(text, ()), start, now) for text in predicates(formula)}
    begins = max(
        [start, *(found[0][0] for found in changes.values() if found and found[0][0] > start)]
    )
    complete = all(
        not found or found[0][0] <= start or not found[0][1] for found in changes.values()
    )
    begin = start if complete else min(begins, now)
    atoms = {text: _signal(found, begin, now + 1) for text, found in changes.items()}
    unlogged = [text for text in changes if text not in logs]
    unknown = any(value is None for found in changes.values() for _, value, _ in found)
    if unknown or unlogged:  # at its best the formula is false still, for what is known
        reasoned = reduced(formula, by_polarity=True)
        perhaps = {text: _signal(found, begin, now + 1, None) for text, found in changes.items()}
        perhaps.update((text, [(begin, now + 1)]) for text in unlogged)
        atoms = {
            **{f"+{text}": union(found, perhaps[text]) for text, found in atoms.items()},
            **{f"-{text}": found for text, found in atoms.items()},
        }
    signals = Signals(atoms, begin, now + 1)
    wrong = signals.where(reasoned, False)
    if not wrong or wrong[-1][1] != now + 1:
        return Witness(now, _last(changes, now), complete=False)
    at = wrong[-1][0] if wrong[-1][0] > true_at else now
    spans: dict[tuple[str, bool], Signal] = {}
    _Reasons(signals, spans).collect(reasoned, False, [(at, at + 1)])
    facts = [
        fact
        for (text, value), signal in spans.items()
        for name in [text[1:] if unknown or unlogged else text]
        for fact in _facts(name, value, signal, changes[name])
    ]
    facts.sort(key=lambda fact: (fact.start_ns, fact.end_ns, fact.predicate))
    if complete:
        facts = list(minimal(formula, facts, at, begin, now + 1))
    return Witness(at, tuple(facts), complete)


def _between(changes: Iterable[Change], start: int, now: int) -> Sequence[Change]:
    """The changes up to ``now``, from the one that holds at ``start`` on."""
    kept: list[Change] = []
    for change in reversed(changes if isinstance(changes, Sequence) else tuple(changes)):
        if change[0] > now:
            continue
        kept.append(change)
        if change[0] < start:
            break
    kept.reverse()
    return kept


def _signal(changes: Sequence[Change], start: int, end: int, wanted: bool | None = True) -> Signal:
    signal: Signal = []
    since: int | None = None
    for instant, value, _ in changes:
        if value is wanted and since is None:
            since = instant
        elif value is not wanted and since is not None:
            signal.append((since, max(instant, since + 1)))
            since = None
    if since is not None:
        signal.append((since, end))
    return intersect(union([], signal), [(start, end)])


def _last(changes: Mapping[str, Sequence[Change]], now: int) -> tuple[Fact, ...]:
    """What is remembered when the reasons no longer are: each predicate's last change."""
    facts = [
        Fact(text, value, instant, now, source)
        for text, found in changes.items()
        for instant, value, source in found[-1:]
        if value is not None
    ]
    return tuple(sorted(facts, key=lambda fact: (fact.start_ns, fact.predicate)))


def _facts(text: str, value: bool, signal: Signal, changes: Sequence[Change]) -> Iterable[Fact]:
    """Facts of one predicate over ``signal``, with the observation that made it have ``value``."""
    for first, end in signal:
        source, before = None, None
        for instant, new, observation in changes:
            if instant > first:
                break
            # one that says the same again did not make it so
            if new is value and (before is not value or source is None):
                source = observation
            before = new
        yield Fact(text, value, first, end - 1, source)


class _Reasons:
    """Follows reasons downwards; ``spans`` gathers which predicate must have which value when."""

    def __init__(self, signals: Signals, spans: dict[tuple[str, bool], Signal]) -> None:
        self._signals = signals
        self._spans = spans

    def collect(self, formula: Formula, value: bool, where: Signal) -> None:
        """Why ``formula`` has ``value`` throughout ``where`` (it does)."""
        if not where:
            return
        match formula:
            case Predicate(text=text):
                self._spans[text, value] = union(self._spans.get((text, value), []), where)
            case Not(operand=inner):
                self.collect(inner, not value, where)
            case And(operands=operands):
                self._and(operands, value, where)
            case Once(operand=inner, interval=interval):
                self._once(inner, interval, value, where)
            case Since():
                self._since(formula, value, where)

    def _and(self, operands: Sequence[Formula], value: bool, where: Signal) -> None:
        rest = where
        for item in operands:
            if value:
                self.collect(item, True, where)
                continue
            part = intersect(rest, self._signals.where(item, False))
            self.collect(item, False, part)
            rest = _without(rest, part)

    def _once(self, inner: Formula, interval: Interval, value: bool, where: Signal) -> None:
        low, high = interval.lower, interval.upper
        if not value:
            window = [
                (self._signals.start if high is None else first - high, end - low)
                for first, end in where
            ]
            inside = intersect(union([], window), [(self._signals.start, self._signals.end)])
            self.collect(inner, False, inside)
            return
        self.collect(inner, True, self._instants(self._signals.of(inner), low, high, where))

    def _instants(self, signal: Signal, low: int, high: int | None, where: Signal) -> Signal:
        """Few instants of ``signal`` that every instant of ``where`` sees at its distance."""
        chosen: Signal = []
        for first, end in where:
            at = first
            while at < end:
                seen = [pair for pair in signal if pair[0] <= at - low]
                if not seen:
                    break
                instant = min(seen[-1][1] - 1, at - low)
                sees_to = end - 1 if high is None else instant + high
                if (
                    sees_to - at < end - 1 - at
                    and instant == at - low
                    and seen[-1][1] > instant + 1
                ):
                    # the signal goes on: take it as a span, not instant by instant
                    last = min(seen[-1][1], end - low)
                    chosen.append((instant, last))
                    sees_to = last - 1 + (high or 0)
                else:
                    chosen.append((instant, instant + 1))
                at = max(sees_to, at) + 1
        return union([], chosen)

    def _since(self, formula: Since, value: bool, where: Signal) -> None:
        left, right = self._signals.of(formula.left), self._signals.of(formula.right)
        low, high = formula.interval.lower, formula.interval.upper
        if not value:
            gone = intersect(where, complement(left, self._signals.start, self._signals.end))
            self.collect(formula.left, False, gone)
            where = _without(where, gone)
        for start, stop in left:
            for first, end in intersect(where, [(start, stop)]):
                if value:
                    self._held(formula, right, start, (first, end))
                    continue
                begin = self._signals.start if high is None else first - high
                if start - 1 >= self._signals.start and start > begin:
                    self.collect(formula.left, False, [(start - 1, start)])
                    begin = start
                    # a right side that held as left began counts from that beginning on
                    if start + low < end and (high is None or first < start + high):
                        self.collect(formula.right, False, [(start - 1, start)])
                begin = max(begin, start, self._signals.start)
                if begin < end - low:
                    self.collect(formula.right, False, [(begin, end - low)])

    def _held(self, formula: Since, right: Signal, start: int, piece: tuple[int, int]) -> None:
        """``right`` at instants not too long ago, ``left`` from the first of them on."""
        low, high = formula.interval.lower, formula.interval.upper
        usable = intersect(right, [(start, piece[1])])
        shifted = [(first + low, piece[1] if high is None else end + high) for first, end in usable]
        within = intersect([piece], union([], shifted))
        before = _without([piece], within)
        instants = self._instants(usable, low, high, within)
        begin = piece[0]
        if instants:
            self.collect(formula.right, True, instants)
            begin = instants[0][0]
        if before:
            self.collect(formula.right, True, [(start - 1, start)])
            begin = start
        self.collect(formula.left, True, [(min(begin, piece[0]), piece[1])])


def _without(signal: Signal, part: Signal) -> Signal:
    if not signal:
        return []
    return intersect(signal, complement(part, signal[0][0], signal[-1][1]))


def minimal(
    formula: Formula, facts: Sequence[Fact], at: int, start: int, end: int
) -> Sequence[Fact]:
    """Those of ``facts`` that are needed for ``formula`` to be false at ``at``.

    ``start`` and ``end`` are the instants between which anything is known.
    """
    if len(facts) > MOST_FACTS:
        return facts
    at_best = reduced(formula, by_polarity=True)
    texts = predicates(formula)

    def bounds_of(text: str, some: Sequence[Fact]) -> dict[str, Signal]:
        """The predicate ``text`` where ``some`` leave it open taken the ways that help and harm."""
        known = [fact for fact in some if fact.predicate == text]
        spans = {
            value: union(
                [], [(fact.start_ns, fact.end_ns + 1) for fact in known if fact.value is value]
            )
            for value in (True, False)
        }
        return {f"+{text}": complement(spans[False], start, end), f"-{text}": spans[True]}

    computed: Computed = {}

    def suffice(atoms: Mapping[str, Signal]) -> bool:
        wrong = Signals(atoms, start, end, computed).where(at_best, False)
        return any(first <= at < last for first, last in wrong)

    atoms = {name: signal for text in texts for name, signal in bounds_of(text, facts).items()}
    if not suffice(atoms):
        return facts
    kept = list(facts)
    for fact in facts:
        others = [other for other in kept if other is not fact]
        changed = {**atoms, **bounds_of(fact.predicate, others)}
        if suffice(changed):
            kept, atoms = others, changed
    return kept


# -- signals ----------------------------------------------------------------------------------


def union(first: Signal, second: Signal) -> Signal:
    """Where either holds."""
    merged: Signal = []
    for start, end in sorted(first + second):
        if merged and start <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(end, merged[-1][1]))
        elif start < end:
            merged.append((start, end))
    return merged


def complement(signal: Signal, start: int, end: int) -> Signal:
    """Where ``signal`` does not hold in ``[start, end)``."""
    rest: Signal = []
    at = start
    for first, last in signal:
        if first > at:
            rest.append((at, min(first, end)))
        at = max(at, last)
    if at < end:
        rest.append((at, end))
    return [(first, last) for first, last in rest if first < last]


def intersect(first: Signal, second: Signal) -> Signal:
    """Where both hold."""
    found: Signal = []
    left = right = 0
    while left < len(first) and right < len(second):
        start = max(first[left][0], second[right][0])
        end = min(first[left][1], second[right][1])
        if start < end:
            found.append((start, end))
        if first[left][1] <= second[right][1]:
            left += 1
        else:
            right += 1
    return found


Computed = dict[tuple[int, ...], tuple[Formula, Sequence[Signal], Signal]]
"""Per formula and its operands' signals (their ids; kept here, so that these stay theirs), its signal."""


class Signals:
    """The signals of a reduced formula's parts in ``[start, end)``, given its predicates'.

    This is a second, direct implementation of the operators of :mod:`moon.properties.formula`; the
    compiled networks never use it.

    Args:
        atoms: the predicates' signals; nobody changes them.
        start, end: where.
        computed: what is known from others with the same ``start`` and ``end``, who share some of the
            predicates' signals.
    """

    def __init__(
        self, atoms: Mapping[str, Signal], start: int, end: int, computed: Computed | None = None
    ) -> None:
        self._atoms = atoms
        self.start, self.end = start, end
        self._whole: Signal = [(start, end)]
        self._known: dict[int, tuple[Formula, Signal]] = {}
        self._computed: Computed = {} if computed is None else computed

    def of(self, formula: Formula) -> Signal:
        """Where ``formula`` holds."""
        if isinstance(formula, Predicate):
            return self._atoms.get(formula.text, NOWHERE)
        known = self._known.get(id(formula))
        if known is None:
            known = self._known[id(formula)] = (formula, self._of(formula))
        return known[1]

    def _of(self, formula: Formula) -> Signal:
        inputs = [self.of(item) for item in operands(formula)]
        key = (id(formula), *map(id, inputs))
        known = self._computed.get(key)
        if known is None:
            known = self._computed[key] = (formula, inputs, self._compute(formula, inputs))
        return known[2]

    def where(self, formula: Formula, value: bool) -> Signal:
        """Where ``formula`` has ``value``."""
        signal = self.of(formula)
        return signal if value else complement(signal, self.start, self.end)

    def _compute(self, formula: Formula, inputs: Sequence[Signal]) -> Signal:
        match formula:
            case Constant(value=value):
                return self._whole if value else []
            case Not():
                return complement(inputs[0], self.start, self.end)
            case And():
                found = self._whole
                for item in inputs:
                    found = intersect(found, item)
                return found
            case Once(interval=interval):
                return self._once(inputs[0], interval)
            case Since(interval=interval):
                return self._since(inputs[0], inputs[1], interval)
        raise TypeError(f"not reduced: {formula!r}")

    def _once(self, signal: Signal, interval: Interval) -> Signal:
        shifted = [
            (first + interval.lower, self.end if interval.upper is None else end + interval.upper)
            for first, end in signal
        ]
        return union([], [(first, min(end, self.end)) for first, end in shifted])

    def _since(self, left: Signal, right: Signal, interval: Interval) -> Signal:
        found: Signal = []
        for start, stop in left:
            # where left holds, an instant of right at its beginning counts from just before it
            anchors = [
                (max(first, start), min(end, stop))
                for first, end in right
                if first < stop and end >= start
            ]
            shifted = [
                (first + interval.lower, stop if interval.upper is None else end + interval.upper)
                for first, end in anchors
            ]
            found += intersect(union([], shifted), [(start, stop)])
        return union([], found)
