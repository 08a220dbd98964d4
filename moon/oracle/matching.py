"""Values: as keys, and expected ones against observed ones."""

from __future__ import annotations

import struct
from typing import Any

from m2c.model.datatypes import Array, DataType, Primitive, Structure
from moon.oracle.unknowns import Unknown, is_unknown

SCALARS = frozenset({int, float, str, bool, type(None)})


def frozen(value: Any, numbers: dict[int, int]) -> Any:
    """``value`` as something that can be compared and hashed.

    Unknown values are known by their shape and by which of them are the same.

    Args:
        value: of a model.
        numbers: those of the unknown values that were met before, by identity; new ones are added.
    """
    if value.__class__ in SCALARS:
        return value
    if value.__class__ is dict:
        return tuple((name, frozen(item, numbers)) for name, item in value.items())
    if isinstance(value, list | tuple):
        return tuple(frozen(item, numbers) for item in value)
    if isinstance(value, Unknown):
        return (*value.shape(), numbers.setdefault(id(value), len(numbers)))
    return value


def agree(expected: Any, observed: Any, kind: DataType | None) -> bool:
    """Whether ``observed`` is what was ``expected``; unknown parts agree with all they allow."""
    if expected == observed and expected.__class__ is not Unknown:
        return _same_kinds(expected, observed)
    if isinstance(expected, Unknown):
        return expected.allows(observed)
    match kind:
        case Structure() if isinstance(expected, dict) and isinstance(observed, dict):
            return all(
                agree(expected.get(name), observed[name], inner)
                for name, inner in kind.fields
                if name in observed or is_unknown(expected.get(name))
            )
        case Array(element, _, _) if isinstance(expected, list):
            items = list(observed) if isinstance(observed, list | tuple | bytes) else None
            if items is None or len(items) != len(expected):
                return False
            return all(agree(e, o, element) for e, o in zip(expected, items, strict=True))
        case Primitive(name) if isinstance(expected, int | float) and isinstance(
            observed, int | float
        ):
            if expected != expected or observed != observed:  # noqa: PLR0124 - NaN
                return expected != expected and observed != observed  # noqa: PLR0124
            if name == "float32":
                return _single(expected) == _single(observed)
    return False


def _same_kinds(expected: Any, observed: Any) -> bool:
    """Whether two equal values are equal as the model means it: true is not 1."""
    if expected.__class__ is dict:
        for name, value in expected.items():
            other = observed[name]
            if value.__class__ in SCALARS and value.__class__ is other.__class__:
                continue
            if not _same_kinds(value, other):
                return False
        return True
    if expected.__class__ is list:
        return all(_same_kinds(a, b) for a, b in zip(expected, observed, strict=True))
    return (expected.__class__ is bool) == (observed.__class__ is bool)


def _single(value: float) -> float:
    """``value`` as a 32-bit float holds it."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return float("inf") if value > 0 else float("-inf")


def learned(expected: Any, observed: Any, found: dict[int, tuple[Unknown, Any]]) -> None:
    """Collect into ``found`` what ``observed`` says of unknown values in ``expected``."""
    if isinstance(expected, Unknown):
        found[id(expected)] = (expected, observed)
    elif isinstance(expected, dict) and isinstance(observed, dict):
        for name, item in expected.items():
            if name in observed:
                learned(item, observed[name], found)
    elif isinstance(expected, list) and isinstance(observed, list):
        for item, seen in zip(expected, observed, strict=False):
            learned(item, seen, found)
