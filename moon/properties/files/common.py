"""What both kinds of property files share: places of ports, names, their checks, the finished property."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.language.datatypes import ANY, BOOL, DataType, describe
from m2c.language.expressions import Expression
from m2c.model.walk import variables_of
from moon.properties.describe import (
    formula_deadline,
    formula_sentence,
    pattern_sentence,
)
from moon.properties.files.interfaces import Interfaces, Named, faults, field_type, is_value_of
from moon.properties.formula import Formula, Historically, Interval, operands, predicates
from moon.properties.network import build_network
from moon.properties.patterns import Pattern, PatternError, deadline, pattern_formula
from moon.properties.predicates import PredicateError, bind
from moon.properties.property import (
    Port,
    Property,
    PropertySeverity,
    Role,
)
from moon.properties.syntax import (
    MAX_DEPTH,
    MAX_OPERATORS,
    MAX_PREDICATE_OPERATORS,
    TIME_UNITS,
    TIME_UNITS_HINT,
    FormulaError,
    condition,
    edge,
    parse_formula,
    ticks,
)
from transports.interface import REQUESTS, RESPONSES, ObservationKind

MAX_SIZE = 4 * MAX_OPERATORS
MAX_LEVELS = MAX_DEPTH + MAX_PREDICATE_OPERATORS
"""A formula whose named predicates are written out is no larger or deeper than one that is written."""
MAX_PATH = 32
"""Fields inside each other: what reads them is compiled, and may not nest without limit."""
MAX_SHOWN = 80
"""Characters of a text that a message quotes."""

MESSAGES = (ObservationKind.MESSAGE,)

MessagePath = tuple[str, tuple[ObservationKind, ...], tuple[str, ...]]
"""(channel, kinds, fields that lead to what the user calls the message)."""

SERVICE_PARTS = ("request", "response")
ACTION_PARTS = ("goal", "feedback", "result", "cancel")


def absolute(name: str) -> str:
    """``name`` as an absolute channel name."""
    return name if name.startswith("/") else f"/{name}"


def topic_place(name: str) -> MessagePath:
    """A topic's messages."""
    return absolute(name), MESSAGES, ()


def service_place(name: str, part: str) -> MessagePath:
    """A service's requests or responses."""
    return absolute(name), REQUESTS if part == "request" else RESPONSES, ()


def action_place(name: str, part: str) -> MessagePath:
    """A part of an action, under ROS 2's names for it."""
    prefix = f"{absolute(name)}/_action"
    match part:
        case "goal":
            return f"{prefix}/send_goal", REQUESTS, ("goal",)
        case "feedback":
            return f"{prefix}/feedback", MESSAGES, ("feedback",)
        case "result":
            return f"{prefix}/get_result", RESPONSES, ("result",)
        case _:
            return f"{prefix}/cancel_goal", REQUESTS, ()


def goal_id_place(name: str) -> MessagePath:
    """The id of the goal sent last."""
    return f"{absolute(name)}/_action/send_goal", REQUESTS, ("goal_id", "uuid")


def result_code_place(name: str) -> MessagePath:
    """How the last goal ended (action_msgs/msg/GoalStatus: 4 succeeded, 5 canceled, 6 aborted)."""
    return f"{absolute(name)}/_action/get_result", RESPONSES, ("status",)


