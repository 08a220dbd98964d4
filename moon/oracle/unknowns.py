"""Values of which only a range is known: random draws, and data from before the oracle looked.

A condition on such a value can go either way, and the oracle follows both (design, section 6:
"random choice: every outcome"). Ranges are intervals; what interval arithmetic cannot express is
``ANYTHING``, which over-approximates: it can hide a fault, never invent one.
"""

from __future__ import annotations

import copy
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from m2c.language import ecmascript
from m2c.language.conversion import Convert, to_float32
from m2c.language.datatypes import INTEGER_RANGES, Array, DataType, Primitive, Structure
from moon.wording import number_text

SCALARS = frozenset({int, float, str, bool, type(None)})
"""Of these, a value is its own key."""

_WHOLE_TYPES = frozenset(
    (float(low), float(high)) for low, high in INTEGER_RANGES.values() if high - low >= 2**64 - 1
)
"""Ranges of types that no model narrows to by chance: nothing is known of such a number. As floating-point
numbers, which an end is where this is compiled.
"""


class Unknown:
    """A number between ``low`` and ``high`` (both included), or anything at all.

    Compared by identity: the same object is the same unknown value. ``options``: it is one of these scalars
    or ranges (what is calculated with it knows only the range that they are in); empty: no more is known.
    """

    __slots__ = ("_shape", "anything", "high", "integer", "low", "options")

    def __init__(
        self,
        low: float = -math.inf,
        high: float = math.inf,
        integer: bool = False,
        anything: bool = False,
        options: tuple[Any, ...] = (),
    ) -> None:
        self.low = low
        self.high = high
        self.integer = integer
        self.anything = anything
        self.options = options
        self._shape: tuple[Any, ...] | None = None

    def __repr__(self) -> str:
        if self.options:
            return " or ".join(_option(option) for option in self.options)
        ends = (float(self.low), float(self.high))
        if self.anything or ends in _WHOLE_TYPES or not any(map(math.isfinite, ends)):
            return "?"
        return f"{_end(self.low)}…{_end(self.high)}"

    def __deepcopy__(self, memo: dict[int, Any]) -> Unknown:
        """In a copy, too, it is the same unknown value."""
        return self

    def copy(self) -> Unknown:
        """Another value of which as much is known."""
        return Unknown(self.low, self.high, self.integer, self.anything, self.options)

    def shape(self) -> tuple[Any, ...]:
        """What two unknown values must share to be treated alike."""
        if self._shape is None:
            options = tuple([frozen(option, {}) for option in self.options])
            self._shape = ("?", self.low, self.high, self.integer, self.anything, options)
        return self._shape

    def allows(self, value: Any) -> bool:
        """Whether this value may turn out to be ``value``."""
        if self.options:
            return any(_is(option, value) for option in self.options)
        if self.anything:
            return True
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        whole = not self.integer or float(value).is_integer()
        return self.low <= value <= self.high and whole


def _end(bound: float) -> str:
    """An end of a range, for people."""
    return number_text(float(bound)) if math.isfinite(bound) else f"{bound:g}"


def _option(option: Any) -> str:
    """One of the values that something can be, for people."""
    if isinstance(option, float | int) and not isinstance(option, bool):
        return _end(option)
    return repr(option) if isinstance(option, str | Unknown) else str(option).lower()


def _is(option: Any, value: Any) -> bool:
    """Whether what is known to be ``option`` can be ``value``."""
    if option.__class__ is Unknown:
        return bool(option.allows(value))
    if isinstance(option, bool) or isinstance(value, bool):
        return option is value
    return bool(option == value or (option != option and value != value))  # noqa: PLR0124 - NaN


def anything() -> Unknown:
    """A fresh value of which nothing is known."""
    return Unknown(anything=True)


def unknown_of(kind: DataType | None) -> Any:
    """A fresh value of type ``kind`` of which nothing else is known."""
    match kind:
        case Primitive(name) if name in INTEGER_RANGES:
            return Unknown(*INTEGER_RANGES[name], integer=True)
        case Structure() if kind.fields:
            return {name: unknown_of(inner) for name, inner in kind.fields}
        case _:
            return anything()


def length() -> Unknown:
    """How many elements an array has of which nothing is known."""
    return Unknown(0, 2**32 - 1, integer=True)


