"""Our property files: ports, named predicates and properties in plain YAML."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.language.datatypes import ANY, DataType
from m2c.language.expressions import Expression
from m2c.language.parsing import parse_expression
from m2c.model.walk import variables_of
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
    interval,
    one_of,
    read_condition,
    read_formula,
    read_time,
    service_place,
    topic_place,
    unknown_keys,
)
from moon.properties.files.interfaces import Interfaces, Named, faults
from moon.properties.formula import Formula, Interval
from moon.properties.patterns import Pattern, PatternName, Scope, ScopeName
from moon.properties.predicates import PredicateError, truth_source
from moon.properties.property import Port, Property, PropertySeverity, Role
from moon.properties.syntax import TIME_UNITS_HINT
from moon.yaml_tree import (
    Mapping,
    Scalar,
    Sequence,
    YamlNode,
    parse_yaml,
    read_yaml,
)

_TIME = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]+)", re.ASCII)
_EVENTS: dict[PatternName, tuple[str, ...]] = {
    **dict.fromkeys(PatternName, ("of",)),
    PatternName.PRECEDENCE: ("cause", "effect"),
    PatternName.RESPONSE: ("request", "response"),
    PatternName.RESPONSE_CHAIN: ("request", "responses"),
    PatternName.PRECEDENCE_CHAIN: ("causes", "effect"),
}
_LISTS = {"responses", "causes"}
_EDGES = {"rises", "falls"}
_SCOPES = {name.value: name for name in ScopeName if name is not ScopeName.GLOBALLY}
_COMMON = {"id", "text", "severity", "role"}


def read_property_yaml(
    path: Path, log: DiagnosticLog, interfaces: Interfaces | None = None
) -> list[Property]:
    """The properties of the file at ``path``; what is wrong goes to ``log``."""
    tree = read_yaml(path, log)
    return _File(log, interfaces).read(tree) if tree is not None else []


def parse_property_yaml(
    content: bytes, file: str, log: DiagnosticLog, interfaces: Interfaces | None = None
) -> list[Property]:
    """The properties of ``content``, which messages call ``file``."""
    tree = parse_yaml(content, file, log)
    return _File(log, interfaces).read(tree) if tree is not None else []


class _File:
    def __init__(self, log: DiagnosticLog, interfaces: Interfaces | None) -> None:
        self._log = log
        self._names = Names(interfaces)

    def _error(self, position: Position, element: str, message: str, hint: str = "") -> None:
        self._log.error("bad-property-file", position, element, message, hint)

    def _mapping(self, node: YamlNode | None, what: str) -> Mapping | None:
        if isinstance(node, Mapping):
            return node
        if node is not None:
            self._error(node.position, "", f"{what} is a map")
        return None

    def _text(self, parent: Mapping, key: str, element: str) -> Scalar | None:
        """The scalar at ``key``; None (reported) if it is something else, None if it is absent."""
        node = parent.entries.get(key)
        if node is None or isinstance(node, Scalar):
            return node
        self._error(node.position, element, f"`{key}` is one text")
        return None

    def read(self, tree: YamlNode) -> list[Property]:
        root = self._mapping(tree, "a property file")
        if root is None:
            return []
        unknown_keys(root.keys, {"ports", "predicates", "properties"}, "", self._log)
        ports = self._mapping(root.entries.get("ports"), "`ports`")
        for name, position, node in ports.members() if ports is not None else ():
            self._port(name, position, node)
            if name not in self._names.ports:
                self._names.faulty.add(name)
        named = self._mapping(root.entries.get("predicates"), "`predicates`")
        for name, position, node in named.members() if named is not None else ():
            self._predicate(name, position, node)
            if not self._names.known(name):
                self._names.faulty.add(name)
        properties = root.entries.get("properties")
        if not isinstance(properties, Sequence):
            at = properties.position if properties is not None else root.position
            self._error(at, "", "no list of `properties`", "properties: [{id: …, pattern: …}]")
            return []
        found: dict[str, Property] = {}
        for item in properties.items:
            made = self._property(item, found)
            if made is not None:
                found[made.name] = made
        return list(found.values())

    # -- ports and predicates -----------------------------------------------------------------

    def _taken(self, name: str, position: Position, element: str) -> bool:
        if not name.isidentifier():
            self._error(position, element, f"`{name}` is not a name", "letters, digits and _")
            return True
        if self._names.known(name):
            self._error(position, element, f"`{name}` is declared twice")
            return True
        return False

    def _port(self, name: str, position: Position, node: YamlNode) -> None:
        if self._taken(name, position, "ports"):
            return
        port = self._mapping(node, f"the port `{name}`")
        if port is None:
            return
        allowed = {"topic", "service", "action", "type", "on", "field", "keep", "when", "initial"}
        unknown_keys(port.keys, allowed, "ports", self._log)
        found = self._place(name, port)
        if found is None:
            return
        place, contents = found
        field = self._text(port, "field", "ports")
        keep = self._text(port, "keep", "ports")
        when, initial = self._text(port, "when", "ports"), port.entries.get("initial")
        path = place[2]
        fields: tuple[str, ...] = ()
        if field is not None:
            parts = field_path(field.text)
            if parts is None:
                shown = shortened(field.text, MAX_SHOWN)
                self._error(field.position, "ports", f"`{shown}` is not a field", "a or a.b")
                return
            path, fields = (*path, *parts), parts
        state = field is not None or (keep is not None and keep.text == "true")
        if keep is not None and keep.text not in ("true", "false"):
            self._error(keep.position, "ports", "`keep` is true or false")
            return
        if state and when is not None:
            self._error(when.position, "ports", "`when` belongs to an event, `field` to a state")
            return
        if not state and initial is not None:
            self._error(initial.position, "ports", "an event has no `initial` value", "add `field`")
            return
        condition: Expression | None = None
        if when is not None and (condition := self._when(when, place[2], contents)) is None:
            return
        value = self._initial(initial)
        if state:
            made = Port(name, place[0], place[1], path, initial=value, position=position)
        else:
            made = Port(name, place[0], place[1], (), True, condition, position=position)
        at = {key: node.position for key, node in port.entries.items()}
        self._names.declare(made, contents, fields, at, "ports", self._log)

    def _place(self, name: str, port: Mapping) -> tuple[MessagePath, DataType] | None:
        """Where it listens, and the type of the message there."""
        given = [key for key in ("topic", "service", "action") if key in port.entries]
        if len(given) != 1:
            hint = "exactly one of topic, service and action"
            self._error(
                port.position, "ports", f"which channel `{name}` listens to is not clear", hint
            )
            return None
        channel = self._text(port, given[0], "ports")
        if channel is None:
            return None
        if not re.fullmatch(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", channel.text, re.ASCII):
            hint = "a name such as /battery/level"
            shown = shortened(channel.text, MAX_SHOWN)
            self._error(channel.position, "ports", f"`{shown}` is not a channel", hint)
            return None
        part = self._text(port, "on", "ports")
        if given[0] == "topic":
            if part is not None:
                self._error(part.position, "ports", "a topic has no parts", "leave `on` out")
                return None
            return self._typed(port, given[0], channel, "", topic_place(channel.text))
        parts = SERVICE_PARTS if given[0] == "service" else ACTION_PARTS
        if part is None or part.text not in parts:
            at = part.position if part is not None else port.position
            self._error(
                at,
                "ports",
                f"which part of the {given[0]} is not clear",
                f"on: {' or '.join(parts)}",
            )
            return None
        make = service_place if given[0] == "service" else action_place
        place = make(channel.text, part.text)
        return self._typed(port, given[0], channel, part.text, place)

    def _typed(
        self, port: Mapping, kind: str, channel: Scalar, part: str, place: MessagePath
    ) -> tuple[MessagePath, DataType] | None:
        written = self._text(port, "type", "ports")
        if written is None and "type" in port.entries:
            return None
        type_name = written.text if written is not None else ""
        at = written.position if written is not None else channel.position
        name = absolute(channel.text)
        named = Named(kind, name, part, type_name, _inside(channel), at, "ports")
        contents = self._names.contents(named, self._log)
        return None if contents is None else (place, contents)

    def _when(self, when: Scalar, path: tuple[str, ...], contents: DataType) -> Expression | None:
        found = parse_expression(when.text, _inside(when), "when", self._log)
        if found is None:
            return None
        others = [name for name in variables_of(found) if name != "data"]
        if others:
            what = f"`{others[0]}` is not known here"
            self._error(_inside(when), "when", what, "`when` speaks of the message, as data.field")
            return None
        try:
            truth_source(found, {"data": "data"})
        except PredicateError as error:
            self._error(_inside(when), "when", str(error))
            return None
        wrong = faults(found, {"data": contents}) if contents != ANY else []
        for at, what in wrong:
            self._log.error("type-mismatch", at, "when", what)
        return None if wrong else _shifted(found, path)

    def _initial(self, node: YamlNode | None) -> Any:
        if node is None:
            return msgspec.UNSET
        if not isinstance(node, Scalar):
            self._error(node.position, "ports", "`initial` is one value")
            return msgspec.UNSET
        if not node.plain:
            return node.text
        try:
            return msgspec.json.decode(node.text, type=bool | int | float)
        except msgspec.DecodeError:
            return node.text

    def _predicate(self, name: str, position: Position, node: YamlNode) -> None:
        if self._taken(name, position, "predicates"):
            return
        found = self._condition(node, "predicates", name)
        if found is not None:
            self._names.predicates[name] = found

    # -- properties ---------------------------------------------------------------------------

    def _property(self, node: YamlNode, taken: dict[str, Property]) -> Property | None:
        entry = self._mapping(node, "a property")
        if entry is None:
            return None
        name = self._text(entry, "id", "properties")
        if name is None or not name.text or name.text in taken:
            wrong = (
                f"`{name.text}` is declared twice"
                if name and name.text
                else "the property has no `id`"
            )
            self._error(name.position if name else entry.position, "properties", wrong)
            return None
        severity = self._choice(entry, "severity", list(PropertySeverity), PropertySeverity.ERROR)
        role = self._choice(entry, "role", list(Role), Role.GUARANTEE)
        text = self._text(entry, "text", "properties")
        if ("formula" in entry.entries) == ("pattern" in entry.entries):
            self._error(
                entry.position, "properties", f"`{name.text}` needs a `pattern` or a `formula`"
            )
            return None
        what: Formula | Pattern | None
        if "formula" in entry.entries:
            unknown_keys(entry.keys, {*_COMMON, "formula"}, "properties", self._log)
            formula = self._text(entry, "formula", "properties")
            if formula is None:
                return None
            what = read_formula(formula.text, _inside(formula), "formula", self._names, self._log)
        else:
            what = self._pattern(entry)
        if what is None or severity is None or role is None:
            return None
        told = text.text if text is not None else ""
        declared = Declared(name.text, entry.position, told, PropertySeverity(severity), Role(role))
        return finish(declared, what, self._names, self._log)

    def _choice(self, entry: Mapping, key: str, allowed: list[Any], default: str) -> str | None:
        found = self._text(entry, key, "properties")
        if found is None:
            return default
        if found.text not in allowed:
            hint = one_of(found.text, allowed)
            self._error(found.position, key, f"`{found.text}` is not a {key}", hint)
            return None
        return found.text

    def _pattern(self, entry: Mapping) -> Pattern | None:
        word = self._text(entry, "pattern", "properties")
        if word is None:
            return None
        if word.text not in list(PatternName):
            hint = one_of(word.text, list(PatternName))
            self._error(word.position, "pattern", f"`{word.text}` is not a pattern", hint)
            return None
        name = PatternName(word.text)
        roles = _EVENTS[name]
        allowed = {*_COMMON, "pattern", *roles, *_SCOPES, "within", "no_sooner"}
        if name is PatternName.BOUNDED_EXISTENCE:
            allowed.add("at_most")
        unknown_keys(entry.keys, allowed, "properties", self._log)
        events: list[Formula] = []
        for role in roles:
            found = self._conditions(entry, role, 0 if role in _LISTS else 1)
            if found is None:
                return None
            events += found
        scope, bound = self._scope(entry), self._bound(entry)
        most = self._text(entry, "at_most", "properties")
        if most is not None and not (
            most.text.isascii() and most.text.isdecimal() and len(most.text) < 4
        ):
            self._error(most.position, "at_most", f"`{most.text}` is not a number")
            return None
        if scope is None or bound is None:
            return None
        return Pattern(name, tuple(events), scope, bound, int(most.text) if most else 2)

    def _conditions(self, entry: Mapping, key: str, count: int) -> list[Formula] | None:
        """``count`` conditions (0: a list of any length) at ``key``."""
        node = entry.entries.get(key)
        if node is None:
            self._error(entry.position, "properties", f"the pattern needs `{key}`")
            return None
        items = node.items if isinstance(node, Sequence) else [node]
        if isinstance(node, Sequence) == (count == 1) or (count and len(items) != count):
            wanted = {0: "a list of conditions", 1: "one condition"}.get(
                count, f"a list of {count}"
            )
            self._error(node.position, key, f"`{key}` is {wanted}")
            return None
        found = []
        for item in items:
            made = self._condition(item, key, key)
            if made is None:
                return None
            found.append(made)
        return found

    def _condition(self, node: YamlNode, element: str, what: str) -> Formula | None:
        """The condition that ``node`` is: an expression, or that one ``rises`` or ``falls``."""
        which = ""
        if isinstance(node, Mapping):
            unknown_keys(node.keys, _EDGES, element, self._log)
            which = next(iter(node.entries), "")
            if len(node.entries) == 1 and which in _EDGES:
                node = node.entries[which]
            elif node.keys.keys() <= _EDGES:
                self._error(node.position, element, f"`{what}` needs one of `rises` and `falls`")
                return None
            else:
                return None
        if not isinstance(node, Scalar):
            self._error(node.position, element, f"`{what}` is one expression")
            return None
        return read_condition(node.text, _inside(node), element, self._names, self._log, which)

    def _scope(self, entry: Mapping) -> Scope | None:
        given = [key for key in _SCOPES if key in entry.entries]
        if len(given) > 1:
            self._error(
                entry.keys[given[1]],
                "properties",
                f"`{given[0]}` and `{given[1]}` exclude each other",
            )
            return None
        if not given:
            return Scope()
        name = _SCOPES[given[0]]
        double = name in (ScopeName.BETWEEN, ScopeName.AFTER_UNTIL)
        found = self._conditions(entry, given[0], 2 if double else 1)
        if found is None:
            return None
        if name is ScopeName.BEFORE:
            return Scope(name, None, found[0])
        return Scope(name, *found)

    def _bound(self, entry: Mapping) -> Interval | None:
        times: dict[str, int | None] = {}
        for key in ("no_sooner", "within"):
            node = self._text(entry, key, "properties")
            if node is None:
                if key in entry.entries:
                    return None
                continue
            match = _TIME.fullmatch(node.text.strip())
            if match is None:
                hint = f"a number and a unit, {TIME_UNITS_HINT}, as 5 s"
                self._error(node.position, key, f"`{node.text}` is not a time", hint)
                return None
            times[key] = read_time(match[1], match[2], node.position, key, self._log)
            if times[key] is None:
                return None
        return interval(times.get("no_sooner"), times.get("within"))


def _inside(scalar: Scalar) -> Position:
    """Where a scalar's text begins: past the quote."""
    shift = 0 if scalar.plain else 1
    at = scalar.position
    return Position(at.file, at.line, at.column + shift)


def _shifted(expression: Expression, path: tuple[str, ...]) -> Expression:
    """``expression`` with ``data`` standing for the part of the message at ``path``."""
    from m2c.language.expressions import Member, Node, Variable

    def walk(node: Any) -> Any:
        if isinstance(node, Variable):
            found: Expression = node
            for name in path:
                found = Member(object=found, name=name)
            return found
        if not isinstance(node, Node):
            return tuple(walk(item) for item in node) if isinstance(node, tuple) else node
        changes = {name: walk(getattr(node, name)) for name in node.__struct_fields__}
        return msgspec.structs.replace(node, **changes)

    made: Expression = walk(expression)
    return made
