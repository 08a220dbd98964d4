"""Ports and predicates against what models say of channels: their kind, their type and its fields.

At run time a predicate that does not fit what is observed has no value, and its property stays
inconclusive for ever. Where models are given, that is reported before anything runs.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import (
    ANY,
    BOOL,
    NULL,
    STRING,
    Array,
    DataType,
    Structure,
    describe,
    is_number,
)
from m2c.language.expressions import (
    Binary,
    Conditional,
    Expression,
    Logical,
    Unary,
    children,
)
from m2c.language.typing import Scope, check_expression, type_of
from m2c.model.interfaces import InterfaceLibrary, canonical
from m2c.model.machine import InterfaceKind
from m2c.model.system import System
from m2c.policy.ticks import TICK_TYPE, TICKS_CHANNEL
from m2c.suggestions import nearest
from moon.tap.action_parts import action_of
from transports.actions.parts import GoalStatusArray, channel_of_part

_KINDS = {
    InterfaceKind.PUBLISHER: "topic",
    InterfaceKind.SUBSCRIBER: "topic",
    InterfaceKind.SERVER: "service",
    InterfaceKind.CLIENT: "service",
    InterfaceKind.ACTION_SERVER: "action",
    InterfaceKind.ACTION_CLIENT: "action",
}
_FOLDERS = {"topic": "msg", "service": "srv", "action": "action"}
_PARTS = {
    "topic": "a topic has messages only",
    "service": "its parts are request and response",
    "action": "its parts are goal, feedback, result and cancel",
}


class Named(msgspec.Struct, frozen=True):
    """A channel as a port names it.

    Attributes:
        kind: ``topic``, ``service`` or ``action``.
        channel: its absolute name.
        part: of a service or an action: ``request``, ``goal`` …; else empty.
        type_name: the type that the port declares; empty if none.
        position: where the channel is written.
        type_position: where the type is.
        element: for messages.
    """

    kind: str
    channel: str
    part: str
    type_name: str
    position: Position
    type_position: Position
    element: str


class Interfaces:
    """The channels that the models of a system name, and the types that a port may declare.

    Args:
        library: the interface types.
        system: the models; None: only types are known, and any channel may be.
    """

    def __init__(self, library: InterfaceLibrary, system: System | None = None) -> None:
        self._library = library
        self._system = system.name if system is not None else None
        self._channels: dict[str, tuple[str, str]] = {}
        """Kind and type of each channel of the system."""
        if system is not None and system.policy is not None:
            self._channels[TICKS_CHANNEL] = ("topic", TICK_TYPE.name)
        for machine in (*system.nodes, *system.plugins) if system is not None else ():
            for interface in machine.interfaces:
                kind = _KINDS.get(interface.kind)
                if kind is not None and interface.channel:
                    self._channels.setdefault(interface.channel, (kind, interface.type_name))
                if kind == "action" and interface.channel:
                    status = channel_of_part(interface.channel, "status")
                    self._channels[status] = ("topic", GoalStatusArray.__type_name__)

    def contents(self, named: Named, log: DiagnosticLog) -> DataType | None:
        """The type of what a port calls the message; ``ANY`` if it is not known.

        Returns:
            None after reporting what is wrong with the channel or its type.
        """
        known = self._channels.get(named.channel)
        action = action_of(named.channel)
        if known is None and action in self._channels:
            what = f"{named.channel} is a part of the action {action}"
            hint = f"write `action: {action}`; {_PARTS['action']} (`on`)"
            log.error("wrong-channel-kind", named.position, named.element, what, hint)
            return None
        declared = canonical(named.type_name, _FOLDERS[named.kind]) if named.type_name else ""
        if known is None:
            if not self._is_possible(named, log):
                return None
            return self._type(named, declared, named.type_position, log) if declared else ANY
        kind, type_name = known
        if kind != named.kind:
            article = "an" if kind == "action" else "a"
            what = f"{named.channel} is {article} {kind} of {self._system}, not a {named.kind}"
            log.error("wrong-channel-kind", named.position, named.element, what, _PARTS[kind])
            return None
        if declared and type_name and declared != type_name:
            what = f"{named.channel} has the type {type_name}, not {declared}"
            log.error("type-mismatch", named.type_position, named.element, what)
            return None
        return self._type(named, type_name or declared, named.position, log)

    def _is_possible(self, named: Named, log: DiagnosticLog) -> bool:
        """Whether a channel that no model names may be meant; reports what speaks against it."""
        if self._system is None:
            return True
        alike = [name for name, (kind, _) in self._channels.items() if kind == named.kind]
        near = difflib.get_close_matches(named.channel, alike, 1)
        what = f"no model of {self._system} names the {named.kind} {named.channel}"
        if named.type_name:  # somebody else's node has it; its name may be like one of ours
            if near:
                hint = f"did you mean {near[0]}?"
                log.warning("unknown-channel", named.position, named.element, what, hint)
            return True
        foreign = "a channel of a node without a model declares its type"
        hint = f"did you mean {near[0]}? ({foreign})" if near else foreign
        log.error("unknown-channel", named.position, named.element, what, hint)
        return False

    def _type(
        self, named: Named, type_name: str, position: Position, log: DiagnosticLog
    ) -> DataType | None:
        if not type_name:
            return ANY
        try:
            match named.kind, named.part:
                case "topic", _ if type_name == TICK_TYPE.name:
                    found: DataType = TICK_TYPE
                case "topic", _:
                    found = self._library.message(type_name)
                case "service", "request":
                    found = self._library.service(type_name).request
                case "service", _:
                    found = self._library.service(type_name).response
                case _, "goal":
                    found = self._library.action(type_name).goal
                case _, "feedback":
                    found = self._library.action(type_name).feedback
                case _, "result":
                    found = self._library.action(type_name).result
                case _:
                    self._library.action(type_name)
                    found = ANY
        except KeyError as error:
            log.error("unknown-type", position, named.element, str(error.args[0]))
            return None
        return _observed(found)


def _observed(kind: DataType) -> DataType:
    """``kind`` as it is observed: messages have no constants."""
    match kind:
        case Structure():
            fields = tuple((name, _observed(field)) for name, field in kind.fields)
            return msgspec.structs.replace(kind, fields=fields, constants=())
        case Array(element=element):
            return msgspec.structs.replace(kind, element=_observed(element))
        case _:
            return kind


def field_type(
    kind: DataType, path: Iterable[str], position: Position, element: str, log: DiagnosticLog
) -> DataType | None:
    """The type of the field at ``path`` of a message of type ``kind``; None after reporting a fault."""
    for name in path:
        if kind == ANY:
            return ANY
        if not isinstance(kind, Structure):
            what = f"a value of type {describe(kind)} has no field `{name}`"
            hint = "an element is taken in the predicate, as in `port[0] > 1`"
            is_array = isinstance(kind, Array)
            log.error("unknown-field", position, element, what, hint if is_array else "")
            return None
        found = kind.field(name)
        if found is None:
            hint = nearest(name, (key for key, _ in kind.fields)) or "it has no fields"
            what = f"{describe(kind)} has no field `{name}`"
            log.error("unknown-field", position, element, what, hint)
            return None
        kind = found
    return kind


def is_value_of(value: Any, kind: DataType) -> bool:
    """Whether ``value``, from a property file, can be one of type ``kind``."""
    if kind == ANY:
        return True
    if isinstance(value, bool):
        return kind == BOOL
    if isinstance(value, int | float):
        return is_number(kind)
    return isinstance(value, str) and kind == STRING


Fault = tuple[Position, str]
"""Where in an expression, and what is wrong there."""


def faults(expression: Expression, types: Mapping[str, DataType]) -> list[Fault]:
    """Why ``expression`` cannot be true or false: its faults.

    Args:
        expression: a predicate.
        types: of the names in it.
    """
    scope = Scope(types)
    log = DiagnosticLog()
    check_expression(expression, scope, None, "", log)
    found = [
        (item.position, f"{item.message}; {item.hint}" if item.hint else item.message)
        for item in log.diagnostics
    ]
    # what a model would convert has no value in a property
    return found or [*_strict(expression, scope), *_truth(expression, scope)]


def _truth(node: Expression, scope: Scope) -> list[Fault]:
    match node:
        case Logical(left=left, right=right):
            return [*_truth(left, scope), *_truth(right, scope)]
        case Unary(operator="!", operand=operand):
            return _truth(operand, scope)
    kind = type_of(node, scope)
    if kind in (ANY, BOOL):
        return []
    hint = "compare it with a value" + (", as in `… > 0`" if is_number(kind) else "")
    return [(node.position, f"a value of type {describe(kind)} is neither true nor false; {hint}")]


def _strict(node: Expression, scope: Scope) -> list[Fault]:
    found = [fault for child in children(node) for fault in _strict(child, scope)]
    match node:
        case Conditional(test=test):
            found += _truth(test, scope)
        case Binary(operator=operator, left=left, right=right):
            first, second = type_of(left, scope), type_of(right, scope)
            kinds = (first, second)
            mixed = operator == "+" and STRING in kinds and first != second
            unordered = operator[0] in "<>" and not all(
                kind in (ANY, STRING) or is_number(kind) for kind in kinds
            )
            if ANY not in kinds and (mixed or unordered or NULL in kinds):
                what = f"`{operator}` between {describe(first)} and {describe(second)} has no value"
                found.append((node.position, what))
    return found
