"""Facts that a witness can do without.

Reasons are followed one operand at a time, so that two branches may give two for what one explains. A
fact is dropped if the others make the formula false whatever else had been observed: that is, if it is
false even where every value that they leave open is taken the way that helps it most.
"""

from __future__ import annotations

from collections.abc import Sequence

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
    predicates,
    written_out,
)
from moon.properties.signals import Signal, Signals, complement, union
from moon.properties.verdict import Fact

MOST_FACTS = 64
"""With more facts nothing is dropped: it would take longer than it is worth."""


def minimal(
    formula: Formula, facts: Sequence[Fact], at: int, start: int, end: int
) -> Sequence[Fact]:
    """Those of ``facts`` that are needed for ``formula`` to be false at ``at``.

    ``start`` and ``end`` are the instants between which anything is known.
    """
    if len(facts) > MOST_FACTS:
        return facts
    at_best = split(formula, True)
    texts = predicates(formula)

    def suffice(some: Sequence[Fact]) -> bool:
        atoms: dict[str, Signal] = {}
        for text in texts:
            known = [fact for fact in some if fact.predicate == text]
            spans = {
                value: union(
                    [], [(fact.start_ns, fact.end_ns + 1) for fact in known if fact.value is value]
                )
                for value in (True, False)
            }
            atoms[f"+{text}"] = complement(spans[False], start, end)
            atoms[f"-{text}"] = spans[True]
        wrong = Signals(atoms, start, end).where(at_best, False)
        return any(first <= at < last for first, last in wrong)

    if not suffice(facts):
        return facts
    kept = list(facts)
    for fact in facts:
        others = [other for other in kept if other is not fact]
        if suffice(others):
            kept = others
    return kept


def split(formula: Formula, helps: bool) -> Formula:
    """``formula`` with ``+p`` for every predicate ``p`` whose truth helps it, ``-p`` where it harms."""
    match formula:
        case Constant():
            return formula
        case Predicate(text=text, expression=expression):
            return Predicate(f"{'+' if helps else '-'}{text}", expression)
        case Not(operand=inner):
            return Not(split(inner, not helps))
        case And(operands=operands):
            return And(tuple(split(item, helps) for item in operands))
        case Or(operands=operands):
            return Or(tuple(split(item, helps) for item in operands))
        case Implies(left=left, right=right):
            return Implies(split(left, not helps), split(right, helps))
        case Rise():
            return split(written_out(formula), helps)
        case Once(operand=inner, interval=interval):
            return Once(split(inner, helps), interval)
        case Historically(operand=inner, interval=interval):
            return Historically(split(inner, helps), interval)
        case Since(left=left, right=right, interval=interval):
            return Since(split(left, helps), split(right, helps), interval)
