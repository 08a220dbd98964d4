"""Policies as people write them, and what is said of those that cannot be run."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, System, load
from m2c.policy.program import Policy, read_policy

INTERFACES = {
    "TickCondition": "---\nint8 status\n",
    "TickAction": "---\nint8 status\n",
    "HaltAction": "---\nbool is_ok\n",
    "Other": "---\nbool done\n",
}


def machine(name: str, *servers: tuple[str, str]) -> str:
    declared = "".join(
        f'<ros_service_server service_name="{channel}" type="t/{kind}"/>'
        for channel, kind in servers
    )
    return (
        f'<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="a">'
        f'{declared}<state id="a"/></scxml>'
    )


@pytest.fixture
def system(tmp_path: Path) -> System:
    folder = tmp_path / "interfaces" / "t" / "srv"
    folder.mkdir(parents=True)
    for name, text in INTERFACES.items():
        (folder / f"{name}.srv").write_text(text)
    models = tmp_path / "models"
    models.mkdir()
    for name, servers in {
        "LevelSkill": [("/LevelSkill/tick", "TickCondition")],
        "AlarmSkill": [("/AlarmSkill/tick", "TickAction"), ("/AlarmSkill/halt", "HaltAction")],
        # names that mislead: `halt` in a tick's name, a halt service called otherwise
        "Odd": [("/halt_tick_ok/run", "TickAction"), ("/Odd/stop", "HaltAction")],
        "Plain": [("/Plain/tick", "TickCondition"), ("/Plain/halt_lamp", "Other")],
    }.items():
        (models / f"{name}.scxml").write_text(machine(name, *servers))
    log = DiagnosticLog()
    found = load([models], log)
    assert found is not None
    assert not log.has_errors, log.diagnostics
    return found


def read(system: System, tmp_path: Path, text: str) -> tuple[Policy | None, list[str]]:
    path = tmp_path / "policy.xml"
    path.write_text(text)
    log = DiagnosticLog()
    policy = read_policy(path, system, log)
    return policy, [str(found).replace(str(tmp_path) + "/", "") for found in log.diagnostics]


def tree(body: str, root: str = "<root>") -> str:
    return f'{root}<BehaviorTree ID="M">{body}</BehaviorTree></root>'


@pytest.mark.parametrize(
    "leaf",
    [
        '<Condition ID="ROS2Condition" name="Level" service_name="/LevelSkill/tick"/>',
        '<ROS2Condition name="Level" service_name="/LevelSkill/tick"/>',
        '<ROS2Condition name="Level" service_name_tick="/LevelSkill/tick"/>',
        '<Condition ID="ROS2Condition" name="Level" interface="ROS2SERVICE"/>',
        '<Condition ID="C" name="Level" service_name="/LevelSkill/tick_mon" isMonitored="true"/>',
    ],
)
def test_every_way_to_address_a_skill_names_the_same_service(
    leaf: str, system: System, tmp_path: Path
) -> None:
    policy, found = read(system, tmp_path, tree(leaf))
    assert policy is not None, found
    assert [(item.name, item.tick, item.action) for item in policy.leaves] == [
        ("Level", "/LevelSkill/tick", False)
    ]


def test_the_type_of_the_tick_decides_what_a_leaf_is_and_not_the_tag_or_a_name(
    system: System, tmp_path: Path
) -> None:
    text = tree('<Condition ID="C" name="X" service_name="/halt_tick_ok/run"/>')
    policy, found = read(system, tmp_path, text)
    assert policy is not None
    assert policy.leaves[0].action
    assert policy.leaves[0].halt == "/Odd/stop"
    assert "[leaf-kind]" in found[0]


def test_a_service_with_halt_in_its_name_does_not_make_a_condition_an_action(
    system: System, tmp_path: Path
) -> None:
    policy, _ = read(system, tmp_path, tree('<C name="P" service_name="/Plain/tick"/>'))
    assert policy is not None
    assert not policy.leaves[0].action
    assert policy.leaves[0].halt == ""


def test_version_3_words_and_a_blank_line_before_the_prologue_are_read(
    system: System, tmp_path: Path
) -> None:
    alarm = '<Action ID="A" name="Alarm" interface="ROS2SERVICE"/>'
    body = (
        f'<Parallel success_threshold="" failure_threshold="2"><SequenceStar>{alarm}'
        "</SequenceStar><IfThenElse><AlwaysFailure/><AlwaysSuccess/></IfThenElse></Parallel>"
    )
    policy, found = read(system, tmp_path, '\n<?xml version="1.0"?>\n' + tree(body))
    assert policy is not None, found
    assert '<Parallel failure_count="2">' in policy.xml
    assert "<SequenceWithMemory>" in policy.xml
    import behaviortreepy

    factory = behaviortreepy.BehaviorTreeFactory()
    status = behaviortreepy.NodeStatus.SUCCESS
    factory.register_simple_condition("Alarm", lambda _: status)
    factory.create_tree_from_text(policy.xml)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            tree("<Sequnce><AlwaysSuccess/></Sequnce>"),
            "policy.xml:1:28: error: <Sequnce>: unknown node; did you mean Sequence? [unknown-node]",
        ),
        (
            tree("<Retry><AlwaysSuccess/></Retry>"),
            "policy.xml:1:28: error: <Retry>: unknown node; did you mean RetryUntilSuccessful? "
            "[unknown-node]",
        ),
        (
            tree('<SubTree ID="N"/>'),
            "policy.xml:1:28: error: <SubTree>: the sub-tree `N` does not exist; known: M "
            "[missing-subtree]",
        ),
        (
            tree('<SubTree ID="M"/>'),
            "policy.xml:1:28: error: <SubTree>: a tree cannot contain itself: M → M "
            "[recursive-subtree]",
        ),
        (
            tree('<Action ID="A" name="x"/>'),
            "policy.xml:1:28: error: <Action>: the leaf `x` has no address; write "
            'service_name="/…/tick", or interface="ROS2SERVICE"; else bind it in the system file, '
            '<leaf ID="A" action="/…" type="…"/>, or give the system a plugin of this name [leaf-address]',
        ),
        (
            tree('<Action ID="A" name="x" service_name="/Plain/halt_lamp"/>'),
            "policy.xml:1:28: error: <Action>: /Plain/halt_lamp has type t/srv/Other, which cannot "
            "answer a tick; its response needs an integer field `status` [leaf-type]",
        ),
        (
            tree(
                '<Repeat num_cycles="1"><SubTree ID="N" __autoremap="1" __shared_blackboard="1"/></Repeat>'
            )
            .replace("</root>", '<BehaviorTree ID="N"><AlwaysSuccess/></BehaviorTree></root>')
            .replace("<root>", '<root main_tree_to_execute="M">'),
            "policy.xml:1:129: error: <SubTree>: `__shared_blackboard` is the port `_autoremap`, which "
            "is given already; give it once [unknown-port]",
        ),
        (
            tree('<Parallel success_count="1" success_threshold="2"><AlwaysSuccess/></Parallel>'),
            "policy.xml:1:75: error: <Parallel>: `success_threshold` is the port `success_count`, which "
            "is given already; give it once [unknown-port]",
        ),
    ],
)
def test_a_policy_that_cannot_run_is_reported_with_its_place(
    text: str, expected: str, system: System, tmp_path: Path
) -> None:
    policy, found = read(system, tmp_path, text)
    assert policy is None
    assert [line for line in found if "[older-spelling]" not in line] == [expected]


def test_what_is_written_in_a_policy_reaches_its_engine_as_it_was(
    system: System, tmp_path: Path
) -> None:
    import behaviortreepy

    named = """a "b" 'c' <d> & é &#10; \U0001f600 &amp; ]]>"""
    shown = named.replace("&#10;", "\n").replace("&amp;", "&")
    escaped = shown.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    escaped = escaped.replace("\n", "&#10;")
    policy, found = read(system, tmp_path, tree(f'<AlwaysSuccess name="{escaped}"/>'))
    assert policy is not None, found
    factory = behaviortreepy.BehaviorTreeFactory()
    factory.register_behavior_tree_from_text(policy.xml)
    assert factory.create_tree("M").root_node().name() == shown


