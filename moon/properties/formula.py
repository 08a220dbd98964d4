"""Past-time metric temporal logic as a tree.

Time is counted in ticks: nanoseconds in dense time, steps in discrete time. A signal is constant
between observations and holds from its observation on, ``[t, next)``; every bound counts ticks and
both ends belong to it. These are Reelay's operators (Ulus, "Online Monitoring of Metric Temporal
Logic using Sequential Networks", 2019) with ``[t, next)`` for its ``(t, next]``, so that a verdict is
known when an observation arrives and not only when the next one does.
"""

from __future__ import annotations

import msgspec

from m2c.language.expressions import Expression

TICKS_PER_SECOND = 1_000_000_000
"""Dense time is counted in nanoseconds, as stamps are."""
LONGEST_TICKS = 100 * 366 * 86_400 * TICKS_PER_SECOND
"""A hundred years: a larger bound is a slip of the pen."""


class Interval(msgspec.Struct, frozen=True):
    """Distances into the past, in ticks, both included; ``upper`` None is unbounded."""

    lower: int = 0
    upper: int | None = None


EVER = Interval()


class Constant(msgspec.Struct, frozen=True, tag=True):
    """``true`` or ``false``."""

    value: bool


class Predicate(msgspec.Struct, frozen=True, tag=True):
    """A condition on observed values; ``text`` identifies it: equal texts mean equal conditions."""

    text: str
    expression: Expression


class Not(msgspec.Struct, frozen=True, tag=True):
    """``not f``."""

    operand: Formula


class And(msgspec.Struct, frozen=True, tag=True):
    """All of ``operands``."""

    operands: tuple[Formula, ...]


class Or(msgspec.Struct, frozen=True, tag=True):
    """At least one of ``operands``."""

    operands: tuple[Formula, ...]


class Implies(msgspec.Struct, frozen=True, tag=True):
    """``left -> right``."""

    left: Formula
    right: Formula


class Once(msgspec.Struct, frozen=True, tag=True):
    """``once[a:b] f``: f held at some instant between b and a ago."""

    operand: Formula
    interval: Interval = EVER


class Historically(msgspec.Struct, frozen=True, tag=True):
    """``historically[a:b] f``: f held at all instants between b and a ago (since the start)."""

    operand: Formula
    interval: Interval = EVER


class Since(msgspec.Struct, frozen=True, tag=True):
    """``left since[a:b] right``: right held between b and a ago, and left ever since and now.

    Reelay's dense rule: an instant at which ``right`` holds without ``left`` counts from its end on.
    """

    left: Formula
    right: Formula
    interval: Interval = EVER


class Rise(msgspec.Struct, frozen=True, tag=True):
    """``rises f``: f holds, and did not one tick ago; ``falls f`` is the rise of ``not f``.

    There is none at the first instant of all: what was before is not known.
    """

    operand: Formula


Formula = Constant | Predicate | Not | And | Or | Implies | Once | Historically | Since | Rise

TRUE = Constant(True)
FALSE = Constant(False)


def operands(formula: Formula) -> tuple[Formula, ...]:
    """The direct sub-formulas, left to right."""
    match formula:
        case Constant() | Predicate():
            return ()
        case Not(operand=inner) | Once(operand=inner) | Historically(operand=inner):
            return (inner,)
        case Rise(operand=inner):
            return (inner,)
        case And(operands=inner) | Or(operands=inner):
            return inner
        case Implies(left=left, right=right) | Since(left=left, right=right):
            return (left, right)


def predicates(formula: Formula) -> dict[str, Predicate]:
    """The predicates of ``formula`` by text, in order of appearance."""
    found: dict[str, Predicate] = {}
    pending = [formula]
    while pending:
        here = pending.pop()
        if isinstance(here, Predicate):
            found.setdefault(here.text, here)
        pending.extend(reversed(operands(here)))
    return found


