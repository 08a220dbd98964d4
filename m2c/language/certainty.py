"""What is certain of an expression's value before it is evaluated.

``m2c.language.typing`` says what an expression is meant to be; this module says what it can be at run time:
an element may be out of range (undefined), ``0 / 0`` is NaN, ``-n`` of 0 is the double -0. From that
follows where Python's own operators mean the same as ECMAScript's, which assignments may leave the
range of their type, and which may fail. It is interval analysis (Cousot and Cousot, *Abstract
interpretation*, POPL 1977): each operator has a counterpart on intervals.
"""

from __future__ import annotations

import enum
import math

import msgspec

from m2c.language.conversion import MAX_LENGTH, STATUSES
from m2c.language.datatypes import (
    ANY,
    BOOL,
    FLOAT64,
    INT64,
    INTEGER_RANGES,
    NULL,
    NUMBER,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
    is_integer,
    is_number,
    is_scalar,
    only_array,
    part,
)
from m2c.language.expressions import (
    ArrayFrom,
    ArrayLiteral,
    Binary,
    Conditional,
    EventData,
    Expression,
    Index,
    Literal,
    Logical,
    MathCall,
    MathConstant,
    Member,
    ObjectLiteral,
    Parameter,
    PortInput,
    Unary,
    Variable,
    children,
)
from m2c.language.operators import BINARY, PREFIX, Interval
from m2c.language.typing import Scope, array_length

EXACT = 2**53
"""Up to here a double holds every whole number, so that Python's ints compute what ECMAScript does."""
_FINITE = 1e300
"""A bound below which rounding cannot make a result infinite."""
_LONGEST = 2**32
"""No string or array is longer (ECMA-262 6.1.7: an array index is less than 2**32 - 1)."""
_PORT = 2**64
"""What an integer port is given may leave the port's type; it is converted where it is used."""


class Certain(msgspec.Struct, frozen=True):
    """What is certain of a value.

    Attributes:
        kind: its type. ``int64`` stands for any Python int, ``float64`` (or ``float32``, in a place of that
            type) for a Python float, ``number`` for one of the two; ``any``: nothing is certain.
        low: the least that a number can be; None if it may be infinite or NaN. Of a text: its length, if
            that is known.
        high: the most.
        whole: whether it is a whole number (perhaps -0, perhaps as a float).
        grows: whether it is a text made of two of unknown length.
    """

    kind: DataType = ANY
    low: float | None = None
    high: float | None = None
    whole: bool = False
    grows: bool = False

    @property
    def is_int(self) -> bool:
        """Whether it is a Python int, with known bounds."""
        return is_integer(self.kind) and self.low is not None

    @property
    def bounds(self) -> Interval | None:
        """Least and most, if it is a number and finite."""
        if self.low is None or self.high is None or not is_number(self.kind):
            return None
        return self.low, self.high


class Fit(enum.IntEnum):
    """How a value goes to a typed place."""

    AS_IS = 0
    """It is of that type already."""
    CONVERTED = 1
    """It becomes one of that type: wrapped, rounded, or an int made a float. This never fails."""
    MAY_FAIL = 2
    """It may be something that the place does not take."""


