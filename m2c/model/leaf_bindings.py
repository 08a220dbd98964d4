"""Leaves of a tree that are interfaces: a system file binds a leaf's ID to an action, a service or a topic.

``<leaf ID="NavigateToPose" action="/navigate_to_pose" type="nav2_msgs/action/NavigateToPose">
<field name="pose" port="goal"/></leaf>``. What is made of it is a plugin, a machine like any other that is
written for a tree, so nothing else knows of such leaves
(docs/decisions/0043-a-bound-leaf-is-a-plugin.md).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import msgspec

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.datatypes import (
    BOOL,
    STRING,
    DataType,
    Structure,
    describe,
    part,
)
from m2c.language.expressions import (
    EventData,
    Expression,
    Literal,
    Member,
    ObjectLiteral,
    PortInput,
    Variable,
)
from m2c.language.parsing import parse_expression
from m2c.model.interfaces import InterfaceLibrary, canonical, fault_of
from m2c.model.machine import (
    Assign,
    Data,
    Dialect,
    Emit,
    Event,
    EventKind,
    Field,
    If,
    Interface,
    InterfaceKind,
    Machine,
    OutputKind,
    Port,
    State,
    Statement,
    Target,
    Transition,
)
from m2c.model.naming import absolute
from m2c.model.structure import check_attributes, exclude, require
from m2c.model.types import parse_type
from m2c.model.walk import rewritten
from m2c.model.xml import Element
from m2c.suggestions import nearest

LEAF = "leaf"
_KINDS = {
    "action": InterfaceKind.ACTION_CLIENT,
    "service": InterfaceKind.CLIENT,
    "topic": InterfaceKind.SUBSCRIBER,
}
_FOLDERS = {"action": "action", "service": "srv", "topic": "msg"}
_PORT = "bt_declare_port_in"
_CHILDREN = {
    "action": ("field", "feedback", "result", _PORT),
    "service": ("field", "result", _PORT),
    "topic": ("result", _PORT),
}
_ATTRIBUTES = {
    "field": ("name", "port", "expr"),
    "feedback": ("name", "port"),
    "result": ("name", "port"),
    _PORT: ("key", "type"),
}
_GIVEN = re.compile(r"\{\s*([A-Za-z_]\w*)\s*\}")
"""A channel that a port gives."""
_MAX_SHOWN = 80
"""Characters of a name that a message repeats."""
_UNENDED = (EventKind.GOAL_REJECTED, EventKind.GOAL_FAILED)
_ENDED = (EventKind.SUCCEEDED, EventKind.ABORTED, EventKind.CANCELED)
_SUCCESS, _FAILURE, _RUNNING = "SUCCESS", "FAILURE", "RUNNING"
_IDLE, _ACTIVE, _ENDING, _OVER = "idle", "active", "canceling", "ended"
_TICK, _HALT = Event(EventKind.BT_TICK), Event(EventKind.BT_HALT)


class _Types(msgspec.Struct, frozen=True):
    """What the interface carries: what is sent to it, what comes back, and what comes meanwhile."""

    sent: Structure
    got: Structure
    meanwhile: Structure


_NOTHING = Structure("", ())


def read_leaf(element: Element, library: InterfaceLibrary, log: DiagnosticLog) -> Machine | None:
    """The plugin that ``element``, a ``<leaf>``, makes of an interface; None after an error.

    Args:
        element: ``<leaf ID= action=|service=|topic= type= cond=>`` with ``<field>``, ``<feedback>``,
            ``<result>`` and ``<bt_declare_port_in>``.
        library: the interface types.
        log: where faults go: ``unknown-attribute``, ``unknown-tag``, ``missing-attribute``, ``unknown-type``,
            ``bad-name``, ``unknown-field``, ``duplicate-field``, ``type-mismatch`` and those of expressions.
    """
    own = DiagnosticLog()
    machine = _LeafReader(element, library, own).read()
    log.diagnostics += own.diagnostics
    return None if own.has_errors else machine


class _LeafReader:
    def __init__(self, element: Element, library: InterfaceLibrary, log: DiagnosticLog) -> None:
        self._element = element
        self._library = library
        self._log = log
        self._at = element.position
        self._ports: dict[tuple[str, bool], Port] = {}
        self._channel = ""
        """What the machine calls its interface."""

    def read(self) -> Machine | None:
        """The machine; None where it cannot be told what it is."""
        element = self._element
        check_attributes(element, ("ID", *_KINDS, "type", "cond"), self._log)
        name = require(element, "ID", self._log)
        written_type = require(element, "type", self._log)
        given = [kind for kind in _KINDS if element.get(kind)]
        if len(given) != 1:
            what = "a leaf is one action, one service or one topic"
            hint = 'write one of action="/…", service="/…", topic="/…"'
            rule = "unknown-attribute" if given else "missing-attribute"
            at = element.at(given[1]) if given else self._at
            self._log.error(rule, at, element.tag, what, hint)
        if len(given) != 1 or not written_type or not name:
            return None
        (kind,) = given
        types = self._types(kind, written_type)
        if types is None:
            return None
        interface = self._interface(kind, written_type)
        self._channel = interface.name
        for child in element.children:
            if child.tag not in _CHILDREN[kind]:
                what = f"not an element of a <{element.tag}> that is a {kind}"
                hint = nearest(child.tag, _CHILDREN[kind])
                self._log.error("unknown-tag", child.position, child.tag, what, hint)
            else:
                check_attributes(child, _ATTRIBUTES[child.tag], self._log)
        for child in element.all(_PORT):
            key = require(child, "key", self._log)
            port = parse_type(child, self._library, self._log, bounded=True)
            if key and port is not None:
                self._declare(key, port, child)
        data, states = getattr(self, f"_{kind}")(types)
        return Machine(
            name=name,
            dialect=Dialect.ASCXML,
            position=self._at,
            initial=_IDLE,
            states=states,
            data=data,
            interfaces=(interface,),
            ports=tuple(self._ports.values()),
            named_at=element.at("ID"),
            named_in=element.tag,
        )

    def _interface(self, kind: str, type_name: str) -> Interface:
        written = self._element.get(kind)
        given = _GIVEN.fullmatch(written)
        if given is not None:
            self._declare(given[1], STRING, self._element)
        elif part := _GIVEN.search(written):
            port = part[1]
            what = (
                f"`{kind}` is `{shortened(written, _MAX_SHOWN)}`; a port gives the whole of a name"
            )
            hint = f'write {kind}="{{{port}}}" here, and {port}="/…" at each leaf of the tree'
            self._log.error("bad-name", self._element.at(kind), self._element.tag, what, hint)
        return Interface(
            kind=_KINDS[kind],
            name=given[1] if given else absolute(written),
            position=self._at,
            channel=None if given else absolute(written),
            type_name=canonical(type_name, _FOLDERS[kind]),
            port=given[1] if given else None,
        )

    def _types(self, kind: str, type_name: str) -> _Types | None:
        library = self._library
        try:
            match kind:
                case "action":
                    action = library.action(type_name)
                    return _Types(action.goal, action.result, action.feedback)
                case "service":
                    service = library.service(type_name)
                    return _Types(service.request, service.response, _NOTHING)
                case _:
                    return _Types(_NOTHING, library.message(type_name), _NOTHING)
        except KeyError as error:
            at = self._element.at("type")
            self._log.error("unknown-type", at, self._element.tag, *fault_of(error))
            return None

    # -- ports --------------------------------------------------------------------------------

    def _declare(self, key: str, kind: DataType, child: Element, output: bool = False) -> None:
        """Add a port. One that is named twice has one type, and is written from one place."""
        for known in (self._ports.get((key, True)), self._ports.get((key, False))):
            if known is not None and known.type != kind:
                at = child.at("port")
                what = f"the port `{key}` has type {describe(known.type)} and {describe(kind)}"
                hint = (
                    f"the first is at {known.position.line}:{known.position.column}; use two ports"
                )
                self._log.error("type-mismatch", at, child.tag, what, hint)
                return
        if output and (key, True) in self._ports:
            what = f"the port `{key}` is written twice"
            self._log.error("duplicate-field", child.at("port"), child.tag, what, "use two ports")
        port = Port(key, kind, output, child.position, optional=output)
        self._ports.setdefault((key, output), port)

    def _part(self, child: Element, kind: Structure, name: str) -> DataType | None:
        """The type of the part ``name`` (``a.b``) of ``kind``; None after reporting ``unknown-field``."""
        found: DataType = kind
        for step in name.split("."):
            inner = part(found, step)
            if inner is None:
                what = f"{describe(found)} has no field `{step}`"
                fields = found.fields if isinstance(found, Structure) else ()
                hint = nearest(step, [field for field, _ in fields]) if fields else ""
                self._log.error("unknown-field", child.at("name"), child.tag, what, hint)
                return None
            found = inner
        return found

    def _fields(self, kind: Structure) -> tuple[Field, ...]:
        """What is sent: of ports, or written out."""
        found: list[Field] = []
        for child in self._element.all("field"):
            name = require(child, "name", self._log)
            exclude(child, "port", "expr", self._log)
            port = child.get("port")
            wanted = self._part(child, kind, name) if name else None
            value: Expression | None = None
            if port and wanted is not None:
                self._declare(port, wanted, child)
                value = PortInput(key=port, position=child.position)
            elif not port:
                written = child.get("expr")
                if not written:
                    what, hint = "nothing says what it is", 'write port="…" or expr="…"'
                    self._log.error("missing-attribute", child.position, child.tag, what, hint)
                value = self._parsed(written, child, "expr") if written else None
            for known in found:
                if f"{known.name}.".startswith(f"{name}.") or name.startswith(f"{known.name}."):
                    what = f"`{name}` is set twice"
                    self._log.error("duplicate-field", child.position, child.tag, what)
            if value is not None:
                found.append(Field(name, value, child.position))
        return tuple(found)

    def _outputs(self, tag: str, kind: Structure, whole: Expression) -> tuple[Statement, ...]:
        """Statements that write what has come, ``whole``, or parts of it, to ports."""
        found = []
        for child in self._element.all(tag):
            key, name = require(child, "port", self._log), child.get("name")
            wanted = self._part(child, kind, name) if name else kind
            if not key or wanted is None:
                continue
            self._declare(key, wanted, child, output=True)
            value = whole
            for step in filter(None, name.split(".")):
                value = Member(object=value, name=step, position=child.position)
            field = Field("value", value, child.position)
            found.append(
                Emit(
                    kind=OutputKind.BT_SET_OUTPUT,
                    interface=key,
                    position=child.position,
                    fields=(field,),
                )
            )
        return tuple(found)

    def _parsed(self, text: str, child: Element, attribute: str) -> Expression | None:
        """An expression, in which the ports that are declared are called by their keys."""
        value = parse_expression(text, child.at(attribute), child.tag, self._log)

        def read(node: Expression) -> Expression:
            if isinstance(node, Variable) and (node.name, False) in self._ports:
                return PortInput(key=node.name, position=node.position)
            return node

        return None if value is None else rewritten(value, read)

    def _cond(self) -> Expression | None:
        if "cond" not in self._element.attributes:
            return None
        text = require(self._element, "cond", self._log)
        return self._parsed(text, self._element, "cond") if text else None

    # -- the machines -------------------------------------------------------------------------

    def _action(self, types: _Types) -> tuple[tuple[Data, ...], tuple[State, ...]]:
        """The goal is sent by the first tick; its end answers a later one, or the halt that canceled it."""
        goal = self._emit(OutputKind.SEND_GOAL, self._fields(types.sent))
        feedback = self._outputs("feedback", types.meanwhile, self._data("_feedback"))
        result = self._outputs("result", types.got, self._data("_wrapped_result.result"))
        cond = self._cond()
        status = Data("status", STRING, self._literal(_FAILURE), self._at)
        failed = self._assign(self._literal(_FAILURE))
        succeeded: Statement = self._assign(self._literal(_SUCCESS))
        if cond is not None:
            succeeded = If(((cond, (succeeded,)), (None, (failed,))), self._at)
        halted = (self._emit(OutputKind.BT_RETURN_HALTED),)
        cancel = (self._emit(OutputKind.SEND_CANCEL),)
        active = [self._on(_TICK, (self._status(_RUNNING),))]
        if feedback:
            active.append(self._on(Event(EventKind.FEEDBACK, self._channel), feedback))
        active += [
            self._on(
                Event(kind, self._channel),
                (*result, succeeded if kind is EventKind.SUCCEEDED else failed),
                _OVER,
            )
            for kind in _ENDED
        ]
        active += [self._on(Event(kind, self._channel), (failed,), _OVER) for kind in _UNENDED]
        active.append(self._on(_HALT, cancel, _ENDING))
        return (status,), (
            self._state(_IDLE, self._on(_TICK, (goal, self._status(_RUNNING)), _ACTIVE)),
            self._state(_ACTIVE, *active),
            self._state(
                _OVER,
                self._on(_TICK, (self._status(Variable(name="status", position=self._at)),), _IDLE),
                self._on(_HALT, halted, _IDLE),
            ),
            self._state(
                _ENDING,
                *(
                    self._on(Event(kind, self._channel), halted, _IDLE)
                    for kind in (*_ENDED, *_UNENDED)
                ),
            ),
        )

    def _service(self, types: _Types) -> tuple[tuple[Data, ...], tuple[State, ...]]:
        """The response answers the tick that has sent the request."""
        request = self._emit(OutputKind.REQUEST, self._fields(types.sent))
        result = self._outputs("result", types.got, self._data("_res"))
        answer = (*result, *self._answer(self._cond()))
        return (), (
            self._state(_IDLE, self._on(_TICK, (request,), _ACTIVE)),
            self._state(
                _ACTIVE,
                self._on(Event(EventKind.RESPONSE, self._channel), answer, _IDLE),
                self._on(
                    Event(EventKind.CALL_ERROR, self._channel), (self._status(_FAILURE),), _IDLE
                ),
            ),
        )

    def _topic(self, types: _Types) -> tuple[tuple[Data, ...], tuple[State, ...]]:
        """A tick is answered by the last message."""
        message = Variable(name="message", position=self._at)
        result = self._outputs("result", types.got, message)
        cond = self._cond()

        def last(node: Expression) -> Expression:
            is_message = isinstance(node, EventData) and node.part == "data"
            return msgspec.structs.replace(message, position=node.position) if is_message else node

        heard = Variable(name="heard", position=self._at)
        empty = ObjectLiteral(position=self._at)
        take = (
            Assign(message, self._data("_msg"), self._at),
            Assign(heard, Literal(value=True, position=self._at), self._at),
        )
        answer = (*result, *self._answer(None if cond is None else rewritten(cond, last)))
        holds = msgspec.structs.replace(self._on(_TICK, answer), cond=heard)
        return (
            Data("message", types.got, empty, self._at),
            Data("heard", BOOL, Literal(value=False, position=self._at), self._at),
        ), (
            self._state(
                _IDLE,
                self._on(Event(EventKind.MESSAGE, self._channel), take),
                holds,
                self._on(_TICK, (self._status(_FAILURE),)),
            ),
        )

    # -- their parts --------------------------------------------------------------------------

    def _answer(self, cond: Expression | None) -> Iterator[Statement]:
        success = (self._status(_SUCCESS),)
        if cond is None:
            yield from success
        else:
            yield If(((cond, success), (None, (self._status(_FAILURE),))), self._at)

    def _state(self, name: str, *transitions: Transition) -> State:
        return State(name=name, position=self._at, transitions=transitions)

    def _on(self, event: Event, body: tuple[Statement, ...], target: str = "") -> Transition:
        targets = (Target(target),) if target else ()
        return Transition(event=event, position=self._at, targets=targets, body=body)

    def _emit(self, kind: OutputKind, fields: tuple[Field, ...] = ()) -> Emit:
        to_the_tree = kind in (OutputKind.BT_RETURN_HALTED, OutputKind.BT_RETURN_STATUS)
        interface = "" if to_the_tree else self._channel
        return Emit(kind=kind, interface=interface, position=self._at, fields=fields)

    def _status(self, status: str | Variable) -> Emit:
        value = self._literal(status) if isinstance(status, str) else status
        return self._emit(OutputKind.BT_RETURN_STATUS, (Field("status", value, self._at),))

    def _assign(self, value: Expression) -> Assign:
        return Assign(Variable(name="status", position=self._at), value, self._at)

    def _literal(self, value: str) -> Literal:
        return Literal(value=value, position=self._at)

    def _data(self, spelling: str) -> EventData:
        return EventData(part="data", spelling=spelling, position=self._at)
