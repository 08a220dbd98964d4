"""ECMAScript's meaning of operators where Python's differs (ECMA-262, 2024).

Numbers are int or float, ``null`` and ``undefined`` are None, arrays are lists, structures have
attributes (messages) or are dicts (anonymous objects). Generated code calls these functions only
where the static types do not already settle the meaning.
"""

from __future__ import annotations

import copy
import functools
import math
import re
from collections.abc import Callable
from typing import Any, cast

import msgspec

from m2c.language.conversion import (
    MAX_LENGTH,
    MAX_SAFE_INTEGER,
    ExecutionError,
    as_flag,
    as_number,
    as_text,
    as_whole,
    check_length,
    to_array,
    to_double,
    to_flag,
    to_float32,
    to_float64,
    to_int8,
    to_int16,
    to_int32,
    to_int64,
    to_length,
    to_message,
    to_number,
    to_object,
    to_status,
    to_string,
    to_text,
    to_uint8,
    to_uint16,
    to_uint32,
    to_uint64,
    to_untyped,
    to_untyped_number,
    truthy,
    type_name,
)

__all__ = [
    "CONSTANTS",
    "MATH",
    "MAX_LENGTH",
    "MAX_SAFE_INTEGER",
    "ExecutionError",
    "add",
    "as_flag",
    "as_number",
    "as_text",
    "as_whole",
    "column",
    "divide",
    "element",
    "equals",
    "is_object",
    "less",
    "less_or_equal",
    "member",
    "multiply",
    "negate",
    "power",
    "remainder",
    "rows",
    "set_element",
    "set_member",
    "strict_equals",
    "subtract",
    "to_array",
    "to_flag",
    "to_float32",
    "to_float64",
    "to_int8",
    "to_int16",
    "to_int32",
    "to_int64",
    "to_length",
    "to_message",
    "to_number",
    "to_object",
    "to_status",
    "to_string",
    "to_text",
    "to_uint8",
    "to_uint16",
    "to_uint32",
    "to_uint64",
    "to_untyped",
    "to_untyped_number",
    "truthy",
    "type_name",
]
"""What generated code calls, conversions included; the operators stand here."""


_ARRAY_INDEX = re.compile(r"(0|[1-9][0-9]{0,9})\Z")


_NUMERIC = frozenset({int, float})


def is_object(value: Any) -> bool:
    """Whether ``value`` is an array, an object or a message (ECMA-262 6.1.7)."""
    return value is not None and not isinstance(value, str | bool | int | float)


def add(left: Any, right: Any) -> Any:
    """``+``: concatenation if either side is a string or an object, else a sum."""
    if left.__class__ not in _NUMERIC or right.__class__ not in _NUMERIC:
        left, right = _primitive(left), _primitive(right)
        if isinstance(left, str) or isinstance(right, str):
            return to_string(left) + to_string(right)
    return to_double(to_double(left) + to_double(right))


def subtract(left: Any, right: Any) -> int | float:
    """``-`` of operands of any type."""
    return to_double(to_double(left) - to_double(right))


def multiply(left: Any, right: Any) -> int | float:
    """``*`` of operands of any type."""
    first, second = to_double(left), to_double(right)
    product = first * second
    if product == 0 and isinstance(product, int) and (first < 0 or second < 0):
        return -0.0  # integers have one zero; floats keep its sign themselves
    return to_double(product)


def divide(left: Any, right: Any) -> float:
    """``/``: x/0 is an infinity, 0/0 is NaN."""
    dividend, divisor = to_double(left), to_double(right)
    if divisor == 0:
        if dividend == 0 or dividend != dividend:  # noqa: PLR0124
            return math.nan
        return math.copysign(math.inf, dividend) * math.copysign(1.0, divisor)
    return float(dividend / divisor)


def remainder(left: Any, right: Any) -> int | float:
    """``%``: the sign is the dividend's."""
    dividend, divisor = to_double(left), to_double(right)
    if isinstance(dividend, int) and isinstance(divisor, int) and divisor:
        rest = abs(dividend) % abs(divisor)
        if dividend < 0:
            return -rest if rest else -0.0
        return rest
    if divisor == 0 or math.isinf(dividend) or math.isnan(dividend) or math.isnan(divisor):
        return math.nan
    return math.fmod(dividend, divisor)


