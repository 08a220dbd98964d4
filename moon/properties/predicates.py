"""Predicates to Python: strict, so that a strange value never turns into a verdict.

The expression language is the models', but where a model would convert, a monitor must not guess:
comparing a number with a string, a NaN, a field that is not there or contents that are not known make
the predicate *unknown* (:class:`UnknownValue`), not true or false.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from m2c.model.evaluate import OPERATORS, UNARY_OPERATORS, evaluate
from m2c.model.expression_text import expression_text
from m2c.model.expressions import (
    ArrayLiteral,
    Binary,
    Conditional,
    Expression,
    Index,
    Literal,
    Logical,
    MathCall,
    MathConstant,
    Member,
    Unary,
    Variable,
)
from m2c.runtime import ecmascript


class UnknownValue(Exception):
    """A predicate has no value here; the text says why."""


class PredicateError(ValueError):
    """An expression that cannot be a predicate."""


def expression_source(expression: Expression, names: dict[str, str]) -> str:
    """Python source of ``expression``; ``names`` are the Python names of its variables.

    The source uses the names of :data:`ENVIRONMENT`.

    Raises:
        PredicateError: it uses something that only a model has, randomness, or an unknown variable.
    """
    return _Source(names).value(expression)


def truth_source(expression: Expression, names: dict[str, str]) -> str:
    """Like :func:`expression_source`, for a place where a boolean is needed."""
    return _Source(names).truth(expression)


_COMPARE = {"<": "less", "<=": "at_most", ">": "more", ">=": "at_least"}
_ALWAYS_BOOL = {"<", "<=", ">", ">=", "==", "!=", "===", "!=="}


class _Source:
    def __init__(self, names: dict[str, str]) -> None:
        self._names = names
        self._temporaries = 0

    def truth(self, expression: Expression) -> str:
        match expression:
            case Binary(operator=operator) if operator in _ALWAYS_BOOL:
                return self.value(expression)
            case Logical(operator=operator, left=left, right=right):
                word = "and" if operator == "&&" else "or"
                return f"({self.truth(left)} {word} {self.truth(right)})"
            case Unary(operator="!", operand=operand):
                return f"(not {self.truth(operand)})"
            case _:
                name = self._temporary()
                text = self.value(expression)
                return f"({name} if ({name} := {text}).__class__ is bool else truth({name}))"

    def value(self, expression: Expression) -> str:
        match expression:
            case Literal(value=value):
                return _literal(value)
            case Variable(name=name):
                if name not in self._names:
                    raise PredicateError(f"`{name}` is not declared")
                return self._names[name]
            case Member(object=Literal() | ArrayLiteral()):
                raise PredicateError(
                    f"`{expression_text(expression, json.dumps)}` has no value in a property"
                )
            case Member(object=inner, name=name):
                if name == "length":
                    return f"length({self.value(inner)})"
                return f"{self.value(inner)}[{name!r}]"
            case Index(object=inner, index=index):
                return f"element({self.value(inner)}, {self.value(index)})"
            case Unary(operator="!", operand=operand):
                return f"(not {self.truth(operand)})"
            case Unary(operator=operator, operand=operand):
                return f"unary({operator!r}, {self.value(operand)})"
            case Binary(operator=operator, left=left, right=right):
                return self._binary(operator, left, right)
            case Logical():
                return self.truth(expression)
            case Conditional(test=test, then=then, otherwise=otherwise):
                chosen = f"{self.value(then)} if {self.truth(test)} else {self.value(otherwise)}"
                return f"({chosen})"
            case MathCall(function="random"):
                raise PredicateError("Math.random() has no place in a property")
            case MathCall(function=function, arguments=arguments):
                inside = "".join(f"{self.value(argument)}, " for argument in arguments)
                return f"mathematics({function!r}, ({inside}))"
            case MathConstant():
                return repr(evaluate(expression, {}, {}))
            case ArrayLiteral(elements=elements):
                return f"[{', '.join(self.value(element) for element in elements)}]"
            case _:
                raise PredicateError(
                    f"`{expression_text(expression, json.dumps)}` has no value in a property"
                )

    def _binary(self, operator: str, left: Expression, right: Expression) -> str:
        first, second = self.value(left), self.value(right)
        if operator in _COMPARE:
            slow = _COMPARE[operator]
        elif operator in _ALWAYS_BOOL:
            slow = "same" if operator[0] == "=" else "different"
            operator = operator[:2]
        else:
            return f"arithmetic({operator!r}, {first}, {second})"
        # the common case in line: an integer against an integer literal
        if isinstance(right, Literal) and type(right.value) in (int, float):
            name = self._temporary()
            fast = f"{name} {operator} {second}"
            return f"({fast} if ({name} := {first}).__class__ is int else {slow}({name}, {second}))"
        return f"{slow}({first}, {second})"

    def _temporary(self) -> str:
        self._temporaries += 1
        return f"_{self._temporaries}"


def _literal(value: Any) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return f'float("{value}")'
    return repr(value)


def _kind(value: Any) -> str:
    match value:
        case bool():
            return "boolean"
        case int() | float():
            if value != value:  # noqa: PLR0124 - NaN differs from itself
                raise UnknownValue("the value is NaN")
            return "number"
        case str():
            return "string"
        case None:
            raise UnknownValue("the value is not known")
        case list() | tuple():
            return "array"
        case _:
            return "object"


def _alike(left: Any, right: Any, operation: str) -> str:
    first, second = _kind(left), _kind(right)
    if first != second:
        raise UnknownValue(f"`{operation}` of a {first} and a {second}")
    return first


def _ordered(left: Any, right: Any, operation: str) -> None:
    kind = _alike(left, right, operation)
    if kind not in ("number", "string"):
        raise UnknownValue(f"`{operation}` of a {kind}")


def less(left: Any, right: Any) -> bool:
    """``<`` of two numbers or two strings."""
    _ordered(left, right, "<")
    return bool(left < right)


def at_most(left: Any, right: Any) -> bool:
    """``<=`` of two numbers or two strings."""
    _ordered(left, right, "<=")
    return bool(left <= right)


def more(left: Any, right: Any) -> bool:
    """``>`` of two numbers or two strings."""
    _ordered(left, right, ">")
    return bool(left > right)


def at_least(left: Any, right: Any) -> bool:
    """``>=`` of two numbers or two strings."""
    _ordered(left, right, ">=")
    return bool(left >= right)


def same(left: Any, right: Any) -> bool:
    """``==`` of two values of one kind."""
    _alike(left, right, "==")
    return bool(left == right)


def different(left: Any, right: Any) -> bool:
    """``!=`` of two values of one kind."""
    _alike(left, right, "!=")
    return bool(left != right)


def truth(value: Any) -> bool:
    """A value where a boolean is needed: a number is true unless it is 0; nothing else converts."""
    match _kind(value):
        case "boolean" | "number":
            return bool(value)
        case kind:
            raise UnknownValue(f"a {kind} is neither true nor false")


def arithmetic(operator: str, left: Any, right: Any) -> Any:
    """``+ - * / % **`` of two numbers, ``+`` of two strings, with the models' results."""
    kind = _alike(left, right, operator)
    if kind != "number" and not (kind == "string" and operator == "+"):
        raise UnknownValue(f"`{operator}` of a {kind}")
    found = OPERATORS[operator](left, right)
    _kind(found)
    return found


