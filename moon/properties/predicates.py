"""Predicates: what they mean for a message, which names a channel sets, the functions that do it.

*To Python*, strictly, so that a strange value never turns into a verdict. The expression language is the
models', but where a model would convert, a monitor must not guess: comparing a number with a string, a
NaN, a field that is not there or contents that are not known make the predicate *unknown*
(:class:`UnknownValue`), not true or false.

*From observations* (:func:`bind`). Per channel and group of kinds one function is written into the compiled
monitor: it takes the values out of the message, evaluates the predicates that use them and, only if one
of them changed or something is due, brings the network to the observation's instant.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import msgspec

from m2c.language import ecmascript
from m2c.language.evaluate import evaluate
from m2c.language.expressions import (
    ArrayLiteral,
    Binary,
    Conditional,
    Expression,
    Index,
    Literal,
    Logical,
    MathCall,
    MathConstant,
    Member,
    Unary,
    Variable,
)
from m2c.language.operators import BINARY, LOGICAL, OPERATORS, UNARY_OPERATORS
from m2c.language.text import expression_text
from m2c.model.walk import variables_of
from moon.properties.formula import Formula, Predicate, predicates
from moon.properties.property import Port
from transports.interface import ObservationKind


class UnknownValue(Exception):
    """A predicate has no value here; the text says why."""


class PredicateError(ValueError):
    """An expression that cannot be a predicate."""


def truth_source(expression: Expression, names: dict[str, str]) -> str:
    """Python source of ``expression``, for a place where a boolean is needed.

    Args:
        expression: over names of :data:`ENVIRONMENT`, too.
        names: the Python names of its variables.

    Raises:
        PredicateError: it uses something that only a model has, randomness, or an unknown variable.
    """
    return _Source(names).truth(expression)


_COMPARE = {
    "<": "less",
    "<=": "at_most",
    ">": "more",
    ">=": "at_least",
    "==": "same",
    "!=": "different",
}
"""What compares two values that need not be whole numbers, by Python's operator."""


class _Source:
    def __init__(self, names: dict[str, str]) -> None:
        self._names = names
        self._temporaries = 0

    def truth(self, expression: Expression) -> str:
        match expression:
            case Binary(operator=operator) if BINARY[operator].is_comparison:
                return self.value(expression)
            case Logical(operator=operator, left=left, right=right):
                return f"({self.truth(left)} {LOGICAL[operator][1]} {self.truth(right)})"
            case Unary(operator="!", operand=operand):
                return f"(not {self.truth(operand)})"
            case _:
                name = self._temporary()
                text = self.value(expression)
                return f"({name} if ({name} := {text}).__class__ is bool else truth({name}))"

    def value(self, expression: Expression) -> str:
        match expression:
            case Literal(value=value):
                return _literal(value)
            case Variable(name=name):
                if name not in self._names:
                    raise PredicateError(f"`{name}` is not declared")
                return self._names[name]
            case Member(object=Literal() | ArrayLiteral()):
                raise PredicateError(
                    f"`{expression_text(expression, json.dumps)}` has no value in a property"
                )
            case Member(object=inner, name=name):
                if name == "length":
                    return f"length({self.value(inner)})"
                return f"{self.value(inner)}[{name!r}]"
            case Index(object=inner, index=index):
                return f"element({self.value(inner)}, {self.value(index)})"
            case Unary(operator="!", operand=operand):
                return f"(not {self.truth(operand)})"
            case Unary(operator=operator, operand=operand):
                return f"unary({operator!r}, {self.value(operand)})"
            case Binary(operator=operator, left=left, right=right):
                return self._binary(operator, left, right)
            case Logical():
                return self.truth(expression)
            case Conditional(test=test, then=then, otherwise=otherwise):
                chosen = f"{self.value(then)} if {self.truth(test)} else {self.value(otherwise)}"
                return f"({chosen})"
            case MathCall(function="random"):
                raise PredicateError("Math.random() has no place in a property")
            case MathCall(function=function, arguments=arguments):
                inside = "".join(f"{self.value(argument)}, " for argument in arguments)
                return f"mathematics({function!r}, ({inside}))"
            case MathConstant():
                return repr(evaluate(expression, {}, {}))
            case ArrayLiteral(elements=elements):
                return f"[{', '.join(self.value(element) for element in elements)}]"
            case _:
                raise PredicateError(
                    f"`{expression_text(expression, json.dumps)}` has no value in a property"
                )

    def _binary(self, operator: str, left: Expression, right: Expression) -> str:
        first, second = self.value(left), self.value(right)
        if not BINARY[operator].is_comparison:
            return f"arithmetic({operator!r}, {first}, {second})"
        python = BINARY[operator].python
        slow = _COMPARE[python]
        # the common case in line: an integer against an integer literal
        if isinstance(right, Literal) and type(right.value) in (int, float):
            name = self._temporary()
            fast = f"{name} {python} {second}"
            return f"({fast} if ({name} := {first}).__class__ is int else {slow}({name}, {second}))"
        return f"{slow}({first}, {second})"

    def _temporary(self) -> str:
        self._temporaries += 1
        return f"_{self._temporaries}"


