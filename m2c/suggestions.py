"""Names in a sentence: what a misspelt one may have meant (*did you mean*), and the first of many."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable, Sequence
from functools import lru_cache

COMPARED = 100
"""Names, and letters of one, that a suggestion is looked for in: bounds the work on hostile input."""
LISTED = 5
"""Names that a hint lists."""
_DIGITS = re.compile(r"\d+")
_SHORT = 4
"""Names with fewer letters differ on purpose (``get``, ``set``)."""
_LONG = 10
"""From so many letters on, two may be wrong (``increase`` and ``decrease`` are two names)."""


def nearest(name: str, known: Iterable[str]) -> str:
    """``did you mean x?`` for the closest of ``known``, else a list of them (see :func:`listed`)."""
    names = _sorted(frozenset(name for name in known if name))
    near = difflib.get_close_matches(name[:COMPARED], names[:COMPARED], 1)
    longer = [other for other in names[:COMPARED] if len(name) > 2 and other.startswith(name)]
    if near or longer:
        return f"did you mean {(near or longer)[0]}?"
    return f"known: {listed(name, names)}" if names else ""


def listed(name: str, known: Iterable[str]) -> str:
    """``a, b and 18 more``: of ``known`` the five nearest to ``name``, nearest first."""
    names = _sorted(frozenset(known))
    alike = difflib.SequenceMatcher(None, "", name[:COMPARED])
    likeness = {}
    for other in names[:COMPARED]:
        alike.set_seq1(other[:COMPARED])
        likeness[other] = alike.quick_ratio()
    ordered = sorted(names, key=lambda other: -likeness.get(other, 0.0))  # stable: else by name
    return first_of(ordered)


def first_of(names: Sequence[str], most: int = LISTED) -> str:
    """``a, b and 18 more``: the first ``most`` of ``names``, in their order."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"


def meant_channel(written: str, known: Collection[str]) -> str:
    """The channel of ``known`` that ``written``, which is none of them, is a slip for; "" if it is none."""
    near = (name for name in sorted(known) if nearly_the_same(written, name))
    return "" if written in known else next(near, "")


def nearly_the_same(one: str, other: str) -> bool:
    """Whether two channels are so alike that one is a slip of the pen for the other.

    One part of the name may differ, by a letter or two or in case. Numbers tell instances apart
    (``/Poi1``, ``/Poi2``), and so do whole prefixes (``/lock``, ``/unlock``): those are no slips.
    """
    parts = list(zip(one.split("/"), other.split("/"), strict=False))
    if one.count("/") != other.count("/"):
        return False
    different = [(left, right) for left, right in parts if left != right]
    if len(different) != 1:
        return False
    left, right = different[0]
    if _DIGITS.findall(left) != _DIGITS.findall(right):
        return False
    left, right = left.lower().replace("_", ""), right.lower().replace("_", "")
    if left == right:
        return True
    if left.endswith(right) or right.endswith(left) or min(len(left), len(right)) < _SHORT:
        return False
    most = 1 if len(left) < _LONG else 2
    return abs(len(left) - len(right)) <= most and _edits(left, right) <= most


def _edits(one: str, other: str) -> int:
    """How many letters to add, drop, replace or swap with the next (optimal string alignment)."""
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        last, before, row = before, row, [i]
        for j, wanted in enumerate(other, 1):
            cost = min(before[j] + 1, row[j - 1] + 1, before[j - 1] + (letter != wanted))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == wanted:
                cost = min(cost, last[j - 2] + 1)
            row.append(cost)
    return row[-1]


@lru_cache(maxsize=64)
def _sorted(names: frozenset[str]) -> tuple[str, ...]:
    return tuple(sorted(names))
