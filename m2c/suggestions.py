"""Names in a sentence: what a misspelt one may have meant (*did you mean*), and the first of many."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from functools import lru_cache

COMPARED = 100
"""Names, and letters of one, that a suggestion is looked for in: bounds the work on hostile input."""
LISTED = 5
"""Names that a hint lists."""


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


@lru_cache(maxsize=64)
def _sorted(names: frozenset[str]) -> tuple[str, ...]:
    return tuple(sorted(names))
