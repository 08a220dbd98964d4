"""Properties in plain English."""

from __future__ import annotations

from collections.abc import Container

from moon.properties.formula import (
    EVER,
    TICKS_PER_SECOND,
    And,
    Constant,
    Formula,
    Historically,
    Implies,
    Interval,
    Not,
    Once,
    Or,
    Predicate,
    Rise,
    Since,
    number,
)
from moon.properties.patterns import Pattern, PatternName, ScopeName


def duration(ticks: int) -> str:
    """``ticks`` of dense time for people: ``5 s``, ``200 ms``."""
    for unit, size in (("s", TICKS_PER_SECOND), ("ms", 10**6), ("us", 10**3)):
        if ticks >= size or unit == "us":
            shown = number(ticks, size)
            if shown.endswith("ns"):  # exact to the nanosecond, which is more than people read
                shown = f"{ticks / size:.6f}".rstrip("0").rstrip(".")
            return f"{shown} {unit}"
    return f"{ticks} ns"


def formula_words(formula: Formula) -> str:
    """``formula`` as a clause."""
    match formula:
        case Constant(value=value):
            return "nothing is asked" if value else "the impossible holds"
        case Predicate(text=text):
            return f"`{text}`"
        case Not(operand=Predicate(text=text)):
            return f"not `{text}`"
        case Not(operand=Since() as since):
            return f"it is not so that {formula_words(since)}"
        case Not(operand=inner):
            return f"not ({formula_words(inner)})"
        case And(operands=parts):
            return " and ".join(_group(part) for part in parts)
        case Or(operands=parts):
            return " or ".join(_group(part) for part in parts)
        case Implies(left=left, right=right):
            return f"if {formula_words(left)} then {formula_words(right)}"
        case Rise(operand=Not(operand=inner)):
            return f"fall of {_group(inner)}"
        case Rise(operand=inner):
            return f"rise of {_group(inner)}"
        case Once(operand=inner, interval=interval):
            return f"{_group(inner)} {_past('was so at some time', interval)}"
        case Historically(operand=inner, interval=interval):
            if interval == EVER:
                return f"at every moment so far {formula_words(inner)}"
            return f"{_group(inner)} {_past('was so all the time', interval)}"
        case Since(left=left, right=right, interval=interval):
            when = f" ({_window(interval)})" if interval != EVER else ""
            return f"{_group(left)} ever since {_group(right)}{when}"


def _group(formula: Formula) -> str:
    words = formula_words(formula)
    return words if isinstance(formula, Predicate | Constant | Not | Rise) else f"({words})"


def _past(words: str, interval: Interval) -> str:
    return words if interval == EVER else f"{words} {_window(interval)}"


def _window(interval: Interval) -> str:
    if interval.upper is None:
        return f"at least {duration(interval.lower)} ago"
    if interval.lower == 0:
        return f"within the last {duration(interval.upper)}"
    return f"between {duration(interval.upper)} and {duration(interval.lower)} ago"


def formula_sentence(formula: Formula) -> str:
    """One sentence for a free formula."""
    if isinstance(formula, Historically) and formula.interval == EVER:
        return f"At every moment, {formula_words(formula.operand)}."
    words = formula_words(formula)
    return f"At this moment, {words}."


def formula_deadline(formula: Formula, events: Container[str] = ()) -> int | None:
    """The shortest time after which waiting alone can make ``formula`` false; None: it cannot.

    ``events`` are the predicates that hold for an instant only: nobody waits while one does.
    """
    return min(_lapses(formula, False, events), default=None)