def _literal(value: Any) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return f'float("{value}")'
    return repr(value)


def _kind(value: Any) -> str:
    match value:
        case bool():
            return "boolean"
        case int() | float():
            if value != value:  # noqa: PLR0124 - NaN differs from itself
                raise UnknownValue("the value is NaN")
            return "number"
        case str():
            return "string"
        case None:
            raise UnknownValue("the value is not known")
        case list() | tuple():
            return "array"
        case _:
            return "object"


def _alike(left: Any, right: Any, operation: str) -> str:
    first, second = _kind(left), _kind(right)
    if first != second:
        raise UnknownValue(f"`{operation}` of a {first} and a {second}")
    return first


def _ordered(left: Any, right: Any, operation: str) -> None:
    kind = _alike(left, right, operation)
    if kind not in ("number", "string"):
        raise UnknownValue(f"`{operation}` of a {kind}")


def less(left: Any, right: Any) -> bool:
    """``<`` of two numbers or two strings."""
    _ordered(left, right, "<")
    return bool(left < right)


def at_most(left: Any, right: Any) -> bool:
    """``<=`` of two numbers or two strings."""
    _ordered(left, right, "<=")
    return bool(left <= right)


def more(left: Any, right: Any) -> bool:
    """``>`` of two numbers or two strings."""
    _ordered(left, right, ">")
    return bool(left > right)


def at_least(left: Any, right: Any) -> bool:
    """``>=`` of two numbers or two strings."""
    _ordered(left, right, ">=")
    return bool(left >= right)


def same(left: Any, right: Any) -> bool:
    """``==`` of two values of one kind."""
    _alike(left, right, "==")
    return bool(left == right)


def different(left: Any, right: Any) -> bool:
    """``!=`` of two values of one kind."""
    _alike(left, right, "!=")
    return bool(left != right)


def truth(value: Any) -> bool:
    """A value where a boolean is needed: a number is true unless it is 0; nothing else converts."""
    match _kind(value):
        case "boolean" | "number":
            return bool(value)
        case kind:
            raise UnknownValue(f"a {kind} is neither true nor false")


def arithmetic(operator: str, left: Any, right: Any) -> Any:
    """``+ - * / % **`` of two numbers, ``+`` of two strings, with the models' results."""
    kind = _alike(left, right, operator)
    if kind != "number" and not (kind == "string" and operator == "+"):
        raise UnknownValue(f"`{operator}` of a {kind}")
    found = OPERATORS[operator](left, right)
    _kind(found)
    return found


def unary(operator: str, value: Any) -> Any:
    """``-``, ``+`` of a number; ``typeof``."""
    if operator != "typeof" and _kind(value) != "number":
        raise UnknownValue(f"`{operator}` of a {_kind(value)}")
    return UNARY_OPERATORS[operator](value)


