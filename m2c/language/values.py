"""Values of a type as plain data (a structure is a dict): converted to it, and its zero.

What generated code does in place, by the functions of :mod:`m2c.language.conversion`, is done here from the
type: by the model oracle, by the checks, and by whoever holds the two against each other.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

from m2c.language import conversion
from m2c.language.conversion import (
    Convert,
    ExecutionError,
    as_flag,
    as_number,
    as_text,
    as_whole,
    to_array,
    to_flag,
    to_float32,
    to_float64,
    to_object,
    to_text,
    to_uint8,
    to_untyped,
    to_untyped_number,
    unfit,
)
from m2c.language.datatypes import INTEGER_RANGES, Array, DataType, Primitive, Structure

_SCALARS: dict[str, Convert] = {
    **{name: getattr(conversion, f"to_{name}") for name in INTEGER_RANGES if "int" in name},
    **{"byte": to_uint8, "char": to_uint8},
    "bool": to_flag,
    "string": to_text,
    "float32": to_float32,
    "float64": to_float64,
    "number": to_untyped_number,
}

LENIENT: dict[str, Convert] = {
    **dict.fromkeys(INTEGER_RANGES, as_whole),
    **{"bool": as_flag, "string": as_text},
    **dict.fromkeys(("float32", "float64", "number"), as_number),
}
"""What a string, number or bool becomes before it goes to a place, of a model that is read leniently."""


def convert(value: Any, kind: DataType, lenient: bool = False) -> Any:
    """``value`` in a place of type ``kind``, as plain data (a structure is a dict).

    Raises:
        ExecutionError: it cannot be there.
    """
    return converter(kind, lenient=lenient)(value)


def converter(
    kind: DataType,
    around: Callable[[DataType, Convert], Convert] | None = None,
    lenient: bool = False,
) -> Convert:
    """What converts plain data to ``kind``, made once; see :func:`convert`.

    Args:
        kind: the type of the place.
        around: what each conversion, of parts too, is replaced with, given its type; for values that
            stand for several.
        lenient: whether strings, numbers and bools become one another.
    """
    made = _converter(kind, around, lenient)
    return made if around is None else around(kind, made)


def _converter(
    kind: DataType, around: Callable[[DataType, Convert], Convert] | None, lenient: bool
) -> Convert:
    match kind:
        case Primitive(name) if lenient and name in LENIENT:
            becomes, strictly = LENIENT[name], _SCALARS[name]
            return lambda value: strictly(becomes(value))
        case Primitive(name):
            return _SCALARS.get(name, to_untyped)
        case Array(element, length, fixed):
            inner = converter(element, around, lenient)
            least = (length or 0) if fixed else 0
            return lambda value: to_array(value, inner, length, least)
        case Structure(name) if name:
            return _structured(kind, around, lenient)
        case _:
            return to_object


def _structured(
    kind: Structure, around: Callable[[DataType, Convert], Convert] | None, lenient: bool
) -> Convert:
    conversions = {name: converter(inner, around, lenient) for name, inner in kind.fields}
    template = zero(kind)

    def convert_fields(value: Any) -> Any:
        if not isinstance(value, dict):
            raise unfit(value, kind.name)
        made = copy.deepcopy(template)
        for name, item in value.items():
            if name not in conversions:
                raise ExecutionError(f"{kind.name} has no field `{name}`")
            made[name] = conversions[name](item)
        return made

    return convert_fields


def zero(kind: DataType) -> Any:
    """The zero value of ``kind`` as plain data (ROS 2's initial value of a field)."""
    match kind:
        case Primitive("bool"):
            return False
        case Primitive("string"):
            return ""
        case Primitive(name) if name in INTEGER_RANGES:
            return 0
        case Primitive(name) if name in ("any", "null"):
            return None
        case Primitive():
            return 0.0
        case Structure():
            declared = dict(kind.defaults)
            return {
                name: _plain(declared[name], inner) if name in declared else zero(inner)
                for name, inner in kind.fields
            }
        case Array(element, length, True):
            return [zero(element) for _ in range(length or 0)]
        case Array():
            return []


def _plain(value: Any, kind: DataType) -> Any:
    """A declared default as data: a whole number for a float field is a float."""
    if isinstance(value, tuple):
        element = kind.element if isinstance(kind, Array) else kind
        return [_plain(item, element) for item in value]
    is_float = kind in (Primitive("float32"), Primitive("float64"))
    return float(value) if is_float and not isinstance(value, str) else value