class Names:
    """The names that a file declares: ports and named predicates.

    Args:
        interfaces: what channels and types there are; None: nothing is known of them.
    """

    def __init__(self, interfaces: Interfaces | None = None) -> None:
        self._interfaces = interfaces
        self._types: dict[str, DataType] = {}
        """Of the ports, where they are known."""
        self.ports: dict[str, Port] = {}
        self.predicates: dict[str, Formula] = {}
        self.faulty: set[str] = set()
        """Declared with an error, which was reported: who uses them is not to blame."""

    def contents(self, named: Named, log: DiagnosticLog) -> DataType | None:
        """The type of what a port calls the message; None after reporting what is wrong with it."""
        return ANY if self._interfaces is None else self._interfaces.contents(named, log)

    def declare(
        self,
        port: Port,
        contents: DataType,
        fields: tuple[str, ...],
        at: Mapping[str, Position],
        element: str,
        log: DiagnosticLog,
        example: Any = msgspec.UNSET,
    ) -> None:
        """Take ``port`` in, unless what it says is not so; then that is reported.

        Args:
            port: the port.
            contents: the type of what it calls the message.
            fields: those that lead from there to its value.
            at: where ``field``, ``initial`` and ``type`` are written, if they are.
            element: for messages.
            log: where faults go.
            example: a value of the type that the file says it has; UNSET if it says none.
        """
        place = at.get("field", port.position)
        found = BOOL if port.event else field_type(contents, fields, place, element, log)
        if found is None:
            return
        if example is not msgspec.UNSET and not is_value_of(example, found):
            what = f"the field's type is {describe(found)}"
            log.error("type-mismatch", at.get("type", port.position), element, what)
            return
        if port.initial is not msgspec.UNSET and not is_value_of(port.initial, found):
            what = f"the initial value is not of the field's type, {describe(found)}"
            log.error("type-mismatch", at.get("initial", port.position), element, what)
            return
        self._types[port.name] = found
        self.ports[port.name] = port

    def faults(self, expression: Expression) -> list[str]:
        """Why ``expression``, of names that are declared, is neither true nor false: a clause each."""
        if self._interfaces is None:
            return []
        return [what for _, what in faults(expression, self._types)]

    def resolve(self, text: str, _offset: int) -> Formula | None:
        """The named predicate ``text``, if it is one."""
        return self.predicates.get(text)

    def known(self, name: str) -> bool:
        """Whether ``name`` is taken."""
        return name in self.ports or name in self.predicates

    def closest(self, name: str) -> str:
        """A hint: the declared name that looks most like ``name``."""
        found = difflib.get_close_matches(name, [*self.ports, *self.predicates], 1)
        return f"did you mean `{found[0]}`?" if found else "declare it among the ports"


def field_path(text: str) -> tuple[str, ...] | None:
    """The fields of ``a.b``; None if ``text`` is not such a path."""
    parts = tuple(text.split("."))
    good = len(parts) <= MAX_PATH and all(part.isidentifier() for part in parts)
    return parts if good else None


def read_condition(
    text: str, position: Position, element: str, names: Names, log: DiagnosticLog, which: str = ""
) -> Formula | None:
    """The condition ``text`` (an expression over names); None after reporting what is wrong.

    ``which``: ``rises`` or ``falls``, if the condition is that it becomes true or false.
    """
    try:
        found = condition(text, 0, names.resolve)
        if which:
            found = edge(which, found)
        _bound(found)
    except FormulaError as error:
        _report(error, text, position, element, log)
        return None
    return found if names_known(found, text, position, element, names, log) else None


def read_formula(
    text: str, position: Position, element: str, names: Names, log: DiagnosticLog
) -> Formula | None:
    """The formula ``text``; None after reporting what is wrong."""
    try:
        found = parse_formula(text, resolve=names.resolve)
        _bound(found)
    except FormulaError as error:
        _report(error, text, position, element, log)
        return None
    return found if names_known(found, text, position, element, names, log) else None


def _bound(formula: Formula) -> None:
    """Raise FormulaError if ``formula``, with its named predicates written out, is too large."""
    known: dict[int, tuple[int, int]] = {}

    def extent(part: Formula) -> tuple[int, int]:
        if id(part) not in known:
            inside = [extent(item) for item in operands(part)]
            size = 1 + sum(count for count, _ in inside)
            known[id(part)] = size, 1 + max((depth for _, depth in inside), default=0)
        return known[id(part)]

    size, depth = extent(formula)
    if size > MAX_SIZE:
        what = f"more than {MAX_SIZE} operators and predicates"
    elif depth > MAX_LEVELS:
        what = f"nested more than {MAX_LEVELS} deep"
    else:
        return
    raise FormulaError(f"{what}, with its named predicates written out", 0)


def _report(
    error: FormulaError, text: str, position: Position, element: str, log: DiagnosticLog
) -> None:
    at, hint = _inside(text, error.offset, position), error.hint
    if re.match(r"\s*(rises|falls)\s*\(", text) and element != "formula":
        hint = (
            'a condition that becomes true is written {rises: x > 1}, in XML <event edge="rises">'
        )
    log.error("bad-formula", at, element, error.message, hint)


def _inside(text: str, offset: int, position: Position) -> Position:
    """Where the character at ``offset`` of ``text``, which begins at ``position``, stands."""
    before = text[:offset]
    lines = before.count("\n")
    column = len(before) - before.rfind("\n") if lines else position.column + offset
    return Position(position.file, position.line + lines, column)


