"""Formulas over remembered signals: which instants each sub-formula holds at.

A signal is a sorted list of disjoint intervals ``[first, end)`` of ticks. This is a second, direct
implementation of the operators of :mod:`moon.properties.formula`, used to explain a violation after
the fact; the compiled networks never use it.
"""

from __future__ import annotations

from collections.abc import Mapping

from moon.properties.formula import And, Constant, Formula, Interval, Not, Once, Predicate, Since

Signal = list[tuple[int, int]]


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


class Signals:
    """The signals of a reduced formula's parts in ``[start, end)``, given its predicates'."""

    def __init__(self, atoms: Mapping[str, Signal], start: int, end: int) -> None:
        self._atoms = atoms
        self.start, self.end = start, end
        self._known: dict[int, tuple[Formula, Signal]] = {}

    def of(self, formula: Formula) -> Signal:
        """Where ``formula`` holds."""
        known = self._known.get(id(formula))
        if known is None:
            known = self._known[id(formula)] = (formula, self._compute(formula))
        return known[1]

    def where(self, formula: Formula, value: bool) -> Signal:
        """Where ``formula`` has ``value``."""
        signal = self.of(formula)
        return signal if value else complement(signal, self.start, self.end)

    def _compute(self, formula: Formula) -> Signal:
        whole = [(self.start, self.end)]
        match formula:
            case Constant(value=value):
                return whole if value else []
            case Predicate(text=text):
                return self._atoms.get(text, [])
            case Not(operand=inner):
                return self.where(inner, False)
            case And(operands=operands):
                found = whole
                for item in operands:
                    found = intersect(found, self.of(item))
                return found
            case Once(operand=inner, interval=interval):
                return self._once(self.of(inner), interval)
            case Since(left=left, right=right, interval=interval):
                return self._since(self.of(left), self.of(right), interval)
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
