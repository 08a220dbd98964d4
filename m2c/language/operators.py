"""The operators of expressions, one row each: what all that walk expressions know of them.

The parser admits what is here, writers bracket by ``binding``, interpreters call ``apply``, generated code
calls ``function`` or uses ``python``, and the checks take ``result`` and ``interval`` from here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from m2c.language import ecmascript
from m2c.language.datatypes import BOOL, FLOAT64, STRING, DataType

Interval = tuple[float, float]
"""The least and the most that a number can be."""

CONDITIONAL, UNARY, POSTFIX, ATOM = 1, 10, 11, 12
"""How tightly ``?:``, unary operators, member access and single words bind: see ``Operator.binding``."""


class Operator(msgspec.Struct, frozen=True, kw_only=True):
    """An operator of one or two operands that are all evaluated.

    Attributes:
        symbol: as models write it.
        arity: how many operands it has.
        binding: how tightly it binds (ECMA-262 section 13), from the loosest (1) to the tightest.
        function: the function in :mod:`m2c.language.ecmascript` that computes it.
        mirrored: whether that takes the right operand first.
        negated: whether its result is the opposite.
        python: Python's operator that gives the same for operands of some types; "" if there is none.
        result: the type of what it gives, if that is always the same.
        interval: where the result lies if it is a finite number, by where the operands lie.
    """

    symbol: str
    arity: int = 2
    binding: int
    function: str
    mirrored: bool = False
    negated: bool = False
    python: str = ""
    result: DataType | None = None
    interval: Callable[[Interval, Interval], Interval] | None = None

    @property
    def is_strict(self) -> bool:
        """Whether it compares without converting: ``===``, ``!==``."""
        return self.function == "strict_equals"

    @property
    def is_equality(self) -> bool:
        """Whether it is ``==`` or one of its kind."""
        return self.function in ("equals", "strict_equals")

    @property
    def is_comparison(self) -> bool:
        """Whether it compares two operands."""
        return self.arity == 2 and self.result == BOOL

    @property
    def apply(self) -> Callable[..., Any]:
        """What it does to values that are all known."""
        call: Callable[..., Any] = getattr(ecmascript, self.function)
        if self.mirrored:
            return lambda left, right: call(right, left)
        return (lambda *operands: not call(*operands)) if self.negated else call


def _sum(first: Interval, second: Interval) -> Interval:
    return first[0] + second[0], first[1] + second[1]


def _difference(first: Interval, second: Interval) -> Interval:
    return first[0] - second[1], first[1] - second[0]


def _product(first: Interval, second: Interval) -> Interval:
    corners = [a * b for a in first for b in second]
    return min(corners), max(corners)


def _comparison(symbol: str, function: str, python: str, binding: int) -> Operator:
    return Operator(
        symbol=symbol,
        binding=binding,
        function=function,
        mirrored=symbol[0] == ">",
        negated=symbol[0] == "!",
        python=python,
        result=BOOL,
    )


_BINARY = (
    Operator(symbol="+", binding=7, function="add", python="+", interval=_sum),
    Operator(symbol="-", binding=7, function="subtract", python="-", interval=_difference),
    Operator(symbol="*", binding=8, function="multiply", python="*", interval=_product),
    Operator(symbol="/", binding=8, function="divide", result=FLOAT64),
    Operator(symbol="%", binding=8, function="remainder", python="%"),
    Operator(symbol="**", binding=9, function="power", result=FLOAT64),
    _comparison("==", "equals", "==", 5),
    _comparison("!=", "equals", "!=", 5),
    _comparison("===", "strict_equals", "==", 5),
    _comparison("!==", "strict_equals", "!=", 5),
    _comparison("<", "less", "<", 6),
    _comparison("<=", "less_or_equal", "<=", 6),
    _comparison(">", "less", ">", 6),
    _comparison(">=", "less_or_equal", ">=", 6),
)
_UNARY = (
    Operator(symbol="!", arity=1, binding=UNARY, function="truthy", negated=True, python="not", result=BOOL),
    Operator(symbol="-", arity=1, binding=UNARY, function="negate", python="-"),
    Operator(symbol="+", arity=1, binding=UNARY, function="to_number"),
    Operator(symbol="typeof", arity=1, binding=UNARY, function="type_name", result=STRING),
)  # fmt: skip

BINARY = {operator.symbol: operator for operator in _BINARY}
"""Arithmetic and comparisons."""
PREFIX = {operator.symbol: operator for operator in _UNARY}
"""Operators before their only operand."""
LOGICAL = {"&&": (3, "and"), "||": (2, "or")}
"""How tightly the operators bind that may leave out their right operand, and Python's word for each."""

OPERATORS: dict[str, Callable[[Any, Any], Any]] = {it.symbol: it.apply for it in _BINARY}
"""What each binary operator does, on values that are all known."""
UNARY_OPERATORS: dict[str, Callable[[Any], Any]] = {it.symbol: it.apply for it in _UNARY}
"""What each unary operator does."""
