"""Property files: MOON's XML and our YAML say the same; every fault has its place; nothing hurts."""

from __future__ import annotations

import html
import random
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st

from m2c.diagnostics import DiagnosticLog, ModelError
from moon.cli import main
from moon.properties.compiler import network_code
from moon.properties.files import load_properties, read_properties
from moon.properties.files.xml import parse_property_xml
from moon.properties.files.yaml import parse_property_yaml
from moon.properties.formula import text
from moon.properties.monitor import PropertyMonitor, PropertySet
from moon.properties.network import build_network
from moon.properties.property import Role, Status
from moon.properties.syntax import parse_formula
from tests.properties.runs import seen
from transports.interface import ObservationKind

XML = """\
<properties>
  <ports>
    <ros_topic topic_name="/BatteryComponent/battery_level" type="std_msgs/Int32">
      <state_var id="battery_level" type="int32" field="data" expr="100"/>
      <event_var id="published"/>
    </ros_topic>
    <ros_service service_name="/AlarmSkill/tick" type="bt/TickAction" event="request">
      <event_var id="alarm"/>
    </ros_service>
    <ros_service service_name="/IsPoiDone1Skill/tick" type="bt/TickCondition" event="response">
      <state_var id="done" type="int8" field="status"/>
    </ros_service>
    <ros_action action_name="GoToPoi" type="nav/GoToPoi" event="goal">
      <event_var id="going"/>
      <state_var id="poi" type="int32" field="poi_number" expr="0"/>
      <goal_id id="goal"/>
      <result_code id="code"/>
    </ros_action>
    <clock topic_name="/clock" type="builtin_interfaces/Time"/>
  </ports>
  <assumes>
    <property id="A1" pattern="recurrence">
      <event>published</event><scope type="globally"/><time_interval within="3" time_unit="s"/>
    </property>
  </assumes>
  <guarantees>
    <property id="P1" pattern="absence">
      <event>alarm</event><scope type="before" event="battery_level &lt; 30"/>
    </property>
    <property id="P2" pattern="response">
      <events><event>battery_level &lt; 30</event><event>alarm</event></events>
      <scope type="globally"/><time_interval time="5000" time_unit="ms"/>
    </property>
    <property id="P3" pattern="precedence">
      <events><event>done == 0 &amp;&amp; poi == 1</event><event>going</event></events>
      <scope type="globally"/><time_interval after="1" within="9" time_unit="s"/>
    </property>
    <property id="P4" pattern="universality">
      <event>battery_level &gt; 5</event><scope type="after" event="alarm"/>
      <time_interval time="2" time_unit="s"/>
    </property>
    <property id="P5" pattern="absence">
      <event>alarm</event><scope type="between" begin="going" end="code == 4"/>
    </property>
    <property id="P6" logic="pmtl" expr="H({alarm} -> P {battery_level &lt; 30})"/>
  </guarantees>
</properties>
"""

YAML = """\
ports:
  battery_level: {topic: /BatteryComponent/battery_level, field: data, initial: 100}
  published: {topic: /BatteryComponent/battery_level}
  alarm: {service: /AlarmSkill/tick, on: request}
  done: {service: /IsPoiDone1Skill/tick, on: response, field: status}
  going: {action: GoToPoi, on: goal}
  poi: {action: GoToPoi, on: goal, field: poi_number, initial: 0}
predicates:
  low: battery_level < 30
properties:
  - {id: A1, role: assumption, pattern: recurrence, of: published, within: 3 s}
  - id: P1
    text: The alarm rang although the battery was full.
    severity: critical
    pattern: absence
    of: alarm
    before: low
  - {id: P2, pattern: response, request: low, response: alarm, within: 5 s}
  - {id: P3, pattern: precedence, cause: done == 0 && poi == 1, effect: going, no_sooner: 1 s, within: 9 s}
  - {id: P6, formula: "H({alarm} -> P {low})"}
"""


def from_xml(source: str):
    log = DiagnosticLog()
    return parse_property_xml(source.encode(), "p.xml", log), [
        str(found) for found in log.diagnostics
    ]


def from_yaml(source: str):
    log = DiagnosticLog()
    return parse_property_yaml(source.encode(), "p.yaml", log), [
        str(found) for found in log.diagnostics
    ]


