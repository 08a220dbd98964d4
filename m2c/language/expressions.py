"""Expressions of a model: the ECMAScript sub-language as a typed syntax tree.

The tree is what the checks, the code generator and the model oracle work on; source text is parsed
once (``m2c.language.parsing``) and never evaluated. Event data has one spelling here, whichever
root the model used: ``_msg.x``, ``_req.x``, ``_res.x``, ``_feedback.x``, ``_goal.x``,
``_wrapped_result.result.x`` and ``_event.data.x`` are all ``Member(EventData("data"), "x")``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Literal as OneOf

import msgspec

from m2c.diagnostics import Position
from m2c.language.conversion import MAX_LENGTH


class Node(msgspec.Struct, frozen=True, tag=True, kw_only=True):
    """What every expression has: where it stands in the model."""

    position: Position = msgspec.field(default_factory=lambda: Position(""))


class Literal(Node, frozen=True):
    """``1``, ``0.5``, ``'text'``, ``true``, ``null``/``undefined`` (value None).

    A whole number (``1``, ``1.0``, ``1e3``) is an int, any other a float; the Python spellings ``True`` and
    ``False`` that real models use are read as booleans.
    """

    value: bool | int | float | str | None


class Variable(Node, frozen=True):
    """A datamodel variable."""

    name: str


class InState(Variable, frozen=True):
    """``In('moving')``: whether the machine is in that state, or in one inside it (W3C SCXML 5.9.1).

    ``name`` is how it is written. A state or its path tells; lowered machines have a literal instead.
    """

    state: str


EventPart = OneOf["data", "goal_id", "thread_id", "code", "status", "name"]


class EventData(Node, frozen=True):
    """Something of the event being processed.

    ``data``: the message, request, response, feedback, goal, result or event parameters;
    ``goal_id``: an action's goal (``_action.goal_id``, ``_event.goal_id``); ``thread_id``: an
    action thread (``_event.thread_id``); ``code``: ``_wrapped_result.code``; ``status``: a behaviour
    tree child's status (``_bt.status``); ``name``: ``_event.name``.
    """

    part: EventPart
    spelling: str = "_event.data"


class PortInput(Node, frozen=True):
    """The value of a behaviour-tree input port: ``<bt_get_input key="…"/>``."""

    key: str


class Member(Node, frozen=True):
    """``object.name``; ``.length`` of arrays and strings included."""

    object: Expression
    name: str


class Index(Node, frozen=True):
    """``object[index]``; out of range is undefined (None), as in ECMAScript."""

    object: Expression
    index: Expression


class Unary(Node, frozen=True):
    """``!x``, ``-x``, ``+x``, ``typeof x``."""

    operator: OneOf["!", "-", "+", "typeof"]
    operand: Expression


class Binary(Node, frozen=True):
    """Arithmetic and comparison with ECMAScript's meaning."""

    operator: OneOf["+", "-", "*", "/", "%", "**", "==", "!=", "===", "!==", "<", "<=", ">", ">="]
    left: Expression
    right: Expression


class Logical(Node, frozen=True):
    """``&&`` and ``||``: the value of an operand, not necessarily a boolean."""

    operator: OneOf["&&", "||"]
    left: Expression
    right: Expression


class Conditional(Node, frozen=True):
    """``test ? then : otherwise``."""

    test: Expression
    then: Expression
    otherwise: Expression


class MathCall(Node, frozen=True):
    """``Math.function(arguments…)``; ``Math.random()`` leaves the choice open."""

    function: str
    arguments: tuple[Expression, ...] = ()


class MathConstant(Node, frozen=True):
    """``Math.PI`` and its like."""

    name: str


class ArrayLiteral(Node, frozen=True):
    """``[a, b]``."""

    elements: tuple[Expression, ...] = ()


class Parameter(Node, frozen=True):
    """The index that the function of an :class:`ArrayFrom` is called with.

    ``depth``: in how many other such functions that one stands.
    """

    name: str
    depth: int = 0


class ArrayFrom(Node, frozen=True):
    """``Array.from({length: n}, (_, i) => item)``: ``item`` evaluated for each place (ECMA-262 23.1.2.1).

    ``index`` is the name of the second parameter, "" without one; ``depth`` as its :class:`Parameter` has it;
    ``most``: elements that it may have.
    """

    length: Expression
    item: Expression
    index: str = ""
    depth: int = 0
    most: int = MAX_LENGTH


class ObjectLiteral(Node, frozen=True):
    """``{'key': value}``."""

    entries: tuple[tuple[str, Expression], ...] = ()


Expression = (
    Literal
    | Variable
    | EventData
    | PortInput
    | Member
    | Index
    | Unary
    | Binary
    | Logical
    | Conditional
    | MathCall
    | MathConstant
    | ArrayLiteral
    | Parameter
    | ArrayFrom
    | ObjectLiteral
)

Location = Variable | Member | Index
"""What can be assigned to: ``a``, ``a.b``, ``a[i]``, ``a.length`` (Member with name ``length``)."""


def children(expression: Expression) -> tuple[Expression, ...]:
    """The direct sub-expressions of ``expression``, left to right."""
    match expression:
        case Member(object=inner):
            return (inner,)
        case Index(object=inner, index=index):
            return (inner, index)
        case Unary(operand=operand):
            return (operand,)
        case Binary(left=left, right=right) | Logical(left=left, right=right):
            return (left, right)
        case Conditional(test=test, then=then, otherwise=otherwise):
            return (test, then, otherwise)
        case MathCall(arguments=arguments):
            return arguments
        case ArrayLiteral(elements=elements):
            return elements
        case ArrayFrom(length=length, item=item):
            return (length, item)
        case ObjectLiteral(entries=entries):
            return tuple(value for _, value in entries)
        case _:
            return ()


def nodes(expression: Expression) -> Iterator[Expression]:
    """``expression`` and every expression in it."""
    yield expression
    for child in children(expression):
        yield from nodes(child)


def is_settled(expression: Expression, known: Collection[str] = ()) -> bool:
    """Whether ``expression`` has one value, given those of the variables ``known``."""
    match expression:
        case Variable(name=name):
            return name in known
        case EventData() | PortInput() | Parameter() | MathCall(function="random"):
            return False
        case _:
            return all(is_settled(child, known) for child in children(expression))