def test_a_leaf_that_no_node_serves_is_a_warning(system: System, tmp_path: Path) -> None:
    text = tree('<Action ID="A" name="x" service_name="/AlarmSkil/tick"/>')
    policy, found = read(system, tmp_path, text)
    assert policy is not None
    assert found == [
        "policy.xml:1:28: warning: <Action>: no node serves /AlarmSkil/tick: the leaf `x` will fail; "
        "did you mean /AlarmSkill/tick? [unserved-leaf]"
    ]


def test_a_leaf_whose_node_lacks_skill_in_its_name_is_told_both_ways(
    system: System, tmp_path: Path
) -> None:
    text = tree('<Action ID="A" name="AlarmSkill" interface="ROS2SERVICE"/>')
    _, (found,) = read(system, tmp_path, text)
    assert found.endswith(
        "no node serves /AlarmSkillSkill/tick: the leaf `AlarmSkill` will fail; did you mean /AlarmSkill/tick? "
        'call the node AlarmSkillSkill, or write service_name="/AlarmSkill/tick" [unserved-leaf]'
    )


def test_two_trees_of_one_name_are_an_error(system: System, tmp_path: Path) -> None:
    one = '<BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree>'
    policy, found = read(system, tmp_path, f"<root>{one}{one}</root>")
    assert policy is None
    assert "[duplicate-tree]" in found[0]


