"""A direct interpreter of expressions.

Generated code is compiled; whoever checks it interprets. Two implementations of one semantics, held
together by differential tests, so that one fault is not blind to itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from m2c.language import ecmascript
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
from m2c.language.operators import OPERATORS, UNARY_OPERATORS


def evaluate(expression: Expression, variables: Mapping[str, Any], event: Mapping[str, Any]) -> Any:
    """The value of ``expression``.

    Args:
        expression: what to evaluate.
        variables: the datamodel.
        event: the event's parts (``data``, ``goal_id``, …).

    Raises:
        ecmascript.ExecutionError: ECMAScript would throw, or the value is drawn at random.
    """
    match expression:
        case Literal(value=value):
            return value
        case Variable(name=name):
            if name not in variables:
                raise ecmascript.ExecutionError(f"`{name}` is not defined")
            return variables[name]
        case EventData(part=part):
            return event.get(part)
        case PortInput(key=key):
            return event.get(f"port:{key}")
        case Member(object=inner, name=name):
            return ecmascript.member(evaluate(inner, variables, event), name)
        case Index(object=inner, index=index):
            return ecmascript.element(
                evaluate(inner, variables, event), evaluate(index, variables, event)
            )
        case Unary(operator=operator, operand=operand):
            return UNARY_OPERATORS[operator](evaluate(operand, variables, event))
        case Binary(operator=operator, left=left, right=right):
            return OPERATORS[operator](
                evaluate(left, variables, event), evaluate(right, variables, event)
            )
        case Logical(operator=operator, left=left, right=right):
            value = evaluate(left, variables, event)
            keep = ecmascript.truthy(value) == (operator == "||")
            return value if keep else evaluate(right, variables, event)
        case Conditional(test=test, then=then, otherwise=otherwise):
            chosen = then if ecmascript.truthy(evaluate(test, variables, event)) else otherwise
            return evaluate(chosen, variables, event)
        case MathCall(function="random"):
            raise ecmascript.ExecutionError("the value of Math.random() is open")
        case MathCall(function=function, arguments=arguments):
            return ecmascript.MATH[function](
                *(evaluate(argument, variables, event) for argument in arguments)
            )
        case MathConstant(name=name):
            return ecmascript.CONSTANTS[name]
        case ArrayLiteral(elements=elements):
            return [evaluate(element, variables, event) for element in elements]
        case Parameter(depth=depth):
            return event[f"index:{depth}"]
        case ArrayFrom(length=length, item=item, depth=depth, most=most):
            count = ecmascript.to_length(evaluate(length, variables, event), most)
            indices = ({**event, f"index:{depth}": index} for index in range(count))
            return [evaluate(item, variables, each) for each in indices]
        case ObjectLiteral(entries=entries):
            return {key: evaluate(value, variables, event) for key, value in entries}