def reduced(formula: Formula, by_polarity: bool = False) -> Formula:
    """``formula`` in constants, predicates, ``not``, ``and``, ``once`` and ``since`` alone.

    ``or``, ``->`` and ``historically`` are written as their duals, a rise as what gives it its meaning.
    What is one object in ``formula`` is one in the result.

    Args:
        formula: any formula.
        by_polarity: split every predicate ``p`` into ``+p`` where its truth helps the formula and ``-p``
            where it harms, so that an unknown value can be taken at its best and at its worst.
    """
    known: dict[tuple[int, bool], Formula] = {}

    def rewritten(part: Formula, helps: bool) -> Formula:
        key = (id(part), helps or not by_polarity)
        found = known.get(key)
        if found is None:
            found = known[key] = rewrite(part, helps)
        return found

    def rewrite(part: Formula, helps: bool) -> Formula:
        match part:
            case Constant():
                return part
            case Predicate(text=name, expression=expression):
                return (
                    Predicate(f"{'+' if helps else '-'}{name}", expression) if by_polarity else part
                )
            case Not(operand=inner):
                return negation(rewritten(inner, not helps))
            case And(operands=inner):
                return And(tuple(rewritten(item, helps) for item in inner))
            case Or(operands=inner):
                return Not(And(tuple(negation(rewritten(item, helps)) for item in inner)))
            case Implies(left=left, right=right):
                return Not(And((rewritten(left, not helps), negation(rewritten(right, helps)))))
            case Once(operand=inner, interval=interval):
                return Once(rewritten(inner, helps), interval)
            case Historically(operand=inner, interval=interval):
                return Not(Once(negation(rewritten(inner, helps)), interval))
            case Since(left=left, right=right, interval=interval):
                return Since(rewritten(left, helps), rewritten(right, helps), interval)
            case Rise(operand=inner):
                before = Once(negation(rewritten(inner, not helps)), Interval(1, 1))
                return And((rewritten(inner, helps), before))

    return rewritten(formula, True)


def loosened(formula: Formula, ticks: int) -> Formula:
    """What holds of every run of which ``formula`` holds, where instants are known to ``ticks`` only.

    Each time bound is longer where that helps the formula, and shorter where it harms. Bounds up to one
    tick say what was before what, not how long before: these stay.

    Args:
        formula: any formula.
        ticks: two instants are this much further apart at most than they seem to be, or nearer.
    """
    known: dict[tuple[int, bool], Formula] = {}

    def rewritten(part: Formula, helps: bool) -> Formula:
        found = known.get((id(part), helps))
        if found is None:
            found = known[id(part), helps] = rewrite(part, helps)
        return found

    def rewrite(part: Formula, helps: bool) -> Formula:
        match part:
            case Constant() | Predicate():
                return part
            case Not(operand=inner):
                return negation(rewritten(inner, not helps))
            case And(operands=inner):
                return conjunction(*(rewritten(item, helps) for item in inner))
            case Or(operands=inner):
                return disjunction(*(rewritten(item, helps) for item in inner))
            case Implies(left=left, right=right):
                return disjunction(negation(rewritten(left, not helps)), rewritten(right, helps))
            case Once(operand=inner, interval=interval):
                changed = _changed(interval, ticks if helps else -ticks)
                return FALSE if changed is None else Once(rewritten(inner, helps), changed)
            case Historically(operand=inner, interval=interval):
                changed = _changed(interval, -ticks if helps else ticks)
                return TRUE if changed is None else Historically(rewritten(inner, helps), changed)
            case Since(left=left, right=right, interval=interval):
                changed = _changed(interval, ticks if helps else -ticks)
                if changed is None:
                    return FALSE
                return Since(rewritten(left, helps), rewritten(right, helps), changed)
            case Rise(operand=inner):
                before = Once(negation(rewritten(inner, not helps)), Interval(1, 1))
                return conjunction(rewritten(inner, helps), before)

    return rewritten(formula, True)


def _changed(interval: Interval, ticks: int) -> Interval | None:
    """``interval``, longer by ``ticks`` at both ends (shorter, if negative); None if nothing is left."""
    lower, upper = interval.lower, interval.upper
    if lower > 1:
        lower = max(lower - ticks, 1)
    if upper is None:
        return Interval(lower)
    if upper > 1:
        upper += ticks
    return Interval(lower, upper) if lower <= upper else None


def has_rise(formula: Formula) -> bool:
    """Whether a rise is part of ``formula``."""
    pending = [formula]
    while pending:
        here = pending.pop()
        if isinstance(here, Rise):
            return True
        pending.extend(operands(here))
    return False