class Certainty:
    """Says what is certain of the expressions at one place of a model.

    Args:
        scope: what names mean there.
    """

    def __init__(self, scope: Scope) -> None:
        self._scope = scope
        self._known: dict[int, tuple[Expression, Certain]] = {}

    def of(self, node: Expression) -> Certain:
        """What is certain of the value of ``node``."""
        known = self._known.get(id(node))
        if known is None:
            known = self._known[id(node)] = (node, self._of(node))
        return known[1]

    def may_throw(self, node: Expression) -> bool:
        """Whether evaluating ``node`` may fail: access to parts of undefined does, and a length too great."""
        match node:
            case Variable(name=name):
                return name not in self._scope.variables and name not in STATUSES
            case Member(object=inner) | Index(object=inner):
                if self.may_be_undefined(inner):
                    return True
            case ArrayFrom() if self.lengths(node) is None:
                return True
        return any(map(self.may_throw, children(node)))

    def may_be_undefined(self, node: Expression) -> bool:
        """Whether the value of ``node`` may have no parts."""
        return self.of(node).kind in (ANY, NULL)

    def lengths(self, node: ArrayFrom) -> tuple[int, int] | None:
        """The fewest and the most elements that ``node`` has; None: not even that it can be made."""
        count = array_length(node)
        if count is not None:
            return (int(count), int(count)) if count <= node.most else None
        length = self.of(node.length)
        if not length.is_int or length.high is None or length.high > node.most:
            return None
        return max(int(length.low or 0), 0), max(int(length.high), 0)

    def fit(self, node: Expression, target: DataType) -> Fit:
        """How the value of ``node`` goes to a place of type ``target``."""
        match node:
            case Conditional(then=then, otherwise=otherwise):
                return max(self.fit(then, target), self.fit(otherwise, target))
            case ArrayLiteral(elements=elements) if isinstance(target, Array):
                if not elements:
                    return Fit.AS_IS if target.fixed or target.length is None else Fit.CONVERTED
                least = target.length or 0 if target.fixed else 0
                if not least <= len(elements) <= (target.length or len(elements)):
                    return Fit.MAY_FAIL
                return max(self.fit(element, target.element) for element in elements)
            case ArrayFrom(item=item) if isinstance(target, Array):
                lengths = self.lengths(node)
                least = target.length or 0 if target.fixed else 0
                most = MAX_LENGTH if target.length is None else target.length
                if lengths is None or not least <= lengths[0] <= lengths[1] <= most:
                    return Fit.MAY_FAIL
                return self.fit(item, target.element)
            case ObjectLiteral(entries=entries) if isinstance(target, Structure) and target.name:
                fields = [(target.field(key), value) for key, value in entries]
                fits = [
                    Fit.MAY_FAIL if kind is None else self.fit(value, kind)
                    for kind, value in fields
                ]
                return max(fits, default=Fit.AS_IS)
            case ObjectLiteral() if isinstance(target, Structure):
                return Fit.AS_IS
            case ArrayLiteral() | ArrayFrom() | ObjectLiteral() if target == ANY:
                return Fit.AS_IS
        value = self.of(node)
        how = fit(value, target)
        if how is Fit.MAY_FAIL and self._scope.lenient and is_scalar(value.kind):
            # a number, string or bool becomes any other of them; a text may be too long, too
            never_fails = is_scalar(target) and not (value.kind == target == STRING)
            return Fit.CONVERTED if never_fails else how
        return how

    # -- one form after the other ---------------------------------------------------------------

    def _of(self, node: Expression) -> Certain:
        match node:
            case Literal(value=value):
                return _literal(value)
            case Variable(name=name):
                if name not in self._scope.variables and name in STATUSES:
                    return Certain(STRING)
                return _held(self._scope.variables.get(name, ANY))
            case EventData(part=part):
                return _held(self._scope.event.get(part, ANY))
            case PortInput(key=key):
                kind = self._scope.ports.get(key, ANY)
                return Certain(INT64, -_PORT, _PORT, True) if is_integer(kind) else _port(kind)
            case Member(object=inner, name=name):
                return _member(self.of(inner).kind, name)
            case Index(object=inner, index=index):
                return _element(self.of(inner).kind, self.of(index))
            case Unary(operator=operator, operand=operand):
                return _unary(operator, self.of(operand))
            case Binary(operator=operator, left=left, right=right):
                return _binary(operator, self.of(left), self.of(right))
            case Logical(left=left, right=right):
                return _either(self.of(left), self.of(right))
            case Conditional(then=then, otherwise=otherwise):
                return _either(self.of(then), self.of(otherwise))
            case MathCall(function=function, arguments=arguments):
                return _math(function, [self.of(argument) for argument in arguments])
            case MathConstant():
                return Certain(FLOAT64, 0.0, 10.0)
            case Parameter():
                return Certain(INT64, 0, MAX_LENGTH - 1, True)
            case ArrayLiteral() | ArrayFrom():
                return Certain(Array(ANY))
            case ObjectLiteral():
                return Certain(Structure("", ()))


def fit(value: Certain, target: DataType) -> Fit:
    """How ``value`` goes to a place of type ``target``."""
    kind = value.kind
    match target:
        case Primitive(name) if name in INTEGER_RANGES:
            low, high = INTEGER_RANGES[name]
            if value.low is None or value.high is None or not value.whole:
                return Fit.MAY_FAIL
            inside = is_integer(kind) and low <= value.low and value.high <= high
            return Fit.AS_IS if inside else Fit.CONVERTED
        case Primitive("float32" | "float64"):
            if kind == target:
                return Fit.AS_IS
            return Fit.CONVERTED if is_number(kind) else Fit.MAY_FAIL
        case Primitive("number"):
            return Fit.AS_IS if is_number(kind) else Fit.MAY_FAIL
        case Primitive("string"):
            return Fit.AS_IS if kind == STRING and not value.grows else Fit.MAY_FAIL
        case Primitive("any" | "null"):
            if value.grows:
                return Fit.MAY_FAIL
            return Fit.MAY_FAIL if _is_open(kind) else Fit.AS_IS
        case Array(element, length, fixed):
            if not isinstance(kind, Array):
                return Fit.MAY_FAIL
            least = (kind.length or 0) if kind.fixed else 0
            most = math.inf if kind.length is None else kind.length
            if most > (length or math.inf) or (fixed and least != length):
                return Fit.MAY_FAIL
            return fit(_held(kind.element), element)
        case Structure(""):
            return Fit.MAY_FAIL if _is_open(kind) or not isinstance(kind, Structure) else Fit.AS_IS
        case _:
            return Fit.AS_IS if kind == target else Fit.MAY_FAIL


