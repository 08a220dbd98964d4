"""Findings that are one mistake repeated, so that a big system's stay readable.

Which names a message quotes is not kept with it. So two findings count as one mistake repeated if they are
of one rule, severity and element, and say the same in the same words once everything that can only be a
name, a place or a number is taken out.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

import msgspec

from m2c.diagnostics import Diagnostic, Severity

SHOWN = 3
"""Findings of one mistake that are shown each; of more, the first one is."""
_NAME = re.compile(
    r"`[^`]*`"  # quoted
    r"|\"[^\"]*\""
    r"|(?:did you mean|known:) .*"  # what comes near depends on the name
    r"|[^\s,;()]*[^\W_a-z][^\s,;()]*"  # a capital letter or a digit: a name, a number, a place
    r"|[^\s,;()]*[/_.:\\][^\s,;()]+"  # a channel, a type, a path
)


class Group(msgspec.Struct, frozen=True):
    """One mistake: the ``first`` finding of it and the ``others``, in the order of their places."""

    first: Diagnostic
    others: tuple[Diagnostic, ...]


def grouped(diagnostics: Iterable[Diagnostic]) -> list[Group]:
    """``diagnostics`` by mistake, each where its first finding stands.

    A mistake of up to ``SHOWN`` findings is as many groups, without others.
    """
    ordered = sorted(diagnostics, key=lambda item: (item.position, item.rule))
    mistakes: dict[tuple[Severity, str, str, str], list[Diagnostic]] = {}
    for found in ordered:
        mistakes.setdefault(_mistake(found), []).append(found)
    groups = []
    for found in ordered:
        first, *others = mistakes[_mistake(found)]
        if len(others) < SHOWN:
            groups.append(Group(found, ()))
        elif found is first:
            groups.append(Group(first, tuple(others)))
    return groups


def by_rule(diagnostics: Iterable[Diagnostic]) -> str:
    """``12 request-discarded, 3 unknown-field``: how many findings each rule has, most first."""
    counts = Counter(found.rule for found in diagnostics)
    return ", ".join(f"{number} {rule}" for rule, number in counts.most_common())


def _mistake(found: Diagnostic) -> tuple[Severity, str, str, str]:
    text = _NAME.sub("_", f"{found.message}; {found.hint}")
    return found.severity, found.rule, found.element, text
