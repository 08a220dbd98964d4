"""The message type of a plain event: a field for each param, typed by what its senders give it.

The types of all events are found together: a param may be computed from what another event brought.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.conversion import STATUSES
from m2c.language.datatypes import (
    ANY,
    FLOAT64,
    NULL,
    NUMBER,
    STRING,
    Array,
    DataType,
    Structure,
    describe,
)
from m2c.language.expressions import EventData, Expression, children, is_settled
from m2c.language.typing import Scope, assignable, check_expression, common_type
from m2c.model.interfaces import MAX_NESTING, InterfaceLibrary
from m2c.model.machine import (
    Emit,
    EventKind,
    Field,
    InterfaceKind,
    Machine,
    OutputKind,
    Statement,
    Transition,
)
from m2c.model.scopes import event_parts
from m2c.model.walk import flat

PACKAGE = "plain_events"
"""The package of the types of plain events, and the first part of the names of their topics."""


def type_names(
    events: Iterable[str], known: Mapping[str, str], structures: Iterable[str]
) -> dict[str, str]:
    """The type of each of ``events``: ``plain_events/msg/NavDone`` for ``nav_done``.

    Args:
        events: in the order in which equal names are told apart by a number.
        known: those that have one already.
        structures: names of those that the system declares, which are in the same package.
    """
    found = dict(known)
    declared = {f"{PACKAGE}/msg/{name}" for name in structures}
    for event in events:
        if event not in found:
            words = re.findall(r"[A-Za-z0-9]+", event)
            base = "".join(word[0].upper() + word[1:] for word in words)
            base = base if base[:1].isalpha() else f"Event{base}"
            last, count = base, 1
            while (name := f"{PACKAGE}/msg/{last}") in declared or name in found.values():
                count += 1
                last = f"{base}{count}"
            found[event] = name
    return found


class _Given(msgspec.Struct, frozen=True):
    """What a sender gives a param.

    Attributes:
        kind: its type; with ``ANY`` in it, as far as it is known.
        is_constant: it is written out, and takes the type that other senders give.
        is_wrong: the checks report it.
        is_received: it is computed from what an event brought.
        position: where.
    """

    kind: DataType
    position: Position
    is_constant: bool = False
    is_wrong: bool = False
    is_received: bool = False


_MOST_CHANGES = 16
"""For each param, the type of an event changes so often at most: params could take each other's for ever."""
_Params = dict[str, list[_Given]]
"""What is given for each param of an event."""


def define_types(
    owners: Sequence[Machine],
    types: Mapping[str, str],
    library: InterfaceLibrary,
    log: DiagnosticLog,
) -> None:
    """Define the type of every plain event in ``library``.

    A param has the type of what it is computed from, and a literal that which other senders give. Where
    senders differ, integers become int64 and other numbers float64. Params that a sender leaves out are
    fields all the same. A number without a declared type is a float64.

    Args:
        owners: the machines and action threads that send and take them as messages.
        types: the name of each event's type.
        library: where they are defined; a type that is there already keeps its fields.
        log: where faults go: ``event-param-types`` and ``untyped-event-param``.
    """
    known = {item.name: item for item in library.defined()}
    before = {
        event: _fields_before(event, known.get(name), owners) for event, name in types.items()
    }
    sent = list(_sent(owners))
    kinds = _kinds(sent, before, types, library)
    given = _given(sent, before)
    untyped: list[tuple[str, str, Sequence[_Given]]] = []
    for event, name in types.items():
        fields: list[tuple[str, DataType]] = []
        for param, found in given[event].items():
            kind = _concrete(kinds[event][param])
            if _is_wrong(event, param, kinds[event][param], found, log):
                kind = ANY
            elif kind is None:
                untyped.append((event, param, found))
            fields.append((param, kind or ANY))
        library.define(Structure(name, tuple(fields)))
    _report_untyped(untyped, log)