def mathematics(function: str, arguments: tuple[Any, ...]) -> Any:
    """``Math.function(arguments)`` of numbers."""
    for argument in arguments:
        if _kind(argument) != "number":
            raise UnknownValue(f"`Math.{function}` of a {_kind(argument)}")
    found = ecmascript.MATH[function](*arguments)
    _kind(found)
    return found


def length(value: Any) -> Any:
    """``value.length``."""
    if isinstance(value, dict):
        return value["length"]
    return len(value)


def element(value: Any, index: Any) -> Any:
    """``value[index]``; out of range is unknown."""
    if isinstance(index, float) and index.is_integer():
        index = int(index)
    if isinstance(index, int) and (isinstance(index, bool) or index < 0):
        raise UnknownValue(f"there is no element {index}")
    return value[index]


ENVIRONMENT: dict[str, Callable[..., Any]] = {
    function.__name__: function
    for function in (
        *(less, at_most, more, at_least, same, different, truth),
        *(arithmetic, unary, mathematics, length, element),
    )
}
"""What compiled predicates call."""

UNKNOWN_ERRORS = (UnknownValue, KeyError, IndexError, TypeError, OverflowError, AttributeError)
"""What evaluating a predicate may raise; each means that it has no value."""


def why_unknown(error: BaseException) -> str:
    """One clause on why a predicate has no value."""
    match error:
        case UnknownValue():
            return str(error)
        case KeyError():
            return f"there is no field {error}"
        case IndexError():
            return "the index is out of range"
        case _:
            return f"the value has another shape ({error})"


# -- binding: from observations to predicates ---------------------------------------------------

ANY_CHANNEL = "*"
"""Of ports that were not declared: their field may come on any channel."""


class PortGroup(msgspec.Struct, frozen=True):
    """Ports that the same observations set."""

    name: str
    channel: str
    kinds: tuple[ObservationKind, ...]
    ports: tuple[Port, ...]
    atoms: tuple[str, ...]
    """Texts of the predicates that these ports decide (with others' help, perhaps)."""


class Binding(msgspec.Struct, frozen=True):
    """How the names of some formulas get their values.

    Attributes:
        ports: by name.
        atoms: the predicates by text.
        events: texts of predicates that are events.
        groups: the channels' groups.
        evaluate: per state predicate, ``evaluate(values)`` with values by name; raises one of
            ``UNKNOWN_ERRORS`` (:class:`KeyError` for a name without a value).
        conditions: per event port name, whether a message counts.
    """

    ports: dict[str, Port]
    atoms: dict[str, Predicate]
    events: frozenset[str]
    groups: tuple[PortGroup, ...]
    evaluate: dict[str, Callable[[dict[str, Any]], bool]]
    conditions: dict[str, Callable[[Any], bool]]


def bind(formulas: Iterable[Formula], ports: Iterable[Port]) -> Binding:
    """The binding of ``formulas``; names that ``ports`` do not declare are fields on any channel.

    Raises:
        PredicateError: a predicate uses an event inside a larger expression, or what is no value.
    """
    declared = {port.name: port for port in ports}
    atoms: dict[str, Predicate] = {}
    for formula in formulas:
        atoms.update(predicates(formula))
    used: dict[str, Port] = {}
    users: dict[str, list[str]] = {}
    events = set()
    for text, atom in atoms.items():
        names = variables_of(atom.expression)
        for name in names:
            port = declared.get(name) or Port(name, ANY_CHANNEL, (), (name,))
            used[name] = port
            users.setdefault(name, []).append(text)
            if port.event:
                if not isinstance(atom.expression, Variable):
                    raise PredicateError(
                        f"`{text}`: `{name}` is an event; it stands alone, not inside an expression"
                    )
                events.add(text)
    grouped: dict[tuple[str, tuple[ObservationKind, ...]], list[Port]] = {}
    for port in used.values():
        grouped.setdefault((port.channel, port.kinds), []).append(port)
    groups = tuple(
        PortGroup(
            f"on_{number}",
            channel,
            kinds,
            tuple(members),
            tuple(dict.fromkeys(text for port in members for text in users[port.name])),
        )
        for number, ((channel, kinds), members) in enumerate(grouped.items())
    )
    evaluate = {text: _evaluator(atom) for text, atom in atoms.items() if text not in events}
    conditions = {name: _condition(port) for name, port in used.items() if port.event}
    return Binding(used, atoms, frozenset(events), groups, evaluate, conditions)


