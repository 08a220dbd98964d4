"""Reading executable content: assignments, conditions, logs, events and outputs."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.language.conversion import STATUSES, ExecutionError
from m2c.language.durations import parse_duration, seconds
from m2c.language.expressions import EventPart, Expression, Literal, PortInput, Variable, nodes
from m2c.language.parsing import parse_expression, parse_location, python_boolean
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Assign,
    Cancel,
    Emit,
    Event,
    Field,
    Foreach,
    If,
    Interface,
    InterfaceKind,
    Log,
    OutputKind,
    Raise,
    Statement,
)
from m2c.model.scopes import parts_in_data
from m2c.model.structure import check_element, exclude, note_read_as, require
from m2c.model.vocabulary import EVENT_PROCESSORS, EXECUTABLE, HANDLERS, OUTPUTS, UNSUPPORTED
from m2c.model.xml import Element
from m2c.suggestions import nearest

_NO_MACHINE = re.compile(r"[#:/]")
"""What the name of a machine has not, but addresses of other processors have (W3C SCXML 6.2.4)."""
_WHICH_GOAL = 'write goal_id="_action.goal_id", or a variable that keeps it'
_MAX_SHOWN = 80
"""Characters of a location that an error repeats."""

LEGACY_SENDS = {
    "bt_halt_response": (OutputKind.BT_RETURN_HALTED, ""),
    **{f"bt_{name.lower()}": (OutputKind.BT_RETURN_STATUS, name) for name in STATUSES},
}
"""How early plugins spell their answers to the tree; see ``m2c.model.states.LEGACY_EVENTS``."""


class ContentReader:
    """Reads expressions and statements of one machine, given its declared interfaces.

    ``parts_in_data``: see :func:`m2c.language.parsing.parse_expression`.
    """

    def __init__(
        self,
        log: DiagnosticLog,
        interfaces: tuple[Interface, ...],
        parts_in_data: Collection[EventPart] = (),
    ) -> None:
        self._log = log
        self._interfaces = interfaces
        self._parts_in_data = parts_in_data

    def inside(self, event: Event | None, library: InterfaceLibrary) -> ContentReader:
        """A reader of what stands in a transition on ``event``."""
        parts = () if event is None else parts_in_data(event, self._interfaces, library)
        return ContentReader(self._log, self._interfaces, parts)

    # -- names --------------------------------------------------------------------------------

    def interface_of(self, element: Element, kind: InterfaceKind) -> str:
        """The name of the declared interface that ``element`` refers to (by name or channel)."""
        attribute = next(
            (
                key
                for key in ("name", "topic", "service_name", "service", "action_name", "action")
                if element.get(key)
            ),
            "name",
        )
        written = require(element, attribute, self._log)
        if not written:
            return ""
        same_kind = [known for known in self._interfaces if known.kind is kind]
        for known in same_kind:
            if written in (known.name, known.channel) or f"/{written}" == known.channel:
                return known.name
        other = next((known for known in self._interfaces if known.name == written), None)
        if other is not None:
            what = f"`{written}` is declared as {_a(other.kind)}, not as {_a(kind)}"
            hint = "declare it with the matching element"
        else:
            what = f"no {kind.noun} called `{written}` is declared"
            names = [known.name for known in same_kind]
            hint = nearest(written, names) or f"declare {_a(kind)} at the top of the machine"
        self._log.error("undeclared-interface", element.at(attribute), element.tag, what, hint)
        return ""

    def handler_event(self, element: Element) -> Event:
        """The event that the handler ``element`` waits for."""
        handler = HANDLERS[element.tag]
        if handler.interface is not None:
            return Event(handler.event, self.interface_of(element, handler.interface))
        if element.tag in ("bt_child_status", "bt_child_halted"):
            return Event(handler.event, require(element, "id", self._log))
        return Event(handler.event)

    # -- expressions --------------------------------------------------------------------------

    def expression_of(
        self, element: Element, attribute: str, optional: bool = False
    ) -> Expression | None:
        """The expression in ``attribute``, in a child ``<expr>`` or ``<bt_get_input>``."""
        if attribute in element.attributes:
            text = element.attributes[attribute]
            return self._parsed(text, element.at(attribute), element)
        if attribute == "expr":
            holder = element.first("expr") or element
            lookup = holder.first("bt_get_input")
            if lookup is not None:
                check_element(lookup, self._log)
                return PortInput(key=require(lookup, "key", self._log), position=lookup.position)
            text = holder.text.strip()
            if text:
                return self._parsed(text, holder.position, element)
        if not optional:
            require(element, attribute, self._log)
        return None

    def _parsed(self, text: str, position: Position, element: Element) -> Expression | None:
        found = parse_expression(
            text, position, element.tag, self._log, self._parts_in_data, has_states=True
        )
        for node in nodes(found) if found is not None else ():
            written = python_boolean(node, text[node.position.column - position.column :].lstrip())
            if written:
                meaning = f"`{written.lower()}`"
                note_read_as(node.position, element.tag, written, meaning, self._log)
        return found

    def fields_of(self, element: Element, tag: str) -> tuple[Field, ...]:
        """The ``<field>`` or ``<param>`` children of ``element``."""
        fields: list[Field] = []
        for child in element.children:
            if not check_element(child, self._log, inside=(tag,), parent=element.tag):
                continue
            name = require(child, "name", self._log)
            exclude(child, "expr", "location", self._log)
            source = "location" if child.get("location") else "expr"
            value = self.expression_of(child, source)
            if any(f"{known.name}.".startswith(f"{name}.") for known in fields) or any(
                name.startswith(f"{known.name}.") for known in fields
            ):
                what = f"`{name}` is set twice"
                self._log.error("duplicate-field", child.position, child.tag, what)
            if value is not None:
                fields.append(Field(name, value, child.position))
        return tuple(fields)

    # -- statements ---------------------------------------------------------------------------

    def block(self, elements: Sequence[Element]) -> tuple[Statement, ...]:
        """The statements that ``elements`` describe, in order."""
        statements: list[Statement] = []
        for element in elements:
            if element.tag in UNSUPPORTED:
                hint = UNSUPPORTED[element.tag]
                self._log.error(
                    "unsupported-element", element.position, element.tag, "not supported", hint
                )
                continue
            where = "executable content"
            if not check_element(element, self._log, inside=EXECUTABLE, parent=where):
                continue
            statement = self._statement(element)
            if statement is not None:
                statements.append(statement)
        return tuple(statements)

    def _statement(self, element: Element) -> Statement | None:
        match element.tag:
            case "assign":
                return self._assign(element)
            case "if":
                return self._if(element)
            case "foreach":
                return self._foreach(element)
            case "log":
                value = self.expression_of(element, "expr", optional=True)
                return Log(element.get("label"), value, element.position)
            case "raise":
                event = require(element, "event", self._log)
                return Raise(event=event, position=element.position)
            case "cancel":
                return Cancel(require(element, "sendid", self._log), element.position)
            case "send":
                return self._send(element)
            case _:
                return self._emit(element)

    def _assign(self, element: Element) -> Assign | None:
        written = require(element, "location", self._log)
        value = self.expression_of(element, "expr")
        if not written:
            return None
        location = parse_location(written, element.at("location"), "assign", self._log)
        if location is None or value is None:
            return None
        return Assign(location, value, element.position)

    def _foreach(self, element: Element) -> Foreach | None:
        array = self.expression_of(element, "array")
        item = self._variable(element, "item")
        index = self._variable(element, "index") if "index" in element.attributes else ""
        body = self.block(element.children)
        if array is None or not item:
            return None
        return Foreach(array=array, item=item, index=index, body=body, position=element.position)

    def _variable(self, element: Element, attribute: str) -> str:
        """The variable that ``attribute`` names; "" if it names none, which is reported."""
        written = require(element, attribute, self._log)
        at = element.at(attribute)
        location = parse_location(written, at, element.tag, self._log) if written else None
        if location is None or isinstance(location, Variable):
            return "" if location is None else location.name
        what = f"`{shortened(written, _MAX_SHOWN)}` is not a variable"
        self._log.error("bad-location", at, element.tag, what, "a loop assigns a variable")
        return ""

    def _if(self, element: Element) -> If:
        branches: list[tuple[Expression | None, list[Element]]] = []
        condition = self.expression_of(element, "cond")
        branches.append((condition, []))
        closed = False
        for child in element.children:
            if child.tag in ("elseif", "else"):
                check_element(child, self._log)
                if closed:
                    what = f"<{child.tag}> after <else>"
                    self._log.error("unknown-tag", child.position, child.tag, what)
                closed = child.tag == "else"
                condition = None if closed else self.expression_of(child, "cond")
                branches.append((condition, []))
                if child.children:
                    self._log.error(
                        "unknown-tag",
                        child.children[0].position,
                        child.children[0].tag,
                        f"content inside <{child.tag}>",
                        f"<{child.tag}/> is empty; its content follows it",
                    )
            else:
                branches[-1][1].append(child)
        return If(
            tuple((condition, self.block(body)) for condition, body in branches), element.position
        )

    def _send(self, element: Element) -> Statement | None:
        if (way := element.get("type").removesuffix("/")) not in EVENT_PROCESSORS:
            what = f"the type `{shortened(way, _MAX_SHOWN)}` is not part of the language"
            hint = "leave it out: an event goes to machines"
            self._log.error("unsupported-element", element.at("type"), "send", what, hint)
            return None
        event = require(element, "event", self._log)
        if event in LEGACY_SENDS:
            kind, status = LEGACY_SENDS[event]
            meaning = f'<bt_return_status status="{status}">' if status else "<bt_return_halted>"
            note_read_as(element.at("event"), "send", event, meaning, self._log)
            named = Literal(value=status, position=element.at("event"))
            answer = (Field("status", named, element.position),) if status else ()
            return Emit(kind=kind, interface="", position=element.position, fields=answer)
        fields = list(self.fields_of(element, "param"))
        for name in element.get("namelist").split():
            value = Variable(name=name, position=element.at("namelist"))
            if any(known.name == name for known in fields):
                what = f"`{name}` is set twice"
                self._log.error("duplicate-field", element.at("namelist"), element.tag, what)
            fields.append(Field(name, value, element.position))
        target = element.get("target")
        if target != "#_internal" and _NO_MACHINE.search(target):
            what = f"the target `{shortened(target, _MAX_SHOWN)}` is not part of the language"
            hint = (
                "name a machine of the system, or #_internal; without a target, every machine that has a "
                "transition for the event gets it"
            )
            self._log.error("unsupported-element", element.at("target"), "send", what, hint)
        delay = self._delay(element)
        if delay is not None and target == "#_internal":
            what = "an internal event has no delay"
            hint = "leave the target out: a delayed event is the machine's own"
            self._log.error("unknown-attribute", element.at("target"), "send", what, hint)
        return Raise(
            event=event,
            position=element.position,
            fields=tuple(fields),
            external=target != "#_internal",
            target=target if target != "#_internal" else "",
            delay_s=delay,
            id=element.get("id"),
        )

    def _delay(self, element: Element) -> Expression | None:
        """What ``delay`` or ``delayexpr`` says: an expression in seconds; None without either."""
        exclude(element, "delay", "delayexpr", self._log)
        delay = self.expression_of(element, "delayexpr", optional=True)
        if isinstance(delay, Literal) and isinstance(delay.value, int | float):
            delay = self._written_out(delay)
        if element.get("delay"):
            written = parse_duration(element.get("delay"))
            if written is None:
                what = f"`{element.get('delay')}` is not a time"
                hint = "write it like 5s or 200ms"
                self._log.error("bad-duration", element.at("delay"), "send", what, hint)
            delay = Literal(value=written or 0.0, position=element.at("delay"))
        return delay

    def _written_out(self, delay: Literal) -> Literal:
        """A ``delayexpr`` that is a number, of milliseconds, in seconds."""
        try:
            in_seconds = seconds(delay.value)
        except ExecutionError as error:
            hint = "write it like '5s', or a number of milliseconds"
            self._log.error("bad-duration", delay.position, "send", str(error), hint)
            in_seconds = 0.0
        return Literal(value=in_seconds, position=delay.position)

    def _emit(self, element: Element) -> Emit | None:
        output = OUTPUTS[element.tag]
        interface = ""
        if output.interface is not None:
            interface = self.interface_of(element, output.interface)
            if not interface:
                return None
        fields: tuple[Field, ...] = ()
        match output.kind:
            case OutputKind.BT_RETURN_STATUS:
                status = require(element, "status", self._log).strip()
                at = element.at("status")
                value: Expression = Variable(name=status, position=at)
                if not status or status in STATUSES:
                    value = Literal(value=status, position=at)
                fields = (Field("status", value, element.position),)
            case OutputKind.BT_SET_OUTPUT:
                interface = require(element, "key", self._log)
                written = self.expression_of(element, "expr")
                if written is not None:
                    fields = (Field("value", written, element.position),)
            case OutputKind.BT_TICK_CHILD | OutputKind.BT_HALT_CHILD:
                interface = require(element, "id", self._log)
            case _:
                fields = self.fields_of(element, "field")
        if (
            output.interface is InterfaceKind.ACTION_SERVER
            and output.kind is not OutputKind.THREAD_FREE
        ):
            require(element, "goal_id", self._log, _WHICH_GOAL)
        if output.kind is OutputKind.START_THREAD:
            require(element, "thread_id", self._log, "it is the thread's number, from 0")
        return Emit(
            kind=output.kind,
            interface=interface,
            position=element.position,
            fields=fields,
            goal_id=self.expression_of(element, "goal_id", optional=True),
            thread_id=self.expression_of(element, "thread_id", optional=True),
        )


def _a(kind: InterfaceKind) -> str:
    return f"{'an' if kind.noun.startswith('a') else 'a'} {kind.noun}"
