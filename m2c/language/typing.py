"""Static types of expressions, and the faults that can be told before a model runs."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from typing import Any

import msgspec

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.conversion import MAX_LENGTH, ExecutionError, to_number, to_string
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
    describe,
    is_integer,
    is_number,
    is_scalar,
    only_array,
    part,
)
from m2c.language.evaluate import evaluate
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
    is_settled,
)
from m2c.language.operators import BINARY, PREFIX
from m2c.language.values import convert
from m2c.suggestions import nearest

INTEGRAL_MATH = frozenset({"floor", "ceil", "round", "trunc", "sign"})
"""``Math`` functions whose result is a whole number."""
SHOWN = 40
"""Characters of a text that a message repeats."""
_OF_SCXML = {
    "_name": "it is the machine's name, and is not assigned",
    "_event": "it is what a transition takes, and is not assigned",
    **dict.fromkeys(
        ("_sessionid", "_ioprocessors", "_x"),
        "of SCXML's own variables the language has _event and _name; a machine is addressed by its name",
    ),
}
"""What is said of SCXML's system variables (W3C SCXML 5.10) where nothing is declared."""


class Scope(msgspec.Struct, frozen=True):
    """What names mean at one place of a model.

    Attributes:
        variables: the datamodel.
        event: what of the event can be read here, by ``EventData.part``.
        ports: the behaviour-tree input ports, by key.
        lenient: whether strings, numbers and bools become one another, as ECMAScript has it.
        later: variables that have no value yet, in the expression that another begins with.
    """

    variables: Mapping[str, DataType]
    event: Mapping[str, DataType] = {}
    ports: Mapping[str, DataType] = {}
    lenient: bool = False
    later: Container[str] = ()


def how_to_declare(name: str, variables: Iterable[str]) -> str:
    """What would be right instead of the variable ``name``, which is none of ``variables``."""
    return _OF_SCXML.get(name) or nearest(name, variables) or "declare it with <data>"


def type_of(expression: Expression, scope: Scope) -> DataType:
    """The static type of ``expression``; ``ANY`` where nothing is known."""
    return _Typer(scope, None, "").type_of(expression)


def check_expression(
    expression: Expression,
    scope: Scope,
    expected: DataType | None,
    element: str,
    log: DiagnosticLog,
) -> DataType:
    """Report every fault in ``expression`` and return its type.

    Args:
        expression: what to check.
        scope: what is visible.
        expected: the type that the place wants; None if any will do.
        element: the XML element, for messages.
        log: where faults go: ``undeclared-variable``, ``unknown-field``, ``type-mismatch``,
            ``out-of-range``, ``event-data-not-available``.
    """
    typer = _Typer(scope, log, element)
    kind = typer.type_of(expression, expected)
    if expected is not None:
        typer.check_fits(expression, expected)
    return kind


def assignable(value: DataType, target: DataType) -> bool:
    """Whether a value of type ``value`` may be stored where ``target`` is declared."""
    if ANY in (value, target):
        return True
    if is_integer(target):
        return is_integer(value) or value == NUMBER
    if is_number(target):
        return is_number(value)
    if isinstance(target, Array):
        return (
            isinstance(value, Array)
            and _lengths_meet(value, target)
            and assignable(value.element, target.element)
        )
    if isinstance(target, Structure):
        if not isinstance(value, Structure):
            return False
        if value.name:
            return value.name == target.name
        return all(
            (wanted := target.field(name)) is not None and assignable(kind, wanted)
            for name, kind in value.fields
        )
    return value == target


def _lengths_meet(value: Array, target: Array) -> bool:
    """Whether some length is one that both arrays can have."""
    if value.fixed and target.fixed:
        return value.length == target.length
    if value.fixed and value.length is not None and target.length is not None:
        return value.length <= target.length
    if target.fixed and target.length is not None and value.length is not None:
        return target.length <= value.length
    return True