def is_unknown(value: Any) -> bool:
    """Whether ``value`` is, or contains, something unknown."""
    if isinstance(value, Unknown):
        return True
    if isinstance(value, list | tuple):
        return any(is_unknown(item) for item in value)
    if isinstance(value, dict):
        return any(is_unknown(item) for item in value.values())
    return False


def is_whole(value: Any, target: DataType) -> bool:
    """Whether ``value`` goes to a place of type ``target`` for sure: a whole number, into an integer."""
    is_integer = isinstance(target, Primitive) and target.name in INTEGER_RANGES
    return is_integer and isinstance(value, Unknown) and value.integer and not value.anything


def tolerant(kind: DataType, convert: Convert, lenient: bool = False) -> Convert:
    """``convert``, the conversion to ``kind``, for values that may be unknown.

    ``lenient``: whether strings, numbers and bools become one another.
    """

    def place(value: Any) -> Any:
        if value.__class__ is not Unknown:
            return convert(value)
        fitting = []
        for option in value.options:
            try:
                fitting.append(place(option))
            except ecmascript.ExecutionError:
                continue  # whether the value fits was asked before
        return one_of(fitting) if fitting else _in_place(value, kind, lenient)

    return place


def _in_place(value: Unknown, kind: DataType, lenient: bool) -> Unknown:
    """What is known of ``value`` once a place of type ``kind`` has taken it."""
    match kind:
        case Primitive(name) if name in INTEGER_RANGES:
            low, high = INTEGER_RANGES[name]
            if value.anything or not (low <= value.low and value.high <= high):
                return Unknown(low, high, integer=True)  # it may have wrapped
            if value.integer:
                return value
            if lenient:
                return Unknown(math.trunc(value.low), math.trunc(value.high), integer=True)
            return Unknown(math.ceil(value.low), math.floor(value.high), integer=True)
        case Primitive("bool" | "string") if lenient:
            return anything()  # not that value: what it becomes
        case Primitive("float32" | "float64" | "number") if lenient and value.anything:
            return anything()
        case Primitive("float32") if value.anything:
            return anything()  # rounded: not that value
        case Primitive("float32"):
            return Unknown(to_float32(value.low), to_float32(value.high))
        case _:
            return value


def _bounds(value: Any) -> tuple[float, float, bool] | None:
    """Least, most, whole; None if ``value`` may be no number."""
    if isinstance(value, Unknown):
        return None if value.anything else (value.low, value.high, value.integer)
    if isinstance(value, bool) or not isinstance(value, int | float) or value != value:  # noqa: PLR0124
        return None
    return value, value, isinstance(value, int)


