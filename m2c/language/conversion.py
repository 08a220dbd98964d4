"""What a value becomes: ECMAScript's conversions, and those to a declared type.

The first half is ECMA-262 (2024) section 7.1. The second half is what happens to a value that goes to a
typed place (a variable, an element, a field of a message, a port): see
docs/decisions/0024-assignments-convert-to-the-declared-type.md. The generated code calls these functions;
the model oracle and the checks do by way of :mod:`m2c.language.values`, so that an assignment has one
meaning.

Numbers are int or float, ``null`` and ``undefined`` are None, arrays are lists, structures have
attributes (messages) or are dicts (anonymous objects, and messages as the oracle sees them).
"""

from __future__ import annotations

import copy
import ctypes
import math
import re
from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

import msgspec

MAX_SAFE_INTEGER = 2**53
"""Beyond it an ECMAScript number is a double that no longer holds every integer."""
MAX_LENGTH = 1_000_000
"""Longest array, or string made of others, that a model may make: what grows at each event is a fault, not
a reason to fill the memory."""
MAX_DEPTH = 64
"""Arrays and objects inside each other: an array put into itself at each event must end somewhere."""


class ExecutionError(Exception):
    """An expression that ECMAScript would not evaluate either; SCXML's ``error.execution``."""


# -- ECMA-262 7.1 -----------------------------------------------------------------------------------


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
            return str(value) if abs(value) <= MAX_SAFE_INTEGER else _float_text(to_double(value))
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
    """ECMA-262 7.1.4 ToNumber; ``undefined`` is NaN.

    A whole number that is only copied or compared stays exact (a 64-bit field does not lose its last
    digits on the way); arithmetic is done on doubles, see :func:`to_double`.
    """
    match value:
        case bool():
            return int(value)
        case int() | float():
            return value
        case None:
            return math.nan
        case str():
            return _number_of_text(value.strip(_BLANKS))
        case list():
            return to_number(to_string(value))
        case _:
            return math.nan


def to_double(value: Any) -> int | float:
    """A number for arithmetic: an int only as long as a double holds it exactly (ECMA-262 6.1.6.1)."""
    if value.__class__ is float:
        number: float = value
        return number
    whole = value if value.__class__ is int else to_number(value)
    if -MAX_SAFE_INTEGER <= whole <= MAX_SAFE_INTEGER or whole.__class__ is float:
        exact: int | float = whole
        return exact
    return _float(whole)


def _float(number: int | float) -> float:
    """``number`` as the nearest double; an infinity where that is too small."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


_BLANKS = (
    "\t\n\v\f\r \u00a0\u1680\u2000\u2001\u2002\u2003\u2004\u2005\u2006\u2007\u2008\u2009\u200a"
    "\u2028\u2029\u202f\u205f\u3000\ufeff"
)
"""ECMA-262 12.2 white space and 12.3 line terminators: what ToNumber leaves out at both ends."""
_RADIX = re.compile(r"0(?:[xX]([0-9a-fA-F]+)|[oO]([0-7]+)|[bB]([01]+))\Z")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?\Z")


def _number_of_text(text: str) -> int | float:
    """ECMA-262 7.1.4.1 StringToNumber."""
    if not text:
        return 0
    radix = _RADIX.match(text)
    if radix is not None:
        return to_double(int(radix[radix.lastindex or 1], (16, 8, 2)[(radix.lastindex or 1) - 1]))
    if text in ("Infinity", "+Infinity", "-Infinity"):
        return -math.inf if text[0] == "-" else math.inf
    if _DECIMAL.match(text) is None:
        return math.nan
    value = float(text)
    exact = value.is_integer() and abs(value) <= MAX_SAFE_INTEGER
    return int(value) if exact and (value or text[0] != "-") else value


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


STATUS_NUMBERS = {"SUCCESS": 1, "FAILURE": 2, "RUNNING": 3}
"""The statuses of a behaviour tree's nodes by name, and the numbers that stand for them in AS2FM."""
STATUSES = tuple(STATUS_NUMBERS)
"""What a behaviour-tree node may return."""
_STATUS_NAMES: dict[int | float, str] = {number: name for name, number in STATUS_NUMBERS.items()}


def to_status(value: Any) -> str:
    """The name of a status that a variable holds, by name or by number.

    Raises:
        ExecutionError: it is neither.
    """
    name = value if isinstance(value, str) else None
    if value.__class__ is int or value.__class__ is float:
        name = _STATUS_NAMES.get(value)
    if name not in STATUS_NUMBERS:
        raise unfit(value, "a status")
    assert name is not None
    return name


# -- of a model that is read with --lenient ----------------------------------------------------------
#
# What becomes of a string, number or bool before it goes to a typed place. All else stays as it is, so
# that the place refuses it: what is missing is never made a value.


