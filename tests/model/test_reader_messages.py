"""Every fault in a model has one message, with its place and what would be right."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog, load

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M" initial="a">\n'
SERVER = '<ros_action_server name="act" action_name="/act" type="example_interfaces/Fibonacci"/>'
SERVED = len(f'{SERVER}<state id="a"><ros_action_handle_goal name="act">') + 1

ERRORS = [
    # (body from line 2 on, line:column, the rest of the message)
    ('<state id="a"><onentry></state></scxml>', "2:26", "error: malformed XML: mismatched tag </state>; <onentry> of 2:15 is open; write </onentry> before it [malformed-xml]"),
    ('<stat id="a"/></scxml>', "2:1", "error: <stat>: not an element of <scxml>; did you mean state? [unknown-tag]"),
    ('<state id="a"><transition tarket="a"/></state></scxml>', "2:35", "error: <transition>: unknown attribute `tarket`; did you mean target? [unknown-attribute]"),
    ('<state id="a"><transition event="e" target="b"/></state></scxml>', "2:45", "error: <transition>: the target state `b` does not exist; known: a [unknown-target]"),
    ('<state id="a"><onentry><assign location="x" expr="1"/></onentry></state></scxml>', "2:42", "error: <assign>: `x` is not declared; declare it with <data> [undeclared-variable]"),
    ('<datamodel><data id="count" type="int8" expr="0"/></datamodel><state id="a"><onentry><assign location="count" expr="coumt + 1"/></onentry></state></scxml>', "2:117", "error: <assign>: `coumt` is not declared; did you mean count? [undeclared-variable]"),
    ('<datamodel><data id="n" type="int8" expr="300"/></datamodel><state id="a"/></scxml>', "2:43", "error: <data>: 300 does not fit int8; int8 holds -128 to 127 [out-of-range]"),
    ("<datamodel><data id=\"n\" type=\"int8\" expr=\"'x'\"/></datamodel><state id=\"a\"/></scxml>", "2:43", "error: <data>: a value of type string where int8 is declared; a value of type int8 is needed [type-mismatch]"),
    ('<datamodel><data id="n" type="int8" expr="0.5"/></datamodel><state id="a"/></scxml>', "2:43", "error: <data>: a value of type float64 where int8 is declared; use Math.floor, Math.round or Math.trunc to make it whole [type-mismatch]"),
    ('<datamodel><data id="n" type="intt8" expr="0"/></datamodel><state id="a"/></scxml>', "2:31", "error: <data>: unknown type `intt8`; did you mean int8? [unknown-type]"),
    ("<datamodel><data id=\"n\" type=\"int8\" expr=\"1\"/></datamodel><state id=\"a\"><transition cond=\"n == 'x'\" target=\"a\"/></state></scxml>", "2:91", "error: <transition>: `==` between int8 and string; both sides must have one type [type-mismatch]"),
    ('<state id="a"><ros_service_handle_request name="/x/tick"/></state></scxml>', "2:49", "error: <ros_service_handle_request>: no server called `/x/tick` is declared; declare a server at the top of the machine [undeclared-interface]"),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"><ros_topic_callback name="/t"/></state></scxml>', "2:96", "error: <ros_topic_callback>: `/t` is declared as a publisher, not as a subscriber; declare it with the matching element [undeclared-interface]"),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int3"/><state id="a"><onentry><ros_topic_publish name="/t"/></onentry></state></scxml>', "2:1", "error: unknown type std_msgs/msg/Int3; did you mean std_msgs/msg/Int32? else give the folder of its definition with --interfaces [unknown-type]"),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"><onentry><ros_topic_publish name="/t"><field name="dat" expr="1"/></ros_topic_publish></onentry></state></scxml>', "2:108", "error: <field>: std_msgs/msg/Int32 has no field `dat`; did you mean data? [unknown-field]"),
    ('<ros_topic_subscriber topic="/t" type="std_msgs/Int32"/><datamodel><data id="n" type="int32"/></datamodel><state id="a"><ros_topic_callback name="/t"><assign location="n" expr="_msg.percentage"/></ros_topic_callback></state></scxml>', "2:178", "error: <assign>: std_msgs/msg/Int32 has no field `percentage`; known: data [unknown-field]"),
    ('<state id="a"><onentry><log expr="_msg.data"/></onentry></state></scxml>', "2:35", "error: <log>: `_msg` is not available here; no event data is, outside a handler [event-data-not-available]"),
    ('<state id="a"><onentry><log expr="eval(1)"/></onentry></state></scxml>', "2:35", "error: <log>: `eval(1)`: call `eval(1)` is outside the sub-language; literals, arrays, objects, members, indices, operators, ?: and Math.* are in it [unsupported-expression]"),
    ('<state id="a"><onentry><log expr="1 +"/></onentry></state></scxml>', "2:38", "error: <log>: `1 +`: not an expression: Unexpected token ) [bad-expression]"),
    ('<parallel id="p"/><state id="a"/></scxml>', "2:1", "error: <parallel>: not supported; parallel states are not part of the language; use one machine per activity [unsupported-element]"),
    ('<state id="a"><onentry><script>x = 1</script></onentry></state></scxml>', "2:24", "error: <script>: not supported; scripts are not part of the language; use <assign> and <if> [unsupported-element]"),
    ('<state id="a"><transition after="5 parsecs" target="a"/></state></scxml>', "2:34", "error: <transition>: `5 parsecs` is not a time; write it like 5s or 200ms [bad-duration]"),
    ('<state id="a"><transition event="e"><target id="a" prob="0.5"/><target id="a" prob="0.2"/></transition></state></scxml>', "2:15", "error: <transition>: the probabilities add up to 0.7; they add up to 1 [bad-probability]"),
    ('<ros_time_rate name="t" rate_hz="0"/><state id="a"><ros_rate_callback name="t"/></state></scxml>', "2:34", "error: <ros_time_rate>: `0` is not a rate; rate_hz is a number of callbacks a second, greater than 0 [bad-rate]"),
    *(
        (f'{SERVER}<state id="a"><ros_action_handle_goal name="act"><{element} name="act"/></ros_action_handle_goal></state></scxml>', f"2:{SERVED}", f"error: <{element}>: the attribute `goal_id` is missing; write goal_id=\"_action.goal_id\", or a variable that keeps it [missing-attribute]")
        for element in ("ros_action_accept_goal", "ros_action_reject_goal", "ros_action_feedback", "ros_action_succeed", "ros_action_aborted", "ros_action_canceled")
    ),
    (f'{SERVER}<state id="a"><ros_action_handle_goal name="act"><ros_action_start_thread name="act" goal_id="_action.goal_id"/></ros_action_handle_goal></state></scxml>', f"2:{SERVED}", "error: <ros_action_start_thread>: the attribute `thread_id` is missing; it is the thread's number, from 0 [missing-attribute]"),
    ('<state id="a"/><state id="a"/></scxml>', "2:16", "error: <state>: a second state is called `a`; state ids are unique in a machine [duplicate-state]"),
]  # fmt: skip

TICK = '<ros_service_server service_name="/s/tick" type="std_srvs/Trigger"/>'
ANSWER = '<ros_service_handle_request name="/s/tick"><ros_service_send_response name="/s/tick"><field name="success" expr="true"/><field name="message" expr="\'\'"/></ros_service_send_response></ros_service_handle_request>'  # fmt: skip

WARNINGS = [
    (f'{TICK}<state id="a">{ANSWER}<transition event="e" target="b"/></state><state id="b"/></scxml>', "<state>: state `b` discards a request to /s/tick: its caller would never be answered; add <ros_service_handle_request> to the state [request-discarded]"),
    ('<state id="a"/><state id="b"/></scxml>', "<state>: state `b` cannot be reached from `a` [unreachable-state]"),
    ('<state id="a"><transition event="e" target="a"/><transition event="e" target="a"/></state></scxml>', "<transition>: never taken: the transition at 2:15 takes the same event and has no condition; put it before that one, or give that one a condition [shadowed-transition]"),
    ('<ros_topic_subscriber topic="/t" type="std_msgs/Int32"/><state id="a"/></scxml>', "the subscriber /t: its messages are never read; handle it, or remove the declaration [unread-input]"),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"/></scxml>', "the publisher /t is declared and never used; use it, or remove the declaration [unused-interface]"),
    ('<state id="a"><transition target="b"/></state><state id="b"><transition target="a"/></state></scxml>', "<transition>: endless eventless transitions: a -> b -> a; wait for an event, or add a condition [eventless-cycle]"),
    ('<ros_topic_publisher topic="/t" type="std_msgs/Int32"/><state id="a"><onentry><ros_topic_publish name="/t"/></onentry></state></scxml>', "<ros_topic_publish>: `data` of std_msgs/msg/Int32 is never set; it is sent as zero or empty; set it with <field> [unset-output-field]"),
]  # fmt: skip


def findings(path: Path) -> list[str]:
    log = DiagnosticLog()
    system = load([path], log)
    if system is not None:
        check_system(system, log)
    return [str(found).removeprefix(f"{path}:") for found in log.diagnostics]


@pytest.mark.parametrize(
    ("body", "place", "message"), ERRORS, ids=[item[2][-40:] for item in ERRORS]
)
def test_an_error_names_its_place_and_what_would_be_right(
    tmp_path: Path, body: str, place: str, message: str
) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(HEAD + body)
    assert f"{place}: {message}" in findings(path)


@pytest.mark.parametrize(("body", "message"), WARNINGS, ids=[item[1][-30:] for item in WARNINGS])
def test_a_warning_says_what_the_model_can_never_do(
    tmp_path: Path, body: str, message: str
) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(HEAD + body)
    found = findings(path)
    assert [text for text in found if text.endswith(f"warning: {message}")], found
    assert not [text for text in found if " error: " in text]


def test_a_type_without_a_package_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    declared = '<ros_topic_subscriber topic="/t" type="Int32"/><state id="a">'
    path.write_text(f'{HEAD}{declared}<ros_topic_callback name="/t"/></state></scxml>')
    assert findings(path) == [
        "2:1: error: unknown type Int32; a type is written pkg/Name; give the folder of its definition "
        "with --interfaces [unknown-type]"
    ]


def test_billion_laughs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(
        '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><scxml/>'
    )
    assert findings(path) == [
        "1:34: error: a document type declaration (<!DOCTYPE l…>) is refused; models need no entities; "
        "remove it [hostile-xml]"
    ]


def test_an_external_entity_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text('<!DOCTYPE l SYSTEM "file:///etc/passwd"><scxml/>')
    assert findings(path) == [
        "1:40: error: a document type declaration (<!DOCTYPE l…>) is refused; models need no entities; "
        "remove it [hostile-xml]"
    ]


def test_fifty_megabytes_are_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    with path.open("wb") as file:
        file.truncate(50_000_000)
    assert findings(path) == [
        "0:0: error: the file has 50000000 bytes; a model has at most 4194304 bytes [hostile-xml]"
    ]


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    os.mkfifo(path)
    assert findings(path) == [
        "0:0: error: cannot read the file: a pipe or a device, which may never end; save it as a "
        "file [unreadable-file]"
    ]


def test_ten_thousand_levels_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text("<scxml>" + "<state>" * 10_000)
    assert findings(path) == [
        "1:449: error: elements are nested more than 64 deep; a model is a few levels deep [hostile-xml]"
    ]


def test_an_empty_file_is_one_message(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text("")
    assert findings(path) == ["1:1: error: the file is empty [malformed-xml]"]


def test_blank_lines_before_the_declaration_are_accepted_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text('\n\n<?xml version="1.0"?>\n' + HEAD + '<state id="a"/></scxml>')
    assert findings(path) == [
        "3:1: warning: <?xml>: blank lines before the XML declaration; the declaration belongs at the "
        "very start of the file [xml-prologue]"
    ]


def test_a_placeholder_namespace_is_accepted_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text('<scxml xmlns="..." name="M" initial="a"><state id="a"/></scxml>')
    assert findings(path) == [
        '1:1: warning: <scxml>: the namespace is "..."; xmlns="http://www.w3.org/2005/07/scxml" is the '
        "standard's [xml-namespace]"
    ]


def test_ten_thousand_levels_of_executable_content_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    inside = "<if cond='true'>" * 10_000 + "</if>" * 10_000
    path.write_text(f'{HEAD}<state id="a"><onentry>{inside}</onentry></state></scxml>')
    assert findings(path) == [
        "2:1000: error: elements are nested more than 64 deep; a model is a few levels deep [hostile-xml]"
    ]


def test_elements_without_number_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(HEAD + "<state/>" * 50_001)
    assert findings(path) == [
        "2:399993: error: more than 50000 elements; a model has a few hundred elements [hostile-xml]"
    ]


def test_attributes_without_number_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    attributes = " ".join(f'a{i}="1"' for i in range(101))
    path.write_text(f"{HEAD}<state {attributes}/></scxml>")
    assert findings(path) == [
        "2:1: error: more than 100 attributes in an element; a model has a few hundred elements "
        "[hostile-xml]"
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'<?xml version="1.0" encoding="none-8"?><scxml/>', "1:31: error: unknown encoding: none-8; write the file in UTF-8 [malformed-xml]"),
        (b'<scxml name="\xff"/>', "1:14: error: malformed XML: the byte 0xff, number 14 of the file, is not UTF-8, which is read where none is declared; write the file in UTF-8 [malformed-xml]"),
        (b'<scxml name="a\0"/>', "1:15: error: malformed XML: not well-formed (invalid token) [malformed-xml]"),
        (b"\x7fELF\x02\x01", "1:1: error: malformed XML: not well-formed (invalid token) [malformed-xml]"),
        (b"<scxml/><scxml/>", "1:9: error: malformed XML: junk after document element [malformed-xml]"),
        (b'<scxml a="1" a="2"/>', "1:14: error: malformed XML: duplicate attribute [malformed-xml]"),
        (b"<scxml>&lol;</scxml>", "1:8: error: malformed XML: undefined entity; <scxml> of 1:1 is open [malformed-xml]"),
        (b"<html/>", "1:1: error: <html>: not a state machine; the root of a model is <scxml> or <ascxml> [unknown-tag]"),
    ],
)  # fmt: skip
def test_what_is_no_model_is_one_message(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "model.scxml"
    path.write_bytes(content)
    assert findings(path) == [message]


def test_a_model_in_another_encoding_is_read(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    text = f'<?xml version="1.0" encoding="iso-8859-1"?>{HEAD}<state id="\u00e4"/></scxml>'
    path.write_bytes(text.encode("latin-1"))
    assert findings(path) == [
        "1:123: error: <scxml>: the initial state `a` does not exist; known: \u00e4 [unknown-target]"
    ]


def test_a_quote_inside_an_attribute_does_not_move_the_next_ones(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    body = (
        '<state id="a"><onentry><log label="it\'s > 1" expr="x"/>\n'
        '<log label=\'a "b\' expr="y"/></onentry></state></scxml>'
    )
    path.write_text(HEAD + body)
    assert findings(path) == [
        "2:52: error: <log>: `x` is not declared; declare it with <data> [undeclared-variable]",
        "3:25: error: <log>: `y` is not declared; declare it with <data> [undeclared-variable]",
    ]


@pytest.mark.parametrize("rate", ["nan", "inf", "1e999", "-1", "fast", "1_0", "٣", "1 0"])
def test_a_rate_is_a_finite_number(tmp_path: Path, rate: str) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(f'{HEAD}<ros_time_rate name="t" rate_hz="{rate}"/><state id="a"/></scxml>')
    assert (
        f"2:34: error: <ros_time_rate>: `{rate}` is not a rate; rate_hz is a number of callbacks a "
        "second, greater than 0 [bad-rate]"
    ) in findings(path)


@pytest.mark.parametrize("size", ["-1", "x", "9" * 30, "<="])
def test_an_array_has_a_length_that_is_one(tmp_path: Path, size: str) -> None:
    path = tmp_path / "model.scxml"
    shown = size.replace("<", "&lt;")
    path.write_text(
        f'{HEAD}<datamodel><data id="n" type="int8[{shown}]"/></datamodel><state id="a"/></scxml>'
    )
    (found,) = findings(path)
    assert found.startswith(f"2:31: error: <data>: unknown type `int8[{size}]`")


def test_reading_a_model_goes_on_after_a_character_that_is_not_escaped(tmp_path: Path) -> None:
    path = tmp_path / "model.scxml"
    path.write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="M" initial="a">\n'
        '  <state id="a">\n'
        '    <transition event="e" cond="1 < 2" target="b"/>\n'
        "  </state>\n"
        "</scxml>\n"
    )
    first, *others = findings(path)
    assert first.startswith("3:35: error: malformed XML: a raw < in the value of `cond`")
    assert any("`b`" in other for other in others)
