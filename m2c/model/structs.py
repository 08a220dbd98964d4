"""Data structures that a system declares for its models: by XML, or by a JSON Schema.

The XML is ``<types>`` with a ``<struct id="…">`` each, which has a ``<member id="…" type="…"/>`` for each
member. Of a JSON Schema (https://json-schema.org/draft/2020-12) the root and what it refers to are
structures: ``object`` with ``properties``, ``array`` with ``items``, ``$ref`` within the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import Array, DataType, Primitive, Structure
from m2c.model.interfaces import MAX_NESTING, InterfaceLibrary
from m2c.model.json_places import JsonValue, read_json
from m2c.model.structure import check_attributes, require
from m2c.model.types import PRIMITIVES, type_of_text
from m2c.model.xml import Element, read_xml
from m2c.suggestions import nearest

MAX_MEMBERS = 10_000
"""Members of a structure, with those of its members: the largest published one has 3."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9]*(?:_+[A-Za-z0-9]+)*", re.ASCII)
_SCALARS = {"boolean": "bool", "integer": "int32", "number": "float32", "string": "string"}
"""The types of JSON Schema, as AS2FM takes them."""


class _Member(msgspec.Struct, frozen=True):
    name: str
    type: str
    position: Position


class _Declaration(msgspec.Struct, frozen=True):
    name: str
    members: tuple[_Member, ...]
    position: Position


def declare_structures(
    files: Iterable[tuple[Path, str]], library: InterfaceLibrary, log: DiagnosticLog
) -> None:
    """Add the structures that ``files`` declare to ``library``.

    Args:
        files: each with its kind, ``xml`` or ``json``.
        library: which also has the message types that members may have.
        log: where faults go: ``unknown-tag``, ``missing-attribute``, ``unknown-attribute``,
            ``malformed-json``, ``bad-structure``, ``bad-name``, ``duplicate-type``, ``unknown-type``,
            ``recursive-type`` and what :func:`m2c.model.xml.read_xml` reports.
    """
    declared: dict[str, _Declaration] = {}
    for path, kind in files:
        for found in (_of_xml if kind == "xml" else _of_json)(path, log):
            first = declared.get(found.name)
            if first is not None:
                what = f"a second structure is called `{found.name}`"
                hint = f"the first is at {first.position}"
                log.error("duplicate-type", found.position, "", what, hint)
            elif _is_usable(found, log):
                declared[found.name] = found
    _Resolver(declared, library, log).run()


def _is_usable(found: _Declaration, log: DiagnosticLog) -> bool:
    names = [(found.name, found.position), *((item.name, item.position) for item in found.members)]
    usable = True
    for name, at in names:
        if _NAME.fullmatch(name) is None or (name == found.name and name in PRIMITIVES):
            what = f"a structure or member cannot be called `{name}`"
            hint = "letters, digits and _ within, beginning with a letter; not a primitive type"
            log.error("bad-name", at, "", what, hint)
            usable = False
    for index, member in enumerate(found.members):
        if any(member.name == other.name for other in found.members[:index]):
            what = f"a second member of `{found.name}` is called `{member.name}`"
            log.error("bad-structure", member.position, "", what)
            usable = False
    if not found.members:
        what = f"the structure `{found.name}` has no members"
        log.error("bad-structure", found.position, "", what)
        usable = False
    return usable


# -- XML --------------------------------------------------------------------------------------------


def _of_xml(path: Path, log: DiagnosticLog) -> list[_Declaration]:
    root = read_xml(path, log)
    if root is None or not _is_called(root, "types", "the root of a declaration", (), log):
        return []
    found = []
    for element in root.children:
        if not _is_called(element, "struct", "an element of <types>", ("id",), log):
            continue
        name = require(element, "id", log)
        members = [
            _Member(require(member, "id", log), require(member, "type", log), member.at("type"))
            for member in element.children
            if _is_called(member, "member", "an element of <struct>", ("id", "type"), log)
        ]
        if name and all(member.name and member.type for member in members):
            found.append(_Declaration(name, tuple(members), element.at("id")))
    return found


def _is_called(
    element: Element, tag: str, what: str, attributes: tuple[str, ...], log: DiagnosticLog
) -> bool:
    if element.tag != tag:
        log.error("unknown-tag", element.position, element.tag, f"not {what}", f"use <{tag}>")
        return False
    check_attributes(element, attributes, log)
    return True


# -- JSON Schema ------------------------------------------------------------------------------------


def _of_json(path: Path, log: DiagnosticLog) -> list[_Declaration]:
    root = read_json(path, log)
    if root is None:
        return []
    title = root.text("title")
    if root.text("type") != "object" or not title:
        hint = 'write {"title": "Name", "type": "object", "properties": {…}}'
        what = "the root of a schema is an object with a title, which names it"
        log.error("bad-structure", root.position, "", what, hint)
        return []
    return _Schema(root, log).read(title)


