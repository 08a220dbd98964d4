"""Whether two systems mean the same, whichever dialect and files they were read from."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Any

import msgspec

from m2c.diagnostics import Position

_SPELLINGS = {
    "System": {"name", "path", "library", "sources", "findings", "origins"},
    "Data": {"element"},
    "Machine": {"dialect"},
    "Transition": {"element"},
    "EventData": {"spelling"},
}
"""What says how something is written, or where, and not what it means."""


def first_difference(one: Any, other: Any, at: Position) -> Position | None:
    """The place of the first part of ``one`` that ``other`` has not; None if they mean the same.

    Args:
        one: a System, a Machine or a part of one.
        other: what it is compared with.
        at: the place of ``one``, where it has none of its own.
    """
    if type(one) is not type(other):
        return at
    if isinstance(one, Position):
        return None
    if isinstance(one, msgspec.Struct):
        at = getattr(one, "position", at)
        skipped = _SPELLINGS.get(type(one).__name__, set())
        pairs = [
            (getattr(one, name), getattr(other, name))
            for name in one.__struct_fields__
            if name not in skipped
        ]
    elif isinstance(one, tuple | list):
        if len(one) != len(other):
            return at
        pairs = list(zip(one, other, strict=True))
    elif isinstance(one, Path):
        return None if one.resolve() == other.resolve() else at
    elif isinstance(one, Enum):
        return None if one is other else at
    else:
        return None if repr(one) == repr(other) else at  # a NaN is not equal to itself
    found = (first_difference(mine, theirs, at) for mine, theirs in pairs)
    return next((place for place in found if place is not None), None)