def has_duration(formula: Formula) -> bool:
    """Whether ``formula`` says how long ago something was, or how long it lasted."""
    pending = [formula]
    while pending:
        here = pending.pop()
        if isinstance(here, Once | Historically | Since):
            interval = here.interval
            if interval.lower > 1 or (interval.upper or 0) > 1:
                return True
        pending.extend(operands(here))
    return False


def conjunction(*parts: Formula) -> Formula:
    """``and`` of ``parts``, flattened; true parts vanish, a false one decides."""
    return _joined(And, TRUE, FALSE, parts)


def disjunction(*parts: Formula) -> Formula:
    """``or`` of ``parts``, flattened; false parts vanish, a true one decides."""
    return _joined(Or, FALSE, TRUE, parts)


def negation(formula: Formula) -> Formula:
    """``not formula``, without a double negation."""
    if isinstance(formula, Not):
        return formula.operand
    if isinstance(formula, Constant):
        return Constant(not formula.value)
    return Not(formula)


def _joined(
    kind: type[And] | type[Or], neutral: Constant, absorbing: Constant, parts: tuple[Formula, ...]
) -> Formula:
    flat: list[Formula] = []
    for part in parts:
        for item in part.operands if isinstance(part, kind) else (part,):
            if item == absorbing:
                return absorbing
            if item != neutral and item not in flat:
                flat.append(item)
    if len(flat) > 1:
        return kind(tuple(flat))
    return flat[0] if flat else neutral


def text(formula: Formula, ticks_per_unit: int = TICKS_PER_SECOND) -> str:
    """``formula`` in the syntax of :mod:`moon.properties.syntax`; parsing it gives it back."""
    match formula:
        case Constant(value=value):
            return "true" if value else "false"
        case Predicate(text=inside):
            return f"{{{inside}}}"
        case Not(operand=inner):
            return f"not {_tight(inner, ticks_per_unit)}"
        case And(operands=inner):
            return " and ".join(_tight(item, ticks_per_unit) for item in inner)
        case Or(operands=inner):
            return " or ".join(_tight(item, ticks_per_unit) for item in inner)
        case Implies(left=left, right=right):
            return f"{_tight(left, ticks_per_unit)} -> {_tight(right, ticks_per_unit)}"
        case Rise(operand=Not(operand=inner)):
            return f"falls {_tight(inner, ticks_per_unit)}"
        case Rise(operand=inner):
            return f"rises {_tight(inner, ticks_per_unit)}"
        case Once(operand=inner, interval=interval):
            return f"once{bounds(interval, ticks_per_unit)} {_tight(inner, ticks_per_unit)}"
        case Historically(operand=inner, interval=interval):
            return f"historically{bounds(interval, ticks_per_unit)} {_tight(inner, ticks_per_unit)}"
        case Since(left=left, right=right, interval=interval):
            return (
                f"{_tight(left, ticks_per_unit)} since{bounds(interval, ticks_per_unit)} "
                f"{_tight(right, ticks_per_unit)}"
            )


def _tight(formula: Formula, ticks_per_unit: int) -> str:
    inside = text(formula, ticks_per_unit)
    return inside if isinstance(formula, Predicate | Constant) else f"({inside})"


def bounds(interval: Interval, ticks_per_unit: int = TICKS_PER_SECOND) -> str:
    """``[a:b]`` in units; empty if the interval is all of the past."""
    if interval == EVER:
        return ""
    lower = number(interval.lower, ticks_per_unit) if interval.lower else ""
    upper = "" if interval.upper is None else number(interval.upper, ticks_per_unit)
    if interval.upper is not None and not lower and interval.lower == 0:
        return f"[:{upper}]"
    return f"[{lower}:{upper}]"


def number(ticks: int, ticks_per_unit: int = TICKS_PER_SECOND) -> str:
    """``ticks`` in units, exactly: ``0.5``; in nanoseconds where seconds would hide them: ``1ns``."""
    whole, rest = divmod(ticks, ticks_per_unit)
    if not rest:
        return str(whole)
    if ticks_per_unit == TICKS_PER_SECOND and rest % 1000:
        return f"{ticks}ns"
    digits = len(str(ticks_per_unit)) - 1
    return f"{whole}.{rest:0{digits}d}".rstrip("0")
