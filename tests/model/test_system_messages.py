"""Faults of a system file: each is one message, with its place and what would be right."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load

MODEL = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="A"><state id="a"/></scxml>'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('<html/>', ['system.xml:1:1: error: <html>: neither a model nor a system file; the root of a system file is one of convince_mc_tc, roaml, specification [unknown-tag]']),
        ('<roaml><nodes/></roaml>', ['system.xml:1:8: error: <nodes>: not an element of <roaml>; did you mean node_models? [unknown-tag]']),
        ('<roaml><parameters><bt_tick_rate value="nan"/></parameters></roaml>', ['system.xml:1:41: error: <bt_tick_rate>: `nan` is not a rate; ticks a second, greater than 0 [bad-rate]']),
        ('<roaml><node_models><input type="ros-scml" src="a.scxml"/></node_models></roaml>', ['system.xml:1:21: error: <input>: unknown input type `ros-scml`; did you mean ros-scxml? [unknown-tag]']),
        ('<roaml><node_models><file/></node_models></roaml>', ['system.xml:1:21: error: <file>: not an element of <node_models>; use <input> [unknown-tag]']),
        ('<roaml><node_models><input type="ros-scxml"/></node_models></roaml>', ['system.xml:1:21: error: <input>: the attribute `src` is missing [missing-attribute]']),
        ('<roaml><node_models><input type="ros-scxml" src="b.scxml"/></node_models></roaml>', ['system.xml:1:50: error: <input>: b.scxml does not exist; did you mean a.scxml? [missing-file]']),
        ('<roaml><behavior_tree><input type="bt-xml" src="b.xml"/></behavior_tree></roaml>', ['system.xml:1:23: error: <input>: unknown input type `bt-xml`; did you mean bt.cpp-xml? [unknown-tag]']),
        ('<roaml><interfaces><input type="ros-interfaces" src="types"/></interfaces></roaml>', ['system.xml:1:54: error: <input>: types does not exist; known: system.xml, a.scxml [missing-file]']),
        ('<roaml><interfaces><input type="ros-interfaces" src="a.scxml"/></interfaces></roaml>', ['system.xml:1:54: error: <input>: this interface folder is not a folder [missing-file]']),
        ('<roaml><node_models><input type="ros-scxml" src="."/></node_models></roaml>', ['system.xml:1:50: error: <input>: cannot read the file: Is a directory [unreadable-file]']),
        ('<roaml><node_models><input type="ros-scxml" src="a.scxml"/><input type="ros-scxml" src="a.scxml"/></node_models></roaml>', ['system.xml:1:89: warning: <input>: this model is listed twice [duplicate-input]']),
        ('<specification><model><skills><skill moc="fsm" path="b.scxml"/></skills></model></specification>', ['system.xml:1:54: error: <skill>: b.scxml does not exist; did you mean a.scxml? [missing-file]']),
    ],
)  # fmt: skip
def test_a_fault_of_a_system_file_is_reported_once(
    tmp_path: Path, text: str, expected: list[str]
) -> None:
    (tmp_path / "a.scxml").write_text(MODEL)
    path = tmp_path / "system.xml"
    path.write_text(text)
    log = DiagnosticLog()
    load([path], log)
    found = [
        str(item).replace(f"{tmp_path}/", "")
        for item in log.diagnostics
        if item.rule != "older-spelling"
    ]
    assert [item.replace(str(tmp_path), ".") for item in found] == expected


@pytest.mark.parametrize(
    ("written", "changed", "said"),
    [
        ("<roaml>", '<roaml name="lab">', "<roaml>: unknown attribute `name`; it has no attributes"),
        ("<parameters>", '<parameters rate="5">', "<parameters>: unknown attribute `rate`; it has no attributes"),
        ("<node_models>", '<node_models type="x">', "<node_models>: unknown attribute `type`; it has no attributes"),
        (' src="m.scxml"', ' src="m.scxml" scr="n.scxml"', "<input>: unknown attribute `scr`; did you mean src?"),
        (' src="m.scxml"', ' src="m.scxml" kind="n"', "<input>: unknown attribute `kind`; known: name, src, type"),
        ("<qos>", '<qos topic="/t">', "<qos>: unknown attribute `topic`; it has no attributes"),
        ("<interfaces>", '<interfaces src="i">', "<interfaces>: unknown attribute `src`; it has no attributes"),
        ("<properties/>", '<properties src="i"/>', ""),
    ],
)  # fmt: skip
def test_an_attribute_that_a_system_file_does_not_have_is_told(
    tmp_path: Path, written: str, changed: str, said: str
) -> None:
    (tmp_path / "m.scxml").write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="m" initial="a"><state id="a"/></scxml>'
    )
    text = (
        '<roaml><parameters><bt_tick_rate value="5"/></parameters><node_models>'
        '<input type="node-ascxml" src="m.scxml"/></node_models><qos></qos><interfaces></interfaces>'
        "<properties/></roaml>"
    )
    assert written in text
    path = tmp_path / "system.xml"
    path.write_text(text.replace(written, changed, 1))
    log = DiagnosticLog()
    load([path], log)
    found = [item for item in log.diagnostics if item.rule == "unknown-attribute"]
    assert [f"<{item.element}>: {item.message}; {item.hint}" for item in found] == [said] * bool(
        said
    )
    for item in found:  # it points to the attribute's value
        assert path.read_text()[item.position.column - 2] == '"'


def test_a_system_is_shown_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "m.scxml").write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="m" initial="a"><state id="a"/></scxml>'
    )
    system = load([tmp_path / "m.scxml"], DiagnosticLog())
    path = tmp_path / "m.scxml"
    assert repr(system) == f"<System 'm': 1 node, read from '{path}'>"