def _is_open(kind: DataType) -> bool:
    """Whether values of ``kind`` may be nested without end."""
    return (
        kind == ANY
        or (isinstance(kind, Array) and _is_open(kind.element))
        or (isinstance(kind, Structure) and not kind.name)
    )


def _literal(value: bool | int | float | str | None) -> Certain:
    match value:
        case None:
            return Certain(NULL)
        case bool():
            return Certain(BOOL)
        case str():
            return Certain(STRING, 0, len(value))
        case int():
            return Certain(INT64, value, value, True)
        case float():
            return _float(value, value, value.is_integer())


def _float(low: float, high: float, whole: bool = False) -> Certain:
    return _number(FLOAT64, low, high, whole)


def _number(kind: DataType, low: float, high: float, whole: bool) -> Certain:
    """A number between ``low`` and ``high``, or any at all if these are too large."""
    if not (-_FINITE < low <= high < _FINITE):
        return Certain(kind)
    return Certain(kind, low, high, whole)


def _held(kind: DataType) -> Certain:
    """What a typed place holds."""
    if isinstance(kind, Primitive) and kind.name in INTEGER_RANGES:
        low, high = INTEGER_RANGES[kind.name]
        return Certain(INT64, low, high, True)
    return Certain(kind)


def _port(kind: DataType) -> Certain:
    if kind in (BOOL, STRING):
        return Certain(kind)
    return Certain(FLOAT64 if is_number(kind) else ANY)


def _member(kind: DataType, name: str) -> Certain:
    if isinstance(kind, Structure) and kind.name:
        found = kind.field(name)
        if found is not None:
            return _held(found)
        constant = next((value for key, _, value in kind.constants if key == name), None)
        return Certain() if constant is None else _literal(constant)
    length_of = only_array(kind) if name == "length" else None
    if length_of is not None and isinstance(kind, Structure):
        return _member(kind.field(length_of) or ANY, name)
    column = part(kind, name) if isinstance(kind, Array) and name != "length" else None
    if column is not None:
        return Certain(column)
    if name == "length" and (isinstance(kind, Array) or kind == STRING):
        most = kind.length if isinstance(kind, Array) and kind.length is not None else _LONGEST
        least = most if isinstance(kind, Array) and kind.fixed else 0
        return Certain(INT64, least, most, True)
    return Certain()


def _element(kind: DataType, index: Certain) -> Certain:
    """An element may be out of range, unless the length is fixed and the index is within it."""
    bounds = index.bounds
    if not isinstance(kind, Array) or not kind.fixed or bounds is None or not index.is_int:
        return Certain()
    return _held(kind.element) if bounds[0] >= 0 and bounds[1] < (kind.length or 0) else Certain()


def _unary(operator: str, value: Certain) -> Certain:
    result = PREFIX[operator].result
    if result is not None:
        return Certain(result)
    if operator == "+":
        return value if is_number(value.kind) else Certain(NUMBER)
    bounds = value.bounds
    if bounds is None:
        return Certain(FLOAT64 if is_float(value) else NUMBER)
    never_zero = bounds[0] > 0 or bounds[1] < 0
    kind = INT64 if value.is_int and never_zero else FLOAT64 if is_float(value) else NUMBER
    return Certain(kind, -bounds[1], -bounds[0], value.whole)


def is_float(value: Certain) -> bool:
    """Whether ``value`` is a Python float."""
    return isinstance(value.kind, Primitive) and value.kind.name in ("float32", "float64")


def _binary(operator: str, left: Certain, right: Certain) -> Certain:
    row = BINARY[operator]
    if row.is_comparison:
        return Certain(BOOL)
    if operator == "+" and STRING in (left.kind, right.kind):
        return Certain(STRING, grows=_is_long(left) and _is_long(right))
    if operator == "**":
        return Certain(FLOAT64)
    numbers = is_number(left.kind) and is_number(right.kind)
    if operator == "+" and not numbers:
        return Certain()
    if operator == "/":
        return _quotient(left, right)
    floats = numbers and (is_float(left) or is_float(right))
    kind = FLOAT64 if floats else NUMBER
    first, second = left.bounds, right.bounds
    if first is None or second is None:
        return Certain(kind)
    whole = left.whole and right.whole
    if operator == "%":
        return _rest(left, right, first, second, kind)
    if row.interval is None:
        return Certain(kind)
    low, high = row.interval(first, second)
    if is_native(operator, left, right) and not floats:
        kind = INT64
    return _number(kind, low, high, whole)


