"""An expression as text again: ECMAScript, with no more brackets than it needs."""

from __future__ import annotations

import math
from collections.abc import Callable

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
)
from m2c.language.operators import ATOM, BINARY, CONDITIONAL, LOGICAL, POSTFIX, UNARY


def single_quoted(text: str) -> str:
    """``text`` as models write it."""
    escaped = text.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n")
    return f"'{escaped}'"


def expression_text(expression: Expression, quoted: Callable[[str], str] = single_quoted) -> str:
    """``expression`` as a model would write it, spaced one way: equal trees give equal texts.

    Args:
        expression: what is to be written.
        quoted: how texts in it are written; ``json.dumps`` for double quotes.
    """
    return _Writer(quoted).text(expression)


class _Writer:
    """Writes expressions, with texts in them ``quoted`` one way."""

    def __init__(self, quoted: Callable[[str], str]) -> None:
        self._quoted = quoted

    def text(self, expression: Expression) -> str:
        """All of ``expression``."""
        return self._parts(expression)[0]

    def _within(self, expression: Expression, least: int) -> str:
        text, binding = self._parts(expression)
        return text if binding >= least else f"({text})"

    def _parts(self, node: Expression) -> tuple[str, int]:
        """The text of ``node``, and how tightly its outermost operator binds."""
        match node:
            case Literal(value=value):
                return self._literal(value)
            case Variable(name=name) | Parameter(name=name):
                return name, ATOM
            case EventData(spelling=spelling):
                return spelling, ATOM
            case PortInput(key=key):
                return f"{{{key}}}", ATOM
            case Member(object=inner, name=name):
                return f"{self._within(inner, POSTFIX)}.{name}", POSTFIX
            case Index(object=inner, index=index):
                return f"{self._within(inner, POSTFIX)}[{self.text(index)}]", POSTFIX
            case Unary(operator=operator, operand=operand):
                inside = self._within(operand, UNARY)
                blank = " " if operator == "typeof" or inside.startswith(operator) else ""
                return f"{operator}{blank}{inside}", UNARY
            case Binary(operator=operator, left=left, right=right):
                level = BINARY[operator].binding
                if operator == "**":  # binds to the right, and takes no unary operator on its left
                    return f"{self._within(left, POSTFIX)} ** {self._within(right, level)}", level
                return (
                    f"{self._within(left, level)} {operator} {self._within(right, level + 1)}",
                    level,
                )
            case Logical(operator=operator, left=left, right=right):
                level, _ = LOGICAL[operator]
                return (
                    f"{self._within(left, level)} {operator} {self._within(right, level + 1)}",
                    level,
                )
            case Conditional(test=test, then=then, otherwise=otherwise):
                rest = f"{self._within(then, CONDITIONAL)} : {self._within(otherwise, CONDITIONAL)}"
                return f"{self._within(test, CONDITIONAL + 1)} ? {rest}", CONDITIONAL
            case MathCall(function=function, arguments=arguments):
                return f"Math.{function}({', '.join(map(self.text, arguments))})", ATOM
            case MathConstant(name=name):
                return f"Math.{name}", ATOM
            case ArrayLiteral(elements=elements):
                return f"[{', '.join(map(self.text, elements))}]", ATOM
            case ArrayFrom(length=length, item=item, index=index):
                made = self.text(item)
                made = f"({made})" if made.startswith("{") else made  # else it would be a block
                parameters = f"_, {index}" if index else ""
                return (
                    f"Array.from({{length: {self.text(length)}}}, ({parameters}) => {made})",
                    ATOM,
                )
            case ObjectLiteral(entries=entries):
                inside = ", ".join(f"{key}: {self.text(value)}" for key, value in entries)
                return f"{{{inside}}}", ATOM

    def _literal(self, value: bool | int | float | str | None) -> tuple[str, int]:
        if value is None:
            return "null", ATOM
        if isinstance(value, bool):
            return str(value).lower(), ATOM
        if isinstance(value, str):
            return self._quoted(value), ATOM
        if isinstance(value, float) and not math.isfinite(value):
            return ("NaN" if math.isnan(value) else "-Infinity" if value < 0 else "Infinity"), UNARY
        return repr(value), POSTFIX if value >= 0 else UNARY
