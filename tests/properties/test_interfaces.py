"""Properties against models: channels, kinds, fields and types that do not fit are errors with places."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

import m2c
from m2c.diagnostics import DiagnosticLog
from m2c.model import load
from m2c.model.interfaces import InterfaceLibrary
from moon.cli import main
from moon.properties.files.interfaces import Interfaces
from moon.properties.files.xml import parse_property_xml
from moon.properties.files.yaml import parse_property_yaml
from tests.monitor.hand_driven import write_models
from tests.systems import EXAMPLES

PORTS = {
    "level": "{topic: /battery, field: data}",
    "whole": "{topic: /battery, keep: true}",
    "asked": "{service: /Level/tick, on: request}",
    "status": "{service: /Level/tick, on: response, field: status}",
    "scan": "{topic: /scan, type: sensor_msgs/LaserScan, field: ranges}",
    "frame": "{topic: /scan, type: sensor_msgs/msg/LaserScan, field: header.frame_id}",
    "poses": "{topic: /poses, type: geometry_msgs/msg/PoseArray, field: poses}",
    "going": "{action: /go, type: t/Go, on: goal, field: place, initial: 0}",
    "near": "{action: /go, type: t/Go, on: feedback, field: distance, initial: 1.5}",
    "docked": "{topic: /docked, type: std_msgs/Bool, field: data}",
}


@pytest.fixture
def known(tmp_path) -> Interfaces:
    model = write_models(tmp_path)
    action = tmp_path / "interfaces" / "t" / "action" / "Go.action"
    action.parent.mkdir()
    action.write_text("int32 place\n---\nbool arrived\n---\nfloat64 distance\n")
    log = DiagnosticLog()
    system = load([model], log)
    assert system is not None
    assert not log.has_errors
    return Interfaces(system.library, system)


def found_in(source: str, known: Interfaces | None) -> list[str]:
    log = DiagnosticLog()
    parse_property_yaml(source.encode(), "p.yaml", log, known)
    return [str(item) for item in log.diagnostics]


def port(text: str) -> str:
    return f"ports:\n  x: {text}\nproperties: []\n"


def predicate(text: str) -> str:
    ports = "".join(f"  {name}: {written}\n" for name, written in PORTS.items())
    return f'ports:\n{ports}properties:\n  - {{id: P, pattern: absence, of: "{text}"}}\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "{topic: /batery, field: data}",
            "p.yaml:2:14: error: <ports>: no model of Level names the topic /batery; did you mean "
            "/battery? (a channel of a node without a model declares its type) [unknown-channel]",
        ),
        (
            "{topic: /scan}",
            "p.yaml:2:14: error: <ports>: no model of Level names the topic /scan; a channel of a "
            "node without a model declares its type [unknown-channel]",
        ),
        (
            "{topic: /Level/tick}",
            "p.yaml:2:14: error: <ports>: /Level/tick is a service of Level, not a topic; its parts "
            "are request and response [wrong-channel-kind]",
        ),
        (
            "{topic: /battery, field: date}",
            "p.yaml:2:31: error: <ports>: t/msg/Level has no field `date`; did you mean data? "
            "[unknown-field]",
        ),
        (
            "{topic: /battery, field: data.value}",
            "p.yaml:2:31: error: <ports>: a value of type int32 has no field `value` [unknown-field]",
        ),
        (
            "{topic: /battery, type: std_msgs/Int32}",
            "p.yaml:2:30: error: <ports>: /battery has the type t/msg/Level, not std_msgs/msg/Int32 "
            "[type-mismatch]",
        ),
        (
            "{topic: /scan, type: sensor_msgs/LaserScn}",
            "p.yaml:2:27: error: <ports>: unknown type sensor_msgs/msg/LaserScn; did you mean "
            "sensor_msgs/msg/LaserScan? [unknown-type]",
        ),
        (
            "{topic: /battery, field: data, initial: low}",
            "p.yaml:2:46: error: <ports>: the initial value is not of the field's type, int32 "
            "[type-mismatch]",
        ),
        (
            "{service: /Level/tick, on: response, when: data.stat == 1}",
            "p.yaml:2:49: error: <when>: t/srv/Tick_Response has no field `stat`; did you mean "
            "status? [type-mismatch]",
        ),
        (
            "{service: /Level/tick, on: response, when: data.status == true}",
            "p.yaml:2:49: error: <when>: `==` between int8 and bool; both sides must have one type "
            "[type-mismatch]",
        ),
    ],
)
def test_a_port_that_no_model_has_so_is_an_error_where_it_stands(known, text, message):
    assert found_in(port(text), known) == [message]
    assert found_in(port(text), None) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("level < 'low'", "`<` between int32 and string; both sides must have one type"),
        ("level[0] > 1", "a value of type int32 has no elements"),
        ("level", "a value of type int32 is neither true nor false; compare it with a value"),
        ("whole.date > 1", "t/msg/Level has no field `date`; did you mean data?"),
        ("scan > 1", "`>` between float32[] and int64"),
        ("frame && docked", "a value of type string is neither true nor false"),
        ("docked < true", "`<` between bool and bool has no value"),
        ("docked == 1", "`==` between bool and int64"),
        ("frame + level == '3'", "`+` between string and int32 has no value"),
        ("status == null", "`==` between int8 and null has no value"),
        ("poses[0].position.w > 1", "geometry_msgs/msg/Point has no field `w`; did you mean x"),
        ("near == 'far'", "`==` between float64 and string"),
    ],
)
def test_a_predicate_that_never_has_a_value_is_an_error(known, text, message):
    (found,) = found_in(predicate(text), known)
    line = predicate(text).count("\n")
    assert found.startswith(f"p.yaml:{line}:")
    assert message.split("; did")[0] in found
    assert "[type-mismatch]" in found


@pytest.mark.parametrize(
    "text",
    [
        *(
            "level < 30 && status == 0",
            "whole.data > 3",
            "asked && scan[3] < 0.5",
            "scan.length > 3",
        ),
        *("frame == 'map'", "docked", "!docked || going == 4", "near < 1", "near < going"),
        *("poses[1].position.x > 1", "Math.abs(level) > 3", "docked ? level > 1 : level > 2"),
    ],
)
def test_predicates_that_fit_are_not_complained_of(known, text):
    assert found_in(predicate(text), known) == []


def test_the_place_is_where_the_predicate_begins_in_its_formula(known):
    source = predicate("asked")
    source += '  - {id: F, formula: "historically {asked} -> once[:5] {level == frame}"}\n'
    (found,) = found_in(source, known)
    line = source.splitlines()[-1]
    assert f":{line.index('level') + 1}: error: <formula>: `level == frame`: `==` between" in found


def test_who_uses_a_port_that_is_declared_wrongly_is_not_blamed(known):
    source = port("{topic: /batery, field: data}").replace(
        "[]", "[{id: P, pattern: absence, of: x > 3}]"
    )
    assert len(found_in(source, known)) == 1


def test_without_models_a_declared_type_is_held_against_the_interfaces_alone():
    known = Interfaces(InterfaceLibrary())
    good = "{topic: /any, type: std_msgs/msg/Bool, field: data}"
    assert found_in(port(good), known) == []
    assert found_in(port("{topic: /any, field: nothing}"), known) == []
    (found,) = found_in(port(good.replace("data", "date")), known)
    assert "did you mean data?" in found


def test_moons_xml_is_held_against_the_models_too(known):
    source = """\
