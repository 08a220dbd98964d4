"""Expressions to Python: native operators where the static types settle the meaning."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from m2c.codegen.interfaces import zero_text
from m2c.codegen.names import field_attribute
from m2c.codegen.source import py, quoted
from m2c.language.certainty import Certain, Certainty, Fit, fit, is_float, is_native
from m2c.language.conversion import MAX_LENGTH, STATUSES, to_float32
from m2c.language.datatypes import (
    ANY,
    BOOL,
    FLOAT64,
    INTEGER_RANGES,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
    is_integer,
    is_number,
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
)
from m2c.language.operators import BINARY, LOGICAL, PREFIX
from m2c.language.typing import Scope, array_length, constant_value, type_of
from m2c.language.values import LENIENT

_FLOAT32 = Primitive("float32")
_CONVERSIONS = {
    **{name: f"to_{name}" for name in INTEGER_RANGES},
    **{"byte": "to_uint8", "char": "to_uint8", "bool": "to_flag", "string": "to_text"},
    **{"float32": "to_float32", "float64": "to_float64", "number": "to_untyped_number"},
}
"""The function that converts to each primitive type."""
_LENIENT = {name: function.__name__ for name, function in LENIENT.items()}
"""The function whose result is converted, if the model is read leniently."""
_ATOM, _UNARY, _COMPARE = 100, 80, 40
_PRECEDENCE = {
    "**": 90,
    "*": 70,
    "%": 70,
    "+": 60,
    "-": 60,
    **dict.fromkeys(("==", "!=", "<", "<=", ">", ">="), _COMPARE),
    "or": 10,
    "and": 20,
    "not": 30,
    "if": 5,
}

_INDICES = ("i", "j")
"""The index in a list comprehension, and in one inside it."""

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
        self._certainty = Certainty(scope)
        self._class_of = class_of
        self._data_name = data_name
        self.may_fail = False

    # -- entry points -------------------------------------------------------------------------

    def value(self, node: Expression, target: DataType | None = None) -> str:
        """Python source of ``node`` as a value for a place of type ``target``.

        It is converted where the static types do not show that it is of that type already (see
        docs/decisions/0024-assignments-convert-to-the-declared-type.md). None: it goes to no place.
        """
        return (self._compile(node) if target is None else self._converted(node, target)).text

    def elements(self, array: Expression, each: str, target: DataType) -> tuple[str, str]:
        """Python source of a copy of ``array``, and of its element ``each`` for a place of ``target``."""
        kind = self._certain(array).kind
        text = self._compile(array).text
        is_array = isinstance(kind, Array)
        found = f"list({text})" if is_array else self._runtime("elements", text, fails=True)
        if not isinstance(kind, Array) or kind.element != target:
            nothing = Literal(value=None)  # nothing is certain of an element
            return found, self._conversion(each, nothing, target, Fit.MAY_FAIL).text
        return found, f"copy.deepcopy({each})" if isinstance(target, Array | Structure) else each

    def place(self, name: str, target: DataType) -> str:
        """Python source of ``name``, a place in an array, for a variable of type ``target``."""
        if (
            isinstance(target, Primitive)
            and INTEGER_RANGES.get(target.name, (0, 0))[1] > MAX_LENGTH
        ):
            return name
        return self._conversion(name, Literal(value=None), target, Fit.MAY_FAIL).text

    def text(self, node: Expression) -> str:
        """Python source of the text of ``node``, for a log."""
        code = self._compile(node).text
        return code if self._certain(node).kind == STRING else self._runtime("to_string", code)

    def status(self, node: Expression) -> str:
        """Python source of the status that ``node`` is: a literal, or a variable that holds one."""
        if isinstance(node, Literal):
            return self._compile(node).text
        return self._runtime("to_status", self._compile(node).text, fails=True)

    def condition(self, node: Expression, operand_of: str = "") -> str:
        """Python source of ``node`` as a condition, or as an operand of ``and`` (or another operator)."""
        return self._truth(node).within(_PRECEDENCE[operand_of] if operand_of else 0)

    def _truth(self, node: Expression) -> Code:
        if self._certain(node).kind == BOOL:
            return self._compile(node)
        return Code(self._runtime("truthy", self._compile(node).text))

    # -- types --------------------------------------------------------------------------------

    def _certain(self, node: Expression) -> Certain:
        return self._certainty.of(node)

    def _runtime(self, function: str, *arguments: str, fails: bool = False) -> str:
        self.may_fail = self.may_fail or fails
        return f"ecmascript.{function}({', '.join(arguments)})"

    def _converted(self, node: Expression, target: DataType) -> Code:
        match node:
            case Conditional(test=test, then=then, otherwise=otherwise):
                return self._choice(
                    test, self._converted(then, target), self._converted(otherwise, target)
                )
            case ArrayLiteral(elements=elements) if isinstance(target, Array):
                return self._array(elements, target)
            case ArrayFrom() if isinstance(target, Array):
                return self._array_from(node, target)
            case ObjectLiteral(entries=entries) if isinstance(target, Structure) and target.name:
                return self._message(entries, target)
        constant = self._constant(node, target)
        if constant is not None:
            return constant
        how = self._certainty.fit(node, target)
        code = self._compile(node)
        if how is not Fit.AS_IS:
            return self._conversion(code.text, node, target, how)
        literal = isinstance(node, ArrayLiteral | ArrayFrom | ObjectLiteral)
        if isinstance(self._certain(node).kind, Array | Structure) and not literal:
            return Code(f"copy.deepcopy({code.text})")
        return code

    def _constant(self, node: Expression, target: DataType) -> Code | None:
        """A literal for a floating-point place, written as one."""
        value = constant_value(node)
        if value is None or target not in (FLOAT64, _FLOAT32):
            return None
        if value == 0 and not isinstance(node, Literal):
            return None  # -0
        number = float(value)
        held = to_float32(number) == number or math.isnan(number)
        return _literal(number) if target == FLOAT64 or held else None

    def _conversion(self, text: str, node: Expression, target: DataType, how: Fit) -> Code:
        if how is Fit.CONVERTED and target == FLOAT64 and is_integer(self._certain(node).kind):
            return Code(f"float({text})")
        fails = how is Fit.MAY_FAIL
        lenient = self._scope.lenient
        match target:
            case Primitive(name):
                value = self._certain(node)
                fits = value.kind == target == STRING or fit(value, target) is not Fit.MAY_FAIL
                if lenient and name in _LENIENT and not fits:
                    text = self._runtime(_LENIENT[name], text)
                return Code(self._runtime(_CONVERSIONS.get(name, "to_untyped"), text, fails=fails))
            case Array(element, length, fixed):
                arguments = [text, self._element_conversion(element)]
                if length is not None:
                    arguments += [str(length), str(length)] if fixed else [str(length)]
                return Code(self._runtime("to_array", *arguments, fails=fails))
            case Structure(name) if name:
                arguments = [text, self._class_of[name], *(["lenient=True"] if lenient else [])]
                return Code(self._runtime("to_message", *arguments, fails=fails))
            case _:
                return Code(self._runtime("to_object", text, fails=fails))

    def _element_conversion(self, element: DataType) -> str:
        """What converts one element of an array."""
        if isinstance(element, Primitive) and not self._scope.lenient:
            return f"ecmascript.{_CONVERSIONS.get(element.name, 'to_untyped')}"
        item = Literal(value=None)  # nothing is certain of it
        return f"lambda item: {self._conversion('item', item, element, Fit.MAY_FAIL).text}"

    def _array(self, elements: tuple[Expression, ...], target: Array) -> Code:
        """An array literal; an empty one for an array of fixed length is its zero value."""
        most, least = target.length, (target.length or 0) if target.fixed else 0
        if not elements and least:
            return Code(self.zero(target))
        text = f"[{', '.join(self._converted(item, target.element).text for item in elements)}]"
        if least <= len(elements) <= (len(elements) if most is None else most):
            return Code(text)
        return self._conversion(text, Literal(value=None), target, Fit.MAY_FAIL)

    def _array_from(self, node: ArrayFrom, target: Array) -> Code:
        """``Array.from`` as a list comprehension, for a place of type ``target``."""
        count, lengths = array_length(node), self._certainty.lengths(node)
        if count is not None and lengths is not None:
            length = str(int(count))
        elif lengths is not None:
            length = self._compile(node.length).text
        else:
            bound = [] if node.most == MAX_LENGTH else [str(node.most)]
            code = self._compile(node.length).text
            length = self._runtime("to_length", code, *bound, fails=True)
        item = self._converted(node.item, target.element).within(_PRECEDENCE["if"])
        index = _INDICES[node.depth] if node.index else "_"
        text = f"[{item} for {index} in range({length})]"
        least = (target.length or 0) if target.fixed else 0
        most = MAX_LENGTH if target.length is None else target.length
        if lengths is not None and least <= lengths[0] <= lengths[1] <= most:
            return Code(text)
        if least == 0 and target.length is None:
            return Code(text)
        return self._conversion(text, Literal(value=None), target, Fit.MAY_FAIL)

    def zero(self, kind: DataType) -> str:
        """Python source of the zero value of ``kind``, as ROS 2 initialises a field."""
        return zero_text(kind, self._class_of)

    # -- nodes --------------------------------------------------------------------------------

    def _compile(self, node: Expression) -> Code:
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
            case Index():
                return self._index(node)
            case Unary():
                return self._unary(node)
            case Binary():
                return self._binary(node)
            case Logical():
                return self._logical(node)
            case Conditional(test=test, then=then, otherwise=otherwise):
                return self._choice(test, self._compile(then), self._compile(otherwise))
            case MathCall():
                return self._math(node)
            case MathConstant(name=name):
                return Code(f"ecmascript.CONSTANTS[{quoted(name)}]")
            case ArrayLiteral(elements=elements):
                return Code(f"[{', '.join(self.value(item, ANY) for item in elements)}]")
            case Parameter(depth=depth):
                return Code(_INDICES[depth])
            case ArrayFrom():
                return self._array_from(node, Array(ANY))
            case ObjectLiteral(entries=entries):
                items = [f"{quoted(key)}: {self.value(value, ANY)}" for key, value in entries]
                return Code(f"{{{', '.join(items)}}}")

    def _choice(self, test: Expression, then: Code, otherwise: Code) -> Code:
        level = _PRECEDENCE["if"]
        condition = self._truth(test).within(level + 1)
        text = f"{then.within(level + 1)} if {condition} else {otherwise.within(level)}"
        return Code(text, level)

    def _member(self, node: Member) -> Code:
        declared = type_of(node.object, self._scope)
        if isinstance(declared, Structure) and declared.field(node.name) is None:
            for name, _, value in declared.constants:
                if name == node.name:
                    return _literal(value)
        kind = self._certain(node.object).kind
        inner = self._compile(node.object).within(_ATOM)
        if node.name == "length" and (isinstance(kind, Array) or kind == STRING):
            return Code(f"len({inner})")
        if isinstance(kind, Structure) and kind.name and kind.field(node.name) is not None:
            return Code(f"{inner}.{field_attribute(node.name)}")
        is_certain = kind == declared
        only = only_array(declared) if node.name == "length" else None
        if only is not None and is_certain:
            return Code(f"len({inner}.{field_attribute(only)})")
        if only is not None:
            inner = self._runtime("member", inner, quoted(only), fails=True)
        elif isinstance(declared, Array) and part(declared, node.name) is not None:
            if is_certain:
                return Code(f"[row.{field_attribute(node.name)} for row in {inner}]")
            return Code(self._runtime("column", inner, quoted(node.name), fails=True))
        fails = not isinstance(kind, Structure)
        return Code(self._runtime("member", inner, quoted(node.name), fails=fails))

    def _index(self, node: Index) -> Code:
        """An element: by Python's own indexing where the index is known to be in range."""
        inner, index = self._compile(node.object), self._compile(node.index)
        if self._certain(node).kind != ANY:
            return Code(f"{inner.within(_ATOM)}[{index.text}]")
        kind = self._certain(node.object).kind
        fails = not (isinstance(kind, Array | Structure) or kind == STRING)
        return Code(self._runtime("element", inner.text, index.text, fails=fails))

    def _unary(self, node: Unary) -> Code:
        operand = self._compile(node.operand)
        match node.operator:
            case "!":
                level = _PRECEDENCE["not"]
                return Code(f"not {self._truth(node.operand).within(level)}", level)
            case "-":
                if is_integer(self._certain(node).kind) or is_float(self._certain(node.operand)):
                    return Code(f"-{operand.within(_UNARY)}", _UNARY)
            case "+":
                if is_number(self._certain(node.operand).kind):
                    return operand
        return Code(self._runtime(PREFIX[node.operator].function, operand.text))

    def _binary(self, node: Binary) -> Code:
        left, right = self._certain(node.left), self._certain(node.right)
        first, second = self._compile(node.left), self._compile(node.right)
        operator = BINARY[node.operator]
        numbers = is_number(left.kind) and is_number(right.kind)
        alike = numbers or (left.kind == right.kind and left.kind in (BOOL, STRING))
        if operator.is_equality and alike and _is_bool(node.right):
            return self._is_true(first, getattr(node.right, "value", None) is not operator.negated)
        if alike if operator.is_equality else numbers and operator.is_comparison:
            return _infix(operator.python, first.within(_COMPARE + 1), second)
        texts = node.operator == "+" and left.kind == right.kind == STRING
        if texts or is_native(node.operator, left, right):
            return _infix(operator.python, first.within(_PRECEDENCE[operator.python]), second)
        pair = (second.text, first.text) if operator.mirrored else (first.text, second.text)
        text = self._runtime(operator.function, *pair)
        return Code(f"not {text}", _PRECEDENCE["not"]) if operator.negated else Code(text)

    def _is_true(self, code: Code, wanted: bool) -> Code:
        """``code``, a condition, compared with a literal: itself, or its opposite."""
        level = _PRECEDENCE["not"]
        return code if wanted else Code(f"not {code.within(level)}", level)

    def _logical(self, node: Logical) -> Code:
        _, word = LOGICAL[node.operator]
        level = _PRECEDENCE[word]
        left, right = self._certain(node.left).kind, self._certain(node.right).kind
        if left == BOOL or (left == right == STRING):
            first = self._compile(node.left).within(level)
            return Code(f"{first} {word} {self._compile(node.right).within(level + 1)}", level)
        first = self._compile(node.left).within(_PRECEDENCE["if"] + 1)
        test = self._runtime("truthy", first)
        second = self._compile(node.right).within(_PRECEDENCE["if"] + 1)
        chosen = (second, first) if word == "and" else (first, second)
        return Code(f"{chosen[0]} if {test} else {chosen[1]}", _PRECEDENCE["if"])

    def _math(self, node: MathCall) -> Code:
        if node.function == "random":
            return Code("self._random()")
        arguments = [self._compile(argument).text for argument in node.arguments]
        if all(is_integer(self._certain(argument).kind) for argument in node.arguments):
            many = node.function in ("max", "min") and len(arguments) > 1
            if many or (node.function == "abs" and len(arguments) == 1):
                return Code(f"{node.function}({', '.join(arguments)})")
        return Code(f"ecmascript.MATH[{quoted(node.function)}]({', '.join(arguments)})")

    def _message(self, entries: tuple[tuple[str, Expression], ...], target: Structure) -> Code:
        fields = [
            f"{field_attribute(key)}={self.value(value, target.field(key))}"
            for key, value in entries
        ]
        return Code(f"{self._class_of[target.name]}({', '.join(fields)})")


def _infix(operator: str, first: str, second: Code) -> Code:
    level = _PRECEDENCE[operator]
    return Code(f"{first} {operator} {second.within(level + 1)}", level)


def _is_bool(node: Expression) -> bool:
    return isinstance(node, Literal) and isinstance(node.value, bool)


def _literal(value: bool | int | float | str | None) -> Code:
    negative = isinstance(value, int | float) and value < 0
    return Code(str(py(value)), _UNARY if negative else _ATOM)
