"""MOON's property files: ``properties/ports`` and ``properties/{assumes,guarantees}/property``.

Read as MOON's generator reads them, and where it is silent or fails (scopes, patterns and bounds that
it does not translate, ports other than topics) with the meaning that docs/property-semantics.md gives.
"""

from __future__ import annotations

from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.language.datatypes import ANY, DataType
from m2c.language.evaluate import evaluate
from m2c.language.expressions import Expression
from m2c.language.parsing import parse_expression
from m2c.model.xml import Element, parse_xml, read_xml
from moon.properties.files.common import (
    ACTION_PARTS,
    MAX_SHOWN,
    SERVICE_PARTS,
    Declared,
    MessagePath,
    Names,
    absolute,
    action_place,
    field_path,
    finish,
    goal_id_place,
    interval,
    one_of,
    read_condition,
    read_formula,
    read_time,
    result_code_place,
    service_place,
    topic_place,
    unknown_keys,
)
from moon.properties.files.interfaces import Interfaces, Named
from moon.properties.formula import Formula, Interval
from moon.properties.patterns import Pattern, PatternName, Scope, ScopeName, looking_back
from moon.properties.property import Port, Property, PropertySeverity, Role
from moon.properties.syntax import TIME_UNITS, TIME_UNITS_HINT