def test_both_kinds_of_files_make_the_same_properties():
    first, notes = from_xml(XML)
    second, found = from_yaml(YAML)
    assert found == []
    assert notes == [
        "p.xml:19:5: note: <clock>: not needed: time comes from the stamps and timers [clock-port]"
    ]
    by_name = {item.name: item for item in first}
    for item in second:
        twin = by_name[item.name]
        assert text(twin.formula) == text(item.formula)
        assert twin.meaning == item.meaning
        assert twin.deadline_ticks == item.deadline_ticks
        assert [(p.name, p.channel, p.kinds, p.path, p.event, p.initial) for p in twin.ports] == [
            (p.name, p.channel, p.kinds, p.path, p.event, p.initial) for p in item.ports
        ]
    assert by_name["A1"].role is Role.ASSUMPTION


def test_a_time_of_moons_universality_looks_back_as_moon_does():
    by_name = {item.name: item for item in from_xml(XML)[0]}
    assert text(by_name["P4"].formula) == "historically[:2] ((once {alarm}) -> {battery_level > 5})"


def test_an_actions_parts_are_its_channels():
    by_name = {item.name: item for item in from_xml(XML)[0]}
    ports = {
        port.name: (port.channel, port.path) for item in by_name.values() for port in item.ports
    }
    assert ports["going"] == ("/GoToPoi/_action/send_goal", ())
    assert ports["poi"] == ("/GoToPoi/_action/send_goal", ("goal", "poi_number"))
    assert ports["code"] == ("/GoToPoi/_action/get_result", ("status",))


