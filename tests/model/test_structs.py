"""Data structures that a system declares: by XML or by a JSON Schema, usable as the types of data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.language.datatypes import Array, Primitive, Structure, describe
from m2c.model import DiagnosticLog, System
from m2c.model.json_places import read_json

XML = """<types>
  <struct id="Route"><member id="stops" type="Stop[]"/><member id="recent" type="Stop[][5]"/></struct>
  <struct id="Stop"><member id="place" type="string"/><member id="at" type="geometry_msgs/Point"/></struct>
</types>"""
SCHEMA = {
    "title": "Shelf",
    "type": "object",
    "properties": {
        "boxes": {"type": "array", "items": {"$ref": "#/$defs/Box"}},
        "label": {"type": "object", "properties": {"text": {"type": "string"}}},
        "spare": {"$ref": "#/$defs/Box"},
    },
    "$defs": {
        "Box": {
            "type": "object",
            "properties": {
                "full": {"type": "boolean"},
                "count": {"type": "integer"},
                "weight": {"type": "number"},
            },
        },
        "Unused": {"type": "object", "properties": {}},
    },
}
MODEL = (
    '<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="A"><datamodel>{data}</datamodel>'
    '<state id="a">{content}</state></ascxml>'
)


def read(
    folder: Path, text: str, kind: str = "xml", data: str = "", content: str = ""
) -> tuple[System, list[str]]:
    (folder / "a.ascxml").write_text(MODEL.format(data=data, content=content))
    (folder / f"types.{kind}").write_text(text)
    path = folder / "system.xml"
    path.write_text(
        f'<roaml><data_declarations><input type="{kind}" src="types.{kind}"/></data_declarations>'
        '<node_models><input type="node-ascxml" src="a.ascxml"/></node_models></roaml>'
    )
    log = DiagnosticLog()
    system = read_and_check([path], [], log)
    assert system is not None
    return system, [str(found).replace(f"{folder}/", "") for found in log.diagnostics]


def test_structures_are_declared_by_xml_in_any_order(tmp_path: Path) -> None:
    system, found = read(tmp_path, XML)
    assert found == []
    route = system.library.structures["Route"]
    stop = system.library.structures["Stop"]
    assert route.fields == (("stops", Array(stop)), ("recent", Array(Array(stop, 5))))
    assert [name for name, _ in stop.fields] == ["place", "at"]
    assert describe(stop.fields[1][1]) == "geometry_msgs/msg/Point"
    assert [describe(kind) for _, kind in route.fields] == ["Stop[]", "Stop[][<=5]"]


def test_a_json_schema_declares_what_its_root_refers_to(tmp_path: Path) -> None:
    system, found = read(tmp_path, json.dumps(SCHEMA), "json")
    assert found == []
    box = Structure(
        "Box",
        (
            ("full", Primitive("bool")),
            ("count", Primitive("int32")),
            ("weight", Primitive("float32")),
        ),
    )
    label = Structure("label", (("text", Primitive("string")),))
    shelf = Structure("Shelf", (("boxes", Array(box)), ("label", label), ("spare", box)))
    assert system.library.structures == {"Shelf": shelf, "label": label, "Box": box}


def test_texts_of_json_are_read_with_their_escapes(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(r'{"a\"]": ["\u0041\\", {}, [] , -1.5e3, true ,null]}')
    log = DiagnosticLog()
    found = read_json(tmp_path / "a.json", log)
    assert found is not None
    (value,) = [found.get('a"]')]
    assert value is not None
    assert isinstance(value.value, list)
    assert [item.value for item in value.value] == ["A\\", {}, [], -1500.0, True, None]
    assert [item.position.column for item in value.value] == [11, 23, 27, 32, 40, 46]


def test_a_file_of_structures_is_one_of_the_sources(tmp_path: Path) -> None:
    system, _ = read(tmp_path, XML)
    assert tmp_path / "types.xml" in system.sources


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('<types><struct id="A"><member id="b" type="B"/></struct><struct id="B"><member id="a" type="A[]"/></struct></types>', 'types.xml:1:20: error: the structure contains itself: A → B → A [recursive-type]'),
        ('<types><struct id="A"><member id="b" type="Pointt"/></struct><struct id="Point"><member id="x" type="int8"/></struct></types>', 'types.xml:1:44: error: <member>: unknown type `Pointt`; did you mean Point? [unknown-type]'),
        ('<types><struct id="A"/></types>', 'types.xml:1:20: error: the structure `A` has no members [bad-structure]'),
        ('<types><struct id="A"><member id="x" type="int8"/><member id="x" type="int8"/></struct></types>', 'types.xml:1:72: error: a second member of `A` is called `x` [bad-structure]'),
        ('<types><struct id="int8"><member id="x" type="int8"/></struct></types>', 'types.xml:1:20: error: a structure or member cannot be called `int8`; letters, digits and _ within, beginning with a letter; not a primitive type [bad-name]'),
        ('<types><struct id="A"><member id="__slots__" type="int8"/></struct></types>', 'types.xml:1:52: error: a structure or member cannot be called `__slots__`; letters, digits and _ within, beginning with a letter; not a primitive type [bad-name]'),
        ('<types><struct id="A"><member id="x"/></struct></types>', 'types.xml:1:23: error: <member>: the attribute `type` is missing [missing-attribute]'),
        ('<types><struct><member id="x" type="int8"/></struct></types>', 'types.xml:1:8: error: <struct>: the attribute `id` is missing [missing-attribute]'),
        ('<types><structure id="A"/></types>', 'types.xml:1:8: error: <structure>: not an element of <types>; use <struct> [unknown-tag]'),
        ('<types><struct id="A" size="2"><member id="x" type="int8"/></struct></types>', 'types.xml:1:29: error: <struct>: unknown attribute `size`; known: id [unknown-attribute]'),
        ('<scxml/>', 'types.xml:1:1: error: <scxml>: not the root of a declaration; use <types> [unknown-tag]'),
        ('{"title": "A"}', 'types.xml:1:1: error: malformed XML: no XML but JSON; a JANI file has properties, a JSON Schema data types: name them in <properties> and in <data_declarations>, as type="json" [malformed-xml]'),
    ],
)  # fmt: skip
def test_a_fault_in_an_xml_declaration_is_one_error(
    tmp_path: Path, text: str, expected: str
) -> None:
    _, found = read(tmp_path, text, data='<data id="v" type="A"/><data id="w" type="Lost[]"/>')
    assert [line for line in found if "warning" not in line] == [expected]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{"title": "A",\n "type" "object"}', "types.json:2:9: error: malformed JSON: Expecting ':' delimiter [malformed-json]"),
        ('[]', 'types.json:1:1: error: the root of a schema is an object with a title, which names it; write {"title": "Name", "type": "object", "properties": {…}} [bad-structure]'),
        ('{"title": "A", "type": "object", "properties": {"b": {"$ref": "#/$defs/B"}}}', 'types.json:1:54: error: `#/$defs/B` refers to nothing in this file; write #/$defs/Name or #/definitions/Name [bad-structure]'),
        ('{"title": "A", "type": "object", "properties": {"b": {"$ref": "other.json#/B"}}}', 'types.json:1:54: error: `other.json#/B` refers to nothing in this file; write #/$defs/Name or #/definitions/Name [bad-structure]'),
        ('{"title": "A", "type": "object", "properties": {"b": {"type": "array"}}}', 'types.json:1:54: error: an array without `items`; say what is in it [bad-structure]'),
        ('{"title": "A", "type": "object",\n "properties": {"b":\n  {"type": ["string", "null"]}}}', 'types.json:3:3: error: the schema has no `type` that is read; one of boolean, integer, number, string, array, object [bad-structure]'),
        ('{"title": "A", "type": "object", "properties": {"a": {"$ref": "#/$defs/A"}}, "$defs": {"A": {"type": "object", "properties": {"a": {"type": "string"}}}}}', 'types.json:1:1: error: a second structure is called `A`; the first is at types.json:1:93 [duplicate-type]'),
        ('{"title": "R", "type": "object", "properties": {"a": {"$ref": "#/$defs/A"}}, "$defs": {"A": {"type": "object", "properties": {"a": {"$ref": "#/$defs/A"}}}}}', 'types.json:1:93: error: the structure contains itself: A → A [recursive-type]'),
        ('{"title": "A", "type": "object", "properties": {"x": {"type": NaN}}}', 'types.json:1:1: error: malformed JSON: NaN is not part of JSON [malformed-json]'),
        ('[' * 100_000, 'types.json:1:1: error: malformed JSON: nested more than 64 deep [malformed-json]'),
        ('[' * 70 + ']' * 70, 'types.json:1:1: error: malformed JSON: nested more than 64 deep [malformed-json]'),
    ],
)  # fmt: skip
def test_a_fault_in_a_json_schema_is_one_error(tmp_path: Path, text: str, expected: str) -> None:
    _, found = read(tmp_path, text, "json", data='<data id="v" type="A"/>')
    assert [line for line in found if "warning" not in line] == [expected]


def test_structures_that_would_unfold_without_end_are_refused(tmp_path: Path) -> None:
    doubling = "".join(
        f'<struct id="S{i}"><member id="a" type="S{i + 1}"/><member id="b" type="S{i + 1}"/></struct>'
        for i in range(20)
    )
    last = '<struct id="S20"><member id="x" type="int8"/></struct>'
    _, found = read(tmp_path, f"<types>{doubling}{last}</types>")
    assert len(found) == 1
    assert "has more than 10000 members, with those of its members" in found[0]


def test_a_second_structure_in_another_file_is_an_error(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.xml").write_text(
            '<types><struct id="P"><member id="x" type="int8"/></struct></types>'
        )
    (tmp_path / "a.ascxml").write_text(MODEL.format(data="", content=""))
    path = tmp_path / "system.xml"
    path.write_text(
        '<roaml><data_declarations><input type="xml" src="one.xml"/><input type="xml" src="two.xml"/>'
        '<input type="xml" src="three.xml"/><input type="jani" src="one.xml"/></data_declarations>'
        '<node_models><input type="node-ascxml" src="a.ascxml"/></node_models></roaml>'
    )
    log = DiagnosticLog()
    read_and_check([path], [], log)
    assert [str(found).replace(f"{tmp_path}/", "") for found in log.diagnostics] == [
        "system.xml:1:116: error: <input>: three.xml does not exist; did you mean system.xml? "
        "[missing-file]",
        "system.xml:1:128: error: <input>: unknown input type `jani`; known: json, xml [unknown-tag]",
        "two.xml:1:20: error: a second structure is called `P`; the first is at one.xml:1:20 "
        "[duplicate-type]",
    ]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        ('<data id="s" type="Stop" expr="{\'place\': \'home\', \'at\': {\'x\': 1}}"/>', ""),
        ('<data id="s" type="Stop" expr="{\'place\': 7}"/>', "a value of type int64 where string is declared"),
        ('<data id="s" type="Stop" expr="{\'plce\': \'home\'}"/>', "Stop has no field `plce`; did you mean place?"),
        ('<data id="r" type="Route" expr="{\'recent\': [[{}, {}, {}, {}, {}, {}]]}"/>', "6 elements, at most 5 fit"),
        ('<data id="s" type="Stopp"/>', "unknown type `Stopp`; did you mean Stop?"),
        ('<data id="s" type="Stop[][3]" expr="[[{}], [{}, {}, {}, {}]]"/>', "4 elements, at most 3 fit"),
    ],
)  # fmt: skip
def test_values_of_structures_are_checked_as_messages_are(
    tmp_path: Path, data: str, expected: str
) -> None:
    _, found = read(tmp_path, XML, data=data)
    assert [expected in line for line in found] == ([True] if expected else [])
