"""Expressions back to text: what a predicate is called in formulas, messages and witnesses."""

from __future__ import annotations

import json
import math

from m2c.model.expressions import (
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
    PortInput,
    Unary,
    Variable,
)


def expression_text(expression: Expression) -> str:
    """ECMAScript text of ``expression``, spaced one way: equal trees give equal texts."""
    return _text(expression, 0)


_LEVEL = {
    **dict.fromkeys(("||",), 1),
    **dict.fromkeys(("&&",), 2),
    **dict.fromkeys(("==", "!=", "===", "!=="), 3),
    **dict.fromkeys(("<", "<=", ">", ">="), 4),
    **dict.fromkeys(("+", "-"), 5),
    **dict.fromkeys(("*", "/", "%"), 6),
    "**": 7,
}
_PREFIX, _ATOM = 8, 9


def _text(expression: Expression, outer: int) -> str:
    inside, level = _parts(expression)
    return f"({inside})" if level < outer else inside


def _parts(expression: Expression) -> tuple[str, int]:
    match expression:
        case Literal(value=value):
            return _literal(value), _ATOM
        case Variable(name=name):
            return name, _ATOM
        case EventData(spelling=spelling):
            return spelling, _ATOM
        case PortInput(key=key):
            return f"port:{key}", _ATOM
        case Member(object=inner, name=name):
            return f"{_text(inner, _ATOM)}.{name}", _ATOM
        case Index(object=inner, index=index):
            return f"{_text(inner, _ATOM)}[{_text(index, 0)}]", _ATOM
        case Unary(operator=operator, operand=operand):
            gap = " " if operator == "typeof" else ""
            return f"{operator}{gap}{_text(operand, _PREFIX + 1)}", _PREFIX
        case (
            Binary(operator=operator, left=left, right=right)
            | Logical(operator=operator, left=left, right=right)
        ):
            level = _LEVEL[operator]
            below = level + 1
            first = _text(left, below if operator == "**" else level)
            return f"{first} {operator} {_text(right, below)}", level
        case Conditional(test=test, then=then, otherwise=otherwise):
            return f"{_text(test, 1)} ? {_text(then, 1)} : {_text(otherwise, 1)}", 0
        case MathCall(function=function, arguments=arguments):
            return f"Math.{function}({', '.join(_text(item, 0) for item in arguments)})", _ATOM
        case MathConstant(name=name):
            return f"Math.{name}", _ATOM
        case ArrayLiteral(elements=elements):
            return f"[{', '.join(_text(item, 0) for item in elements)}]", _ATOM
        case ObjectLiteral(entries=entries):
            inside = ", ".join(f"{json.dumps(key)}: {_text(value, 0)}" for key, value in entries)
            return f"({{{inside}}})", _ATOM


def _literal(value: bool | int | float | str | None) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value)
        case float() if math.isnan(value):
            return "NaN"
        case float() if math.isinf(value):
            return "Infinity"
        case _:
            return repr(value)