def files(folder: Path, **texts: str) -> None:
    for name, text in texts.items():
        path = folder / f"{name.replace('__', '/')}.xml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"<root>{text}</root>")


def named(name: str, body: str = "<AlwaysSuccess/>") -> str:
    return f'<BehaviorTree ID="{name}">{body}</BehaviorTree>'


def test_trees_of_included_files_are_found_relative_to_the_file_that_includes_them(
    system: System, tmp_path: Path
) -> None:
    inner = '<include path="../other.xml"/>' + named("N", '<SubTree ID="O"/>')
    files(tmp_path, sub__inner=inner, other=named("O"))
    includes = '<include path="sub/inner.xml"/><include path="other.xml"/>'
    main = named("M", '<SubTree ID="N"/>')
    text = f'<root main_tree_to_execute="M">{includes}{main}</root>'
    policy, found = read(system, tmp_path, text)
    assert policy is not None, found
    assert policy.main == "M"
    assert policy.xml.count("<BehaviorTree") == 3


@pytest.mark.parametrize(
    ("include", "expected"),
    [
        (
            'path="loop.xml"',
            "loop.xml:1:22: error: <include>: a file cannot include itself: "
            "loop.xml → loop.xml [recursive-include]",
        ),
        (
            'path="nowhere.xml"',
            "policy.xml:1:22: error: <include>: the file nowhere.xml does not exist; the path is "
            "relative to the file that includes it [missing-file]",
        ),
        (
            'ros_pkg="tour" path="loop.xml"',
            "policy.xml:1:25: error: <include>: `ros_pkg` is not known here; write path=, relative "
            "to this file [unknown-attribute]",
        ),
        (
            'path="wrong.xml"',
            "wrong.xml:1:28: error: <Sequnce>: unknown node; did you mean Sequence? else bind it in the "
            'system file, <leaf ID="Sequnce" action="/…" type="…"/>, or give the system a plugin of this '
            "name [unknown-node]",
        ),
    ],
)
def test_an_include_that_cannot_be_followed_is_reported_where_it_stands(
    include: str, expected: str, system: System, tmp_path: Path
) -> None:
    files(tmp_path, loop='<include path="loop.xml"/>', wrong=named("W", "<Sequnce/>"))
    policy, found = read(system, tmp_path, f"<root><include {include}/>{named('M')}</root>")
    assert policy is None
    assert found == [expected]