_PORT_NAMES = {
    "ros_topic": "topic_name",
    "ros_service": "service_name",
    "ros_action": "action_name",
}
_MODEL_PORTS = ("scxml_event_send", "port")
"""What the model checkers' property files have instead."""
_TYPES = {
    "bool": bool,
    "boolean": bool,
    "string": str,
    **dict.fromkeys(("float", "double", "float32", "float64"), float),
    **dict.fromkeys(("int", "byte", "char"), int),
    **{f"{sign}int{bits}": int for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
_SCOPES = {
    **{name.value: name for name in ScopeName},
    "after-until": ScopeName.AFTER_UNTIL,
    "after until": ScopeName.AFTER_UNTIL,
    "global": ScopeName.GLOBALLY,
}
_PATTERNS = {
    **{name.value: name for name in PatternName},
    **{name.value.replace("_", "-"): name for name in PatternName},
    **{name.value.replace("_", " "): name for name in PatternName},
}


def read_property_xml(
    path: Path, log: DiagnosticLog, interfaces: Interfaces | None = None
) -> list[Property]:
    """The properties of the file at ``path``; what is wrong goes to ``log``."""
    root = read_xml(path, log)
    return _File(log, interfaces).read(root) if root is not None else []


def parse_property_xml(
    content: bytes, file: str, log: DiagnosticLog, interfaces: Interfaces | None = None
) -> list[Property]:
    """The properties of ``content``, which messages call ``file``."""
    root = parse_xml(content, file, log)
    return _File(log, interfaces).read(root) if root is not None else []


class _File:
    def __init__(self, log: DiagnosticLog, interfaces: Interfaces | None) -> None:
        self._log = log
        self._names = Names(interfaces)

    def _error(self, position: Position, element: Element, message: str, hint: str = "") -> None:
        self._log.error("bad-property-file", position, element.tag, message, hint)

    def _attributes(self, element: Element, *allowed: str) -> None:
        """Report those of ``element`` that are none of ``allowed``."""
        given = {key: element.at(key) for key in element.attributes}
        unknown_keys(given, set(allowed), element.tag, self._log)

    def read(self, root: Element) -> list[Property]:
        if root.tag != "properties":
            self._error(
                root.position, root, "this is not a property file", "its root is <properties>"
            )
            return []
        found: list[Property] = []
        self._attributes(root)
        for child in sorted(root.children, key=lambda item: item.tag != "ports"):
            if child.tag in ("ports", "assumes", "guarantees"):
                self._attributes(child)
            if child.tag == "ports":
                for port in child.children:
                    self._port(port)
                    names = {variable.get("id") for variable in (port, *port.children)}
                    self._names.faulty |= names - self._names.ports.keys()
            elif child.tag in ("assumes", "guarantees"):
                role = Role.ASSUMPTION if child.tag == "assumes" else Role.GUARANTEE
                found += self._properties(child, role, {item.name for item in found})
            elif child.tag == "predicates":
                self._error(
                    child.position,
                    child,
                    "predicates of their own are not part of MOON's form",
                    "write the expression where it is used: <event>battery &lt; 30</event>",
                )
            else:
                self._error(
                    child.position,
                    child,
                    "this element means nothing here",
                    "<ports>, <assumes> and <guarantees> do",
                )
        if not any(child.tag in ("assumes", "guarantees") for child in root.children):
            self._error(root.position, root, "no properties", "add <guarantees> or <assumes>")
        return found

    # -- ports --------------------------------------------------------------------------------

    def _port(self, port: Element) -> None:
        if port.tag == "clock":
            self._log.note(
                "clock-port",
                port.position,
                "clock",
                "not needed: time comes from the stamps and timers",
            )
            return
        if port.tag in _MODEL_PORTS:
            self._error(
                port.position,
                port,
                "this names an event between models, for a model checker; nothing on a robot sends it",
                "name the channel: <ros_topic topic_name=…>, <ros_service …> or <ros_action …>",
            )
            return
        if port.tag not in _PORT_NAMES:
            self._error(
                port.position,
                port,
                "this is not a port",
                "ros_topic, ros_service, ros_action or clock",
            )
            return
        key = _PORT_NAMES[port.tag]
        name = port.get(key) or (port.get("topic") if port.tag == "ros_topic" else "")
        self._attributes(port, key, "type", "event", "topic", "qos_reliability")
        if not name:
            self._error(port.position, port, f"it has no {key}", f'{key}="/name"')
            return
        part = port.get("event") or ("goal" if port.tag == "ros_action" else "")
        parts = {"ros_service": SERVICE_PARTS, "ros_action": ACTION_PARTS}.get(port.tag)
        if parts is not None and part not in parts:
            what = (
                f'event="{part}" is none of its parts'
                if part
                else "which part is meant is not said"
            )
            self._error(port.at("event"), port, what, f"event is {' or '.join(parts)}")
            return
        kind, at = port.tag.removeprefix("ros_"), port.at(key if port.get(key) else "topic")
        channel, type_at = absolute(name), port.at("type")
        named = Named(kind, channel, part, port.get("type"), at, type_at, port.tag)
        contents = self._names.contents(named, self._log)
        if contents is None:
            return
        for variable in port.children:
            self._variable(port, name, part, contents, variable)

    def _variable(
        self, port: Element, channel: str, part: str, contents: DataType, variable: Element
    ) -> None:
        is_state = variable.tag == "state_var"
        if is_state or variable.tag in ("event_var", "goal_id", "result_code"):
            of_state = ("field", "param", "expr") if is_state else ()
            self._attributes(variable, "id", "type", *of_state)
        name = variable.get("id")
        if not name.isidentifier():
            self._error(variable.at("id"), variable, f'id="{name}" is not a name')
            return
        if self._names.known(name):
            self._error(variable.at("id"), variable, f"`{name}` is declared twice")
            return
        match port.tag:
            case "ros_topic":
                place = topic_place(channel)
            case "ros_service":
                place = service_place(channel, part)
            case _:
                place = action_place(channel, part)
        position = variable.position
        match variable.tag:
            case "state_var":
                self._state(variable, name, place, contents)
                return
            case "event_var":
                made = Port(name, place[0], place[1], (), True, position=position)
            case "goal_id" | "result_code" if port.tag == "ros_action":
                where = goal_id_place if variable.tag == "goal_id" else result_code_place
                place = where(channel)
                made = Port(name, *place, position=position)
            case _:
                self._error(
                    position, variable, f"a <{port.tag}> has no such variable",
                    "state_var and event_var; goal_id and result_code of an action",
                )  # fmt: skip
                return
        self._names.declare(made, ANY, (), {}, variable.tag, self._log)

    def _state(self, variable: Element, name: str, place: MessagePath, contents: DataType) -> None:
        field = variable.get("field") or variable.get("param")
        parts = field_path(field) if field else None
        if parts is None:
            self._error(
                variable.at("field"),
                variable,
                f'field="{shortened(field or "", MAX_SHOWN)}" is not a field',
                "field, or outer.inner",
            )
            return
        initial: msgspec.UnsetType | bool | float | str = msgspec.UNSET
        if "expr" in variable.attributes:
            initial = self._initial(variable)
        at = variable.position
        made = Port(name, place[0], place[1], (*place[2], *parts), initial=initial, position=at)
        places = {"initial": variable.at("expr")} | {k: variable.at(k) for k in ("field", "type")}
        written = _TYPES.get(variable.get("type"))
        example = written() if written is not None else msgspec.UNSET
        self._names.declare(made, contents, parts, places, variable.tag, self._log, example)

    def _initial(self, variable: Element) -> msgspec.UnsetType | bool | int | float | str:
        before = len(self._log.diagnostics)
        expression: Expression | None = parse_expression(
            variable.get("expr"), variable.at("expr"), variable.tag, self._log
        )
        if expression is None:
            return msgspec.UNSET
        wanted = _TYPES.get(variable.get("type"))
        try:
            value = evaluate(expression, {}, {})
        except Exception as error:
            self._error(
                variable.at("expr"), variable, f"the initial value is not a constant: {error}"
            )
            return msgspec.UNSET
        if wanted is None and variable.get("type"):
            self._error(
                variable.at("type"), variable, f"`{variable.get('type')}` is not a type",
                "bool, int8 to uint64, float32, float64 or string",
            )  # fmt: skip
        elif wanted is float and type(value) is int:
            value = float(value)
        elif wanted is not None and type(value) is not wanted:
            self._error(
                variable.at("expr"), variable,
                f"the initial value {variable.get('expr')} is not of type {variable.get('type')}",
            )  # fmt: skip
        return value if len(self._log.diagnostics) == before else msgspec.UNSET

    # -- properties ---------------------------------------------------------------------------

    def _properties(self, parent: Element, role: Role, taken: set[str]) -> list[Property]:
        found = []
        for element in parent.children:
            if element.tag != "property":
                self._error(
                    element.position,
                    element,
                    "only <property> stands here",
                    '<property id="…" pattern="…"> or <property id="…" expr="formula"/>',
                )
                continue
            name = element.get("id")
            if not name or name in taken:
                what = f"`{name}` is declared twice" if name else "the property has no id"
                self._error(element.at("id"), element, what)
                continue
            made = self._property(element, name, role)
            if made is not None:
                taken.add(name)
                found.append(made)
        return found

    def _property(self, element: Element, name: str, role: Role) -> Property | None:
        self._attributes(element, "id", "pattern", "expr", "logic", "most", "severity", "text")
        severity = element.get("severity") or "error"
        if severity not in list(PropertySeverity):
            hint = ", ".join(PropertySeverity)
            self._error(element.at("severity"), element, f"`{severity}` is not a severity", hint)
            return None
        what: Pattern | Formula | None
        instead = None
        if element.get("expr"):
            what = read_formula(
                element.attributes["expr"], element.at("expr"), "property", self._names, self._log
            )
        else:
            what = self._pattern(element)
            if what is not None:
                timed = any("time" in child.attributes for child in element.all("time_interval"))
                instead = looking_back(what) if timed else None
        if what is None:
            return None
        declared = Declared(
            name, element.position, element.get("text"), PropertySeverity(severity), role
        )
        return finish(declared, what, self._names, self._log, instead)

    def _pattern(self, element: Element) -> Pattern | None:
        name = _PATTERNS.get(element.get("pattern"))
        if name is None:
            written = element.get("pattern")
            what, hint = f'pattern="{written}" is not a pattern', one_of(written, list(PatternName))
            self._error(element.at("pattern"), element, what, hint)
            return None
        events: list[Formula | None] = []
        scope: Scope | None = Scope()
        bound: Interval | None = Interval()
        scoped = False
        for child in element.children:
            match child.tag:
                case "event":
                    events.append(self._event(child))
                case "events":
                    self._attributes(child)
                    events += [self._event(item) for item in child.children]
                case "scope" if not scoped:
                    scope, scoped = self._scope(child), True
                case "time_interval":
                    bound = self._interval(child)
                case _:
                    self._error(
                        child.position, child, "this element means nothing here",
                        "event, events, scope and time_interval do, the last two once",
                    )  # fmt: skip
                    return None
        most = element.get("most") or "2"
        if not (most.isascii() and most.isdecimal()) or len(most) > 3:
            self._error(element.at("most"), element, f'most="{most}" is not a number')
            return None
        if scope is None or bound is None or any(event is None for event in events):
            return None
        kept = tuple(event for event in events if event is not None)
        return Pattern(name, kept, scope, bound, int(most))

    def _event(self, element: Element) -> Formula | None:
        self._attributes(element, "edge")
        lead = element.text[: len(element.text) - len(element.text.lstrip())]
        which = element.get("edge")
        if which not in ("", "rises", "falls"):
            self._error(element.at("edge"), element, f'edge="{which}" is neither rises nor falls')
            return None
        at = _after(element, lead)
        return read_condition(element.text.strip(), at, element.tag, self._names, self._log, which)

    def _scope(self, element: Element) -> Scope | None:
        name = _SCOPES.get(element.get("type"))
        if name is None:
            what = f'type="{element.get("type")}" is not a scope'
            self._error(element.at("type"), element, what, ", ".join(ScopeName))
            return None
        allowed = {
            ScopeName.GLOBALLY: (),
            ScopeName.BEFORE: ("event",),
            ScopeName.AFTER: ("event",),
            ScopeName.BETWEEN: ("begin", "end"),
            ScopeName.AFTER_UNTIL: ("begin", "end"),
        }[name]
        unknown_keys(
            {key: element.at(key) for key in element.attributes if element.get(key)},
            {"type", *allowed}, "scope", self._log,
        )  # fmt: skip
        delimiters = []
        for key in allowed:
            if not element.get(key):
                self._error(element.position, element, f"a scope `{name}` needs {key}=")
                return None
            delimiters.append(
                read_condition(element.get(key), element.at(key), "scope", self._names, self._log)
            )
        if any(delimiter is None for delimiter in delimiters):
            return None
        match name:
            case ScopeName.GLOBALLY:
                return Scope()
            case ScopeName.BEFORE:
                return Scope(name, None, delimiters[0])
            case _:
                return Scope(name, *delimiters)

    def _interval(self, element: Element) -> Interval | None:
        self._attributes(element, "time", "after", "within", "time_unit")
        unit = element.get("time_unit")
        if unit not in TIME_UNITS:
            what = f"`{unit}` is not a unit of time" if unit else "the unit of time is not said"
            at = element.at("time_unit")
            self._log.error("bad-time", at, element.tag, what, TIME_UNITS_HINT)
            return None
        times: dict[str, int | None] = {}
        for key in ("time", "after", "within"):
            if key in element.attributes:
                found = read_time(element.get(key), unit, element.at(key), element.tag, self._log)
                if found is None:
                    return None
                times[key] = found
        if not times or ("time" in times and len(times) > 1):
            self._error(
                element.position, element, "which time is not clear", "time, or after and/or within"
            )
            return None
        return interval(times.get("after"), times.get("time", times.get("within")))


def _after(element: Element, lead: str) -> Position:
    """Where an element's text begins, ``lead`` (white space) after its start tag.

    Exactly, if the tag has no attributes or ends its line; else the tag's own column.
    """
    at = element.position
    if "\n" in lead:
        column = len(lead) - lead.rfind("\n")
        return Position(at.file, at.line + lead.count("\n"), column)
    inside = len(f"<{element.tag}>") + len(lead) if not element.attributes else 0
    return Position(at.file, at.line, at.column + inside)