def power(left: Any, right: Any) -> float:
    """``**`` (ECMA-262 6.1.6.1.3)."""
    base, exponent = to_double(left), to_double(right)
    if math.isnan(exponent) or (abs(base) == 1 and math.isinf(exponent)):
        return math.nan
    try:
        return math.pow(base, exponent)
    except OverflowError:
        negative = base < 0 and float(exponent).is_integer() and exponent % 2 == 1
        return -math.inf if negative else math.inf
    except ValueError:
        if base == 0:
            odd = float(exponent).is_integer() and exponent % 2 == 1
            return math.copysign(math.inf, base) if odd else math.inf
        return math.nan


def negate(value: Any) -> int | float:
    """Unary ``-``."""
    number = to_number(value)
    return -number if number != 0 or isinstance(number, float) else -0.0


def equals(left: Any, right: Any) -> bool:
    """``==`` (ECMA-262 7.2.13 IsLooselyEqual)."""
    if isinstance(left, int | float) and isinstance(right, int | float):
        return bool(left == right)
    if left is None or right is None:
        return left is right
    if is_object(left) and is_object(right):
        return left is right
    left, right = _primitive(left), _primitive(right)
    if isinstance(left, str) and isinstance(right, str):
        return left == right
    return bool(to_number(left) == to_number(right))


def strict_equals(left: Any, right: Any) -> bool:
    """``===`` (ECMA-262 7.2.14)."""
    if type_name(left) != type_name(right):
        return False
    if type_name(left) == "object":
        return left is right
    return bool(left == right)


def less(left: Any, right: Any) -> bool:
    """``<`` (ECMA-262 7.2.12): strings by code unit, all else as numbers."""
    if isinstance(left, int | float) and isinstance(right, int | float):
        return bool(left < right)
    left, right = _primitive(left), _primitive(right)
    if isinstance(left, str) and isinstance(right, str):
        return _units(left) < _units(right)
    return bool(to_number(left) < to_number(right))


def _units(text: str) -> bytes:
    """The UTF-16 code units of ``text``, in an order in which bytes compare as they do."""
    return text.encode("utf-16-be", "surrogatepass")


def _primitive(value: Any) -> Any:
    """ECMA-262 7.1.1 ToPrimitive: objects as their text."""
    return to_string(value) if is_object(value) else value


def less_or_equal(left: Any, right: Any) -> bool:
    """``<=``; false if either side is NaN."""
    if isinstance(left, int | float) and isinstance(right, int | float):
        return bool(left <= right)
    left, right = _primitive(left), _primitive(right)
    if isinstance(left, str) and isinstance(right, str):
        return _units(left) <= _units(right)
    return bool(to_number(left) <= to_number(right))


def _attribute(value: Any, name: str) -> str | None:
    """The attribute of a message that holds its field ``name``; None if there is no such field."""
    if not isinstance(value, msgspec.Struct):
        return None
    return _attributes(type(value)).get(name)


@functools.lru_cache(maxsize=1024)
def _attributes(message: type[msgspec.Struct]) -> dict[str, str]:
    """The attribute of each field: another than its name where that is a word of Python."""
    return dict(zip(message.__struct_encode_fields__, message.__struct_fields__, strict=True))


def member(value: Any, name: str) -> Any:
    """``value.name``; undefined if there is no such field.

    Raises:
        ExecutionError: ``value`` is undefined.
    """
    if value is None:
        raise ExecutionError(f"cannot read `{name}` of undefined")
    if name == "length" and isinstance(value, str | list):
        return len(value)
    if isinstance(value, dict):
        return value.get(name)
    attribute = _attribute(value, name)
    return None if attribute is None else getattr(value, attribute)


def column(value: Any, name: str) -> list[Any]:
    """``value.name`` of an array of structures: the field ``name`` of each.

    Raises:
        ExecutionError: ``value`` is undefined.
    """
    if value is None:
        raise ExecutionError(f"cannot read `{name}` of undefined")
    return [member(row, name) for row in value]