class _Schema:
    """Collects the structures of one schema."""

    def __init__(self, root: JsonValue, log: DiagnosticLog) -> None:
        self._root = root
        self._log = log
        self._found: list[_Declaration] = []
        self._seen: set[tuple[str, Position]] = set()

    def read(self, title: str) -> list[_Declaration]:
        self._type(self._root, title)
        return self._found

    def _type(self, schema: JsonValue, name: str) -> str:
        """The type that ``schema`` describes; an object is declared under ``name``, once."""
        reference = schema.text("$ref")
        if reference is not None:
            target = self._referred(reference)
            if target is None or target.get("$ref") is not None:
                what = f"`{reference}` refers to nothing in this file"
                hint = "write #/$defs/Name or #/definitions/Name"
                self._fault(schema, what, hint)
                return ""
            schema, name = target, reference.rpartition("/")[2]
        kind = schema.text("type")
        if kind == "array":
            items = schema.get("items")
            if items is None:
                self._fault(schema, "an array without `items`", "say what is in it")
                return ""
            inner = self._type(items, name)
            return f"{inner}[]" if inner else ""
        if kind == "object":
            self._declare(schema, name)
            return name
        if kind not in _SCALARS:
            hint = f"one of {', '.join(_SCALARS)}, array, object"
            self._fault(schema, "the schema has no `type` that is read", hint)
            return ""
        return _SCALARS[kind]

    def _declare(self, schema: JsonValue, name: str) -> None:
        identity = (name, schema.position)
        if identity in self._seen:
            return
        self._seen.add(identity)
        properties = schema.get("properties")
        members = properties.value if properties is not None else {}
        if not isinstance(members, dict):
            self._fault(schema, "`properties` is an object")
            return
        read = [_Member(key, self._type(item, key), item.position) for key, item in members.items()]
        if all(member.type for member in read):  # else a fault is reported
            self._found.append(_Declaration(name, tuple(read), schema.position))

    def _referred(self, reference: str) -> JsonValue | None:
        head, *keys = reference.split("/")
        found: JsonValue | None = self._root if head == "#" and keys else None
        for key in keys:
            found = found.get(key) if found is not None else None
        return found

    def _fault(self, schema: JsonValue, what: str, hint: str = "") -> None:
        self._log.error("bad-structure", schema.position, "", what, hint)


# -- types of members -------------------------------------------------------------------------------


class _Resolver:
    """Makes structures of declarations: those that are members of others first."""

    def __init__(
        self, declared: Mapping[str, _Declaration], library: InterfaceLibrary, log: DiagnosticLog
    ) -> None:
        self._declared = declared
        self._library = library
        self._log = log
        self._made: dict[str, Structure] = {}
        self._faulty: set[str] = set()
        self._sizes: dict[str, int] = {}
        self._open: list[str] = []
        library.structures = self._made

    def run(self) -> None:
        for name in self._declared:
            self._make(name)

    def _make(self, name: str) -> None:
        if name in self._made or name in self._faulty:
            return
        declared = self._declared[name]
        if name in self._open:
            chain = " → ".join([*self._open[self._open.index(name) :], name])
            self._fault(declared, "recursive-type", f"the structure contains itself: {chain}")
            return
        if len(self._open) >= MAX_NESTING:
            what = f"structures are nested more than {MAX_NESTING} deep"
            self._fault(declared, "bad-structure", what)
            return
        self._open.append(name)
        fields = [(member.name, self._type(member)) for member in declared.members]
        self._open.pop()
        known = tuple((field, kind) for field, kind in fields if kind is not None)
        made = Structure(name, known)
        if self._size(made) > MAX_MEMBERS:
            what = f"`{name}` has more than {MAX_MEMBERS} members, with those of its members"
            self._fault(declared, "bad-structure", what)
        if len(known) < len(fields):
            self._faulty.add(name)
        if name not in self._faulty:
            self._made[name] = made

    def _fault(self, declared: _Declaration, rule: str, what: str) -> None:
        self._faulty.add(declared.name)
        self._log.error(rule, declared.position, "", what)

    def _type(self, member: _Member) -> DataType | None:
        """The type of ``member``; None after a fault was reported."""
        base = member.type.partition("[")[0].strip()
        if base in self._declared:
            self._make(base)
            if base in self._faulty:
                return None
        found = type_of_text(member.type, self._library, bounded=True)
        if isinstance(found, str):
            if _NAME.fullmatch(base) is not None:
                found = nearest(base, [*PRIMITIVES, *self._declared])
            what = f"unknown type `{member.type}`"
            self._log.error("unknown-type", member.position, "member", what, found)
            return None
        return found

    def _size(self, kind: DataType) -> int:
        match kind:
            case Structure(name, fields):
                if name not in self._sizes:
                    self._sizes[name] = sum(self._size(inner) for _, inner in fields)
                return self._sizes[name]
            case Array(element):
                return self._size(element)
            case Primitive():
                return 1