def constant_value(expression: Expression) -> int | float | None:
    """The number that ``expression`` is, if it is a literal (with a sign or not)."""
    match expression:
        case Literal(value=bool()):
            return None
        case Literal(value=int() | float() as value):
            return value
        case Unary(operator="-", operand=Literal(value=int() | float() as value)):
            return None if isinstance(value, bool) else -value
        case _:
            return None


def _computed(expression: Expression) -> tuple[bool, Any]:
    """The value of ``expression``, if it depends on nothing: (True, value), else (False, None)."""
    if isinstance(expression, ArrayLiteral | ArrayFrom | ObjectLiteral):
        return False, None  # checked element by element
    if not is_settled(expression):
        return False, None
    try:
        return True, evaluate(expression, {}, {})
    except ExecutionError:
        return True, None


def array_length(node: ArrayFrom) -> int | float | None:
    """How many elements ``node`` has, if that depends on nothing; it may be more than it may have."""
    known, value = _computed(node.length)
    if not known or value is None:
        return None
    number = to_number(value)
    return (
        0 if math.isnan(number) else max(math.trunc(number) if math.isfinite(number) else number, 0)
    )


class _Typer:
    """One walk over an expression; reports if it has a log."""

    def __init__(self, scope: Scope, log: DiagnosticLog | None, element: str) -> None:
        self._scope = scope
        self._log = log
        self._element = element

    def _error(self, rule: str, node: Expression, message: str, hint: str = "") -> None:
        if self._log is not None:
            self._log.error(rule, node.position, self._element, message, hint)

    def _let_through(self, node: Expression, message: str, *kinds: DataType) -> bool:
        """Whether values of ``kinds`` become others here, as ECMAScript has it; says so."""
        if not self._scope.lenient or not all(kind == ANY or is_scalar(kind) for kind in kinds):
            return False
        if self._log is not None:
            hint = "an error without --lenient"
            self._log.warning("lenient-conversion", node.position, self._element, message, hint)
        return True

    def check_fits(self, node: Expression, expected: DataType) -> None:
        """Report what of ``node`` cannot be in a place of type ``expected``."""
        match node:
            case Conditional(then=then, otherwise=otherwise):
                self.check_fits(then, expected)
                self.check_fits(otherwise, expected)
                return
            case Logical(operator=operator, left=left, right=right):
                kind = type_of(left, self._scope)
                # undefined is never what `||` gives, nor an object what `&&` gives of its left side
                kept = kind != NULL if operator == "||" else not isinstance(kind, Array | Structure)
                if kept:
                    self.check_fits(left, expected)
                self.check_fits(right, expected)
                return
        known, value = _computed(node)
        is_settled = known and isinstance(expected, Primitive) and is_integer(expected)
        if is_settled and self._check_integer(node, value, expected):
            return
        silent = _Typer(self._scope, None, "")
        kind = silent.type_of(node, expected)  # an index out of range was reported as such
        if assignable(kind, expected):
            return
        if self._scope.lenient and is_scalar(kind) and is_scalar(expected):
            self._let_through(node, _becoming(value if known else None, kind, expected), kind)
            return
        hint = f"a value of type {describe(expected)} is needed"
        if is_integer(expected) and is_number(kind):
            hint = "use Math.floor, Math.round or Math.trunc to make it whole"
        what = f"a value of type {describe(kind)} where {describe(expected)} is declared"
        self._error("type-mismatch", node, what, hint)

    def _check_integer(self, node: Expression, value: Any, expected: DataType) -> bool:
        """Whether ``value`` is a number of which all is said: a whole one, or one that is none."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        low, high = INTEGER_RANGES[describe(expected)]
        if isinstance(value, float) and not value.is_integer():
            if math.isfinite(value) or self._scope.lenient:
                return False
            hint = f"{describe(expected)} holds {low} to {high}"
            self._error("out-of-range", node, f"this is {to_string(value)}", hint)
            return True
        if not low <= value <= high:
            what, hint = (
                f"{value} does not fit {describe(expected)}",
                f"{describe(expected)} holds {low} to {high}",
            )
            self._error("out-of-range", node, what, hint)
        return True

    def type_of(self, node: Expression, expected: DataType | None = None) -> DataType:
        match node:
            case Literal(value=value):
                return _literal_type(value)
            case Variable(name=name):
                return self._variable(node, name)
            case EventData(part=part, spelling=spelling):
                if part not in self._scope.event:
                    self._error(
                        "event-data-not-available",
                        node,
                        f"`{spelling}` is not available here",
                        self._available(),
                    )
                return self._scope.event.get(part, ANY)
            case PortInput(key=key):
                if key not in self._scope.ports:
                    hint = nearest(key, self._scope.ports) or "declare it with <bt_declare_port_in>"
                    self._error("undeclared-port", node, f"port `{key}` is not declared", hint)
                return self._scope.ports.get(key, ANY)
            case Member(object=inner, name=name):
                return self._member(node, self.type_of(inner), name)
            case Index(object=inner, index=index):
                kind, position = self.type_of(inner), self.type_of(index)
                self._check_index(inner, kind, index)
                return self._index(node, kind, position)
            case Unary(operator=operator, operand=operand):
                return self._unary(node, operator, self.type_of(operand))
            case Binary():
                return self._binary(node, self.type_of(node.left), self.type_of(node.right))
            case Logical(left=left, right=right):
                first, second = self.type_of(left), self.type_of(right)
                return first if first == second else (common_type(first, second) or ANY)
            case Conditional(test=test, then=then, otherwise=otherwise):
                self.type_of(test)
                first, second = self.type_of(then, expected), self.type_of(otherwise, expected)
                return common_type(first, second) or ANY
            case MathCall(function=function, arguments=arguments):
                return self._math(function, arguments)
            case MathConstant():
                return FLOAT64
            case ArrayLiteral(elements=elements):
                return self._array(node, elements, expected)
            case Parameter():
                return INT64
            case ArrayFrom():
                return self._array_from(node, expected)
            case ObjectLiteral(entries=entries):
                return self._object(node, entries, expected)

    def _available(self) -> str:
        parts = {"data": "the message's fields"}
        names = [parts.get(part, part) for part in self._scope.event]
        return f"available: {', '.join(names)}" if names else "no event data is, outside a handler"

    def _variable(self, node: Expression, name: str) -> DataType:
        kind = self._scope.variables.get(name)
        if kind is None:
            what, hint = f"`{name}` is not declared", how_to_declare(name, self._scope.variables)
            if name in self._scope.later:
                what, hint = (
                    f"`{name}` has no value yet",
                    "variables begin in the order of their <data>",
                )
            self._error("undeclared-variable", node, what, hint)
            return ANY
        return kind

    def _member(self, node: Expression, kind: DataType, name: str) -> DataType:
        if isinstance(kind, Structure):
            found = kind.field(name)
            if found is None and name == "length" and only_array(kind):
                return INT64
            if found is None:
                constant = next((base for key, base, _ in kind.constants if key == name), None)
                if constant is not None:
                    return Primitive(constant)
                self._error(
                    "unknown-field",
                    node,
                    f"{describe(kind)} has no field `{name}`",
                    nearest(name, (key for key, _ in kind.fields)) or "it has no fields",
                )
                return ANY
            return found
        if name == "length" and (isinstance(kind, Array) or kind == STRING):
            return INT64
        column = part(kind, name)
        if column is not None:
            return column
        if isinstance(kind, Array) and isinstance(kind.element, Structure):
            return self._member(node, kind.element, name)  # which says that there is no such field
        if kind != ANY:
            hint = "it has `length`" if isinstance(kind, Array) or kind == STRING else ""
            what = f"a value of type {describe(kind)} has no `{name}`"
            self._error("unknown-field", node, what, hint)
        return ANY

    def _index(self, node: Expression, kind: DataType, index: DataType) -> DataType:
        if isinstance(kind, Array):
            if index != ANY and not is_number(index):
                self._error("type-mismatch", node, f"an index of type {describe(index)}")
            return kind.element
        if kind == STRING:
            return STRING
        if isinstance(kind, Primitive) and kind != ANY:
            self._error("type-mismatch", node, f"a value of type {describe(kind)} has no elements")
        return ANY

    def _check_index(self, inner: Expression, kind: DataType, index: Expression) -> None:
        """Report an index that is written out and never in range."""
        known, value = _computed(index)
        is_number_ = isinstance(value, int | float) and not isinstance(value, bool)
        if not isinstance(kind, Array) or not known or not is_number_:
            return
        length = len(inner.elements) if isinstance(inner, ArrayLiteral) else kind.length
        most = math.inf if length is None else length
        if not 0 <= value < most or value != math.floor(value):
            size = "an array" if length is None else f"an array of {length}"
            hint = "elements are numbered from 0"
            what = f"{size} has no element {to_string(value)}"
            self._error("out-of-range", index, what, hint)

    def _unary(self, node: Expression, operator: str, kind: DataType) -> DataType:
        result = PREFIX[operator].result
        if result is not None:
            return result
        if kind != ANY and not is_number(kind):
            what = f"`{operator}` applied to {describe(kind)}"
            if not self._let_through(node, f"{what}, which becomes a number: ToNumber", kind):
                self._error("type-mismatch", node, what)
            return NUMBER
        return kind if kind != ANY else NUMBER

    def _binary(self, node: Binary, left: DataType, right: DataType) -> DataType:
        operator = BINARY[node.operator]
        if operator.is_comparison:
            if not _comparable(left, right, ordered=not operator.is_equality):
                self._mixed(node, left, right)
            return BOOL
        adds = operator.symbol == "+"
        if adds and STRING in (left, right):
            other = right if left == STRING else left
            if isinstance(other, Array | Structure):
                self._mixed(node, left, right)
            return STRING
        for kind in (left, right):
            if kind != ANY and not is_number(kind):
                self._mixed(node, left, right)
                return NUMBER
        if operator.result is not None:
            return operator.result
        if ANY in (left, right):
            return ANY if adds else NUMBER
        return common_type(left, right) or NUMBER

    def _mixed(self, node: Binary, left: DataType, right: DataType) -> None:
        what = f"`{node.operator}` between {describe(left)} and {describe(right)}"
        converts = not BINARY[node.operator].is_strict
        if converts and self._let_through(
            node, f"{what} takes both as numbers: ToNumber", left, right
        ):
            return
        self._error("type-mismatch", node, what, "both sides must have one type")

    def _math(self, function: str, arguments: tuple[Expression, ...]) -> DataType:
        kinds = []
        for argument in arguments:
            kind = self.type_of(argument)
            kinds.append(kind)
            if kind != ANY and not is_number(kind):
                what = f"Math.{function} of a value of type {describe(kind)}"
                becomes = f"{what}, which becomes a number: ToNumber"
                if not self._let_through(argument, becomes, kind):
                    self._error("type-mismatch", argument, what)
        if function in INTEGRAL_MATH:
            return INT64
        if function in ("abs", "max", "min") and kinds and all(is_integer(kind) for kind in kinds):
            return INT64
        return FLOAT64

    def _array(
        self, node: Expression, elements: tuple[Expression, ...], expected: DataType | None
    ) -> DataType:
        inner = expected.element if isinstance(expected, Array) else None
        kinds = [self.type_of(element, inner) for element in elements]
        if inner is not None and self._log is not None:
            for element in elements:
                self.check_fits(element, inner)
            if elements:  # `[]` is all zero
                self._check_length(node, len(elements), expected)
        if inner is not None:
            return Array(inner)
        common: DataType | None = kinds[0] if kinds else ANY
        for kind in kinds[1:]:
            common = common_type(common, kind) if common is not None else None
        return Array(common or ANY)

    def _array_from(self, node: ArrayFrom, expected: DataType | None) -> DataType:
        kind = self.type_of(node.length)
        if kind != ANY and not is_number(kind):
            what = f"a length of type {describe(kind)}"
            becomes = f"{what}, which becomes a number: ToNumber"
            if not self._let_through(node.length, becomes, kind):
                self._error(
                    "type-mismatch", node.length, what, "the length of an array is a number"
                )
        inner = expected.element if isinstance(expected, Array) else None
        element = self.type_of(node.item, inner)
        if inner is not None and self._log is not None:
            self.check_fits(node.item, inner)
        count = array_length(node)
        if count is not None and count > node.most:
            hint = "" if node.most == MAX_LENGTH else "so many where one Array.from is in another"
            what = f"{to_string(count)} elements, at most {node.most} fit"
            self._error("out-of-range", node.length, what, hint)
        elif count is not None:
            self._check_length(node, int(count), expected)
        return Array(inner if inner is not None else element)

    def _check_length(self, node: Expression, count: int, expected: DataType | None) -> None:
        """Report an array that is too long, or too short for a fixed length."""
        if not isinstance(expected, Array) or expected.length is None:
            return
        if count > expected.length:
            self._error("out-of-range", node, f"{count} elements, at most {expected.length} fit")
        elif expected.fixed and count < expected.length:
            hint = "give all of them, or none: `[]` is an array of zeros"
            what = f"{count} elements, {expected.length} are needed"
            self._error("out-of-range", node, what, hint)

    def _object(
        self,
        node: Expression,
        entries: tuple[tuple[str, Expression], ...],
        expected: DataType | None,
    ) -> DataType:
        wanted = expected if isinstance(expected, Structure) else None
        fields = []
        for key, value in entries:
            inner = wanted.field(key) if wanted is not None else None
            if wanted is not None and inner is None:
                self._error(
                    "unknown-field",
                    node,
                    f"{describe(wanted)} has no field `{key}`",
                    nearest(key, (name for name, _ in wanted.fields)),
                )
            kind = self.type_of(value, inner)
            if inner is not None and self._log is not None:
                self.check_fits(value, inner)
            fields.append((key, kind))
        return wanted if wanted is not None else Structure("", tuple(fields))


def _becoming(value: Any, kind: DataType, target: DataType) -> str:
    """What becomes of ``value`` (None: not known), of one scalar type, in a place of another."""
    if target in (STRING, BOOL):
        how = "ToString" if target == STRING else "ToBoolean"
    elif is_number(kind):
        how = "truncated"
    else:
        how = "ToNumber, truncated" if is_integer(target) else "ToNumber"
    if value is None:
        return f"a value of type {describe(kind)} becomes one of type {describe(target)}: {how}"
    number = to_number(value)
    if is_integer(target) and not math.isfinite(number):
        how = f"no integer is {to_string(number)}"
    return f"{_shown(value)} becomes {_shown(convert(value, target, lenient=True))}: {how}"


def _shown(value: Any) -> str:
    return f"`'{shortened(value, SHOWN)}'`" if isinstance(value, str) else f"`{to_string(value)}`"


def _literal_type(value: bool | int | float | str | None) -> DataType:
    match value:
        case None:
            return NULL
        case bool():
            return BOOL
        case str():
            return STRING
        case int():
            return INT64
        case float():
            return FLOAT64


def _comparable(left: DataType, right: DataType, ordered: bool) -> bool:
    if ANY in (left, right) or left == right:
        return True
    if NULL in (left, right):
        return not ordered
    if is_number(left) and is_number(right):
        return True
    return isinstance(left, Structure) and isinstance(right, Structure)


def common_type(left: DataType, right: DataType) -> DataType | None:
    """The narrowest type that holds both, if there is one."""
    if left == right:
        return left
    if ANY in (left, right):
        return ANY
    if is_integer(left) and is_integer(right):
        return INT64
    if is_number(left) and is_number(right):
        return NUMBER if NUMBER in (left, right) else FLOAT64
    return None