def test_files_that_include_one_another_too_deep_are_an_error(
    system: System, tmp_path: Path
) -> None:
    for number in range(20):
        files(tmp_path, **{f"f{number}": f'<include path="f{number + 1}.xml"/>'})
    policy, found = read(system, tmp_path, f'<root><include path="f0.xml"/>{named("M")}</root>')
    assert policy is None
    assert found == [
        "f14.xml:1:22: error: <include>: files are included more than 16 deep [deep-include]"
    ]


def test_a_chain_of_thousands_of_sub_trees_is_one_error(system: System, tmp_path: Path) -> None:
    trees = [named(f"T{i}", f'<SubTree ID="T{i + 1}"/>') for i in range(5000)]
    text = "".join([*trees, named("T5000")])
    policy, found = read(system, tmp_path, f'<root main_tree_to_execute="T0">{text}</root>')
    assert policy is None
    (fault,) = found
    assert "is more than 256 nodes deep [deep-tree]" in fault


def test_trees_that_use_the_next_one_twice_are_measured_before_they_are_unfolded(
    system: System, tmp_path: Path
) -> None:
    twice = '<Sequence><SubTree ID="T{0}"/><SubTree ID="T{0}"/></Sequence>'
    trees = [named(f"T{i}", twice.format(i + 1)) for i in range(60)]
    text = "".join([*trees, named("T60")])
    policy, found = read(system, tmp_path, f'<root main_tree_to_execute="T0">{text}</root>')
    assert policy is None
    (fault,) = found
    assert "has more than 100,000 nodes [large-tree]" in fault


def test_what_behavior_tree_cpp_refuses_is_a_finding_of_the_policy(
    system: System, tmp_path: Path
) -> None:
    policy, found = read(system, tmp_path, tree('<Script code="a:="/>'))
    assert policy is None
    (fault,) = found
    refused = "BehaviorTree.CPP refuses the policy: error: "
    assert fault.startswith(f"policy.xml:1:28: error: <Script>: {refused}")
    assert fault.endswith("expected operand [refused-policy]")


@pytest.mark.parametrize("written", ["²", "-1", "1.5", "4294967296", "9" * 5000])
def test_a_time_that_is_none_is_refused_with_its_place(
    system: System, tmp_path: Path, written: str
) -> None:
    policy, found = read(system, tmp_path, tree(f'<Sleep msec="{written}"/>'))
    assert policy is None
    assert found[0].startswith("policy.xml:1:28: error: <Sleep>: `msec` is ")
    assert len(found[0]) < 400


def test_the_node_that_is_refused_is_found_among_others(system: System, tmp_path: Path) -> None:
    text = tree('<Sequence>\n<AlwaysSuccess/>\n<AlwaysSuccess _post="a :="/>\n</Sequence>')
    policy, found = read(system, tmp_path, text)
    assert policy is None
    assert found[0].startswith("policy.xml:3:1: error: <AlwaysSuccess>: BehaviorTree.CPP refuses")


@pytest.mark.parametrize(
    "around",
    [
        "<Unheard>{}</Unheard>",
        '<Control ID="Unheard">{}</Control>',
        "<Control>{}</Control>",
        '<Action ID="A" service_name="/LevelSkill/tick">{}</Action>',
        "<Unheard><Sequence><Unheard>{}</Unheard></Sequence></Unheard>",
        '<AlwaysSuccess/></BehaviorTree><BehaviorTree ID="M">{}',
        "<AlwaysSuccess/>{}",
    ],
)
def test_what_stands_below_what_is_not_known_is_checked(
    system: System, tmp_path: Path, around: str
) -> None:
    inner = '<Sequence><Repeat num_cyles="3"><Sequnce/></Repeat><Inverter/></Sequence>'
    policy, found = read(system, tmp_path, tree(around.format(inner)))
    assert policy is None
    for said in (
        "Repeat has no port `num_cyles`; did you mean num_cycles?",
        "<Sequnce>: unknown node; did you mean Sequence?",
        "Inverter takes 1",
    ):
        assert any(said in line for line in found), found