def _lapses(formula: Formula, to: bool, events: Container[str]) -> set[int]:
    """The times after which waiting alone can turn ``formula`` into ``to``."""
    match formula:
        case Constant() | Predicate():
            return set()
        case Not(operand=inner):
            return _lapses(inner, not to, events)
        case Implies(left=left, right=right):
            return _lapses(Or((Not(left), right)), to, events)
        case And(operands=parts) | Or(operands=parts):
            # each part has to be ``to`` at once; an event is, for no time at all
            together = isinstance(formula, And) is to
            if together and any(_is_instant(part, to, events) for part in parts):
                return set()
            return set().union(*(_lapses(part, to, events) for part in parts))
        case Once(operand=inner, interval=interval):
            return _limits(interval, to) | (
                set() if interval.upper is None and not to else _lapses(inner, to, events)
            )
        case Historically(operand=inner, interval=interval):
            return _lapses(Once(Not(inner), interval), not to, events)
        case Rise(operand=inner):
            return _lapses(inner, True, events) if to else set()
        case Since(left=left, right=right, interval=interval):
            found = _limits(interval, to) | _lapses(left, to, events)
            return found | _lapses(right, to, events) if to else found


def _limits(interval: Interval, to: bool) -> set[int]:
    """When the window of an operator begins (``to`` true) or ends."""
    limit = interval.lower if to else interval.upper
    return {limit} if limit else set()


def _is_instant(formula: Formula, to: bool, events: Container[str]) -> bool:
    while isinstance(formula, Not):
        formula, to = formula.operand, not to
    if isinstance(formula, And) and to:
        return any(_is_instant(part, True, events) for part in formula.operands)
    if isinstance(formula, Rise):
        return to
    return isinstance(formula, Predicate) and to and formula.text in events


def pattern_sentence(pattern: Pattern) -> str:
    """One sentence for a pattern."""
    return f"{_scope(pattern)}, {_body(pattern)}."


def _scope(pattern: Pattern) -> str:
    begin = formula_words(pattern.scope.begin) if pattern.scope.begin is not None else ""
    end = formula_words(pattern.scope.end) if pattern.scope.end is not None else ""
    match pattern.scope.name:
        case ScopeName.GLOBALLY:
            return "Always"
        case ScopeName.BEFORE:
            return f"Before the first {end}"
        case ScopeName.AFTER:
            return f"After the first {begin}"
        case ScopeName.BETWEEN:
            return f"Between {begin} and the next {end}"
        case ScopeName.AFTER_UNTIL:
            return f"After {begin} and until {end}"


def _body(pattern: Pattern) -> str:
    words = [formula_words(event) for event in pattern.events]
    first, last = words[0], words[-1]
    start = "the start" if pattern.scope.name in (ScopeName.GLOBALLY, ScopeName.BEFORE) else "then"
    from_start = _bounded(pattern.bound, f" of {start}", f" after {start}")
    apart = _bounded(pattern.bound, "", " later")
    match pattern.name:
        case PatternName.ABSENCE:
            return f"{first} never happens{from_start}"
        case PatternName.UNIVERSALITY:
            return f"{first} holds all the time{from_start}"
        case PatternName.EXISTENCE:
            return f"{first} happens at least once{from_start}"
        case PatternName.BOUNDED_EXISTENCE:
            times = {0: "never", 1: "at most once"}.get(
                pattern.most, f"at most {pattern.most} times"
            )
            return f"{first} happens {times}{from_start}"
        case PatternName.RECURRENCE:
            return f"{first} happens at least once every {duration(pattern.bound.upper or 0)}"
        case PatternName.RESPONSE:
            return f"every {first} is followed by {last}{apart}"
        case PatternName.PRECEDENCE:
            return f"{last} happens only if {first} happened before it{apart and f' ({apart.strip()})'}"
        case PatternName.RESPONSE_CHAIN:
            hops = " and then by ".join(words[1:])
            each = f", each{apart}" if apart else ""
            return f"every {first} is followed by {hops}{each}"
        case PatternName.PRECEDENCE_CHAIN:
            causes = " and then ".join(words[:-1])
            return f"{last} happens only if {causes} happened before it{apart and f' ({apart.strip()})'}"


def _bounded(bound: Interval, within: str, after: str) -> str:
    if bound.upper is None:
        return f" from {duration(bound.lower)}{after}" if bound.lower else ""
    if bound.lower == 0:
        return f" within {duration(bound.upper)}{within}"
    return f" between {duration(bound.lower)} and {duration(bound.upper)}{after}"