def elements(value: Any) -> list[Any]:
    """A copy of the array ``value``, for a loop over it (W3C SCXML 4.6).

    Raises:
        ExecutionError: it is no array.
    """
    if not isinstance(value, list):
        raise ExecutionError(f"`{to_string(value)}` is not an array")
    return [*value]


def element(value: Any, index: Any) -> Any:
    """``value[index]``; undefined out of range.

    Raises:
        ExecutionError: ``value`` is undefined.
    """
    if value is None:
        raise ExecutionError(f"cannot read element {to_string(index)} of undefined")
    if isinstance(value, str | list):
        if (isinstance(index, float) and index.is_integer()) or (
            isinstance(index, str) and _ARRAY_INDEX.match(index)
        ):
            index = int(index)
        if isinstance(index, int) and not isinstance(index, bool):
            return value[index] if 0 <= index < len(value) else None
        return member(value, to_string(index))
    return member(value, to_string(index))


def set_member(
    value: Any,
    name: str,
    new: Any,
    fill: Any = None,
    most: int | None = None,
    least: int = 0,
) -> None:
    """``value.name = new``; ``length`` of an array truncates or extends it.

    Another name of an array of structures is a column: ``new`` has its value for each of them. An array
    without elements gets as many as the column has.

    Args:
        value: the object, message or array.
        name: the field.
        new: what goes there, converted to the field's type.
        fill: the zero value of an array's elements, for those that are added.
        most: elements that the array may have; None: ``MAX_LENGTH``.
        least: elements that it must have.

    Raises:
        ExecutionError: ``value`` is undefined or takes no such field, the length is none or not allowed, or
            the column is not as long as the array.
    """
    if isinstance(value, list) and name == "length":
        length = to_number(new)
        if not (0 <= length <= MAX_LENGTH and length == math.floor(length)):
            raise ExecutionError(f"invalid array length {to_string(new)}")
        check_length(int(length), most, least)
        del value[int(length) :]
        _extend(value, int(length), fill)
        return
    if isinstance(value, list) and isinstance(fill, dict | msgspec.Struct):
        if not value:
            check_length(len(new), most)
            _extend(value, len(new), fill)
        if len(new) != len(value):
            raise ExecutionError(f"{len(new)} values of `{name}` for {len(value)} elements")
        for row, item in zip(value, new, strict=True):
            set_member(row, name, item)
        return
    if isinstance(value, dict):
        value[name] = new
        return
    attribute = _attribute(value, name)
    if attribute is None:
        raise ExecutionError(f"cannot set `{name}` of {type_name(value)}")
    setattr(value, attribute, new)


def rows(
    columns: dict[str, list[Any]], fill: Any, most: int | None = None, least: int = 0
) -> list[Any]:
    """An array of structures of which ``columns`` are given; the other fields are as in ``fill``.

    Args:
        columns: values of each element, by field.
        fill: the zero value of an element.
        most: elements that the array may have; None: ``MAX_LENGTH``.
        least: elements that it must have.

    Raises:
        ExecutionError: the columns are not of one length, or of one that is not allowed.
    """
    made: list[Any] = []
    _extend(made, least, fill)
    for name, values in columns.items():
        set_member(made, name, values, fill, most)
    return made


def _extend(value: list[Any], length: int, fill: Any) -> None:
    """Append ``fill``, a new one each time, until there are ``length`` elements."""
    value.extend(copy.deepcopy(fill) for _ in range(length - len(value)))