def _evaluator(atom: Predicate) -> Callable[[dict[str, Any]], bool]:
    names = variables_of(atom.expression)
    source = truth_source(atom.expression, {name: f"values[{name!r}]" for name in names})
    return _function("values", source)


def _condition(port: Port) -> Callable[[Any], bool]:
    if port.condition is None:
        return lambda data: True
    return _function("data", truth_source(port.condition, {"data": "data"}))


def _function(argument: str, source: str) -> Callable[[Any], bool]:
    scope: dict[str, Any] = dict(ENVIRONMENT)
    exec(compile(f"def evaluate({argument}):\n    return {source}\n", "<predicate>", "exec"), scope)
    made: Callable[[Any], bool] = scope["evaluate"]
    return made


def value_of(port: Port, data: Any) -> Any:
    """The value that a message gives a state port.

    Raises:
        UnknownValue: the contents or the field are not there.
    """
    if data is None:
        raise UnknownValue("the contents are not known")
    value = data
    try:
        for name in port.path:
            value = value[name]
    except UNKNOWN_ERRORS as error:
        raise UnknownValue(f"there is no field `{'.'.join(port.path)}`") from error
    return value


class KnownValues:
    """The last value of every state of ``binding``, by port; first, the ports' initial values."""

    def __init__(self, binding: Binding) -> None:
        self._binding = binding
        self.values: dict[str, Any] = {}
        """Without those never observed; None is a value that an observation did not have."""
        self.waiting: set[str] = set()
        """States of which nothing is known: not observed yet (nor initial), or not since a loss."""
        self.lost: dict[str, str] = {}
        """States that a lost message may have set since they were observed last, with the reason."""
        self._names = {text: variables_of(atom.expression) for text, atom in binding.atoms.items()}
        for port in binding.ports.values():
            if not port.event and port.initial is msgspec.UNSET:
                self.waiting.add(port.name)
            elif not port.event:
                self.values[port.name] = port.initial
        self.unseen = frozenset(self.waiting)
        """States that no message has set yet: they have had no value."""
        self.missed: frozenset[str] = frozenset()
        """States of which a message was lost."""

    def take(self, port: Port, data: Any) -> None:
        """Take over what an observation's ``data`` says of ``port``."""
        if port.channel == ANY_CHANNEL:
            if not isinstance(data, Mapping) or port.name not in data:
                return
            self.values[port.name] = data[port.name]
            self._found(port.name)
            return
        self._found(port.name)
        try:
            self.values[port.name] = value_of(port, data)
        except UNKNOWN_ERRORS:
            self.values[port.name] = None

    def settled(self) -> frozenset[str]:
        """The predicates of states of which all messages so far were received, and one at least."""
        events = {port.name for port in self._binding.ports.values() if port.event}
        others = self.unseen | self.missed | events
        return frozenset(text for text, names in self._names.items() if others.isdisjoint(names))

    def _found(self, name: str) -> None:
        self.unseen = self.unseen.difference((name,))
        self.waiting.discard(name)
        self.lost.pop(name, None)

    def lose(self, names: Mapping[str, str]) -> None:
        """The ports ``names`` may have been set by a message that was lost, for the reason given."""
        self.missed = self.missed.union(names)
        for name, reason in names.items():
            if not self._binding.ports[name].event:
                self.waiting.add(name)
                self.lost[name] = reason

    def of_handlers(self) -> dict[str, Any]:
        """The values under the names that the compiled handlers keep them by."""
        return {
            f"X{place}": self.values.get(name) for place, name in enumerate(self._binding.ports)
        }

    def take_from_handlers(self, read: Mapping[str, Any]) -> None:
        """Take over what the handlers' variables ``read`` have kept."""
        for place, name in enumerate(self._binding.ports):
            if (value := read[f"X{place}"]) is not None:
                self.values[name] = value

    def holds(self, text: str) -> bool:
        """Whether the state predicate ``text`` holds; one of ``UNKNOWN_ERRORS`` if it has no value."""
        return self._binding.evaluate[text](self.values)

    def judge(self, text: str, unknown: dict[str, str]) -> bool | None:
        """The state predicate's value; None, with the reason in ``unknown``, if it has none."""
        for name in self._names[text]:
            if name in self.lost:
                unknown[text] = self.lost[name]
                return None
        try:
            value = self.holds(text)
        except UNKNOWN_ERRORS as error:
            unknown[text] = f"`{text}` is not known: {why_unknown(error)}"
            return None
        unknown.pop(text, None)
        return value