def names_known(
    formula: Formula,
    text: str,
    position: Position,
    element: str,
    names: Names,
    log: DiagnosticLog,
) -> bool:
    """Whether every name in ``formula`` is declared and used as what it is; reports what is not.

    ``text`` is what it was read from, and begins at ``position``.
    """
    good = True
    for atom in predicates(formula).values():
        for name in variables_of(atom.expression):
            if name in names.faulty:
                good = False
            elif name not in names.ports:
                what = f"`{name}` is not declared"
                log.error("unknown-name", position, element, what, names.closest(name))
                good = False
    if good:
        try:
            bind([formula], names.ports.values())
        except PredicateError as error:
            log.error("bad-predicate", position, element, str(error))
            good = False
    for atom in predicates(formula).values() if good else ():
        for what in names.faults(atom.expression):
            first = next(iter(variables_of(atom.expression)), "")
            found = re.search(rf"(?<![\w.]){re.escape(first)}(?!\w)", text)
            at = _inside(text, found.start() if found is not None else 0, position)
            shown = shortened(atom.text, MAX_SHOWN)
            log.error("type-mismatch", at, element, f"`{shown}`: {what}")
            good = False
    return good


def read_time(
    text: str, unit: str, position: Position, element: str, log: DiagnosticLog
) -> int | None:
    """``text`` in ``unit`` as ticks of dense time; None after reporting what is wrong."""
    if unit not in TIME_UNITS:
        log.error("bad-time", position, element, f"`{unit}` is not a unit of time", TIME_UNITS_HINT)
        return None
    try:
        return ticks(text, TIME_UNITS[unit])
    except FormulaError as error:
        log.error("bad-time", position, element, error.message, error.hint)
        return None


class Declared(msgspec.Struct, frozen=True):
    """What a file says of a property beside its pattern or formula; see :class:`Property`."""

    name: str
    position: Position
    text: str
    severity: PropertySeverity
    role: Role


def finish(
    declared: Declared,
    what: Pattern | Formula,
    names: Names,
    log: DiagnosticLog,
    instead: Formula | None = None,
) -> Property | None:
    """The property that is ``declared``, from its pattern or formula; None after reporting what is wrong.

    ``instead``: the formula to use for a pattern that a file's own dialect means differently.
    """
    name, position = declared.name, declared.position
    if isinstance(what, Pattern):
        try:
            formula = pattern_formula(what) if instead is None else instead
        except PatternError as error:
            log.error("bad-pattern", position, "property", f"`{name}`: {error}")
            return None
        meaning, limit = pattern_sentence(what), deadline(what)
    else:
        events = {port.name for port in names.ports.values() if port.event}
        formula, meaning = what, formula_sentence(what)
        limit = formula_deadline(what, events)
    if never_false(formula):
        what_for = "a time, or a scope with an end" if isinstance(what, Pattern) else ""
        log.warning("never-false", position, "property", f"`{name}` is never false", what_for)
    used = {
        variable
        for atom in predicates(formula).values()
        for variable in variables_of(atom.expression)
    }
    ports = tuple(port for port in names.ports.values() if port.name in used)
    pattern = what if isinstance(what, Pattern) and instead is None else None
    return Property(
        name=name,
        formula=formula,
        ports=ports,
        text=declared.text,
        severity=declared.severity,
        role=declared.role,
        meaning=meaning,
        deadline_ticks=limit,
        position=position,
        pattern=pattern,
    )


def never_false(formula: Formula) -> bool:
    """Whether ``formula`` is true whatever happens, as far as that can be seen from its form."""
    while isinstance(formula, Historically):
        formula = formula.operand
    network = build_network([formula])
    return network.nodes[network.roots[0]].text == "true"


def interval(lower: int | None, upper: int | None) -> Interval:
    """The bound of times that were given."""
    return Interval(lower or 0, upper)


def unknown_keys(
    given: Mapping[str, Position], allowed: set[str], element: str, log: DiagnosticLog
) -> None:
    """Report keys or attributes that mean nothing."""
    for key, position in given.items():
        if key not in allowed:
            taken = ", ".join(sorted(allowed)) or "none"
            hint = one_of(key, sorted(allowed), f"it takes {taken}")
            log.error("unknown-key", position, element, f"`{key}` means nothing here", hint)


def one_of(word: str, allowed: Sequence[str], otherwise: str = "") -> str:
    """A hint: which of ``allowed`` looks most like ``word``; else ``otherwise``, or all of them."""
    close = difflib.get_close_matches(word, allowed, 1)
    return f"did you mean `{close[0]}`?" if close else otherwise or ", ".join(allowed)
