"""What machines say of each other's channels: in a system, in a folder, through plugins."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.check.reading import read_and_check
from m2c.cli import main
from m2c.model import DiagnosticLog

NS = 'xmlns="http://www.w3.org/2005/07/scxml" version="1.0"'
POLICY = (
    '<root BTCPP_format="4"><BehaviorTree ID="Main"><Action ID="Visit" name="Go"/>'
    "</BehaviorTree></root>"
)


def machine(name: str, body: str) -> str:
    return f'<scxml {NS} name="{name}" initial="a">{body}</scxml>'


def server(channel: str, kind: str = "Trigger", name: str = "Server") -> str:
    return machine(
        name,
        f'<ros_service_server service_name="{channel}" type="std_srvs/{kind}"/><state id="a">'
        f'<ros_service_handle_request name="{channel}"><ros_service_send_response name="{channel}">'
        '<field name="success" expr="true"/><field name="message" expr="\'\'"/>'
        "</ros_service_send_response></ros_service_handle_request></state>",
    )


def client(channel: str, kind: str = "Trigger", name: str = "Client") -> str:
    return machine(
        name,
        f'<ros_service_client service_name="{channel}" type="std_srvs/{kind}"/><state id="a">'
        f'<onentry><ros_service_send_request name="{channel}"/></onentry>'
        f'<ros_service_handle_response name="{channel}"/></state>',
    )


def plugin(channel: str, kind: str = "Trigger", name: str = "Visit") -> str:
    return machine(
        name,
        f'<ros_service_client service_name="{channel}" type="std_srvs/{kind}"/><state id="a">'
        f'<bt_tick><ros_service_send_request name="{channel}"/></bt_tick>'
        f'<ros_service_handle_response name="{channel}"><bt_return_status status="SUCCESS"/>'
        "</ros_service_handle_response></state>",
    )


def check(folder: Path, *arguments: str) -> tuple[int, list[str]]:
    result = CliRunner().invoke(main, ["check", *arguments])
    return result.exit_code, result.output.replace(f"{folder}/", "").splitlines()


def folder_of(tmp_path: Path, *models: str) -> tuple[int, list[str]]:
    for index, text in enumerate(models):
        (tmp_path / f"{index}.scxml").write_text(text)
    return check(tmp_path, str(tmp_path))


def system_of(tmp_path: Path, nodes: list[str], plugins: list[str]) -> tuple[int, list[str]]:
    inputs = {"node_models": "", "behavior_tree": '<input type="bt.cpp-xml" src="policy.xml"/>'}
    for kind, tag, models in (
        ("node-ascxml", "node_models", nodes),
        ("bt-plugin-ascxml", "behavior_tree", plugins),
    ):
        for index, text in enumerate(models):
            name = f"{tag}{index}.scxml"
            (tmp_path / name).write_text(text)
            inputs[tag] += f'<input type="{kind}" src="{name}"/>'
    body = "".join(f"<{tag}>{text}</{tag}>" for tag, text in inputs.items())
    (tmp_path / "policy.xml").write_text(POLICY)
    (tmp_path / "system.xml").write_text(f"<roaml>{body}</roaml>")
    return check(tmp_path, str(tmp_path / "system.xml"))


@pytest.mark.parametrize(
    ("called", "served"),
    [
        ("/Arm/grasp", "/Arm/grsap"),
        ("/Arm/grasp", "/Arm/Grasp"),
        ("/arm/grasp", "/Arm/grasp"),
        ("/Arm/set_pose", "/Arm/setPose"),
        ("/Arm/grasps", "/Arm/grasp"),
        ("/NavigationComponent/go", "/NavigatonComponnt/go"),
    ],
)
def test_a_folder_is_warned_of_a_near_miss(tmp_path: Path, called: str, served: str) -> None:
    code, lines = folder_of(tmp_path, client(called), server(served))
    assert code == 0
    assert lines == [
        f"0.scxml:1:88: warning: Client calls {called}, which no node read here serves; did you mean "
        f"{served}? [nobody-serves]",
        "2 models, 0 errors, 1 warning",
    ]


@pytest.mark.parametrize(
    ("called", "served", "kind"),
    [
        ("/Arm/grasp", "/Leg/walk", "Trigger"),  # simply elsewhere
        ("/Arm/grasp", "/Arm/grsap", "SetBool"),  # another type
        ("/SetPoi1/tick", "/SetPoi2/tick", "Trigger"),  # numbers tell instances apart
        ("/Arm/lock", "/Arm/unlock", "Trigger"),
        ("/Arm/get", "/Arm/set", "Trigger"),
        ("/Arm/increase", "/Arm/decrease", "Trigger"),
        ("/Alarm/start", "/Alarm/stop", "Trigger"),
        ("/Arms/grasp", "/Arm/grasps", "Trigger"),
        ("/Arm/left/grasp", "/Arm/grasp", "Trigger"),
    ],
)
def test_a_folder_is_not_warned_of_what_may_be_elsewhere(
    tmp_path: Path, called: str, served: str, kind: str
) -> None:
    _, lines = folder_of(tmp_path, client(called), server(served, kind))
    assert not [line for line in lines if "nobody-serves" in line]


def test_a_call_that_somebody_serves_is_no_near_miss(tmp_path: Path) -> None:
    _, lines = folder_of(
        tmp_path, client("/Arm/grasp"), server("/Arm/grasps"), server("/Arm/grasp", name="Other")
    )
    assert lines[-1] == "3 models, 0 errors, 0 warnings"


def test_a_whole_system_is_warned_of_every_missing_end(tmp_path: Path) -> None:
    subscriber = machine(
        "Reader",
        '<ros_topic_subscriber topic="/level" type="std_msgs/Int32"/><state id="a">'
        '<ros_topic_callback name="/level"/></state>',
    )
    goals = machine(
        "Sender",
        '<ros_action_client name="g" action_name="/go" type="example_interfaces/Fibonacci"/>'
        '<state id="a"><onentry><ros_action_send_goal name="g"><field name="order" expr="1"/>'
        "</ros_action_send_goal></onentry></state>",
    )
    (tmp_path / "interfaces" / "example_interfaces" / "action").mkdir(parents=True)
    path = tmp_path / "interfaces" / "example_interfaces" / "action" / "Fibonacci.action"
    path.write_text("int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n")
    _, lines = system_of(
        tmp_path,
        [client("/Arm/grasp"), subscriber, goals, server("/Leg/walk")],
        [plugin("/Leg/walk")],
    )
    assert lines == [
        "node_models0.scxml:1:88: warning: Client calls /Arm/grasp, which no node of the system serves; "
        "known: /Leg/walk [nobody-serves]",
        "node_models1.scxml:1:88: warning: Reader subscribes to /level, which no node of the system "
        "publishes [nobody-serves]",
        "node_models2.scxml:1:88: warning: Sender sends goals to /go, which no node of the system serves "
        "[nobody-serves]",
        "5 models, 0 errors, 3 warnings",
    ]


def test_a_plugin_that_calls_what_nobody_serves_is_reported(tmp_path: Path) -> None:
    _, lines = system_of(tmp_path, [server("/Arm/grasp")], [plugin("/Arm/grsap")])
    assert lines == [
        "behavior_tree0.scxml:1:87: warning: Visit calls /Arm/grsap, which no node of the system serves; "
        "did you mean /Arm/grasp? [nobody-serves]",
        "2 models, 0 errors, 1 warning",
    ]


def test_a_plugin_that_calls_with_another_type_is_an_error(tmp_path: Path) -> None:
    code, lines = system_of(tmp_path, [server("/Arm/grasp")], [plugin("/Arm/grasp", "Empty")])
    assert code == 2
    assert lines == [
        "behavior_tree0.scxml:1:87: error: Visit declares /Arm/grasp as std_srvs/srv/Empty, Server as "
        "std_srvs/srv/Trigger; both ends of a channel have one type [type-disagreement]",
        "2 models, 1 error, 0 warnings",
    ]


def test_two_plugins_of_one_name_are_an_error(tmp_path: Path) -> None:
    code, lines = system_of(
        tmp_path, [server("/Arm/grasp")], [plugin("/Arm/grasp"), plugin("/Arm/grasp")]
    )
    assert code == 2
    assert lines[0] == (
        "behavior_tree1.scxml:1:1: error: <scxml>: a second plugin is called `Visit`; the first is "
        "behavior_tree0.scxml [duplicate-node]"
    )


@pytest.mark.parametrize("name", ["Sequence", "Inverter", "AlwaysSuccess", "SubTree", "Action"])
def test_a_plugin_of_the_name_of_a_node_of_the_library_is_an_error_at_its_name(
    tmp_path: Path, name: str
) -> None:
    leaf = f'<leaf ID="{name}" topic="/p" type="std_msgs/Bool" cond="_msg.data"/>'
    tree = f'<behavior_tree><input type="bt.cpp-xml" src="t.xml"/>{leaf}</behavior_tree>'
    (tmp_path / "system.xml").write_text(f"<roaml>{tree}</roaml>")
    (tmp_path / "t.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="M"><AlwaysFailure/></BehaviorTree></root>'
    )
    log = DiagnosticLog()
    read_and_check([tmp_path / "system.xml"], [], log)
    found = [str(item).rpartition("/")[2] for item in log.diagnostics if "duplicate" in item.rule]
    assert found == [
        f"system.xml:1:71: error: <leaf>: BehaviorTree.CPP has a node called `{name}`; "
        "give it another name, here and in the tree [duplicate-node]"
    ]


def test_the_policy_of_a_system_is_checked_with_it(tmp_path: Path) -> None:
    (tmp_path / "policy.xml").touch()
    code, lines = system_of(tmp_path, [server("/Arm/grasp")], [plugin("/Arm/grasp", name="Visti")])
    assert code == 2
    assert lines[0].startswith("policy.xml:1:48: error: <Action>: the leaf `Go` has no address")


def test_a_policy_is_not_blamed_for_machines_that_cannot_be_read(tmp_path: Path) -> None:
    code, lines = system_of(tmp_path, ["<scxml>"], [plugin("/Arm/grasp")])
    assert code == 2
    assert not [line for line in lines if line.startswith("policy.xml")]
    assert lines[-1] == "1 model, 1 error, 0 warnings"  # nor is the plugin, for calling nobody