def as_whole(value: Any) -> Any:
    """ToNumber, without its fraction; NaN and the infinities are 0 (ECMA-262 7.1.6 ToInt32, 1 to 3)."""
    number = as_number(value)
    if number.__class__ is not float:
        return number
    return int(number) if math.isfinite(number) else 0


def as_number(value: Any) -> Any:
    """ECMA-262 7.1.4 ToNumber, of a string or bool."""
    return to_number(value) if isinstance(value, str | bool) else value


def as_text(value: Any) -> Any:
    """ECMA-262 7.1.17 ToString, of a number or bool."""
    return to_string(value) if isinstance(value, int | float) else value


def as_flag(value: Any) -> Any:
    """ECMA-262 7.1.2 ToBoolean, of a string or number."""
    return truthy(value) if isinstance(value, str | int | float) else value


# -- to a declared type -----------------------------------------------------------------------------

Convert = Callable[[Any], Any]


def unfit(value: Any, wanted: str) -> ExecutionError:
    """The error of ``value`` in a place that takes ``wanted``."""
    shown = to_string(value)
    if isinstance(value, str):
        shown = f"'{value if len(value) <= 40 else value[:37] + '...'}'"
    elif isinstance(value, list):
        shown = f"an array of {len(value)}"
    elif type_name(value) == "object":
        shown = "an object"
    return ExecutionError(f"{shown} where {wanted} is declared")


