"""ECMAScript's meaning of operators where Python's differs (ECMA-262, 2024).

Numbers are int or float, ``null`` and ``undefined`` are None, arrays are lists, structures have
attributes (messages) or are dicts (anonymous objects). Generated code calls these functions only
where the static types do not already settle the meaning.
"""

from __future__ import annotations

import math
import random as _random
import re
from collections.abc import Callable
from typing import Any

MAX_SAFE_INTEGER = 2**53
"""Beyond it an ECMAScript number is a double that no longer holds every integer."""

_ARRAY_INDEX = re.compile(r"(0|[1-9][0-9]{0,9})\Z")


class ExecutionError(Exception):
    """An expression that ECMAScript would not evaluate either; SCXML's ``error.execution``."""


def to_string(value: Any) -> str:
    """ECMA-262 7.1.17 ToString; numbers as in 6.1.6.1.20."""
    match value:
        case str():
            return value
        case None:
            return "undefined"
        case bool():
            return "true" if value else "false"
        case int():
            return str(value) if abs(value) <= MAX_SAFE_INTEGER else _float_text(float(value))
        case float():
            return _float_text(value)
        case list():
            return ",".join("" if item is None else to_string(item) for item in value)
        case _:
            return "[object Object]"


def _float_text(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    if value == 0:
        return "0"
    sign = "-" if value < 0 else ""
    mantissa, _, exponent = f"{abs(value)!r}".partition("e")
    whole, _, fraction = mantissa.partition(".")
    fraction = "" if fraction == "0" else fraction
    digits = (whole + fraction).lstrip("0")
    point = len(whole) + int(exponent or 0)
    if whole == "0":
        point -= 1 + len(fraction) - len(fraction.lstrip("0"))
    digits = digits.rstrip("0") or "0"
    count = len(digits)
    if count <= point <= 21:
        return sign + digits + "0" * (point - count)
    if 0 < point <= 21:
        return f"{sign}{digits[:point]}.{digits[point:]}"
    if -6 < point <= 0:
        return f"{sign}0.{'0' * -point}{digits}"
    power = point - 1
    tail = f".{digits[1:]}" if count > 1 else ""
    return f"{sign}{digits[0]}{tail}e{'+' if power >= 0 else '-'}{abs(power)}"


def to_number(value: Any) -> int | float:
    """ECMA-262 7.1.4 ToNumber; ``undefined`` is NaN."""
    match value:
        case bool():
            return int(value)
        case int():
            return value if abs(value) <= MAX_SAFE_INTEGER else float(value)
        case float():
            return value
        case None:
            return math.nan
        case str():
            return _number_of_text(value.strip())
        case list():
            return to_number(to_string(value))
        case _:
            return math.nan


def _number_of_text(text: str) -> int | float:
    if not text:
        return 0
    for prefix, base in (("0x", 16), ("0o", 8), ("0b", 2)):
        if text.lower().startswith(prefix):
            try:
                return int(text[2:], base) if "_" not in text else math.nan
            except ValueError:
                return math.nan
    if text.lstrip("+-") == "Infinity" and len(text) <= 9:
        return -math.inf if text[0] == "-" else math.inf
    if any(letter not in "0123456789.eE+-" for letter in text):
        return math.nan
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return int(value) if value.is_integer() and abs(value) <= MAX_SAFE_INTEGER else value


def truthy(value: Any) -> bool:
    """ECMA-262 7.1.2 ToBoolean: 0, NaN, "", null and undefined are false; all objects are true."""
    if isinstance(value, bool):
        return value
    if value is None:
        return False
    if isinstance(value, int | float):
        return value != 0 and value == value  # noqa: PLR0124 - NaN differs from itself
    if isinstance(value, str):
        return value != ""
    return True


def type_name(value: Any) -> str:
    """``typeof`` (ECMA-262 13.5.3)."""
    match value:
        case None:
            return "undefined"
        case bool():
            return "boolean"
        case int() | float():
            return "number"
        case str():
            return "string"
        case _:
            return "object"


def add(left: Any, right: Any) -> Any:
    """``+``: concatenation if either side is a string or an object, else a sum."""
    if isinstance(left, str | list | dict) or isinstance(right, str | list | dict):
        return to_string(left) + to_string(right)
    return to_number(left) + to_number(right)


def subtract(left: Any, right: Any) -> int | float:
    """``-`` of operands of any type."""
    return to_number(left) - to_number(right)


def multiply(left: Any, right: Any) -> int | float:
    """``*`` of operands of any type."""
    return _product(to_number(left), to_number(right))


def _product(left: int | float, right: int | float) -> int | float:
    product = left * right
    if isinstance(product, int) and product == 0 and (left < 0 or right < 0):
        return -0.0  # integers have one zero; floats keep its sign themselves
    return product


def divide(left: Any, right: Any) -> float:
    """``/``: x/0 is an infinity, 0/0 is NaN."""
    dividend, divisor = to_number(left), to_number(right)
    if divisor == 0:
        if dividend == 0 or dividend != dividend:  # noqa: PLR0124
            return math.nan
        return math.copysign(math.inf, dividend) * math.copysign(1.0, divisor)
    return float(dividend / divisor)


def remainder(left: Any, right: Any) -> int | float:
    """``%``: the sign is the dividend's."""
    dividend, divisor = to_number(left), to_number(right)
    if isinstance(dividend, int) and isinstance(divisor, int) and divisor:
        rest = abs(dividend) % abs(divisor)
        if dividend < 0:
            return -rest if rest else -0.0
        return rest
    if divisor == 0 or math.isinf(dividend) or math.isnan(dividend) or math.isnan(divisor):
        return math.nan
    return math.fmod(dividend, divisor)


def power(left: Any, right: Any) -> int | float:
    """``**`` (ECMA-262 6.1.6.1.3)."""
    base, exponent = to_number(left), to_number(right)
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
    if left is None or right is None:
        return left is right
    if isinstance(left, list | dict) and isinstance(right, list | dict):
        return left is right
    if isinstance(left, str) and isinstance(right, str):
        return left == right
    if isinstance(left, list | dict) and isinstance(right, str):
        return to_string(left) == right
    if isinstance(right, list | dict) and isinstance(left, str):
        return left == to_string(right)
    comparable = (bool, int, float, str, list, dict)
    if not isinstance(left, comparable) or not isinstance(right, comparable):
        return left is right
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
    left, right = _primitive(left), _primitive(right)
    if isinstance(left, str) and isinstance(right, str):
        return left.encode("utf-16-be") < right.encode("utf-16-be")
    return bool(to_number(left) < to_number(right))


def _primitive(value: Any) -> Any:
    """ECMA-262 7.1.1 ToPrimitive: objects as their text."""
    return to_string(value) if isinstance(value, list | dict) else value


def less_or_equal(left: Any, right: Any) -> bool:
    """``<=``; false if either side is NaN."""
    left, right = _primitive(left), _primitive(right)
    if isinstance(left, str) and isinstance(right, str):
        return left.encode("utf-16-be") <= right.encode("utf-16-be")
    return bool(to_number(left) <= to_number(right))


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
    return getattr(value, name, None)


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


def set_member(value: Any, name: str, new: Any) -> None:
    """``value.name = new``; ``length`` of an array truncates or extends it.

    Raises:
        ExecutionError: ``value`` is undefined or takes no such field.
    """
    if isinstance(value, list) and name == "length":
        length = to_number(new)
        if length < 0 or length != math.floor(length) or length > MAX_LENGTH:
            raise ExecutionError(f"invalid array length {to_string(new)}")
        del value[int(length) :]
        value.extend([None] * (int(length) - len(value)))
    elif isinstance(value, dict):
        value[name] = new
    else:
        try:
            setattr(value, name, new)
        except AttributeError as error:
            raise ExecutionError(f"cannot set `{name}` of {type_name(value)}") from error


MAX_LENGTH = 1_000_000
"""Longest array a model may make: a runaway index is a fault, not a reason to fill the memory."""


def set_element(value: Any, index: Any, new: Any, fill: Any = None) -> None:
    """``value[index] = new``; at or past the end the array grows, with ``fill`` in between.

    Raises:
        ExecutionError: not an array, or not a valid index.
    """
    if isinstance(value, dict):
        value[to_string(index)] = new
        return
    number = to_number(index)
    if not isinstance(value, list) or number != number or number != math.floor(number):  # noqa: PLR0124
        raise ExecutionError(f"cannot set element {to_string(index)} of {type_name(value)}")
    position = int(number)
    if not 0 <= position < MAX_LENGTH:
        raise ExecutionError(f"index {position} is out of range")
    if position >= len(value):
        value.extend([fill] * (position - len(value) + 1))
    value[position] = new


def integer(value: Any) -> Any:
    """A number for an integer location: a whole float becomes an int.

    Raises:
        ExecutionError: the number is not whole.
    """
    if isinstance(value, float):
        if not value.is_integer():
            raise ExecutionError(f"{to_string(value)} is not a whole number")
        return int(value)
    return value


def _guarded(function: Callable[[float], float]) -> Callable[[Any], float]:
    def call(value: Any) -> float:
        try:
            return function(float(to_number(value)))
        except ValueError:
            return math.nan
        except OverflowError:
            return math.inf

    return call


def _rounding(function: Callable[[float], int]) -> Callable[[Any], int | float]:
    def call(value: Any) -> int | float:
        number = to_number(value)
        if isinstance(number, int):
            return number
        if not math.isfinite(number):
            return number
        rounded = function(number)
        return -0.0 if rounded == 0 and math.copysign(1, number) < 0 else rounded

    return call


def _logarithm(function: Callable[[float], float]) -> Callable[[Any], float]:
    guarded = _guarded(function)
    return lambda value: -math.inf if to_number(value) == 0 else guarded(value)


def _extreme(pick: Callable[..., Any], empty: float) -> Callable[..., int | float]:
    def call(*values: Any) -> int | float:
        numbers = [to_number(value) for value in values]
        if any(number != number for number in numbers):  # noqa: PLR0124
            return math.nan
        zeros = [number for number in numbers if number == 0]
        result: int | float = pick(numbers, default=empty)
        if result == 0 and zeros:
            signs = [math.copysign(1.0, zero) for zero in zeros]
            return -0.0 if pick(signs) < 0 else 0
        return result

    return call


def _absolute(value: Any) -> int | float:
    return abs(to_number(value))


def _sign(value: Any) -> int | float:
    number = to_number(value)
    return number if number == 0 or number != number else (1 if number > 0 else -1)  # noqa: PLR0124


def _hypot(*values: Any) -> float:
    return math.hypot(*(float(to_number(value)) for value in values))


def _atan2(left: Any, right: Any) -> float:
    return math.atan2(to_number(left), to_number(right))


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
    "random": _random.random,
    "round": _rounding(lambda number: math.floor(number + 0.5)),
    "sign": _sign,
    "sin": _guarded(math.sin),
    "sqrt": _guarded(math.sqrt),
    "tan": _guarded(math.tan),
    "trunc": _rounding(math.trunc),
}
"""``Math.*``; ``random`` is replaced by the machine's own source where one is injected."""

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