def test_the_threshold_of_an_earlier_parallel_is_told_what_to_write(
    system: System, tmp_path: Path
) -> None:
    inner = '<Parallel threshold="1"><AlwaysSuccess/></Parallel>'
    policy, found = read(system, tmp_path, tree(inner))
    assert policy is None
    assert any(
        "Parallel has no port `threshold`; write success_count, and in failure_count how many "
        "failures end it" in line
        for line in found
    ), found


@pytest.mark.parametrize("leaf", ["<Grasp/>", '<Grasp cup="{c}"/>', '<Action ID="Grasp"/>'])
def test_a_leaf_that_is_not_known_says_what_would_make_it_known(
    system: System, tmp_path: Path, leaf: str
) -> None:
    policy, found = read(system, tmp_path, tree(leaf))
    assert policy is None
    (said,) = found
    assert said.startswith("policy.xml:1:28: error: ")
    for way in ('service_name="/…/tick"', 'interface="ROS2SERVICE"', "a plugin "):
        assert way in said


def test_a_control_node_that_is_not_known_could_be_a_plugin(system: System, tmp_path: Path) -> None:
    _, found = read(system, tmp_path, tree("<ManualSelector><AlwaysSuccess/></ManualSelector>"))
    assert found == [
        "policy.xml:1:28: error: <ManualSelector>: unknown node; "
        "give the system a plugin of this name [unknown-node]"
    ]


@pytest.mark.parametrize(
    ("node", "said"),
    [
        (
            '<Wait wait_duration="5"/>',
            '<leaf ID="Wait" action="/wait" type="nav2_msgs/action/Wait">',
        ),
        ('<Action ID="BackUp"/>', 'action="/backup" type="nav2_msgs/action/BackUp">'),
        (
            "<ClearEntireCostmap/>",
            'service="{service_name}" type="nav2_msgs/srv/ClearEntireCostmap">',
        ),
        ("<IsBatteryLow/>", 'cond="_msg.percentage &lt;= min_battery">'),
        (
            '<Condition ID="GoalUpdated"/>',
            "; Nav2 computes it in the node that runs the ",
        ),
        (
            "<SpeedController><Wait/></SpeedController>",
            "; Nav2 computes it in the node that runs the ",
        ),
    ],
)
def test_a_node_of_nav2_that_is_not_bound_says_what_nav2_does(
    system: System, tmp_path: Path, node: str, said: str
) -> None:
    policy, found = read(system, tmp_path, tree(node))
    assert policy is None
    assert found[0].startswith("policy.xml:1:28: error: ")
    assert said in found[0]
    assert "did you mean" not in found[0]


def test_a_leaf_of_nav2_with_the_address_of_a_server_is_told_how_it_is_bound(
    system: System, tmp_path: Path
) -> None:
    _, (said,) = read(system, tmp_path, tree('<ClearEntireCostmap service_name="local/clear"/>'))
    assert "warning: <ClearEntireCostmap>: no node serves /local/clear" in said
    assert 'service="{service_name}" type="nav2_msgs/srv/ClearEntireCostmap"' in said


def test_a_leaf_that_is_not_known_could_be_bound(system: System, tmp_path: Path) -> None:
    _, (said,) = read(system, tmp_path, tree('<Grasp force="2"/>'))
    assert 'bind it in the system file, <leaf ID="Grasp" action="/…" type="…"/>' in said


REFUSED = '<Repeat num_cycles="x"><AlwaysSuccess/></Repeat>'