def handler_source(group: PortGroup, binding: Binding, index_of: dict[str, int]) -> str:
    """The function ``<group.name>(t, data, obs)`` of ``group``; ``t`` has not passed.

    Args:
        group: the ports.
        binding: their binding.
        index_of: network node of each predicate's text.
    """
    number = {name: place for place, name in enumerate(binding.ports)}
    states = [port for port in group.ports if not port.event]
    # an event on which no formula depends (`{e} or not {e}`) has no node
    events = [port for port in group.ports if port.event and port.name in index_of]
    state_atoms = [text for text in group.atoms if text not in binding.events]
    own = {port.name for port in states}
    names = {name: f"{'Y' if name in own else 'X'}{place}" for name, place in number.items()}
    touched = [f"X{number[port.name]}" for port in states]
    touched += [f"p{index_of[text]}" for text in group.atoms]
    lines = [f"def {group.name}(t, data, obs):", f"    nonlocal {', '.join(['now', *touched])}"]
    if group.kinds and group.kinds[0].startswith("response"):
        lines += ["    if obs.error:", "        return"]
    lines += ["    try:", "        pass"]
    lines += [f"        {line}" for line in _values(states, number, group.channel == ANY_CHANNEL)]
    for text in state_atoms:
        source = truth_source(binding.atoms[text].expression, names)
        lines.append(f"        a{index_of[text]} = {source}")
    for port in events:
        condition = "True"
        if port.condition is not None:
            condition = truth_source(port.condition, {"data": "data"})
        lines.append(f"        C{number[port.name]} = {condition}")
    lines += ["    except UNKNOWN as error:", "        raise Unknown from error"]
    lines += ["    changed = due = heap[0][0] <= t and before(t)", "    now = t"]
    lines += [f"    X{number[port.name]} = Y{number[port.name]}" for port in states]
    for text in state_atoms:
        node = index_of[text]
        lines += [
            f"    if a{node} is not p{node}:",
            f"        p{node} = a{node}",
            f"        log{node}((t, a{node}, obs))",
            "        changed = True",
        ]
    for port in events:
        node = index_of[port.name]
        lines += [
            f"    if C{number[port.name]} and not p{node}:",
            f"        p{node} = True",
            f"        log{node}((t, True, obs))",
            f"        heappush(heap, (t + 1, {node}))",
            "        changed = True",
        ]
    lines += ["    if changed:", f"        step(t) if due else {group.name}_cone(t)"]
    return "\n".join(lines)


def _values(states: Sequence[Port], number: dict[str, int], persistent: bool) -> list[str]:
    lines = []
    for port in states:
        name = f"Y{number[port.name]}"
        if persistent:
            field = port.path[0]
            kept = f"X{number[port.name]}"
            lines.append(f"{name} = data[{field!r}] if {field!r} in data else {kept}")
            continue
        fields = "".join(f"[{part!r}]" for part in port.path)
        lines.append(f"{name} = data{fields}")
    return lines
