"""An expression as text again: ECMAScript, with no more brackets than it needs."""

from __future__ import annotations

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

_CONDITIONAL, _OR, _AND, _UNARY, _POSTFIX, _ATOM = 1, 2, 3, 10, 11, 12
_POWER = 9
_BINARY = {
    **dict.fromkeys(("==", "!=", "===", "!=="), 5),
    **dict.fromkeys(("<", "<=", ">", ">="), 6),
    **dict.fromkeys(("+", "-"), 7),
    **dict.fromkeys(("*", "/", "%"), 8),
    "**": _POWER,
}
"""How tightly an operator binds (ECMA-262, section 13, from the loosest to the tightest)."""


def source(expression: Expression) -> str:
    """``expression`` as a model would write it."""
    return _text(expression)[0]


def _within(expression: Expression, least: int) -> str:
    text, binding = _text(expression)
    return text if binding >= least else f"({text})"


def _text(node: Expression) -> tuple[str, int]:
    """The text of ``node``, and how tightly its outermost operator binds."""
    match node:
        case Literal(value=value):
            return _literal(value)
        case Variable(name=name):
            return name, _ATOM
        case EventData(spelling=spelling):
            return spelling, _ATOM
        case PortInput(key=key):
            return f"{{{key}}}", _ATOM
        case Member(object=inner, name=name):
            return f"{_within(inner, _POSTFIX)}.{name}", _POSTFIX
        case Index(object=inner, index=index):
            return f"{_within(inner, _POSTFIX)}[{source(index)}]", _POSTFIX
        case Unary(operator=operator, operand=operand):
            inside = _within(operand, _UNARY)
            blank = " " if operator == "typeof" or inside.startswith(operator) else ""
            return f"{operator}{blank}{inside}", _UNARY
        case Binary(operator=operator, left=left, right=right):
            level = _BINARY[operator]
            if operator == "**":  # binds to the right, and takes no unary operator on its left
                return f"{_within(left, _POSTFIX)} ** {_within(right, level)}", level
            return f"{_within(left, level)} {operator} {_within(right, level + 1)}", level
        case Logical(operator=operator, left=left, right=right):
            level = _OR if operator == "||" else _AND
            return f"{_within(left, level)} {operator} {_within(right, level + 1)}", level
        case Conditional(test=test, then=then, otherwise=otherwise):
            rest = f"{_within(then, _CONDITIONAL)} : {_within(otherwise, _CONDITIONAL)}"
            return f"{_within(test, _OR)} ? {rest}", _CONDITIONAL
        case MathCall(function=function, arguments=arguments):
            return f"Math.{function}({', '.join(map(source, arguments))})", _ATOM
        case MathConstant(name=name):
            return f"Math.{name}", _ATOM
        case ArrayLiteral(elements=elements):
            return f"[{', '.join(map(source, elements))}]", _ATOM
        case ObjectLiteral(entries=entries):
            inside = ", ".join(f"{key}: {source(value)}" for key, value in entries)
            return f"{{{inside}}}", _ATOM


def _literal(value: bool | int | float | str | None) -> tuple[str, int]:
    if value is None:
        return "null", _ATOM
    if isinstance(value, bool):
        return str(value).lower(), _ATOM
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n")
        return f"'{escaped}'", _ATOM
    if isinstance(value, float) and not math.isfinite(value):
        return ("NaN" if math.isnan(value) else "-Infinity" if value < 0 else "Infinity"), _UNARY
    return repr(value), _POSTFIX if value >= 0 else _UNARY
