"""Leaves of a tree that are bound to an action, a service or a topic: no skill in between."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from m2c.check.reading import read_and_check
from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.convert.conversion import convert_files
from m2c.model import DiagnosticLog
from m2c.model.machine import Dialect
from m2c.policy.ticks import TreeTick
from tests.codegen.quality import formatted, strictly_typed
from tests.policy.bound_leaves import LEAVES, written
from tests.policy.simulated import checked, simulated, statuses

PAGE = Path(__file__).parents[2] / "docs" / "leaves.md"


def ticks(folder: Path, tree: str, seconds: float = 2.1) -> list[TreeTick]:
    return simulated(written(folder, tree), seconds).ticks


def goal(x: float) -> str:
    return f"""goal='{{"pose": {{"position": {{"x": {x}}}}}}}'"""


def outputs(told: list[TreeTick], key: str) -> list[str]:
    return [
        out.value for tick in told for leaf in tick.leaves for out in leaf.outputs if out.key == key
    ]


def test_an_action_runs_until_its_goal_has_succeeded(tmp_path: Path) -> None:
    tree = f'<Action ID="Navigate" {goal(7)} remaining="{{r}}" driven="{{p}}"/>'
    told = ticks(tmp_path, tree)
    states = [tick.status for tick in told]
    end = states.index("SUCCESS")
    assert end >= 4
    assert states[:end] == ["RUNNING"] * end
    assert outputs(told[: end + 1], "remaining") == ["2.0", "1.0", "0.0"]
    (path,) = outputs(told[: end + 1], "driven")
    assert path.count('"x":7.0') == 2
    assert outputs(told, "error") == []


def test_an_aborted_goal_is_a_failure_and_its_result_is_written(tmp_path: Path) -> None:
    told = ticks(tmp_path, f'<Action ID="Navigate" {goal(70)} error="{{e}}"/>')
    assert [tick.status for tick in told][:6].count("FAILURE") == 1
    assert outputs(told, "error")[0] == "207"


def test_a_rejected_goal_is_a_failure(tmp_path: Path) -> None:
    told = ticks(tmp_path, f'<Action ID="Navigate" {goal(-1)}/>')
    assert [tick.status for tick in told][:4] == ["RUNNING", "FAILURE", "RUNNING", "FAILURE"]


def test_a_halt_cancels_the_goal_and_the_next_tick_sends_another(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    tree = f'<Timeout msec="600"><Action ID="Navigate" {goal(7)}/></Timeout>'
    told = ticks(tmp_path, tree, 4)
    assert [tick.status for tick in told][:8] == (["RUNNING"] * 3 + ["FAILURE"]) * 2
    canceled = [text for text in caplog.messages if "canceled" in text]
    assert [text[-1] for text in canceled][:3] == ["1", "2", "3"]


@pytest.mark.parametrize(
    ("x", "service", "status"),
    [(3, "clear", "SUCCESS"), (30, "/clear", "FAILURE"), (3, "/gone", "FAILURE")],
)
def test_a_service_answers_the_tick_that_calls_it(
    tmp_path: Path, x: int, service: str, status: str
) -> None:
    told = ticks(tmp_path, f'<Clear service_name="{service}" x="{x}" cleared="{{c}}"/>', 0.3)
    assert told[0].status == status
    wanted = (
        []
        if service == "/gone"
        else [f'[{{"x":{x}.0,"y":0.0,"z":0.0}},{{"x":2.0,"y":0.0,"z":0.0}}]']
    )
    assert outputs(told[:1], "cleared") == wanted


def test_a_condition_looks_at_the_last_message(tmp_path: Path) -> None:
    tree = """<Sequence><Script code="least := 0.8"/>
      <Fallback><Condition ID="BatteryLow" min="{least}" battery="{b}"/><AlwaysSuccess _onSuccess="least := 0.7"/>
      </Fallback></Sequence>"""
    told = ticks(tmp_path, tree)
    states = [tick.leaves[0].status for tick in told]
    assert states[0] == "FAILURE"  # nothing was heard
    assert "SUCCESS" in states
    assert outputs(told, "battery")[0].startswith('{"level":0.')


def test_without_a_condition_it_is_whether_anything_was_heard(tmp_path: Path) -> None:
    leaf = '<leaf ID="Heard" topic="/battery" type="nav_interfaces/msg/Battery"/>'
    run = simulated(written(tmp_path, '<Condition ID="Heard"/>', leaf), 2.1)
    assert statuses(run)[0] == "FAILURE"
    assert statuses(run)[-1] == "SUCCESS"


NAV, SRV, MSG = (
    "nav_interfaces/action/Navigate",
    "nav_interfaces/srv/Clear",
    "nav_interfaces/Battery",
)


@pytest.mark.parametrize(
    ("leaf", "said"),
    [
        ('<leaf action="/a" type="{NAV}"/>', "the attribute `ID` is missing [missing-attribute]"),
        ('<leaf ID="A" action="/a"/>', "the attribute `type` is missing [missing-attribute]"),
        ('<leaf ID="A" type="{NAV}"/>', "a leaf is one action, one service or one topic"),
        (
            '<leaf ID="A" action="/a" topic="/b" type="{NAV}"/>',
            "a leaf is one action, one service or one topic",
        ),
        (
            '<leaf ID="A" action="/a" type="{SRV}"/>',
            "nav_interfaces/srv/Clear is a service, not an action; "
            "the type of an action is written pkg/action/Name [unknown-type]",
        ),
        (
            '<leaf ID="A" service="/a" type="nav_interfaces/srv/Claer"/>',
            "did you mean nav_interfaces/srv/Clear?",
        ),
        ('<leaf ID="A" topic="/a" type="{MSG}" rate="3"/>', "unknown attribute `rate`"),
        ('<leaf ID="A" topic="/a" type="{MSG}" cond=""/>', "the attribute `cond` is missing"),
        ('<leaf ID="A" topic="/a" type="{MSG}" cond="_msg.level &lt;"/>', "[bad-expression]"),
        ('<leaf ID="A" topic="/a" type="{MSG}" cond="_msg.levle &lt; 1"/>', "<leaf>: "),
        ('<leaf ID="A" topic="/a" type="{MSG}" cond="mni &lt; 1"/>', "mni"),
        (
            '<leaf ID="A" topic="/a" type="{MSG}"><field name="level" port="l"/></leaf>',
            "not an element of a <leaf>",
        ),
        (
            '<leaf ID="A" service="/a" type="{SRV}"><feedback name="x" port="l"/></leaf>',
            "not an element of a <leaf>",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="poes" port="g"/></leaf>',
            "did you mean pose?",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="pose.x" port="g"/></leaf>',
            "has no field `x`",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="planner.x" port="g"/></leaf>',
            "string has no field `x`",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="pose"/></leaf>',
            '<field>: nothing says what it is; write port="…" or expr="…"',
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="pose" port="a" expr="1"/></leaf>',
            "exclude each other",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="planner" expr="1"/></leaf>',
            "[type-mismatch]",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><result name="path"/></leaf>',
            "the attribute `port` is missing",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="pose" port="p"/><field name="planner" port="p"/></leaf>',
            "the port `p` has type geometry_msgs/msg/PoseStamped and string; the first is at 3:",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><field name="pose" port="p"/><field name="pose.header" port="q"/></leaf>',
            "`pose.header` is set twice",
        ),
        (
            '<leaf ID="A" action="/a" type="{NAV}"><result name="path" port="p"/><result name="path" port="p"/></leaf>',
            "the port `p` is written twice",
        ),
        (
            '<leaf ID="A" service="{p}" type="{SRV}"><result name="success" port="p"/></leaf>',
            "the port `p` has type string and bool",
        ),
        ('<leaf ID="A" topic="/a//b" type="{MSG}"/>', "/a//b"),
        *(
            (
                f'<leaf ID="A" {kind}="{name}" type="{which}"/>',
                f"`{kind}` is `{name}`; a port gives the whole of a name; "
                f'write {kind}="{{robot}}" here, and robot="/…" at each leaf of the tree [bad-name]',
            )
            for kind, which in (("action", "{NAV}"), ("service", "{SRV}"), ("topic", "{MSG}"))
            for name in ("/{robot}/do", "{ robot }/do", "/fleet/{robot}", "/{robot}/{other}")
        ),
        (
            '<leaf ID="A" topic="/a" type="{MSG}"><bt_declare_port_in key="k" type="flaot64"/></leaf>',
            "[unknown-type]",
        ),
        (
            '<leaf ID="A" topic="/a" type="{MSG}"><leaf/></leaf>',
            "not an element of a <leaf> that is a topic",
        ),
    ],
)
def test_a_binding_that_does_not_fit_is_refused(tmp_path: Path, leaf: str, said: str) -> None:
    for name, text in (("{NAV}", NAV), ("{SRV}", SRV), ("{MSG}", MSG)):
        leaf = leaf.replace(name, text)
    errors = [
        line
        for line in checked(written(tmp_path, "<AlwaysSuccess/>", leaf))[1]
        if ": error:" in line
    ]
    assert len(errors) == 1, errors
    assert errors[0].startswith("system.xml: error: ")
    assert said in errors[0]


def test_two_leaves_of_one_name_are_refused(tmp_path: Path) -> None:
    leaf = f'<leaf ID="A" action="/a" type="{NAV}"/>'
    said = checked(written(tmp_path, "<AlwaysSuccess/>", leaf + leaf))[1]
    assert "system.xml: error: <leaf>: a second plugin is called `A`" in "\n".join(said)


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        ('<Navigate goal="[1]"/>', "the port has type geometry_msgs/msg/PoseStamped, as JSON"),
        ("<Navigate/>", "the port `goal` of `Navigate` is not given"),
        (
            '<Sequence><Clear service_name="/clear" x="1" cleared="{p}"/><Navigate goal="{p}"/></Sequence>',
            "an entry has one type",
        ),
        ('<Clear service_name="{s}" x="1"/>', "is written out"),
    ],
)
def test_a_tree_that_does_not_fit_a_binding_is_refused(
    tmp_path: Path, tree: str, said: str
) -> None:
    errors = [line for line in checked(written(tmp_path, tree))[1] if ": error:" in line]
    assert len(errors) == 1, errors
    assert said in errors[0]


def test_a_leaf_that_may_run_is_no_condition(tmp_path: Path) -> None:
    said = checked(written(tmp_path, f'<Condition ID="Navigate" {goal(1)}/>', LEAVES))[1]
    assert any("leaf-kind" in line and "RUNNING" in line for line in said)
    assert ticks(tmp_path, f'<Condition ID="Navigate" {goal(1)}/>')[0].status == "RUNNING"


def test_what_is_generated_of_a_leaf_is_formatted_and_typed(tmp_path: Path) -> None:
    system, said = checked(written(tmp_path, f"<Navigate {goal(1)}/>"))
    assert system is not None, said
    write_files(system_files(system), tmp_path / "generated")
    formatted(tmp_path / "generated")
    strictly_typed(tmp_path / "generated", list((tmp_path / "generated").glob("*_policy")))


def test_a_system_with_leaves_converts_to_itself(tmp_path: Path) -> None:
    log = DiagnosticLog()
    system = written(tmp_path, f"<Navigate {goal(1)}/>")
    made = convert_files([system], [], tmp_path / "converted", Dialect.ASCXML, log)
    assert made is not None, log.diagnostics
    assert LEAVES in (tmp_path / "converted" / "system.xml").read_text()


DEFINED = {
    "action/ComputePathToPose.action": "geometry_msgs/PoseStamped goal\nstring planner_id\n---\nPath path\n"
    "uint16 error_code\n---\n",
    "action/FollowPath.action": "Path path\nstring controller_id\n---\nuint16 error_code\n---\n"
    "float32 distance_to_goal\n",
    "srv/ClearEntireCostmap.srv": "std_msgs/Empty request\n---\nstd_msgs/Empty response\n",
    "msg/Path.msg": "geometry_msgs/PoseStamped[] poses\n",
}


def test_the_page_shows_a_system_that_is_checked(tmp_path: Path) -> None:
    bindings, tree = re.findall(r"```xml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "navigate.xml").write_text(tree)
    (tmp_path / "system.xml").write_text(f"<roaml>{bindings}</roaml>")
    for name, text in DEFINED.items():
        path = tmp_path / "interfaces" / "nav2_msgs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    log = DiagnosticLog()
    read_and_check([tmp_path / "system.xml"], [tmp_path / "interfaces"], log)
    assert {item.rule for item in log.diagnostics} == {"nobody-serves", "unserved-leaf"}
    assert not any("bind it" in item.hint for item in log.diagnostics), "all are bound"


def test_a_port_that_is_not_given_has_the_default_of_its_model(tmp_path: Path) -> None:
    model = (
        '<TreeNodesModel><Action ID="Navigate"><input_port name="goal" default=\''
        '{"pose": {"position": {"x": 70}}}\'/><output_port name="error" default="{error}"/></Action>'
        "</TreeNodesModel>"
    )
    run = simulated(written(tmp_path, "<Navigate/>", more=model), 2.1)
    assert outputs(run.ticks, "error")[0] == "207"


def test_two_places_of_one_leaf_have_goals_of_their_own(tmp_path: Path) -> None:
    tree = f"""<Sequence><Action ID="Navigate" {goal(7)} driven="{{p}}"/>
      <Action ID="Navigate" {goal(8)} driven="{{p}}"/></Sequence>"""
    told = ticks(tmp_path, tree, 4)
    assert [tick.status for tick in told].index("SUCCESS") >= 8
    first, second = outputs(told, "driven")[:2]
    assert ('"x":7.0' in first, '"x":8.0' in second) == (True, True)
