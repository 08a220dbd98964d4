"""Patterns and operators evaluated straight from their definitions, tick by tick, for tests only."""

from __future__ import annotations

from moon.properties.formula import (
    And,
    Constant,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Predicate,
    Rise,
    Since,
)
from moon.properties.patterns import Pattern, PatternName, ScopeName

Trace = list[dict[str, bool]]
"""The predicates' values at ticks 0, 1, 2 …"""


def name(formula: Formula | None) -> str:
    assert isinstance(formula, Predicate)
    return formula.text


def segments(pattern: Pattern, trace: Trace, now: int) -> list[tuple[int, int | None]]:
    """The scope's segments [begin, end) as seen at ``now``; end None: still open."""
    scope = pattern.scope
    if scope.name is ScopeName.GLOBALLY:
        return [(0, None)]
    seen = range(now + 1)
    if scope.name is ScopeName.BEFORE:
        return [(0, next((t for t in seen if trace[t][name(scope.end)]), None))]
    if scope.name is ScopeName.AFTER:
        return [(t, None) for t in seen if trace[t][name(scope.begin)]][:1]
    found: list[tuple[int, int | None]] = []
    begin: int | None = None
    for t in seen:
        ends = trace[t][name(scope.end)]
        if begin is None and trace[t][name(scope.begin)] and not ends:
            begin = t
        elif begin is not None and ends:
            found.append((begin, t))
            begin = None
    if begin is not None and scope.name is ScopeName.AFTER_UNTIL:
        found.append((begin, None))
    return found


def broken(pattern: Pattern, trace: Trace, now: int) -> bool:
    """Whether the prefix up to ``now`` breaks the pattern at ``now``."""
    return any(
        segment_broken(pattern, trace, begin, end, now)
        for begin, end in segments(pattern, trace, now)
    )


def segment_broken(pattern: Pattern, trace: Trace, begin: int, end: int | None, now: int) -> bool:
    closed = end is not None
    last = now if end is None else end - 1
    inside = range(begin, last + 1)
    low = pattern.bound.lower
    high = pattern.bound.upper
    events = [name(event) for event in pattern.events]

    def between(distance: int) -> bool:
        return low <= distance and (high is None or distance <= high)

    def over(since: int) -> bool:
        return closed or (high is not None and now >= since + high)

    window = [t for t in inside if between(t - begin)]
    match pattern.name:
        case PatternName.ABSENCE:
            return any(trace[t][events[0]] for t in window)
        case PatternName.UNIVERSALITY:
            return not all(trace[t][events[0]] for t in window)
        case PatternName.EXISTENCE:
            found = any(trace[t][events[0]] for t in window)
            return len(inside) > 0 and not found and over(begin)
        case PatternName.BOUNDED_EXISTENCE:
            rises = [
                t
                for t in window
                if trace[t][events[0]] and not (t - 1 in window and trace[t - 1][events[0]])
            ]
            return len(rises) > pattern.most
        case PatternName.RECURRENCE:
            assert high is not None
            return any(
                not any(trace[s][events[0]] for s in range(t - high, t + 1))
                for t in inside
                if t - high >= begin
            )
        case PatternName.PRECEDENCE:
            cause, effect = events
            return any(
                trace[t][effect]
                and not any(trace[s][cause] and between(t - s) for s in range(begin, t + 1))
                for t in inside
            )
        case PatternName.RESPONSE:
            request, response = events
            return any(
                trace[t][request]
                and not any(trace[s][response] and between(s - t) for s in inside if s >= t)
                and over(t)
                for t in inside
            )
        case PatternName.PRECEDENCE_CHAIN:
            *causes, effect = events
            return any(
                trace[t][effect] and not led_to(trace, causes, begin, t, between) for t in inside
            )
        case PatternName.RESPONSE_CHAIN:
            return any(
                trace[t][events[0]] and unanswered(trace, events[1:], t, last, over, high)
                for t in inside
            )


def led_to(trace, causes, begin, at, between) -> bool:
    """Whether causes[0] < causes[1] < … happened in [begin, at], the last one in the bound."""

    def ends(place: int) -> set[int]:
        if place == 0:
            found = {t for t in range(begin, at + 1) if trace[t][causes[0]]}
        else:
            before = ends(place - 1)
            found = {
                t
                for t in range(begin, at + 1)
                if trace[t][causes[place]] and any(s < t for s in before)
            }
        return {t for t in found if between(at - t)} if place == len(causes) - 1 else found

    return bool(ends(len(causes) - 1))


def unanswered(trace, responses, since, last, over, high) -> bool:
    """Whether the chain asked for at ``since`` broke; each link is the first that fits."""
    first = since
    for response in responses:
        limit = last if high is None else min(last, since + high)
        answer = next((t for t in range(first, limit + 1) if trace[t][response]), None)
        if answer is None:
            return over(since)
        since, first = answer, answer + 1
    return False


def holds(formula: Formula, trace: Trace, t: int) -> bool:
    """The operators' definitions; ``since`` with Reelay's rule for instants where left is false."""
    match formula:
        case Constant(value=value):
            return value
        case Predicate(text=text):
            return trace[t][text]
        case Not(operand=inner):
            return not holds(inner, trace, t)
        case And(operands=operands):
            return all(holds(item, trace, t) for item in operands)
        case Or(operands=operands):
            return any(holds(item, trace, t) for item in operands)
        case Implies(left=left, right=right):
            return not holds(left, trace, t) or holds(right, trace, t)
        case Once(operand=inner, interval=i):
            return any(holds(inner, trace, s) for s in reach(i, t))
        case Historically(operand=inner, interval=i):
            return all(holds(inner, trace, s) for s in reach(i, t))
        case Rise(operand=inner):
            return t > 0 and holds(inner, trace, t) and not holds(inner, trace, t - 1)
        case Since(left=left, right=right, interval=i):
            if not holds(left, trace, t):
                return False
            for s in range(t + 1):
                if not holds(right, trace, s):
                    continue
                if not all(holds(left, trace, u) for u in range(s + 1, t + 1)):
                    continue
                if holds(left, trace, s):
                    fits = s + i.lower <= t and (i.upper is None or t <= s + i.upper)
                else:  # it counts from the tick's end on
                    fits = s + 1 + i.lower <= t and (i.upper is None or t < s + 1 + i.upper)
                if fits:
                    return True
            return False


def reach(interval, t: int) -> range:
    first = 0 if interval.upper is None else max(0, t - interval.upper)
    return range(first, t - interval.lower + 1)
