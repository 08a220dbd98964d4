"""Expressions as closures over the step that is being taken.

An interpretation of its own, beside the generated code: the tree is walked once, when the oracle is
made, and every node becomes a Python function. Two variants exist: one for steps in which all values
are known, and one that also takes :class:`~moon.oracle.unknowns.Unknown` values.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Callable, Mapping
from typing import Any

from m2c.language import ecmascript
from m2c.language.certainty import Certainty, Fit
from m2c.language.conversion import STATUSES, check_length
from m2c.language.datatypes import (
    ANY,
    BOOL,
    Array,
    DataType,
    Structure,
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
    nodes,
)
from m2c.language.operators import BINARY, OPERATORS
from m2c.language.typing import Scope, type_of
from m2c.language.values import converter, zero
from m2c.model.walk import is_draw
from moon.oracle import unknowns
from moon.oracle.steps import Step
from moon.oracle.unknowns import Unknown

Evaluate = Callable[[Step], Any]

MAX_ALTERNATIVES = 64
"""So many ways an element of ``Array.from`` can be drawn are told apart."""

_SYMBOLIC = {
    operator: unknowns.arithmetic(operator, OPERATORS[operator])
    for operator in BINARY
    if not BINARY[operator].is_comparison
}


class Closures:
    """Turns the expressions of one machine into closures.

    Args:
        variables: place of each variable in the step's data.
        scope: types, for constants of interface definitions.
        symbolic: whether values may be unknown.
    """

    def __init__(self, variables: Mapping[str, int], scope: Scope, symbolic: bool) -> None:
        self._variables = variables
        self._scope = scope
        self._certainty = Certainty(scope)
        self._symbolic = symbolic

    def value(self, node: Expression, target: DataType | None = None) -> Evaluate:
        """A closure for ``node`` as a value for a place of type ``target``, converted to that type."""
        match node:
            case Conditional(test=test, then=then, otherwise=otherwise) if target is not None:
                chosen = self.condition(test)
                first, second = self.value(then, target), self.value(otherwise, target)
                return lambda step: first(step) if chosen(step) else second(step)
            case ArrayLiteral(elements=elements) if isinstance(target, Array):
                return self._array(elements, target)
            case ArrayFrom() if isinstance(target, Array):
                return self._array_from(node, target)
            case ObjectLiteral(entries=entries) if isinstance(target, Structure) and target.name:
                return self._message(entries, target)
        evaluate = self._compile(node)
        if target is None:
            return evaluate
        return self._into(evaluate, self._certainty.fit(node, target), target)

    def element(self, array: Expression, target: DataType) -> Evaluate:
        """A closure for the element that a loop over ``array`` is at, for a place of type ``target``."""
        kind = self._certainty.of(array).kind
        is_same = isinstance(kind, Array) and kind.element == target
        return self._into(_at_the_element, Fit.AS_IS if is_same else Fit.MAY_FAIL, target)

    def _into(self, evaluate: Evaluate, fit: Fit, target: DataType) -> Evaluate:
        """``evaluate`` with its value converted to ``target``, where it may be of another type."""
        if fit is Fit.AS_IS:
            return evaluate
        lenient = self._scope.lenient
        convert = converter(target, lenient=lenient)
        if not self._symbolic:
            return lambda step: convert(evaluate(step))
        around = functools.partial(unknowns.tolerant, lenient=lenient)
        tolerant = converter(target, around, lenient)
        fails, place = fit is Fit.MAY_FAIL, f"fits {target}"

        def converted(step: Step) -> Any:
            value = evaluate(step)
            if not unknowns.is_unknown(value):
                return convert(value)
            if fails and not unknowns.is_whole(value, target) and not step.whether(place, value):
                raise ecmascript.ExecutionError("a value that is not known may not fit")
            return tolerant(value)

        return converted

    def status(self, node: Expression) -> Evaluate:
        """A closure for the name of the status that ``node`` is: a literal, or a variable that holds one."""
        evaluate = self._compile(node)
        if isinstance(node, Literal):
            return evaluate

        def name(step: Step) -> Any:
            value = evaluate(step)
            if not unknowns.is_unknown(value):
                return ecmascript.to_status(value)
            if not step.whether("is a status", value):
                raise ecmascript.ExecutionError("a value that is not known may be no status")
            return unknowns.anything()

        return name

    def _array(self, elements: tuple[Expression, ...], target: Array) -> Evaluate:
        if not elements and target.fixed:
            return lambda step: zero(target)
        items = [self.value(element, target.element) for element in elements]
        least = (target.length or 0) if target.fixed else 0

        def make(step: Step) -> list[Any]:
            made = [item(step) for item in items]
            check_length(len(made), target.length, least)
            return made

        return make

    def _array_from(self, node: ArrayFrom, target: Array) -> Evaluate:
        """``Array.from`` for a place of type ``target``; each element that is drawn is one of its own."""
        length, item, bound = (
            self._compile(node.length),
            self.value(node.item, target.element),
            node.most,
        )
        least = (target.length or 0) if target.fixed else 0
        drawn = self._symbolic and any(map(is_draw, nodes(node.item)))
        alike = not any(
            isinstance(n, Parameter) and n.depth == node.depth for n in nodes(node.item)
        )

        def make(step: Step) -> Any:
            wanted = step.enumerated(length(step))
            if wanted.__class__ is Unknown:
                fits = not wanted.anything and wanted.high <= bound
                if not fits and not step.whether("is a length", wanted):
                    raise ecmascript.ExecutionError("a length that is not known may be too great")
                return unknowns.anything()
            count = ecmascript.to_length(wanted, bound)
            check_length(count, target.length, least)
            around, made, fails = step.places[: node.depth], [], False
            for index in range(count):
                step.places = (*around, index)
                if not drawn:
                    made.append(item(step))
                elif index == 0 or not alike:
                    found, failing = step.every(item, MAX_ALTERNATIVES)
                    fails = fails or failing
                    made.append(unknowns.one_of(found))
                else:
                    made.append(unknowns.another(made[0]))
            if fails and step.either():
                raise ecmascript.ExecutionError("an element may not be what it has to be")
            return made

        return make

    def _message(self, entries: tuple[tuple[str, Expression], ...], target: Structure) -> Evaluate:
        template = zero(target)
        pairs = [(key, self.value(value, target.field(key))) for key, value in entries]

        def make(step: Step) -> dict[str, Any]:
            made: dict[str, Any] = copy.deepcopy(template)
            for key, value in pairs:
                made[key] = value(step)
            return made

        return make

    def condition(self, node: Expression) -> Callable[[Step], bool]:
        """A closure for ``node`` as a condition."""
        evaluate = self._compile(node)
        truthy = ecmascript.truthy
        if not self._symbolic:

            def holds(step: Step) -> bool:
                value = evaluate(step)
                return value if value is True or value is False else truthy(value)

            return holds

        is_bool = type_of(node, self._scope) == BOOL

        def may_hold(step: Step) -> bool:
            value = evaluate(step)
            if value is True or value is False:
                return value
            if value.__class__ is not Unknown:
                return truthy(value)
            holds = step.whether("holds", value)
            if is_bool:
                step.replace(value, holds)
            return holds

        return may_hold

    def _compile(self, node: Expression) -> Evaluate:
        match node:
            case Literal(value=value):
                return lambda step: value
            case Variable(name=name):
                place = self._variables.get(name)
                if place is None:
                    if name in STATUSES:
                        return lambda step: name
                    return _undefined(name)
                return lambda step: step.data[place]
            case EventData(part="data"):
                return lambda step: step.message
            case EventData(part=part):
                return lambda step: step.parts.get(part)
            case PortInput(key=key):
                return lambda step: step.parts.get(f"port:{key}")
            case Member(object=inner, name=name):
                return self._member(inner, name)
            case Index(object=inner, index=index):
                holder, place_of = self._holder(inner), self._compile(index)
                return lambda step: _element(step, holder(step), place_of(step))
            case Unary(operator="!", operand=operand):
                test = self.condition(operand)
                return lambda step: not test(step)
            case Unary(operator="-", operand=operand):
                minus = self._compile(operand)
                return lambda step: unknowns.negate(minus(step))
            case Unary(operator="+", operand=operand):
                plus = self._compile(operand)
                return lambda step: unknowns.to_number(plus(step))
            case Unary(operand=operand):
                named = self._compile(operand)
                return lambda step: unknowns.type_name(named(step))
            case Binary():
                return self._binary(node)
            case Logical(operator=operator, left=left, right=right):
                return self._logical(operator, left, right)
            case Conditional(test=test_node, then=then, otherwise=otherwise):
                chosen, first, second = (
                    self.condition(test_node),
                    self._compile(then),
                    self._compile(otherwise),
                )
                return lambda step: first(step) if chosen(step) else second(step)
            case MathCall(function="random"):
                return lambda step: unknowns.draw()
            case MathCall(function=function, arguments=arguments):
                call = unknowns.mathematics(function, ecmascript.MATH[function])
                values = [self._compile(argument) for argument in arguments]
                return lambda step: call(*(value(step) for value in values))
            case MathConstant(name=name):
                constant = ecmascript.CONSTANTS[name]
                return lambda step: constant
            case ArrayLiteral(elements=elements):
                items = [self.value(element, ANY) for element in elements]
                return lambda step: [item(step) for item in items]
            case Parameter(depth=depth):
                return lambda step: step.places[depth]
            case ArrayFrom():
                return self._array_from(node, Array(ANY))
            case ObjectLiteral(entries=entries):
                pairs = [(key, self.value(value, ANY)) for key, value in entries]
                return lambda step: {key: value(step) for key, value in pairs}

    def _member(self, inner: Expression, name: str) -> Evaluate:
        kind = type_of(inner, self._scope)
        if isinstance(kind, Structure) and kind.field(name) is None:
            for constant, _, value in kind.constants:
                if constant == name:
                    return lambda step: value
        holder = self._holder(inner)
        only = only_array(kind) if name == "length" else None
        inner_kind = part(kind, name) if isinstance(kind, Structure) else None
        if only is not None:
            return lambda step: _member(step, _member(step, holder(step), only), name)
        if isinstance(kind, Array) and name != "length" and part(kind, name) is not None:
            return lambda step: _column(holder(step), name)
        if isinstance(kind, Array) and name == "length":
            return lambda step: _length(step, holder(step))
        return lambda step: _member(step, holder(step), name, inner_kind)

    def _holder(self, node: Expression) -> Evaluate:
        """A closure for ``node``, of which a part is asked: if it may be undefined, that may fail."""
        evaluate = self._compile(node)
        if not self._symbolic or not self._certainty.may_be_undefined(node):
            return evaluate

        def defined(step: Step) -> Any:
            value = evaluate(step)
            if value.__class__ is Unknown and not step.whether("is defined", value):
                raise ecmascript.ExecutionError("a part of a value that may be undefined")
            return value

        return defined

    def _binary(self, node: Binary) -> Evaluate:
        left, right = self._compile(node.left), self._compile(node.right)
        operator = node.operator
        exact = OPERATORS[operator]
        if not self._symbolic:
            return lambda step: exact(left(step), right(step))
        if operator in _SYMBOLIC:
            operate = _SYMBOLIC[operator]

            def operated(step: Step) -> Any:
                first, second = step.enumerated(left(step)), step.enumerated(right(step))
                if first.__class__ is not Unknown and second.__class__ is not Unknown:
                    return exact(first, second)
                return step.found(operator, (first, second), lambda: operate(first, second))

            return operated

        kinds = type_of(node.left, self._scope), type_of(node.right, self._scope)
        alike = kinds[0] == kinds[1] != ANY or (is_number(kinds[0]) and is_number(kinds[1]))
        tells = alike or len(operator) == 3 or not self._scope.lenient

        def related(step: Step) -> bool:
            first, second = left(step), right(step)
            if first.__class__ is not Unknown and second.__class__ is not Unknown:
                return bool(exact(first, second))
            return relate(step, operator, first, second, tells)

        return related

    def _logical(self, operator: str, left: Expression, right: Expression) -> Evaluate:
        first, second = self._compile(left), self._compile(right)
        keeps = operator == "||"
        truthy = ecmascript.truthy

        def choose(step: Step) -> Any:
            value = first(step)
            if value.__class__ is Unknown:
                holds = step.whether("holds", value)
                if holds == keeps:
                    return holds if value.anything else value
                return second(step)
            return value if truthy(value) == keeps else second(step)

        return choose


def _at_the_element(step: Step) -> Any:
    return step.element


def relate(step: Step, operator: str, left: Any, right: Any, tells: bool = True) -> bool:
    """A comparison with an unknown side: what is certain, else both, each remembered.

    Args:
        step: the step that is taken.
        operator: of the comparison.
        left: its left side.
        right: its right side.
        tells: whether a value of which nothing is known is the one that it is equal to, not another that
            becomes it: ``'3' == 3``.
    """
    if operator in ("==", "===", "!=", "!=="):
        loosely = len(operator) == 2
        equal = _may_equal(step, left, right, loosely, tells)
        return equal if operator[0] == "=" else not equal
    if left is right and not left.anything:
        return operator in ("<=", ">=")  # one number, whichever it is
    certain = unknowns.compare(operator, left, right)
    if certain is not None:
        return certain
    holds = step.whether(operator, left, right)
    if isinstance(left, Unknown) and isinstance(right, int | float) and not left.anything:
        step.replace(left, unknowns.narrowed(left, operator, right, holds))
    elif isinstance(right, Unknown) and isinstance(left, int | float) and not right.anything:
        mirrored = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}[operator]
        step.replace(right, unknowns.narrowed(right, mirrored, left, holds))
    return holds


def _may_equal(step: Step, left: Any, right: Any, loosely: bool, tells: bool) -> bool:
    if left is right:
        return True
    unknown, other = (left, right) if isinstance(left, Unknown) else (right, left)
    if loosely and isinstance(other, str | bool) and not unknown.anything:
        other = ecmascript.to_number(other)  # ECMA-262 7.2.13 IsLooselyEqual
    if not isinstance(other, Unknown) and not unknown.allows(other):
        return False
    equal = step.whether("loosely equal" if loosely else "equal", unknown, other)
    if equal and not isinstance(other, Unknown) and (tells or not unknown.anything):
        step.replace(unknown, other)
    return equal


def _undefined(name: str) -> Evaluate:
    def fail(step: Step) -> Any:
        raise ecmascript.ExecutionError(f"`{name}` is not defined")

    return fail


def _member(step: Step, value: Any, name: str, kind: DataType | None = None) -> Any:
    if value.__class__ is dict and name in value:
        return value[name]
    if value.__class__ is Unknown:
        return step.found(f".{name}", (value,), lambda: unknowns.unknown_of(kind))
    return ecmascript.member(value, name)


def _length(step: Step, value: Any) -> Any:
    """How many elements an array has."""
    if value.__class__ is Unknown:
        return step.found(".length", (value,), unknowns.length)
    return ecmascript.member(value, "length")


def _column(value: Any, name: str) -> Any:
    """The field ``name`` of each structure in an array; unknown where the array or one of them is."""
    if value.__class__ is Unknown or Unknown in map(type, value or ()):
        return unknowns.anything()
    return ecmascript.column(value, name)


def _element(step: Step, value: Any, index: Any) -> Any:
    if value.__class__ is Unknown or index.__class__ is Unknown:
        return step.found("[]", (value, index), unknowns.anything)
    return ecmascript.element(value, index)
