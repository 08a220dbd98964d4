"""Expressions to Python: native operators where the static types settle the meaning."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from m2c.codegen.names import field_attribute
from m2c.codegen.source import quoted
from m2c.model.datatypes import ANY, BOOL, STRING, Array, DataType, Primitive, Structure, is_integer
from m2c.model.datatypes import is_number as is_number_type
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
    children,
)
from m2c.model.typing import Scope, type_of
from m2c.model.vocabulary import STATUSES

_FUNCTIONS = {
    "+": "add",
    "-": "subtract",
    "*": "multiply",
    "/": "divide",
    "%": "remainder",
    "**": "power",
    "==": "equals",
    "===": "strict_equals",
}
_ATOM, _UNARY, _COMPARE = 100, 80, 40
_PRECEDENCE = {"**": 90, "*": 70, "+": 60, "-": 60, "or": 10, "and": 20, "not": 30, "if": 5}

EVENT_NAMES = {
    "goal_id": "goal_id",
    "thread_id": "thread_id",
    "code": "code",
    "status": "status",
    "name": "name",
}
"""Parameter names of event parts other than the data."""


class Code(msgspec.Struct, frozen=True):
    """Python source of an expression and how tightly it binds."""

    text: str
    precedence: int = _ATOM

    def within(self, precedence: int) -> str:
        """The text, in parentheses if it binds less tightly than ``precedence``."""
        return self.text if self.precedence >= precedence else f"({self.text})"


class ExpressionCompiler:
    """Compiles expressions of one machine at one place.

    Attributes:
        may_fail: set when any compiled expression may raise ``ExecutionError``.
    """

    def __init__(
        self,
        scope: Scope,
        attributes: Mapping[str, str],
        class_of: dict[str, str],
        data_name: str = "data",
    ) -> None:
        self._scope = scope
        self._attributes = attributes
        self._class_of = class_of
        self._data_name = data_name
        self.may_fail = False

    # -- entry points -------------------------------------------------------------------------

    def value(self, node: Expression, target: DataType | None = None) -> str:
        """Python source of ``node`` as a value for a place of type ``target``."""
        kind = self._static(node)
        text = self._compile(node, target).text
        if target is None or target == ANY:
            return text
        if is_integer(target):
            if is_integer(kind) and not text.startswith("ecmascript."):
                return text
            return self._runtime("integer", text, fails=True)
        if isinstance(target, Primitive) and target.name.startswith("float"):
            if isinstance(node, Literal) and isinstance(node.value, int):
                return repr(float(node.value))
            if isinstance(kind, Primitive) and kind.name.startswith("float"):
                return text
            return (
                f"float({text})"
                if is_integer(kind)
                else f"float({self._runtime('to_number', text)})"
            )
        if isinstance(target, Array | Structure) and isinstance(
            node, Variable | Member | Index | EventData
        ):
            return f"copy.deepcopy({text})"
        return text

    def condition(self, node: Expression, operand_of: str = "") -> str:
        """Python source of ``node`` as a condition, or as an operand of ``and`` (or another operator)."""
        return self._truth(node).within(_PRECEDENCE[operand_of] if operand_of else 0)

    def _truth(self, node: Expression) -> Code:
        if self._static(node) == BOOL:
            return self._compile(node)
        return Code(self._runtime("truthy", self._compile(node).text))

    # -- types --------------------------------------------------------------------------------

    def _static(self, node: Expression) -> DataType:
        """The static type, or ANY where an element out of range could make it undefined."""
        if _has_element(node):
            return ANY
        if isinstance(node, Variable) and node.name not in self._scope.variables:
            return STRING if node.name in STATUSES else ANY
        return type_of(node, self._scope)

    def _runtime(self, function: str, *arguments: str, fails: bool = False) -> str:
        self.may_fail = self.may_fail or fails
        return f"ecmascript.{function}({', '.join(arguments)})"

    # -- nodes --------------------------------------------------------------------------------

    def _compile(self, node: Expression, target: DataType | None = None) -> Code:
        match node:
            case Literal(value=value):
                return _literal(value)
            case Variable(name=name):
                if name not in self._scope.variables and name in STATUSES:
                    return Code(quoted(name))
                return Code(f"self.{self._attributes[name]}")
            case EventData(part="data"):
                return Code(self._data_name)
            case EventData(part=part):
                return Code(EVENT_NAMES[part])
            case PortInput(key=key):
                return Code(f"self._ports[{quoted(key)}]")
            case Member():
                return self._member(node)
            case Index(object=inner, index=index):
                text = self._runtime(
                    "element", self._compile(inner).text, self._compile(index).text, fails=True
                )
                return Code(text)
            case Unary():
                return self._unary(node)
            case Binary():
                return self._binary(node)
            case Logical():
                return self._logical(node)
            case Conditional(test=test, then=then, otherwise=otherwise):
                level = _PRECEDENCE["if"]
                chosen = self._compile(then, target).within(level + 1)
                text = f"{chosen} if {self._truth(test).within(level + 1)} else "
                return Code(text + self._compile(otherwise, target).within(level), level)
            case MathCall():
                return self._math(node)
            case MathConstant(name=name):
                return Code(f"ecmascript.CONSTANTS[{quoted(name)}]")
            case ArrayLiteral(elements=elements):
                inner_type = target.element if isinstance(target, Array) else None
                return Code(f"[{', '.join(self.value(item, inner_type) for item in elements)}]")
            case ObjectLiteral(entries=entries):
                return self._object(entries, target)

    def _member(self, node: Member) -> Code:
        kind = self._static(node.object)
        inner = self._compile(node.object).within(_ATOM)
        if node.name == "length" and (isinstance(kind, Array) or kind == STRING):
            return Code(f"len({inner})")
        if isinstance(kind, Structure) and kind.name:
            if kind.field(node.name) is None:
                for name, _, value in kind.constants:
                    if name == node.name:
                        return _literal(value)
            return Code(f"{inner}.{field_attribute(node.name)}")
        return Code(self._runtime("member", inner, quoted(node.name), fails=True))

    def _unary(self, node: Unary) -> Code:
        operand = self._compile(node.operand)
        kind = self._static(node.operand)
        match node.operator:
            case "!":
                level = _PRECEDENCE["not"]
                return Code(f"not {self._truth(node.operand).within(level)}", level)
            case "typeof":
                return Code(self._runtime("type_name", operand.text))
            case "-":
                literal = isinstance(node.operand, Literal) and node.operand.value != 0
                if literal or (isinstance(kind, Primitive) and kind.name.startswith("float")):
                    return Code(f"-{operand.within(_UNARY)}", _UNARY)
                return Code(self._runtime("negate", operand.text))
            case "+":
                if is_number_type(kind):
                    return operand
                return Code(self._runtime("to_number", operand.text))

    def _binary(self, node: Binary) -> Code:
        left, right = self._static(node.left), self._static(node.right)
        first, second = self._compile(node.left), self._compile(node.right)
        operator = node.operator
        numbers = is_number_type(left) and is_number_type(right)
        alike = numbers or (left == right and left in (BOOL, STRING))
        if operator in ("==", "===", "!=", "!=="):
            return self._equality(node, first, second, alike)
        if operator in ("<", "<=", ">", ">="):
            if numbers:
                text = f"{first.within(_COMPARE + 1)} {operator} {second.within(_COMPARE + 1)}"
                return Code(text, _COMPARE)
            pair = (first.text, second.text) if operator[0] == "<" else (second.text, first.text)
            return Code(self._runtime("less_or_equal" if "=" in operator else "less", *pair))
        integers = is_integer(left) and is_integer(right)
        native = (
            (operator in ("+", "-") and numbers)
            or (operator == "+" and left == right == STRING)
            or (operator == "*" and integers and _never_zero(node))
        )
        if native:
            level = _PRECEDENCE[operator]
            return Code(f"{first.within(level)} {operator} {second.within(level + 1)}", level)
        return Code(self._runtime(_FUNCTIONS[operator], first.text, second.text))

    def _equality(self, node: Binary, first: Code, second: Code, alike: bool) -> Code:
        negated = node.operator[0] == "!"
        if alike:
            if node.right in (_TRUE, _FALSE) or _is_bool(node.right):
                wanted = getattr(node.right, "value", None) is not negated
                level = _PRECEDENCE["not"]
                if wanted:
                    return self._compile(node.left)
                return Code(f"not {first.within(level)}", level)
            operator = "!=" if negated else "=="
            text = f"{first.within(_COMPARE + 1)} {operator} {second.within(_COMPARE + 1)}"
            return Code(text, _COMPARE)
        strict = len(node.operator) == 3
        name = "strict_equals" if strict else "equals"
        text = self._runtime(name, first.text, second.text)
        return Code(f"not {text}", _PRECEDENCE["not"]) if negated else Code(text)

    def _logical(self, node: Logical) -> Code:
        word = "and" if node.operator == "&&" else "or"
        level = _PRECEDENCE[word]
        left, right = self._static(node.left), self._static(node.right)
        if left == BOOL or (left == right == STRING):
            first = self._compile(node.left).within(level)
            return Code(f"{first} {word} {self._compile(node.right).within(level + 1)}", level)
        first = self._compile(node.left).text
        test = self._runtime("truthy", first)
        second = self._compile(node.right).within(_PRECEDENCE["if"] + 1)
        chosen = (second, first) if word == "and" else (first, second)
        return Code(f"{chosen[0]} if {test} else {chosen[1]}", _PRECEDENCE["if"])

    def _math(self, node: MathCall) -> Code:
        if node.function == "random":
            return Code("self._random()")
        if all(is_integer(self._static(argument)) for argument in node.arguments):
            texts = [self._compile(argument).text for argument in node.arguments]
            if node.function in ("max", "min") and len(texts) > 1:
                return Code(f"{node.function}({', '.join(texts)})")
            if node.function == "abs" and len(texts) == 1:
                return Code(f"abs({texts[0]})")
        arguments = ", ".join(self._compile(argument).text for argument in node.arguments)
        return Code(f"ecmascript.MATH[{quoted(node.function)}]({arguments})")

    def _object(self, entries: tuple[tuple[str, Expression], ...], target: DataType | None) -> Code:
        if isinstance(target, Structure) and target.name:
            fields = [
                f"{field_attribute(key)}={self.value(value, target.field(key))}"
                for key, value in entries
            ]
            return Code(f"{self._class_of[target.name]}({', '.join(fields)})")
        items = [f"{quoted(key)}: {self._compile(value).text}" for key, value in entries]
        return Code(f"{{{', '.join(items)}}}")


_TRUE, _FALSE = Literal(value=True), Literal(value=False)


def _is_bool(node: Expression) -> bool:
    return isinstance(node, Literal) and isinstance(node.value, bool)


def _never_zero(node: Binary) -> bool:
    """Whether a product cannot be ECMAScript's -0: one side is a positive literal."""
    return any(
        isinstance(side, Literal) and isinstance(side.value, int) and side.value > 0
        for side in (node.left, node.right)
    )


def _has_element(node: Expression) -> bool:
    return isinstance(node, Index) or any(_has_element(child) for child in children(node))


def _literal(value: bool | int | float | str | None) -> Code:
    if isinstance(value, str):
        return Code(quoted(value))
    if isinstance(value, float) and not math.isfinite(value):
        return Code(f'float("{value}")')
    negative = isinstance(value, int | float) and not isinstance(value, bool) and value < 0
    return Code(repr(value), _UNARY if negative else _ATOM)