def _fields_before(event: str, defined: Structure | None, owners: Iterable[Machine]) -> _Params:
    """What a type is already: machines that were linked before rely on it."""
    if defined is None:
        return {}
    place = next(
        item.position for owner in owners for item in owner.interfaces if item.event == event
    )
    return {name: [_Given(kind, place)] for name, kind in defined.fields}


class _Sent(msgspec.Struct):
    """A param that is sent.

    Attributes:
        owner: by which machine.
        transition: in which transition; None on entry and exit.
        source: the plain event that this takes, if it takes one.
        event: what is sent.
        field: the param.
        given: what that is, as far as the types of events are known.
    """

    owner: Machine
    transition: Transition | None
    source: str
    event: str
    field: Field
    given: _Given


def _sent(owners: Iterable[Machine]) -> Iterator[_Sent]:
    """Every param of a plain event that is sent; none has a type yet."""
    for owner in owners:
        events = {(item.kind, item.name): item.event for item in owner.interfaces if item.event}
        for transition, block in _blocks(owner) if events else ():
            taken = None if transition is None else transition.event
            source = ""
            if taken is not None and taken.kind is EventKind.MESSAGE:
                source = events.get((InterfaceKind.SUBSCRIBER, taken.name), "")
            for item in flat(block):
                if isinstance(item, Emit) and item.kind is OutputKind.PUBLISH:
                    event = events.get((InterfaceKind.PUBLISHER, item.interface), "")
                    for field in item.fields if event else ():
                        given = _Given(ANY, field.position)
                        yield _Sent(owner, transition, source, event, field, given)


def _blocks(owner: Machine) -> Iterator[tuple[Transition | None, tuple[Statement, ...]]]:
    yield None, owner.on_start
    for state in owner.states:
        yield None, (*state.on_entry, *state.on_exit)
        for item in state.transitions:
            yield item, (*item.body, *(inner for to in item.targets for inner in to.body))


def _given(sent: Iterable[_Sent], before: Mapping[str, _Params]) -> dict[str, _Params]:
    found = {
        event: {name: [*items] for name, items in params.items()}
        for event, params in before.items()
    }
    for item in sent:
        found[item.event].setdefault(item.field.name, []).append(item.given)
    return found


def _kinds(
    sent: Sequence[_Sent],
    before: Mapping[str, _Params],
    types: Mapping[str, str],
    library: InterfaceLibrary,
) -> dict[str, dict[str, DataType]]:
    """The types of all params; what is sent gets what is given.

    Whenever the type of an event changes, what is computed from its data is looked at again.
    """
    computed: dict[str, list[_Sent]] = {"": []}
    given_to: dict[tuple[str, str], list[_Sent]] = {}
    for item in sent:
        computed.setdefault(item.source, []).append(item)
        given_to.setdefault((item.event, item.field.name), []).append(item)
    kinds: dict[str, dict[str, DataType]] = {}
    for event, params in _given(sent, before).items():
        kinds[event] = {name: _merged(items) for name, items in params.items()}
        library.define(Structure(types[event], tuple(kinds[event].items())))
    left = {event: _MOST_CHANGES * len(params) for event, params in kinds.items()}
    waiting = dict.fromkeys(computed)
    while waiting:
        source = next(iter(waiting))
        del waiting[source]
        scopes: dict[int, Scope] = {}
        for item in computed.get(source, ()):
            scope = scopes.get(id(item.transition or item.owner))
            if scope is None:
                scope = _scope(item.owner, item.transition, library)
                scopes[id(item.transition or item.owner)] = scope
            item.given = _what_is_given(item.field, scope)
        for event, name in dict.fromkeys(
            (item.event, item.field.name) for item in computed.get(source, ())
        ):
            items = (item.given for item in given_to[event, name])
            kind = _merged([*before[event].get(name, ()), *items])
            if kind != kinds[event][name] and left[event]:
                left[event] -= 1
                kinds[event][name] = kind
                library.define(Structure(types[event], tuple(kinds[event].items())))
                waiting[event] = None
    return kinds