def test_the_papers_properties_run_on_observations(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(YAML)
    monitors = PropertySet(
        [item for item in load_properties(path) if item.name in ("P1", "P2", "P6")]
    )
    second = 10**9
    monitors.observe(seen(0, "/BatteryComponent/battery_level", data=31))
    alarm = seen(second, "/AlarmSkill/tick", kind=ObservationKind.REQUEST_RECEIVED)
    assert [name for name, _ in monitors.observe(alarm)] == ["P1", "P6"]
    monitors.observe(seen(2 * second, "/BatteryComponent/battery_level", data=29))
    assert monitors.next_deadline() == 7 * second
    (found,) = monitors.advance(7 * second)
    assert found[0] == "P2"
    assert found[1].status is Status.FALSE
    assert found[1].since_ns == 7 * second


XML_FAULTS = {
    (
        "<properties>",
        "<model>",
        "</properties>",
        "</model>",
    ): "1:1: error: <model>: this is not a property file",
    (
        'pattern="recurrence"',
        'pattern="recurrent"',
    ): '22:32: error: <property>: pattern="recurrent" is not a pattern',
    ('type="before"', 'type="until"'): '28:40: error: <scope>: type="until" is not a scope',
    (
        "<event>published",
        "<event>publisht",
    ): "23:14: error: <event>: `publisht` is not declared; did you mean `published`?",
    ('event="battery_level &lt; 30"', ""): "28:27: error: <scope>: a scope `before` needs event=",
    (
        'time_unit="ms"',
        'time_unit="minutes"',
    ): "32:69: error: <time_interval>: `minutes` is not a unit of time",
    ('time="5000"', 'time="-5"'): "32:52: error: <time_interval>: `-5` is not a time",
    (
        'expr="100"',
        'expr="hundred"',
    ): "4:69: error: <state_var>: the initial value is not a constant",
    (
        'expr="100"',
        'expr="1.5"',
    ): "4:69: error: <state_var>: the initial value 1.5 is not of type int32",
    ('field="data"', ""): '4:7: error: <state_var>: field="" is not a field',
    (
        'id="published"',
        'id="battery_level"',
    ): "5:22: error: <event_var>: `battery_level` is declared twice",
    (
        'event="request"',
        'event="call"',
    ): '7:78: error: <ros_service>: event="call" is none of its parts',
    ('id="P2"', 'id="P1"'): "30:19: error: <property>: `P1` is declared twice",
    (
        "<events><event>battery_level &lt; 30</event>",
        "<events>",
    ): "30:5: error: <property>: `P2`: response takes 2 events",
    (
        "<event>battery_level &gt; 5",
        "<event>battery_level &gt;",
    ): "39:29: error: <event>: `battery_level >`: not an expression",
    ("<ros_topic ", "<ros_topik ", "</ros_topic>", "</ros_topik>"): (
        "3:5: error: <ros_topik>: this is not a port"
    ),
    ("<ros_topic ", "<scxml_event_send ", "</ros_topic>", "</scxml_event_send>"): (
        "3:5: error: <scxml_event_send>: this names an event between models, for a model checker"
    ),
    ("<guarantees>", "<predicates/><guarantees>"): (
        "26:3: error: <predicates>: predicates of their own are not part of MOON's form"
    ),
    ('event="battery_level &lt; 30"', 'event="battery_level < 30"'): (
        "28:69: error: malformed XML: a raw < in the value of `event`; write &lt; for <"
    ),
    ("H({alarm} ->", "H({alarm} =>"): "45:52: error: <property>: `=` does not belong in a formula",
}


@pytest.mark.parametrize("change", XML_FAULTS, ids=lambda change: change[1][:30])
def test_a_fault_in_xml_is_named_with_its_place(change):
    source = XML
    for old, new in zip(change[::2], change[1::2], strict=True):
        assert old in source
        source = source.replace(old, new, 1)
    found = [line for line in from_xml(source)[1] if "error" in line]
    expected = XML_FAULTS[change]
    assert any(line.startswith(f"p.xml:{expected}") for line in found), found


def test_who_uses_a_name_that_is_declared_wrongly_is_not_blamed():
    source = XML.replace("<ros_topic ", "<scxml_event_send ")
    source = source.replace("</ros_topic>", "</scxml_event_send>")
    (found,) = [line for line in from_xml(source)[1] if "error" in line]
    assert "<scxml_event_send>" in found
    source = YAML.replace("topic: /BatteryComponent/battery_level, field", "topik: /b, field")
    assert source != YAML
    found = [line for line in from_yaml(source)[1] if "error" in line]
    assert found
    assert not any("is not declared" in line for line in found)


@pytest.mark.parametrize(
    "what",
    [
        "pattern: existence, of: alarm",
        "pattern: response, request: low, response: alarm",
        "pattern: existence, of: alarm, after: low",
        'formula: "historically({alarm} or not {alarm})"',
    ],
)
def test_what_can_never_be_false_is_warned_of(what):
    source = YAML.split("properties:", maxsplit=1)[0] + f"properties:\n  - {{id: P, {what}}}\n"
    made, said = from_yaml(source)
    assert len(made) == 1
    (found,) = said
    assert "warning: <property>: `P` is never false" in found


YAML_FAULTS = {
    (
        "within: 3 s",
        "within: 3 fortnights",
    ): "p.yaml:11:76: error: <within>: `fortnights` is not a unit of time",
    ("within: 3 s", "within: soon"): "p.yaml:11:76: error: <within>: `soon` is not a time",
    (
        "of: alarm",
        "of: allarm",
    ): "p.yaml:16:9: error: <of>: `allarm` is not declared; did you mean `alarm`?",
    (
        "before: low",
        "before: low\n    after: low",
    ): "p.yaml:18:5: error: <properties>: `before` and `after` exclude each other",
    (
        "pattern: absence",
        "pattern: abscence",
    ): "p.yaml:15:14: error: <pattern>: `abscence` is not a pattern; did you mean `absence`?",
    (
        "severity: critical",
        "severity: bad",
    ): "p.yaml:14:15: error: <severity>: `bad` is not a severity",
    (
        "battery_level < 30",
        "battery_level < ",
    ): "p.yaml:9:23: error: <predicates>: `battery_level <`",
    ("id: P6, ", ""): "p.yaml:20:5: error: <properties>: the property has no `id`",
    (
        "on: request",
        "on: reqest",
    ): "p.yaml:4:42: error: <ports>: which part of the service is not clear",
    ("field: data, ", ""): "p.yaml:2:68: error: <ports>: an event has no `initial` value",
    ("P {low}", "P {low"): "p.yaml:20:39: error: <formula>: `{` is not closed",
    ("ports:", "ports: &a"): "p.yaml:1:8: error: anchors and aliases are refused",
    ("ports:", "ports: !!python/object:os.system"): "p.yaml:1:8: error: the tag",
    (
        "  published:",
        "  alarm: {}\n  published:",
    ): "p.yaml:5:3: error: the key `alarm` stands here twice",
    ("ports:", "ports: ["): "error: malformed YAML",
    ("id: P2", "id: P1"): "p.yaml:18:10: error: <properties>: `P1` is declared twice",
    (
        "response: alarm",
        "respons: alarm",
    ): "p.yaml:18:47: error: <properties>: `respons` means nothing here; did you mean `response`?",
}


@pytest.mark.parametrize("change", YAML_FAULTS, ids=lambda change: change[1][:30])
def test_a_fault_in_yaml_is_named_with_its_place(change):
    assert change[0] in YAML
    found = from_yaml(YAML.replace(change[0], change[1], 1))[1]
    assert any(YAML_FAULTS[change] in line for line in found), found


def test_hostile_files_are_refused(tmp_path):
    bomb = b"a: &a [x,x,x]\nb: &b [*a,*a,*a]\nc: [*b,*b,*b]\n"
    deep = b"[" * 10_000
    entity = b'<!DOCTYPE x [<!ENTITY a "aa">]><properties>&a;</properties>'
    for name, content in (
        ("a.yaml", bomb),
        ("b.yaml", deep),
        ("c.xml", entity),
        ("d.yaml", b"x" * 2_000_000),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        log = DiagnosticLog()
        assert read_properties(path, log) == []
        assert log.has_errors


@given(st.data())
@settings(max_examples=300, deadline=None)
def test_no_damaged_file_crashes_a_reader(data):
    choice = random.Random(data.draw(st.integers(0, 2**40)))
    source = choice.choice([XML, YAML])
    letters = list(source)
    for _ in range(choice.randint(1, 6)):
        place = choice.randrange(len(letters))
        match choice.randrange(3):
            case 0:
                del letters[place : place + choice.randint(1, 30)]
            case 1:
                letters.insert(
                    place,
                    choice.choice(
                        ["<", ">", "{", "}", ":", "&", "*", "!", "\t", "\x00", "é", "[", '"']
                    ),
                )
            case _:
                letters[place : place + 5] = letters[choice.randrange(len(letters)) :][:9]
    damaged = "".join(letters)
    (from_xml if source is XML else from_yaml)(damaged)


@given(st.binary(max_size=200))
@example(b"\xff\xfe")
@example(b"%YAML 9.9\n---\na: 1")
@example(b"a: b: c")
@example(b"? [1]\n: 2")
@example(b"--- 1\n--- 2")
@example(b'"\\xZZ"')
@settings(max_examples=200, deadline=None)
def test_no_bytes_crash_a_reader(content):
    log = DiagnosticLog()
    assert parse_property_yaml(content, "p.yaml", log) == []
    assert parse_property_xml(content, "p.xml", log) == []
    assert log.has_errors


def test_one_id_in_two_files_is_refused(tmp_path):
    for name in ("a.yaml", "b.yaml"):
        (tmp_path / name).write_text(YAML)
    with pytest.raises(ModelError, match="`P1` is declared twice"):
        load_properties(tmp_path / "a.yaml", tmp_path / "b.yaml")


def test_the_command_prints_formula_meaning_and_deadline(tmp_path):
    path = tmp_path / "p.xml"
    path.write_text(XML)
    result = CliRunner().invoke(main, ["check-properties", str(path)])
    assert result.exit_code == 0
    assert "P2  (guarantee, error)" in result.output
    assert (
        "meaning   Always, every `battery_level < 30` is followed by `alarm` within 5 s."
        in result.output
    )
    assert "deadline  5 s" in result.output
    assert "7 properties, 0 errors" in result.output


def test_the_command_says_where_a_fault_is_and_exits_with_2(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(YAML.replace("of: alarm", "of: allarm"))
    result = CliRunner().invoke(main, ["check-properties", str(path)])
    assert result.exit_code == 2
    assert f"{path}:16:9: error: <of>: `allarm` is not declared" in result.output


@pytest.mark.parametrize("name", ["missing.yaml", "missing.xml", "what.txt", "folder"])
def test_a_file_that_cannot_be_read_is_one_error(tmp_path, name):
    (tmp_path / "folder").mkdir()
    result = CliRunner().invoke(main, ["check-properties", str(Path(tmp_path) / name)])
    assert result.exit_code == 2
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert result.output.count("error:") == 1


PORT = "ports:\n  p: {topic: /t, field: data}\n"
LEVELS = 10**5


def laughs(count: int, body: str) -> str:
    named = "".join(f"  n{i}: '{body.format(n=f'n{i - 1}')}'\n" for i in range(1, count))
    rest = f"properties:\n  - {{id: f, formula: '{{n{count - 1}}}'}}\n"
    return f"{PORT}predicates:\n  n0: p > 1\n{named}{rest}"


def formula_files(formula: str) -> list[tuple[str, str]]:
    quoted = formula.replace("'", "''")
    attribute = html.escape(formula, quote=True)
    return [
        (".yaml", f"{PORT}properties:\n  - {{id: f, formula: '{quoted}'}}\n"),
        (
            ".xml",
            '<properties><ports><ros_topic topic_name="/t" type="t/T">'
            '<state_var id="p" type="int32" field="data"/></ros_topic></ports><guarantees>'
            f'<property id="f" expr="{attribute}"/></guarantees></properties>',
        ),
    ]


def faults_of(kind: str, source: str) -> list[str]:
    log = DiagnosticLog()
    parse = parse_property_yaml if kind == ".yaml" else parse_property_xml
    assert parse(source.encode(), f"f{kind}", log) == []
    return [str(item) for item in log.diagnostics]


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        ("(", ")"),
        ("not ", ""),
        ("!", ""),
        ("once ", ""),
        ("historically(", ")"),
        ("{p > 3} since ", ""),
        ("{p > 3} -> ", ""),
        ("{", "}"),
    ],
)
def test_a_formula_nested_a_hundred_thousand_deep_is_one_clear_error(begin, end):
    for kind, source in formula_files(begin * LEVELS + "{p > 3}" + end * LEVELS):
        (fault,) = faults_of(kind, source)
        assert "longer than 20000 characters [bad-formula]" in fault
    # within the length that is allowed
    times = 9000 // max(len(begin), 1) // 2
    for kind, source in formula_files(begin * times + "{p > 3}" + end * times):
        (fault,) = faults_of(kind, source)
        assert len(fault) < 500
        assert "bad-formula" in fault


@pytest.mark.parametrize(
    "predicate", ["(" * 1900 + "p" + ")" * 1900, "!" * 1900 + "p", "p" + ".a" * 1900]
)
def test_nor_is_a_predicate(predicate):
    for kind, source in formula_files(f"{{{predicate}}}"):
        (fault,) = faults_of(kind, source)
        assert "a predicate has more than 60 operators" in fault


@pytest.mark.parametrize(
    "predicate",
    ["/^(a+)+$/.test(p)", "p.match(/^(a|a)*$/)", "p == /(x+x+)+y/", 'RegExp("(a+)+$").test(p)'],
)
def test_a_predicate_has_no_regular_expressions_so_that_none_blows_up(predicate):
    for kind, source in formula_files(f"{{{predicate}}}"):
        (fault,) = faults_of(kind, source)
        assert "outside the sub-language" in fault


@pytest.mark.parametrize(
    "source",
    [
        "[" * LEVELS + "]" * LEVELS,
        "{a: " * LEVELS + "1" + "}" * LEVELS,
        "- " * LEVELS + "1",
        "\n".join(" " * level + "a:" for level in range(1400)),
    ],
)
def test_yaml_nested_deep_is_one_clear_error(source):
    (fault,) = faults_of(".yaml", source)
    assert "nested more than 12 deep [hostile-yaml]" in fault


def test_xml_nested_deep_is_one_clear_error():
    (fault,) = faults_of(".xml", "<a>" * LEVELS + "</a>" * LEVELS)
    assert "nested more than 64 deep" in fault


def test_a_file_of_too_many_keys_is_one_clear_error():
    (fault,) = faults_of(".yaml", "\n".join(f"k{i}: 1" for i in range(60_000)))
    assert "more than 50000 keys and values [hostile-yaml]" in fault


@pytest.mark.parametrize(
    ("count", "body", "what"),
    [
        (60, "{n} && {n}", "more than 8000 operators and predicates"),
        (60, "!{n} || ({n} && p > 5)", "more than 8000 operators and predicates"),
        (3000, "!{n}", "nested more than 100 deep"),
    ],
)
def test_named_predicates_that_multiply_are_refused_where_they_become_too_many(count, body, what):
    faults = faults_of(".yaml", laughs(count, body))
    assert what in faults[0]
    assert len(faults) == 1


@pytest.mark.parametrize("text", ["a." * LEVELS + "a", "/a" * LEVELS + "!", "a" * LEVELS + "!"])
def test_a_field_or_channel_without_an_end_is_one_short_error(text):
    end = "properties:\n  - {id: f, formula: '{p > 3}'}\n"
    for port in (f"{{topic: /t, field: {text}}}", f"{{topic: {text}, field: data}}"):
        faults = faults_of(".yaml", f"ports:\n  p: {port}\n{end}")
        assert len(faults) == 1
        assert len(faults[0]) < 250
    source = formula_files("{p > 3}")[1][1].replace('"data"', f'"{text}"')
    (fault,) = faults_of(".xml", source)
    assert "is not a field" in fault
    assert len(fault) < 250


def test_a_formula_as_wide_as_is_allowed_takes_text_in_proportion_to_its_size():
    def source(terms: int) -> str:
        each = [f"(once[1:2]{{p > {number}}})" for number in range(terms)]
        return network_code(build_network([parse_formula("or".join(each))])).source

    assert len(source(700)) < 10 * len(source(100))


def test_large_powers_are_numbers_like_others():
    found = PropertyMonitor("{9 ** 9 ** 9 ** 9 > p ** p ** p}")
    assert found.observe(seen(0, p=2**63)).status is Status.FALSE  # both are infinity