<properties>
  <ports>
    <ros_topic topic_name="/batery"><state_var id="a" type="int32" field="data"/></ros_topic>
    <ros_topic topic_name="/battery" type="t/Level">
      <state_var id="b" type="bool" field="data"/>
      <state_var id="c" type="float64" field="date"/>
      <state_var id="d" type="int16" field="data"/>
    </ros_topic>
  </ports>
  <guarantees>
    <property id="P" pattern="absence"><event>d == "x"</event></property>
  </guarantees>
</properties>
"""
    log = DiagnosticLog()
    parse_property_xml(source.encode(), "p.xml", log, known)
    texts = [str(item) for item in log.diagnostics]
    assert [text.split(": error")[0] for text in texts] == [
        *("p.xml:3:28", "p.xml:5:31", "p.xml:6:47", "p.xml:11:47"),
    ]
    assert "the field's type is int32" in texts[1]


def run(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(main, [str(item) for item in arguments])
    return result.exit_code, result.output


def test_the_commands_take_a_system_and_end_with_2(tmp_path, known):
    model, path = tmp_path / "Level.scxml", tmp_path / "p.yaml"
    path.write_text(port("{topic: /battery, field: date}"))
    wrong = "p.yaml:2:31: error: <ports>: t/msg/Level has no field `date`; did you mean data?"
    recording = tmp_path / "run.mcap"
    for arguments in (
        ("check-properties", path, model),
        ("check-properties", path, tmp_path),
        ("check", recording, model, "--properties", path),
        ("monitor", model, "--properties", path, "--endpoint", "nowhere"),
    ):
        code, text = run(*arguments)
        assert (code, wrong in text) == (2, True), text
    assert run("check-properties", path)[0] == 0


def test_with_interfaces_alone_the_commands_know_the_types(tmp_path, known):
    path = tmp_path / "p.yaml"
    path.write_text(port("{topic: /else, type: t/Level, field: date}"))
    recording = tmp_path / "run.mcap"
    for arguments in (
        ("check-properties", path, "--interfaces", tmp_path / "interfaces"),
        ("check", recording, "--properties", path, "--interfaces", tmp_path / "interfaces"),
        ("monitor", "--properties", path, "--interfaces", tmp_path / "interfaces"),
    ):
        code, text = run(*arguments)
        assert (code, "t/msg/Level has no field `date`" in text) == (2, True), text


def test_models_alone_are_no_properties(tmp_path, known):
    code, text = run("check-properties", tmp_path / "Level.scxml")
    assert code == 2
    assert "error: all that is named are models; give a property file, too" in text


@pytest.mark.parametrize(
    "written",
    [
        "{service: /NavigationComponent/GoToPoi/_action/send_goal, on: request}",
        "{topic: /NavigationComponent/GoToPoi/_action/feedback}",
        "{service: /NavigationComponent/GoToPoi/_action/get_result, on: response, type: a/srv/B}",
    ],
)
def test_a_part_of_an_action_is_written_as_the_action(written: str) -> None:
    tour = m2c.read_system(EXAMPLES / "lab_tour" / "system.xml")
    (found,) = found_in(port(written), Interfaces(tour.library, tour))
    assert (
        "is a part of the action /NavigationComponent/GoToPoi; write `action: /NavigationComponent/GoToPoi`; its parts are goal"
        in found
    )
    assert found.endswith("(`on`) [wrong-channel-kind]")


POLICY = """<root BTCPP_format="4"><BehaviorTree ID="Main">
  <Condition ID="ROS2Condition" name="Level" service_name="/Level/tick"/></BehaviorTree></root>"""
ACTION = """<ascxml version="1.0" name="Going" initial="a" xmlns="http://www.w3.org/2005/07/scxml">
  <ros_action_server name="go" action_name="/go" type="t/Go"/><state id="a"/></ascxml>"""


@pytest.fixture
def with_policy(known, tmp_path) -> Interfaces:
    """The models of ``known``, a policy that ticks one of them, and the server of an action."""
    (tmp_path / "policy.xml").write_text(POLICY)
    (tmp_path / "going.ascxml").write_text(ACTION)
    models = "".join(
        f'<input type="node-ascxml" src="{path.name}"/>'
        for path in sorted(tmp_path.glob("*.*scxml"))
    )
    (tmp_path / "system.xml").write_text(
        '<roaml><behavior_tree><input type="bt.cpp-xml" src="policy.xml"/></behavior_tree>'
        f"<node_models>{models}</node_models></roaml>"
    )
    log = DiagnosticLog()
    system = load([tmp_path / "system.xml"], log)
    assert system is not None, log.diagnostics
    return Interfaces(system.library, system)


@pytest.mark.parametrize("declared", ["", "type: m2c/msg/TreeTick, ", "type: m2c/TreeTick, "])
def test_the_ticks_of_the_policy_have_the_fields_that_it_publishes(with_policy, declared):
    def found(field: str, of: str) -> list[str]:
        return found_in(
            f"ports:\n  x: {{topic: /policy/ticks, {declared}{field}}}\n"
            f'properties:\n  - {{id: P, pattern: absence, of: "{of}"}}\n',
            with_policy,
        )

    assert found("field: status", "x == 'FAILURE'") == []
    assert found("field: leaves", "x[0].status == 'HALTED'") == []
    assert found("field: leaves", "x[0].duration_us > 1000 && x[0].elapsed") == []
    assert found("keep: true", "x.leaves[0].outputs[0].key == 'goal'") == []
    assert found("when: data.tick > 3", "x") == []
    (wrong,) = found("field: stats", "x == 'FAILURE'")
    assert "m2c/msg/TreeTick has no field `stats`; did you mean status?" in wrong
    (wrong,) = found("field: status", "x == 2")
    assert "`==` between string and int64" in wrong


def test_the_status_of_an_actions_goals_is_a_topic_and_its_other_parts_are_not(with_policy):
    status = "topic: /go/_action/status"
    for declared in ("", ", type: action_msgs/GoalStatusArray"):
        written = f"ports:\n  x: {{{status}{declared}, field: status_list}}\n"
        use = 'properties:\n  - {id: P, pattern: absence, of: "x[0].status == 6"}\n'
        assert found_in(written + use, with_policy) == []
    (wrong,) = found_in(port(f"{{{status}, field: status}}"), with_policy)
    assert "action_msgs/msg/GoalStatusArray has no field `status`" in wrong
    (wrong,) = found_in(port("{topic: /go/_action/feedback}"), with_policy)
    assert "is a part of the action /go; write `action: /go`" in wrong


@pytest.mark.parametrize("unit", ["mins", "sec", "minutes", "Hz"])
def test_a_unit_of_time_that_is_none_is_told_with_all_that_are(unit):
    for line in (
        "{id: P, pattern: existence, of: x, within: 1 %s}",
        "{id: P, formula: 'historically({x} -> once[:1%s]{x})'}",
    ):
        (wrong,) = found_in(f"ports:\n  x: {{topic: /x}}\nproperties:\n  - {line % unit}\n", None)
        assert "ns, us, ms, s, min or h" in wrong