def arithmetic(operator: str, exact: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """``exact``, extended to unknown operands."""

    def operate(left: Any, right: Any) -> Any:
        if left.__class__ is not Unknown and right.__class__ is not Unknown:
            return exact(left, right)
        first, second = _bounds(left), _bounds(right)
        if first is None or second is None:
            return anything()
        whole = first[2] and second[2]
        match operator:
            case "+":
                return Unknown(first[0] + second[0], first[1] + second[1], whole)
            case "-":
                return Unknown(first[0] - second[1], first[1] - second[0], whole)
            case "*":
                products = [a * b for a in first[:2] for b in second[:2]]
                if any(product != product for product in products):  # noqa: PLR0124 - 0 * infinity
                    return Unknown(integer=whole)
                return Unknown(min(products), max(products), whole)
            case "/" if second[0] == second[1] != 0:
                quotients = [first[0] / second[0], first[1] / second[0]]
                return Unknown(min(quotients), max(quotients))
            case "%" if second[0] == second[1] and math.isfinite(second[0]) and second[0] != 0:
                limit = abs(second[0])
                if -limit < first[0] and first[1] < limit:
                    return Unknown(first[0], first[1], whole)
                most = limit - 1 if whole else limit
                return Unknown(0 if first[0] >= 0 else -most, most if first[1] > 0 else 0, whole)
            case _:
                return anything()

    return operate


def type_name(value: Any) -> Any:
    """``typeof``: of a range it is ``number``; of what may be anything, it may be any."""
    if value.__class__ is not Unknown:
        return ecmascript.type_name(value)
    return anything() if value.anything else "number"


def negate(value: Any) -> Any:
    """Unary minus."""
    if value.__class__ is not Unknown:
        return ecmascript.negate(value)
    if value.anything:
        return anything()
    return Unknown(-value.high, -value.low, value.integer)


def to_number(value: Any) -> Any:
    """Unary plus."""
    return value if value.__class__ is Unknown else ecmascript.to_number(value)


def mathematics(name: str, exact: Callable[..., Any]) -> Callable[..., Any]:
    """The function ``Math.<name>``, extended to unknown arguments."""
    rounding: dict[str, Callable[[float], float]] = {
        "floor": math.floor,
        "ceil": math.ceil,
        "trunc": math.trunc,
    }

    def rounded(number: float) -> float:
        if not math.isfinite(number):
            return number
        return rounding[name](number) if name in rounding else math.floor(number + 0.5)

    def call(*arguments: Any) -> Any:
        if not any(argument.__class__ is Unknown for argument in arguments):
            return exact(*arguments)
        bounds = [_bounds(argument) for argument in arguments]
        known = [bound for bound in bounds if bound is not None]
        if len(known) < len(bounds) or not known:
            return anything()
        if name in ("floor", "ceil", "trunc", "round"):
            low, high = rounded(known[0][0]), rounded(known[0][1])
            return Unknown(low, high, True)
        whole = all(bound[2] for bound in known)
        if name == "min":
            return Unknown(min(b[0] for b in known), min(b[1] for b in known), whole)
        if name == "max":
            return Unknown(max(b[0] for b in known), max(b[1] for b in known), whole)
        if name == "abs":
            low, high, _ = known[0]
            least = 0 if low <= 0 <= high else min(abs(low), abs(high))
            return Unknown(least, max(abs(low), abs(high)), whole)
        return anything()

    return call


def draw() -> Unknown:
    """``Math.random()``: 0 ≤ x < 1."""
    return Unknown(0.0, math.nextafter(1.0, 0.0))


def compare(operator: str, left: Any, right: Any) -> bool | None:
    """``left operator right`` for ``< <= > >=``; None if it can go either way."""
    first, second = _bounds(left), _bounds(right)
    if first is None or second is None:
        return None
    if operator in (">", ">="):
        first, second = second, first
        operator = "<" if operator == ">" else "<="
    if operator == "<":
        if first[1] < second[0]:
            return True
        return False if first[0] >= second[1] else None
    if first[1] <= second[0]:
        return True
    return False if first[0] > second[1] else None


def narrowed(value: Unknown, operator: str, bound: float, holds: bool) -> Any:
    """``value`` once ``value operator bound`` is known to hold, or not to hold."""
    if value.options:
        left = [item for item in value.options if compare(operator, item, bound) is not (not holds)]
        narrow = [
            narrowed(item, operator, bound, holds) if item.__class__ is Unknown else item
            for item in left
        ]
        return one_of(narrow) if narrow else value
    if not holds:
        operator = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}[operator]
    low, high = value.low, value.high
    if not math.isfinite(bound):
        return value  # nothing is learnt from a comparison with an infinity
    if operator in ("<", "<="):
        most = math.ceil(bound) - 1 if value.integer and operator == "<" else bound
        high = min(high, most)
    else:
        least = math.floor(bound) + 1 if value.integer and operator == ">" else bound
        low = max(low, least)
    return Unknown(low, high, value.integer)


# --- several as one -------------------------------------------------------------------------------


def one_of(values: Sequence[Any]) -> Any:
    """What can be any of ``values``, of which there is one at least: structures and arrays part by part."""
    first = values[0]
    if len(values) == 1:
        return first
    if all(value.__class__ is dict and value.keys() == first.keys() for value in values):
        return {name: one_of([value[name] for value in values]) for name in first}
    if all(value.__class__ is list and len(value) == len(first) for value in values):
        return [one_of(items) for items in zip(*values, strict=True)]
    flat = [option for value in values for option in _options(value)]
    if not all(option.__class__ in SCALARS or option.__class__ is Unknown for option in flat):
        return anything()
    # of two ranges that look alike one will do; -0 is not 0, and true is not 1
    told = {(option.__class__, repr(frozen(option, {}))): option for option in flat}
    options = tuple(told.values())
    if len(options) == 1:
        return options[0]
    bounds = [_bounds(option) for option in options]
    known = [bound for bound in bounds if bound is not None]
    if len(known) < len(bounds):
        return Unknown(anything=True, options=options)
    low, high = min(bound[0] for bound in known), max(bound[1] for bound in known)
    return Unknown(low, high, all(bound[2] for bound in known), options=options)


