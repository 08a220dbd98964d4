"""Types: every expression against the datamodel and the interface definitions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from m2c.diagnostics import DiagnosticLog, Position, Severity
from m2c.language.certainty import Certainty, Fit
from m2c.language.conversion import STATUS_NUMBERS, STATUSES, ExecutionError, to_string
from m2c.language.datatypes import (
    ANY,
    INT64,
    NUMBER,
    STRING,
    Array,
    DataType,
    Structure,
    describe,
    is_integer,
    is_number,
    only_array,
    part,
)
from m2c.language.expressions import Expression, Literal, Member, Variable, is_settled
from m2c.language.typing import Scope, assignable, check_expression, how_to_declare, type_of
from m2c.model.initial import initial_value
from m2c.model.interfaces import InterfaceLibrary, fault_of
from m2c.model.machine import (
    Assign,
    Block,
    Data,
    Emit,
    EventKind,
    Field,
    Foreach,
    If,
    InterfaceKind,
    Log,
    Machine,
    OutputKind,
    Raise,
    Statement,
    Transition,
)
from m2c.model.scopes import event_parts, output_data_type, readable_ports
from m2c.model.vocabulary import OUTPUTS
from m2c.model.walk import ports_read
from m2c.suggestions import nearest

_TAGS = {output.kind: tag for tag, output in OUTPUTS.items()}
_LOOKUP = {
    InterfaceKind.PUBLISHER: "message",
    InterfaceKind.SUBSCRIBER: "message",
    InterfaceKind.SERVER: "service",
    InterfaceKind.CLIENT: "service",
    InterfaceKind.ACTION_SERVER: "action",
    InterfaceKind.ACTION_CLIENT: "action",
}


def check_types(machine: Machine, library: InterfaceLibrary, log: DiagnosticLog) -> bool:
    """Report every type fault of ``machine``; False if an interface type is unknown.

    Rules: ``unknown-type``, ``bad-initial-value``, those of
    :func:`m2c.language.typing.check_expression`, and the warning ``unset-output-field``.
    """
    known = True
    for interface in machine.interfaces:
        if interface.kind is InterfaceKind.TIMER:
            continue
        try:
            getattr(library, _LOOKUP[interface.kind])(interface.type_name)
        except KeyError as error:
            log.error("unknown-type", interface.position, "", *fault_of(error))
            known = False
    if not known:
        return False
    _check_given_by_ports(machine, log)
    inputs = {port.key for port in machine.ports if not port.output}
    outputs = {port.key for port in machine.ports if port.output} - inputs
    for key, position in ports_read(machine).items():
        if key in outputs:
            what = f"`{key}` is an output port, which BehaviorTree.CPP does not let a node read"
            hint = "its blackboard entry is read; zero or empty until something sets it"
            log.warning("output-read", position, "bt_get_input", what, hint)
    _TypeCheck(machine, library, log).run()
    for thread in machine.threads:
        _TypeCheck(thread.machine, library, log).run()
    return True


def _check_given_by_ports(machine: Machine, log: DiagnosticLog) -> None:
    """Report interfaces whose channel or rate comes from a port that is not declared, or of another type."""
    ports = {port.key: port.type for port in machine.ports if not port.output}
    for interface in machine.interfaces:
        if interface.port is None:
            continue
        kind = ports.get(interface.port)
        if kind is None:
            hint = nearest(interface.port, ports) or "declare it with <bt_declare_port_in>"
            what = f"port `{interface.port}` is not declared"
            log.error("undeclared-port", interface.position, "", what, hint)
        elif interface.kind is InterfaceKind.TIMER and kind != ANY and not is_number(kind):
            what = f"the rate of `{interface.name}` is the value of port `{interface.port}`"
            hint = f"it has type {describe(kind)}; a rate is a number"
            log.error("type-mismatch", interface.position, "", what, hint)


class _TypeCheck:
    def __init__(self, machine: Machine, library: InterfaceLibrary, log: DiagnosticLog) -> None:
        self._machine = machine
        self._library = library
        self._log = log
        self._variables: dict[str, DataType] = {data.name: data.type for data in machine.data}
        self._ports = readable_ports(machine)

    def run(self) -> None:
        known: dict[str, DataType] = {}
        values: dict[str, Any] = {}
        later = {data.name for data in self._machine.data}
        for data in self._machine.data:
            scope = Scope(known, {}, self._ports, self._machine.lenient, later)
            expected = data.type if data.declared else None
            before = len(self._log.diagnostics)
            check_expression(data.initial, scope, expected, data.element, self._log)
            if self._is_right_since(before):
                self._initial(data, scope, values)
                initial = values.get(data.name)
                is_literal = isinstance(initial, int | float) and is_number(data.type)
                value = Literal(value=initial, position=data.initial.position)
                self._within(data.name, value if is_literal else data.initial, scope, data.element)
            known[data.name] = data.type
            later.discard(data.name)
        self._block(self._machine.on_start, self._scope({}))
        for state in self._machine.states:
            self._block(state.on_entry, self._scope({}))
            self._block(state.on_exit, self._scope({}))
            for transition in state.transitions:
                self._transition(transition)

    def _is_right_since(self, before: int) -> bool:
        """Whether there are no errors among the findings from number ``before`` on."""
        return all(found.severity is not Severity.ERROR for found in self._log.diagnostics[before:])

    def _initial(self, data: Data, scope: Scope, values: dict[str, Any]) -> None:
        """An initial value is computed here, or cannot fail: no block is there that could end."""
        if is_settled(data.initial, values):
            try:
                values[data.name] = initial_value(data, values, self._machine.lenient)
            except ExecutionError as error:
                hint = f"a value of type {describe(data.type)} is needed"
                what = f"`{data.name}` cannot begin with this: {error}"
                self._log.error(
                    "bad-initial-value", data.initial.position, data.element, what, hint
                )
            return
        certainty = Certainty(scope)
        if certainty.fit(data.initial, data.type) is Fit.MAY_FAIL or certainty.may_throw(
            data.initial
        ):
            hint = "assign it in <onentry> of the initial state"
            what = f"the initial value of `{data.name}` may be none of type {describe(data.type)}"
            self._log.error("bad-initial-value", data.initial.position, data.element, what, hint)

    def _scope(self, event: Mapping[str, DataType]) -> Scope:
        variables = self._variables
        if "status" in event:
            variables = {**dict.fromkeys(STATUSES, STRING), **variables}
        return Scope(variables, event, self._ports, self._machine.lenient)

    def _transition(self, transition: Transition) -> None:
        scope = self._scope(event_parts(transition.event, self._machine, self._library))
        if transition.cond is not None:
            check_expression(transition.cond, scope, None, transition.element, self._log)
        self._block(transition.body, scope)
        for target in transition.targets:
            self._block(target.body, scope)
        event = transition.event
        if event is not None and event.kind in (
            EventKind.BT_CHILD_STATUS,
            EventKind.BT_CHILD_HALTED,
        ):
            self._child(event.name, transition.position, transition.element)

    def _block(self, statements: Sequence[Statement], scope: Scope) -> None:
        is_bound = self._machine.named_in == "leaf"  # its condition is an attribute of that
        condition = self._machine.named_in if is_bound else "if"
        for statement in statements:
            match statement:
                case Assign():
                    self._assign(statement, scope)
                case If(branches=branches):
                    for test, body in branches:
                        if test is not None:
                            check_expression(test, scope, None, condition, self._log)
                        self._block(body, scope)
                case Foreach():
                    self._loop(statement, scope)
                case Block(body=body, name=name):
                    self._block(body, self._scope({}) if name else scope)
                case Log(value=value) if value is not None:
                    check_expression(value, scope, None, "log", self._log)
                case Raise(fields=fields, delay_s=delay):
                    for field in fields:
                        check_expression(field.value, scope, None, "param", self._log)
                    if delay is not None:
                        check_expression(delay, scope, None, "send", self._log)
                case Emit():
                    self._emit(statement, scope)

    def _loop(self, loop: Foreach, scope: Scope) -> None:
        kind = check_expression(loop.array, scope, None, "foreach", self._log)
        element = kind.element if isinstance(kind, Array) else ANY
        if kind != ANY and not isinstance(kind, Array):
            what = f"a value of type {describe(kind)} where an array is needed"
            self._log.error("type-mismatch", loop.array.position, "foreach", what)
        for name, given in ((loop.item, element), (loop.index, INT64)):
            declared = scope.variables.get(name, ANY)
            if name and not assignable(given, declared):
                what = f"a value of type {describe(given)} where {describe(declared)} is declared"
                hint = f"`{name}` takes each in turn"
                self._log.error("type-mismatch", loop.position, "foreach", what, hint)
        self._block(loop.body, scope)

    def _assign(self, statement: Assign, scope: Scope) -> None:
        location = statement.location
        if isinstance(location, Variable) and location.name not in scope.variables:
            hint = how_to_declare(location.name, scope.variables)
            what = f"`{location.name}` is not declared"
            self._log.error("undeclared-variable", location.position, "assign", what, hint)
            check_expression(statement.value, scope, None, "assign", self._log)
            return
        if isinstance(location, Member) and location.name == "length":
            owner = type_of(location.object, scope)
            if isinstance(owner, Structure) and only_array(owner) and not owner.field("length"):
                what = f"the length of {describe(owner)} cannot be assigned"
                hint = f"assign that of its array: .{only_array(owner)}.length"
                self._log.error("bad-location", location.position, "assign", what, hint)
                return
        kind = check_expression(location, scope, None, "assign", self._log)
        before = len(self._log.diagnostics)
        check_expression(statement.value, scope, None if kind == ANY else kind, "assign", self._log)
        if isinstance(location, Variable) and self._is_right_since(before):
            self._within(location.name, statement.value, scope, "assign")

    def _within(self, name: str, value: Expression, scope: Scope, element: str) -> None:
        """Report a value that is never within the bounds that the variable ``name`` declares."""
        data = next((data for data in self._machine.data if data.name == name), None)
        low_high = Certainty(scope).of(value).bounds
        if data is None or low_high is None:
            return
        low, high = low_high
        is_below = data.lower is not None and high < data.lower
        if is_below or (data.upper is not None and low > data.upper):
            found = to_string(low) if low == high else f"from {to_string(low)} to {to_string(high)}"
            ends = "…".join(
                "" if end is None else to_string(end) for end in (data.lower, data.upper)
            )
            what = f"this is {found}, out of the bounds of `{name}`"
            self._log.error("out-of-range", value.position, element, what, f"it is in {ends}")

    def _emit(self, emit: Emit, scope: Scope) -> None:
        tag = _TAGS[emit.kind]
        for number in (emit.goal_id, emit.thread_id):
            if number is not None:
                check_expression(number, scope, INT64, tag, self._log)
        if emit.kind is OutputKind.BT_SET_OUTPUT:
            port = next((item for item in self._machine.ports if item.key == emit.interface), None)
            if port is None or not port.output:
                keys = [item.key for item in self._machine.ports if item.output]
                hint = nearest(emit.interface, keys) or "declare it with <bt_declare_port_out>"
                what = f"output port `{emit.interface}` is not declared"
                self._log.error("undeclared-port", emit.position, tag, what, hint)
            for field in emit.fields:
                check_expression(
                    field.value, scope, port.type if port is not None else None, tag, self._log
                )
            return
        if emit.kind in (OutputKind.BT_TICK_CHILD, OutputKind.BT_HALT_CHILD):
            self._child(emit.interface, emit.position, tag)
            return
        kind = output_data_type(emit.kind, emit.interface, self._machine, self._library)
        if kind is None:
            for field in emit.fields:
                if emit.kind is OutputKind.BT_RETURN_STATUS:
                    self._status(field.value, tag)
                else:
                    what = f"this output has no field `{field.name}`"
                    self._log.error("unknown-field", field.position, "field", what)
            return
        interface = self._machine.interface(emit.interface, InterfaceKind.PUBLISHER)
        if emit.kind is OutputKind.PUBLISH and interface is not None and interface.event:
            self._fields(emit, "send", "param", kind, scope)
        else:
            self._fields(emit, tag, "field", kind, scope)

    def _status(self, value: Expression, tag: str) -> None:
        """A status is named, or a variable holds one: a string with its name, or its number."""
        if not isinstance(value, Variable):
            return
        kind = self._variables.get(value.name)
        if kind in (STRING, NUMBER, ANY) or (kind is not None and is_integer(kind)):
            return
        what = f"`{value.name}` is not a status"
        hint = f"one of {', '.join(STATUSES)}, or a variable that holds one"
        if kind is not None:
            what = f"`{value.name}` has type {describe(kind)}, which holds no status"
            numbers = ", ".join(f"{number} for {name}" for name, number in STATUS_NUMBERS.items())
            hint = f"a status is a string, {', '.join(STATUSES)}, or an integer, {numbers}"
        self._log.error("bad-status", value.position, tag, what, hint)

    def _child(self, written: str, position: Position, tag: str) -> None:
        """A child is named by its number, or by a variable that has the number."""
        if (written.isascii() and written.isdigit()) or is_integer(
            self._variables.get(written, ANY)
        ):
            return
        integers = [name for name, kind in self._variables.items() if is_integer(kind)]
        hint = nearest(written, integers) or "children are numbered from 0"
        what = f"the child `{written}` is neither a number nor an integer variable"
        self._log.error("unknown-child", position, tag, what, hint)

    def _fields(self, emit: Emit, tag: str, inner: str, kind: Structure, scope: Scope) -> None:
        """Check what is sent by the element ``tag``, whose children ``inner`` set the fields of ``kind``."""
        for field in emit.fields:
            wanted = self._field_type(field, kind)
            if wanted is not None:
                expected = None if wanted == ANY else wanted
                check_expression(field.value, scope, expected, inner, self._log)
        given = {field.name.partition(".")[0] for field in emit.fields}
        missing = [
            path
            for name, of in kind.fields
            if name not in given
            for path in _without_default(kind, name, of)
        ]
        if missing:
            names = ", ".join(f"`{name}`" for name in missing)
            are, they, them = (
                ("is", "it is", "it") if len(missing) == 1 else ("are", "they are", "them")
            )
            what = f"{names} of {describe(kind)} {are} never set"
            hint = f"{they} sent as zero or empty; set {them} with <{inner}>"
            self._log.warning("unset-output-field", emit.position, tag, what, hint)

    def _field_type(self, field: Field, kind: Structure) -> DataType | None:
        current: DataType = kind
        for name in field.name.split("."):
            found = part(current, name)
            if found is None:
                inner = current.element if isinstance(current, Array) else current
                names = [key for key, _ in inner.fields] if isinstance(inner, Structure) else []
                what = f"{describe(current)} has no field `{name}`"
                hint = nearest(name, names) or "it has no fields"
                self._log.error("unknown-field", field.position, "field", what, hint)
                return None
            current = found
        return current


def _without_default(owner: Structure, name: str, kind: DataType) -> list[str]:
    """What of the field ``name`` of ``owner`` is sent as zero or empty where nothing sets it.

    That is the field, or those in it that have no default, if others have one.
    """
    if any(name == known for known, _ in owner.defaults):
        return []
    inner, below = kind, f"{name}."
    while isinstance(inner, Array) and inner.fixed:
        inner, below = inner.element, f"{below[:-1]}[]."
    if not isinstance(inner, Structure):
        return [name]
    parts = [(key, _without_default(inner, key, of)) for key, of in inner.fields]
    if parts and all(found == [key] for key, found in parts):
        return [name]
    return [below + path for _, found in parts for path in found]