def _integer(name: str) -> Callable[[Any], int]:
    bits = int(name.lstrip("uint"))
    span = 2**bits
    low = 0 if name.startswith("u") else -(span // 2)
    high = low + span - 1

    def convert(value: Any) -> int:
        if value.__class__ is int:
            number: int = value
        elif value.__class__ is float and value.is_integer():
            number = int(value)
        else:
            raise unfit(value, name)
        return number if low <= number <= high else (number - low) % span + low

    convert.__name__ = f"to_{name}"
    convert.__doc__ = f"A whole number as ``{name}``: modulo 2**n (ECMA-262 7.1.6 to 7.1.12)."
    return convert


to_int8 = _integer("int8")
to_int16 = _integer("int16")
to_int32 = _integer("int32")
to_int64 = _integer("int64")
to_uint8 = _integer("uint8")
to_uint16 = _integer("uint16")
to_uint32 = _integer("uint32")
to_uint64 = _integer("uint64")
"""Each raises ExecutionError for what is no whole number: a fraction, NaN, an infinity, undefined, a
string, a bool, an array, an object."""

_Integers = dict[int | None, Callable[[Any], int]]
_SIGNED: _Integers = {
    **{2**7 - 1: to_int8, 2**15 - 1: to_int16},
    **{2**31 - 1: to_int32, 2**63 - 1: to_int64},
}
_UNSIGNED: _Integers = {
    **{2**8 - 1: to_uint8, 2**16 - 1: to_uint16},
    **{2**32 - 1: to_uint32, None: to_uint64},
}
"""By the most that the annotation of a field allows; see ``m2c.runtime.messages``."""


def to_float64(value: Any) -> float:
    """A number as ``float64``.

    Raises:
        ExecutionError: it is no number.
    """
    if value.__class__ is float:
        number: float = value
        return number
    if value.__class__ is int:
        return _float(value)
    raise unfit(value, "float64")


def to_float32(value: Any) -> float:
    """A number as ``float32`` holds it: the nearest one, as ECMA-262 21.3.2.16 (Math.fround).

    Raises:
        ExecutionError: it is no number.
    """
    if value.__class__ is float or value.__class__ is int:
        return ctypes.c_float(_float(value)).value
    raise unfit(value, "float32")


def to_untyped_number(value: Any) -> int | float:
    """A number for a variable that is a number without a width.

    Raises:
        ExecutionError: it is no number.
    """
    if value.__class__ is float or value.__class__ is int:
        number: int | float = value
        return number
    raise unfit(value, "number")


def to_text(value: Any) -> str:
    """A string for a ``string``; nothing else is taken.

    Raises:
        ExecutionError: it is no string, or has more than ``MAX_LENGTH`` characters.
    """
    if not isinstance(value, str):
        raise unfit(value, "string")
    if len(value) > MAX_LENGTH:
        raise ExecutionError(f"a string of {len(value)} characters where {MAX_LENGTH} fit")
    return value


def to_flag(value: Any) -> bool:
    """A bool for a ``bool``; nothing else is taken.

    Raises:
        ExecutionError: it is no bool.
    """
    if value is True or value is False:
        return bool(value)
    raise unfit(value, "bool")


def to_untyped(value: Any) -> Any:
    """A copy of ``value`` for a place of no declared type: assignments never share arrays or objects.

    Raises:
        ExecutionError: it is nested more than ``MAX_DEPTH`` deep, or holds more than ``MAX_LENGTH`` items or
            a string of more characters than that.
    """
    left = MAX_LENGTH

    def copied(item: Any, depth: int) -> Any:
        nonlocal left
        if isinstance(item, str):
            return to_text(item)
        if not isinstance(item, list | dict):
            return copy.deepcopy(item)
        left -= len(item)
        if depth == 0 or left < 0:
            raise ExecutionError(f"more than {MAX_DEPTH} deep or {MAX_LENGTH} long")
        if isinstance(item, list):
            return [copied(inner, depth - 1) for inner in item]
        return {name: copied(inner, depth - 1) for name, inner in item.items()}

    return copied(value, MAX_DEPTH)


def to_object(value: Any) -> Any:
    """A copy of an object, for a variable that is one without a declared type.

    Raises:
        ExecutionError: it is no object.
    """
    if isinstance(value, dict | msgspec.Struct):
        return to_untyped(value)
    raise unfit(value, "object")


def to_array(value: Any, element: Convert, most: int | None = None, least: int = 0) -> list[Any]:
    """An array with each element converted.

    Args:
        value: what goes to the place.
        element: converts one element.
        most: elements that the place holds; None if there is no bound.
        least: elements that it must have: ``most`` where the length is fixed.

    Raises:
        ExecutionError: it is no array, has too many or too few elements, or one does not fit.
    """
    if not isinstance(value, list):
        raise unfit(value, "an array")
    check_length(len(value), most, least)
    return [element(item) for item in value]


def check_length(length: int, most: int | None, least: int = 0) -> None:
    """Whether an array may have ``length`` elements.

    Raises:
        ExecutionError: it may not.
    """
    if length < least or length > (MAX_LENGTH if most is None else most):
        wanted = f"{least}" if most == least else f"at most {MAX_LENGTH if most is None else most}"
        raise ExecutionError(f"{length} elements where {wanted} fit")


def to_length(value: Any, most: int = MAX_LENGTH) -> int:
    """How many elements an array has that is made with the length ``value`` (ECMA-262 7.1.20 ToLength).

    Args:
        value: the length: fractions are truncated, NaN and what is negative are 0.
        most: elements that the array may have.

    Raises:
        ExecutionError: it is longer.
    """
    number = to_number(value)
    if number != number or number <= 0:  # noqa: PLR0124 - NaN
        return 0
    if number > most:
        raise ExecutionError(f"an array of {to_string(number)} elements where {most} fit")
    return int(number)


def to_message(value: Any, message: type[msgspec.Struct], lenient: bool = False) -> Any:
    """A copy of a message of the class ``message``, or one made of an object with such fields.

    Args:
        value: what goes to the place.
        message: its class.
        lenient: whether strings, numbers and bools become one another.

    Raises:
        ExecutionError: it is neither, or a field does not fit.
    """
    if value.__class__ is message:
        return copy.deepcopy(value)
    if not isinstance(value, dict):
        raise unfit(value, message.__name__)
    fields = message_fields(message)
    made = {}
    for name, item in value.items():
        if name not in fields:
            raise ExecutionError(f"{message.__name__} has no field `{name}`")
        attribute, kind = fields[name]
        made[attribute] = _annotated(item, kind, lenient)
    return message(**made)


_MessageFields = dict[str, tuple[str, msgspec.inspect.Type]]
_fields: WeakKeyDictionary[type[msgspec.Struct], _MessageFields] = WeakKeyDictionary()


def message_fields(message: type[msgspec.Struct]) -> _MessageFields:
    """The fields of a class of messages by their names: the attribute of each, and its type.

    They are looked up once: Python finds what annotations mean in the module of the class.
    """
    known = _fields.get(message)
    if known is None:
        known = _fields[message] = {
            field.encode_name: (field.name, msgspec.inspect.type_info(field.type))
            for field in msgspec.structs.fields(message)
        }
    return known


def _annotated(value: Any, kind: Any, lenient: bool) -> Any:
    """``value`` for a field of a message class, by the field's annotation."""
    match kind:
        case msgspec.inspect.BoolType():
            return to_flag(as_flag(value) if lenient else value)
        case msgspec.inspect.StrType():
            return to_text(as_text(value) if lenient else value)
        case msgspec.inspect.IntType():
            to_integer = (_UNSIGNED if kind.ge == 0 else _SIGNED)[kind.le]
            return to_integer(as_whole(value) if lenient else value)
        case msgspec.inspect.FloatType():
            return to_float64(as_number(value) if lenient else value)
        case msgspec.inspect.ListType():
            least = kind.min_length or 0
            return to_array(
                value,
                lambda item: _annotated(item, kind.item_type, lenient),
                kind.max_length,
                least,
            )
        case msgspec.inspect.StructType(cls=inner):
            return to_message(value, inner, lenient)
    raise AssertionError(kind)