def _what_is_given(field: Field, scope: Scope) -> _Given:
    faults = DiagnosticLog()
    kind = check_expression(field.value, scope, None, "param", faults)
    return _Given(
        ANY if faults.has_errors or _depth(kind) > MAX_NESTING else kind,
        field.position,
        is_settled(field.value),
        faults.has_errors,
        _is_received(field.value),
    )


def _is_received(expression: Expression) -> bool:
    return isinstance(expression, EventData) or any(map(_is_received, children(expression)))


def _depth(kind: DataType) -> int:
    """How many arrays are in one another: what an event brought may be sent in another one, for ever."""
    depth = 0
    while isinstance(kind, Array):
        kind, depth = kind.element, depth + 1
    return depth


def _scope(owner: Machine, transition: Transition | None, library: InterfaceLibrary) -> Scope:
    try:
        parts = event_parts(None if transition is None else transition.event, owner, library)
    except KeyError:  # a type of a channel that nothing defines: reported by the checks
        parts = {}
    variables = {data.name: data.type for data in owner.data}
    if "status" in parts:
        variables = {**dict.fromkeys(STATUSES, STRING), **variables}
    ports = {port.key: port.type for port in owner.ports if not port.output}
    return Scope(variables, parts, ports)


def _merged(given: Iterable[_Given]) -> DataType:
    """The type of a param; what does not go together with the rest is left out."""
    kind: DataType = ANY
    for item in sorted(given, key=lambda one: one.is_constant):
        if not (item.is_constant and kind != ANY and assignable(item.kind, kind)):
            kind = _joined(kind, item.kind) or kind
    return kind


def _joined(one: DataType, other: DataType) -> DataType | None:
    """The narrowest type for values of both; None if there is none."""
    if one in (ANY, NULL) or one == other:
        return other
    if other in (ANY, NULL):
        return one
    if isinstance(one, Array) and isinstance(other, Array):
        element = _joined(one.element, other.element)
        if element is None:
            return None
        if (one.length, one.fixed) == (other.length, other.fixed):
            return Array(element, one.length, one.fixed)
        both = (
            None if None in (one.length, other.length) else max(one.length or 0, other.length or 0)
        )
        return Array(element, both)
    if isinstance(one, Structure) and isinstance(other, Structure):
        for value, target in ((one, other), (other, one)):
            if not value.name and target.name and assignable(value, target):
                return target
        return None
    return common_type(one, other)


def _is_wrong(
    event: str, param: str, kind: DataType, given: Sequence[_Given], log: DiagnosticLog
) -> bool:
    """Whether a param cannot be a field of type ``kind``; that is reported, here or by the checks."""
    odd = next((item for item in given if not assignable(item.kind, kind)), None)
    if odd is not None:
        other = next((item for item in given if assignable(item.kind, kind)), given[0])
        what = (
            f"`{param}` of the event `{event}` is of type {describe(odd.kind)} here, and of type "
            f"{describe(other.kind)} at {other.position}"
        )
        hint = "a param has one type, whoever sends the event"
        log.error("event-param-types", odd.position, "param", what, hint)
    return odd is not None or any(item.is_wrong for item in given)


def _report_untyped(
    untyped: Sequence[tuple[str, str, Sequence[_Given]]], log: DiagnosticLog
) -> None:
    """``untyped-event-param``: of those that are sent on, only the first sender's is to blame."""
    origins = [it for it in untyped if not all(item.is_received for item in it[2])]
    for event, param, given in origins or untyped:
        what = f"the type of `{param}` of the event `{event}` is not known"
        hint = 'compute it from variables that have one: <data id="…" type="…"/>'
        log.error("untyped-event-param", given[0].position, "param", what, hint)


def _concrete(kind: DataType) -> DataType | None:
    """``kind`` as a message can have it; None if it is not known well enough."""
    match kind:
        case Array(element, length, fixed):
            inner = _concrete(element)
            return None if inner is None else Array(inner, length, fixed)
        case Structure(name):
            return kind if name else None
        case _:
            return None if kind in (ANY, NULL) else FLOAT64 if kind == NUMBER else kind
