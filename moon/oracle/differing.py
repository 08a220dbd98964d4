"""The first field in which a message differs from what was expected of it, for people."""

from __future__ import annotations

from typing import Any

from m2c.language.datatypes import Array, DataType, Structure
from moon.oracle.unknowns import agree, is_unknown
from moon.verdict import Difference
from moon.wording import field_text

_COMMON = 12
"""So many characters before the first that differs are shown of a text."""


def first_difference(expected: Any, observed: Any, kind: DataType | None) -> Difference | None:
    """Where ``observed`` does not agree with ``expected``, a message of type ``kind``; None if as a whole."""
    found = _differing("", expected, observed, kind, None)
    if found is None or not found.path:
        return None
    return found


def _differing(
    path: str, expected: Any, observed: Any, kind: DataType | None, holder: Structure | None
) -> Difference | None:
    """The first difference at ``path`` or inside; ``holder``: the structure that it is a field of."""
    if agree(expected, observed, kind):
        return None
    if isinstance(kind, Structure) and isinstance(expected, dict) and isinstance(observed, dict):
        for name, inner in kind.fields:
            if name in observed or is_unknown(expected.get(name)):
                below = f"{path}.{name}" if path else name
                found = _differing(below, expected.get(name), observed.get(name), inner, kind)
                if found is not None:
                    return found
    if isinstance(kind, Array) and isinstance(expected, list):
        items = list(observed) if isinstance(observed, list | tuple | bytes) else []
        if len(items) != len(expected):
            return Difference(f"{path}.length", str(len(expected)), str(len(items)))
        for place, (mine, its) in enumerate(zip(expected, items, strict=True)):
            found = _differing(f"{path}[{place}]", mine, its, kind.element, holder)
            if found is not None:
                return found
    mine, its = _from_where_they_differ(expected, observed)
    name = path.rpartition(".")[2].partition("[")[0]
    return Difference(
        path, field_text(mine, kind, holder, name), field_text(its, kind, holder, name)
    )


def _from_where_they_differ(expected: Any, observed: Any) -> tuple[Any, Any]:
    """Two texts without most of what they have in common at the beginning."""
    if not isinstance(expected, str) or not isinstance(observed, str):
        return expected, observed
    common = 0
    for mine, its in zip(expected, observed, strict=False):
        if mine != its:
            break
        common += 1
    first = common - _COMMON
    if first <= 0:
        return expected, observed
    return f"…{expected[first:]}", f"…{observed[first:]}"
