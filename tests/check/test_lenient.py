"""``--lenient``: what ECMAScript converts is a warning with what it becomes; all else stays an error."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main

NS = 'xmlns="http://www.w3.org/2005/07/scxml" version="1.0"'
PORTS = (
    '<ros_topic_subscriber topic="/in" type="std_msgs/String"/>'
    '<ros_topic_publisher topic="/out" type="std_msgs/Int32"/>'
    '<ros_service_server service_name="/ask" type="std_srvs/Trigger"/>'
)
VARIABLES = (
    '<data id="n" type="int32" expr="0"/><data id="small" type="int8" expr="0"/>'
    '<data id="f" type="float64" expr="0.5"/><data id="s" type="string" expr="\'\'"/>'
    '<data id="b" type="bool" expr="false"/><data id="a" type="int32[]" expr="[1]"/>'
    '<data id="texts" type="string[]" expr="[]"/><data id="free" expr="{}"/>'
)
TAKEN = '<ros_service_handle_request name="/ask"><ros_service_send_response name="/ask"/>{}</ros_service_handle_request>'
WARNED = "lenient-conversion"


def found(folder: Path, body: str, *options: str, data: str = "") -> list[tuple[str, str, str]]:
    """Severity, rule and message of what is wrong with a model that does ``body`` on a request."""
    path = folder / "m.scxml"
    path.write_text(
        f'<scxml {NS} name="M" initial="a">{PORTS}<datamodel>{VARIABLES}{data}</datamodel>'
        f'<state id="a">{TAKEN.format("")}<ros_topic_callback name="/in">{body}</ros_topic_callback>'
        "</state></scxml>"
    )
    result = CliRunner().invoke(main, ["check", "--format", "json", *options, str(path)])
    kinds = (WARNED, "type-mismatch", "out-of-range", "unknown-field", "bad-initial-value")
    return [
        (item["severity"], item["rule"], item["message"])
        for item in json.loads(result.output)
        if item["severity"] == "error" or item["rule"] in kinds
    ]


def assign(location: str, text: str) -> str:
    escaped = text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return f'<assign location="{location}" expr="{escaped}"/>'


PLACES = [
    ("n", "'3'", "`'3'` becomes `3`: ToNumber, truncated"),
    ("n", "' -7.9 '", "`' -7.9 '` becomes `-7`: ToNumber, truncated"),
    ("n", "-2.5", "`-2.5` becomes `-2`: truncated"),
    ("n", "'abc'", "`'abc'` becomes `0`: no integer is NaN"),
    ("n", "0 / 0", "`NaN` becomes `0`: no integer is NaN"),
    ("small", "'300'", "`'300'` becomes `44`: ToNumber, truncated"),
    ("n", "true", "`true` becomes `1`: ToNumber, truncated"),
    ("n", "f", "a value of type float64 becomes one of type int32: truncated"),
    ("n", "s", "a value of type string becomes one of type int32: ToNumber, truncated"),
    ("a[0]", "s", "a value of type string becomes one of type int32: ToNumber, truncated"),
    ("f", "'0.25'", "`'0.25'` becomes `0.25`: ToNumber"),
    ("f", "b", "a value of type bool becomes one of type float64: ToNumber"),
    ("s", "4.50", "`4.5` becomes `'4.5'`: ToString"),
    ("s", "n", "a value of type int32 becomes one of type string: ToString"),
    ("b", "'false'", "`'false'` becomes `true`: ToBoolean"),
    ("b", "n", "a value of type int32 becomes one of type bool: ToBoolean"),
    ("a", "[1, s]", "a value of type string becomes one of type int32: ToNumber, truncated"),
]


@pytest.mark.parametrize(("location", "text", "message"), PLACES)
def test_what_becomes_a_declared_type_is_a_warning_only_if_asked_for(
    tmp_path: Path, location: str, text: str, message: str
) -> None:
    (strict,) = found(tmp_path, assign(location, text))
    assert strict[0] == "error"
    assert found(tmp_path, assign(location, text), "--lenient") == [("warning", WARNED, message)]


OPERATIONS = [
    ("s == 3", "`==` between string and int64 takes both as numbers: ToNumber"),
    ("n != s", "`!=` between int32 and string takes both as numbers: ToNumber"),
    ("b == 1", "`==` between bool and int64 takes both as numbers: ToNumber"),
    ("s < n", "`<` between string and int32 takes both as numbers: ToNumber"),
    ("s - 1 > 0", "`-` between string and int64 takes both as numbers: ToNumber"),
    ("b + 1 > 0", "`+` between bool and int64 takes both as numbers: ToNumber"),
    ("-s > 0", "`-` applied to string, which becomes a number: ToNumber"),
    (
        "Math.floor(s) > 0",
        "Math.floor of a value of type string, which becomes a number: ToNumber",
    ),
]


@pytest.mark.parametrize(("text", "message"), OPERATIONS)
def test_operands_of_several_types_are_a_warning_only_if_asked_for(
    tmp_path: Path, text: str, message: str
) -> None:
    body = f'<if cond="{text.replace("<", "&lt;")}"><log expr="n"/></if>'
    (strict,) = found(tmp_path, body)
    assert strict[:2] == ("error", "type-mismatch")
    assert found(tmp_path, body, "--lenient") == [("warning", WARNED, message)]


def test_a_field_and_an_initial_value_are_places_too(tmp_path: Path) -> None:
    body = (
        '<ros_topic_publish name="/out"><field name="data" expr="_msg.data"/></ros_topic_publish>'
    )
    data = '<data id="limit" type="int32" expr="\'5\'"/><data id="twice" type="int32" expr="limit * 2"/>'
    assert {item[:2] for item in found(tmp_path, body, data=data)} == {("error", "type-mismatch")}
    assert [item[1:] for item in found(tmp_path, body, "--lenient", data=data)] == [
        (WARNED, "`'5'` becomes `5`: ToNumber, truncated"),
        (WARNED, "a value of type string becomes one of type int32: ToNumber, truncated"),
    ]


STAYS = [
    (assign("n", "undefined"), "type-mismatch"),
    (assign("s", "undefined"), "type-mismatch"),
    (assign("n", "a"), "type-mismatch"),
    (assign("a", "texts"), "type-mismatch"),
    (assign("a", "'1,2'"), "type-mismatch"),
    (assign("b", "s === 3"), "type-mismatch"),
    (assign("n", "a['0']"), "type-mismatch"),
    (assign("small", "300"), "out-of-range"),
    (assign("b", "undefined < 1"), "type-mismatch"),
    (assign("n", "a[9]") + assign("n", "_msg.dat"), "unknown-field"),
    (assign("n", "m"), "undeclared-variable"),
    ('<ros_topic_publish name="/no"/>', "undeclared-interface"),
]


@pytest.mark.parametrize(("body", "rule"), STAYS)
def test_what_ecmascript_does_not_convert_stays_an_error(
    tmp_path: Path, body: str, rule: str
) -> None:
    (only,) = found(tmp_path, body, "--lenient")
    assert only[:2] == ("error", rule)
    assert found(tmp_path, body) == [only]


def test_an_unanswered_request_is_said_as_before(tmp_path: Path) -> None:
    path = tmp_path / "m.scxml"
    path.write_text(
        f'<scxml {NS} name="M" initial="a"><ros_service_server service_name="/ask" '
        'type="std_srvs/Trigger"/><state id="a"><ros_service_handle_request name="/ask"/></state></scxml>'
    )
    outputs = {
        CliRunner().invoke(main, ["check", *options, str(path)]).output
        for options in ([], ["--lenient"])
    }
    assert len(outputs) == 1
    assert "[request-unanswered]" in outputs.pop()


def test_a_lenient_model_is_no_error_unless_warnings_are(tmp_path: Path) -> None:
    path = tmp_path / "m.scxml"
    path.write_text(
        f'<scxml {NS} name="M" initial="a"><datamodel><data id="n" type="int32" expr="\'3\'"/></datamodel>'
        '<state id="a"/></scxml>'
    )
    for options, code in (([], 2), (["--lenient"], 0), (["--lenient", "--strict"], 2)):
        assert CliRunner().invoke(main, ["check", *options, str(path)]).exit_code == code