def unary(operator: str, value: Any) -> Any:
    """``-``, ``+`` of a number; ``typeof``."""
    if operator != "typeof" and _kind(value) != "number":
        raise UnknownValue(f"`{operator}` of a {_kind(value)}")
    return UNARY_OPERATORS[operator](value)


def mathematics(function: str, arguments: tuple[Any, ...]) -> Any:
    """``Math.function(arguments)`` of numbers."""
    for argument in arguments:
        if _kind(argument) != "number":
            raise UnknownValue(f"`Math.{function}` of a {_kind(argument)}")
    found = ecmascript.MATH[function](*arguments)
    _kind(found)
    return found


def length(value: Any) -> Any:
    """``value.length``."""
    if isinstance(value, dict):
        return value["length"]
    return len(value)


def element(value: Any, index: Any) -> Any:
    """``value[index]``; out of range is unknown."""
    if isinstance(index, float) and index.is_integer():
        index = int(index)
    if isinstance(index, int) and (isinstance(index, bool) or index < 0):
        raise UnknownValue(f"there is no element {index}")
    return value[index]


ENVIRONMENT: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        *(less, at_most, more, at_least, same, different, truth),
        *(arithmetic, unary, mathematics, length, element),
    )
}
"""What compiled predicates call."""

UNKNOWN_ERRORS = (UnknownValue, KeyError, IndexError, TypeError, OverflowError, AttributeError)
"""What evaluating a predicate may raise; each means that it has no value."""


def why_unknown(error: BaseException) -> str:
    """One clause on why a predicate has no value."""
    match error:
        case UnknownValue():
            return str(error)
        case KeyError():
            return f"there is no field {error}"
        case IndexError():
            return "the index is out of range"
        case _:
            return f"the value has another shape ({error})"