def set_element(
    value: Any, index: Any, new: Any, fill: Any = None, most: int | None = None
) -> None:
    """``value[index] = new``; at or past the end the array grows, with ``fill`` in between.

    Args:
        value: the array, or an object.
        index: the place.
        new: what goes there, converted to the element's type.
        fill: the zero value of the elements, for those in between.
        most: elements that the array may have; None: ``MAX_LENGTH``.

    Raises:
        ExecutionError: neither an array nor an object, or not a valid index.
    """
    if isinstance(value, dict):
        value[to_string(index)] = new
        return
    number = to_double(index)
    if not isinstance(value, list) or not math.isfinite(number) or number != math.floor(number):
        raise ExecutionError(f"cannot set element {to_string(index)} of {type_name(value)}")
    position = int(number)
    if not 0 <= position < (MAX_LENGTH if most is None else most):
        raise ExecutionError(f"index {to_string(number)} is out of range")
    if position >= len(value):
        _extend(value, position + 1, fill)
    value[position] = new


def _guarded(function: Callable[[float], float]) -> Callable[[Any], float]:
    def call(value: Any) -> float:
        try:
            return function(float(to_double(value)))
        except ValueError:
            return math.nan
        except OverflowError:
            return math.inf

    return call


def _rounding(function: Callable[[float], int]) -> Callable[[Any], int | float]:
    def call(value: Any) -> int | float:
        number = to_number(value)
        if isinstance(number, int) or not abs(number) < MAX_SAFE_INTEGER:
            return number  # whole, or not finite
        rounded = function(number)
        return -0.0 if rounded == 0 and math.copysign(1, number) < 0 else rounded

    return call


def _nearest(number: float) -> int:
    """ECMA-262 21.3.2.28 Math.round: halves upwards; ``number + 0.5`` would itself be rounded."""
    below = math.floor(number)
    return below + 1 if number - below >= 0.5 else below


def _logarithm(function: Callable[[float], float]) -> Callable[[Any], float]:
    guarded = _guarded(function)
    return lambda value: -math.inf if to_number(value) == 0 else guarded(value)


def _extreme(pick: Callable[..., Any], empty: float) -> Callable[..., int | float]:
    def call(*values: Any) -> int | float:
        numbers = [to_number(value) for value in values]
        if any(number != number for number in numbers):  # noqa: PLR0124
            return math.nan
        result: int | float = pick(numbers, default=empty)
        if result == 0:  # -0 is less than 0, which Python's comparison does not tell
            zeros = [number for number in numbers if number == 0]
            return cast("int | float", pick(zeros, key=lambda zero: math.copysign(1.0, zero)))
        return result

    return call


def _absolute(value: Any) -> int | float:
    return abs(to_number(value))


def _sign(value: Any) -> int | float:
    number = to_number(value)
    return number if number == 0 or number != number else (1 if number > 0 else -1)  # noqa: PLR0124


def _hypot(*values: Any) -> float:
    return math.hypot(*(float(to_double(value)) for value in values))


def _atan2(left: Any, right: Any) -> float:
    return math.atan2(to_double(left), to_double(right))


MATH: dict[str, Callable[..., Any]] = {
    "abs": _absolute,
    "acos": _guarded(math.acos),
    "asin": _guarded(math.asin),
    "atan": _guarded(math.atan),
    "atan2": _atan2,
    "cbrt": _guarded(math.cbrt),
    "ceil": _rounding(math.ceil),
    "cos": _guarded(math.cos),
    "exp": _guarded(math.exp),
    "floor": _rounding(math.floor),
    "hypot": _hypot,
    "log": _logarithm(math.log),
    "log10": _logarithm(math.log10),
    "log2": _logarithm(math.log2),
    "max": _extreme(max, -math.inf),
    "min": _extreme(min, math.inf),
    "pow": power,
    "round": _rounding(_nearest),
    "sign": _sign,
    "sin": _guarded(math.sin),
    "sqrt": _guarded(math.sqrt),
    "tan": _guarded(math.tan),
    "trunc": _rounding(math.trunc),
}
"""``Math.*`` but ``random``: whoever runs a machine gives it a source of random numbers."""

CONSTANTS = {
    "E": math.e,
    "LN10": math.log(10),
    "LN2": math.log(2),
    "LOG10E": math.log10(math.e),
    "LOG2E": math.log2(math.e),
    "PI": math.pi,
    "SQRT1_2": math.sqrt(0.5),
    "SQRT2": math.sqrt(2),
}
"""``Math.PI`` and its like."""