def _options(value: Any) -> tuple[Any, ...]:
    """What ``value`` can be: itself, if it is not one of several."""
    return (value.options or (value,)) if value.__class__ is Unknown else (value,)


def another(value: Any) -> Any:
    """A value that may be what ``value`` may be, and shares nothing with it."""
    return unshared(copy.deepcopy(value), set(), anew=True)


def covers(value: Any, other: Any) -> bool:
    """Whether ``value`` is ``other``, or unknown and may be whatever ``other`` may be."""
    if value.__class__ is Unknown and value.options:
        return all(any(covers(mine, its) for mine in value.options) for its in _options(other))
    if value.__class__ is Unknown:
        if other.__class__ is not Unknown:
            return bool(value.allows(other)) and (value.anything or not is_unknown(other))
        if value.anything or other.anything:
            return bool(value.anything)
        is_within = value.low <= other.low and other.high <= value.high
        return is_within and (other.integer or not value.integer)
    if value.__class__ is not other.__class__ or is_unknown(value) or is_unknown(other):
        return False
    return repr(value) == repr(other)  # -0 is not 0, and NaN is itself


def like(top: Any) -> Any:
    """An unknown value that may be what ``top`` may be, and is no other's; anything for None."""
    return anything() if top is None else unshared(top, set(), anew=True)


def unshared(value: Any, seen: set[int], anew: bool = False) -> Any:
    """``value``, in which no unknown value is one of ``seen``, to which its own are added.

    ``anew``: nor is any the one that it was before.
    """
    if value.__class__ in SCALARS:
        return value
    if value.__class__ is Unknown:
        if anew or id(value) in seen:
            value = value.copy()
        seen.add(id(value))
        return value
    if not is_unknown(value):
        return value
    if value.__class__ is dict:
        items = {name: unshared(item, seen, anew) for name, item in value.items()}
        return value if all(items[name] is value[name] for name in items) else items
    elements = [unshared(item, seen, anew) for item in value]
    is_same = all(mine is its for mine, its in zip(elements, value, strict=True))
    return value if is_same else elements


# --- as keys, and beside what was observed --------------------------------------------------------


def frozen(value: Any, numbers: dict[int, int]) -> Any:
    """``value`` as something that can be compared and hashed.

    Unknown values are known by their shape and by which of them are the same.

    Args:
        value: of a model.
        numbers: those of the unknown values that were met before, by identity; new ones are added.
    """
    kind = value.__class__
    if kind in SCALARS:
        return value if kind is not float or value else repr(value)  # of 0.0 and -0.0 all differs
    if kind is Unknown:
        return (value.shape(), numbers.setdefault(id(value), len(numbers)))
    if kind is dict:
        return tuple([(name, frozen(item, numbers)) for name, item in value.items()])
    if kind is list or kind is tuple:
        return tuple([frozen(item, numbers) for item in value])
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


def filled_in(value: Any, found: Mapping[int, tuple[Unknown, Any]]) -> Any:
    """``value`` with what was ``found`` (by identity) in place of its unknown values."""
    if value.__class__ in SCALARS:
        return value
    if isinstance(value, Unknown):
        return found[id(value)][1] if id(value) in found else value
    if not is_unknown(value):
        return value
    if isinstance(value, dict):
        return {name: filled_in(item, found) for name, item in value.items()}
    if isinstance(value, list):
        return [filled_in(item, found) for item in value]
    return value


def unknowns_in(value: Any, found: dict[int, Unknown]) -> None:
    """Collect the unknown values in ``value``, in the order in which ``frozen`` numbers them."""
    if value.__class__ is Unknown:
        found.setdefault(id(value), value)
    elif value.__class__ is dict:
        for item in value.values():
            unknowns_in(item, found)
    elif isinstance(value, list | tuple):
        for item in value:
            unknowns_in(item, found)


def renamed(value: Any, found: dict[int, tuple[Unknown, Any]]) -> Any:
    """``value`` with what is in ``found`` in place of its unknown values; of others, each is one anew."""
    if value.__class__ in SCALARS:
        return value
    if value.__class__ is Unknown:
        if id(value) not in found:
            found[id(value)] = (value, value.copy())
        return found[id(value)][1]
    if value.__class__ is dict:
        return {name: renamed(item, found) for name, item in value.items()}
    if value.__class__ is list:
        return [renamed(item, found) for item in value]
    return value