def _is_long(value: Certain) -> bool:
    """Whether the text of ``value`` may have any length."""
    return value.low is None and not is_number(value.kind) and value.kind not in (BOOL, NULL)


def is_native(operator: str, left: Certain, right: Certain) -> bool:
    """Whether Python's operator gives what ECMAScript's does, for numbers.

    That is so for floats; for ints if the result is exact as a double and not -0.
    """
    if not (is_number(left.kind) and is_number(right.kind)):
        return False
    if operator in ("+", "-", "*") and (is_float(left) or is_float(right)):
        return all(is_float(side) or _is_small(side) for side in (left, right))
    first, second = left.bounds, right.bounds
    if first is None or second is None or not (left.is_int and right.is_int):
        return False
    if not (_is_small(left) and _is_small(right)):
        return False
    if operator == "%":
        return first[0] >= 0 and second[0] > 0
    interval = BINARY[operator].interval
    if interval is None:
        return False
    low, high = interval(first, second)
    if operator == "*" and (_is_minus_zero(first, second) or _is_minus_zero(second, first)):
        return False
    return low >= -EXACT and high <= EXACT


def _is_minus_zero(zero: Interval, other: Interval) -> bool:
    """Whether a product may be of 0 and a negative number."""
    return zero[0] <= 0 <= zero[1] and other[0] < 0


def _is_small(value: Certain) -> bool:
    bounds = value.bounds
    return value.is_int and bounds is not None and bounds[0] >= -EXACT and bounds[1] <= EXACT


def _quotient(left: Certain, right: Certain) -> Certain:
    first, second = left.bounds, right.bounds
    if first is None or second is None or second[0] <= 0 <= second[1]:
        return Certain(FLOAT64)
    corners = [float(a) / float(b) for a in first for b in second]
    return _float(min(corners), max(corners))


def _rest(
    left: Certain,
    right: Certain,
    first: Interval,
    second: Interval,
    kind: DataType,
) -> Certain:
    """``%``: smaller than the divisor, with the dividend's sign; NaN if the divisor may be 0."""
    if second[0] <= 0 <= second[1]:
        return Certain(kind)
    most = max(abs(second[0]), abs(second[1]))
    if left.whole and right.whole:
        most -= 1
    low = max(first[0], -most) if first[0] < 0 else 0
    high = min(first[1], most) if first[1] > 0 else 0
    native = is_native("%", left, right)
    return Certain(INT64 if native else kind, low, high, left.whole and right.whole)


def _either(first: Certain, second: Certain) -> Certain:
    """One of two values."""
    kind: DataType
    if first.kind == second.kind:
        kind = first.kind
    elif is_number(first.kind) and is_number(second.kind):
        kind = NUMBER
    else:
        return Certain()
    one, other = first.bounds, second.bounds
    if one is None or other is None:
        return Certain(kind, grows=first.grows or second.grows)
    whole = first.whole and second.whole
    return Certain(kind, min(one[0], other[0]), max(one[1], other[1]), whole)


def _math(function: str, values: list[Certain]) -> Certain:
    if function == "random":
        return Certain(FLOAT64, 0.0, 1.0)
    if function in ("floor", "ceil", "trunc", "round", "sign", "abs", "min", "max"):
        return _simple_math(function, values)
    return Certain(FLOAT64)


def _simple_math(function: str, values: list[Certain]) -> Certain:
    """Functions whose result is their argument, or near it."""
    bounds = [value.bounds for value in values]
    known = [bound for bound in bounds if bound is not None]
    ints = bool(values) and all(value.is_int for value in values)
    floats = all(is_float(value) for value in values)
    if function in ("abs", "min", "max"):
        kind = INT64 if ints else FLOAT64 if floats else NUMBER
    else:
        kind = INT64 if ints else NUMBER
    if len(known) < len(bounds) or not known:
        return Certain(kind if function in ("abs", "min", "max") else NUMBER)
    whole = all(value.whole for value in values)
    low, high = known[0]
    match function:
        case "min":
            return Certain(kind, min(b[0] for b in known), min(b[1] for b in known), whole)
        case "max":
            return Certain(kind, max(b[0] for b in known), max(b[1] for b in known), whole)
        case "abs":
            least = 0 if low <= 0 <= high else min(abs(low), abs(high))
            return Certain(kind, least, max(abs(low), abs(high)), whole)
        case "sign":
            return Certain(kind, -1, 1, True)
        case "ceil":
            return Certain(kind, math.ceil(low), math.ceil(high), True)
        case "floor":
            return Certain(kind, math.floor(low), math.floor(high), True)
        case _:
            return Certain(kind, math.floor(low), math.ceil(high), True)