@pytest.mark.parametrize(
    "around",
    [
        "{}",
        "<Sequence><AlwaysSuccess/>{}</Sequence>",
        '<Timeout msec="5">{}</Timeout>',
        '<Timeout msec="5"><Delay delay_msec="5">{}</Delay></Timeout>',
        '<SubTree ID="N"/></BehaviorTree><BehaviorTree ID="N">{}',
        '<SubTree ID="N"/></BehaviorTree><BehaviorTree ID="N"><Timeout msec="5">{}</Timeout>',
    ],
)
def test_a_refusal_by_the_library_stands_at_its_element_wherever_that_is(
    system: System, tmp_path: Path, around: str
) -> None:
    text = tree(around.format("\n" + REFUSED), '<root main_tree_to_execute="M">')
    policy, found = read(system, tmp_path, text)
    assert policy is None
    (said,) = found
    assert said.startswith("policy.xml:2:1: error: <Repeat>: BehaviorTree.CPP refuses the policy: ")
    assert "line" not in said


def test_of_two_nodes_that_the_library_does_not_take_together_the_second_is_told(
    system: System, tmp_path: Path
) -> None:
    text = tree(
        '<Sequence><Script code="n := 1"/>\n<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>'
        '<AlwaysSuccess/>\n<RunOnce then_skip="{n}"><AlwaysSuccess/></RunOnce><AlwaysSuccess/></Sequence>'
    )
    policy, found = read(system, tmp_path, text)
    assert policy is None
    (said,) = found
    assert said.startswith("policy.xml:3:1: error: <RunOnce>: BehaviorTree.CPP refuses the policy")


@pytest.mark.parametrize(
    "name", ["SubTree", "Action", "Condition", "Control", "Decorator", "BehaviorTree", "root", "T"]
)
def test_a_leaf_may_be_called_as_anything_else_is(
    system: System, tmp_path: Path, name: str
) -> None:
    leaf = f'<Condition ID="ROS2Condition" name="{name}" service_name="/LevelSkill/tick"/>'
    text = tree(f'<Sequence>{leaf}<SubTree ID="T"/></Sequence>', '<root main_tree_to_execute="M">')
    text = text.replace("</root>", f'<BehaviorTree ID="T">{leaf}</BehaviorTree></root>')
    policy, found = read(system, tmp_path, text)
    assert policy is not None, found


def test_a_tree_may_be_called_as_a_tree_that_is_made(system: System, tmp_path: Path) -> None:
    text = tree('<Timeout name="a" msec="5"><SubTree ID="a#0"/></Timeout>')
    text = text.replace("<root>", '<root main_tree_to_execute="M">')
    text = text.replace("</root>", '<BehaviorTree ID="a#0"><AlwaysSuccess/></BehaviorTree></root>')
    policy, found = read(system, tmp_path, text)
    assert policy is not None, found
    assert [leaf.id for leaf in policy.leaves] == ["a_2"]


@pytest.mark.parametrize("written", ["<{} msec='5'/>", "<{} pose='{{p}}'/>", "<{}/>"])
@pytest.mark.parametrize("name", ["SleepAction", "Timeouts", "Repeat3"])
def test_a_leaf_that_is_called_almost_as_a_node_may_be_bound(
    system: System, tmp_path: Path, name: str, written: str
) -> None:
    policy, (found,) = read(system, tmp_path, tree(written.format(name)))
    assert policy is None
    assert "unknown node; did you mean " in found
    assert f'? else bind it in the system file, <leaf ID="{name}" action=' in found


@pytest.mark.parametrize("kind", ["Action", "Condition"])
@pytest.mark.parametrize("port", ["goal='{goal}'", "goal='3'", ""])
@pytest.mark.parametrize(
    ("leaf", "said"),
    [
        ("Retrieve", '<leaf ID="Retrieve" action="/…" type="…"/>, or give the system a plugin'),
        ("Spin", 'it is Nav2\'s: bind it in the system file, <leaf ID="Spin" action="/spin"'),
    ],
)
def test_a_leaf_without_an_address_is_told_how_it_gets_one_whatever_its_ports_are(
    system: System, tmp_path: Path, kind: str, port: str, leaf: str, said: str
) -> None:
    policy, (found,) = read(system, tmp_path, tree(f'<{kind} ID="{leaf}" {port}/>'))
    assert policy is None
    assert "has no address" in found
    assert said in found
