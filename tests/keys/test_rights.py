"""What each process may do is what its models say."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from m2c.policy.ticks import TICKS_CHANNEL
from moon.keys.rights import RightsError, rights_of
from moon.monitor.reading import read_checked
from tests.launch.system import System
from transports.zenoh.access import Rights, Role, access_control

EXAMPLES = Path(__file__).parents[2] / "examples"

ACTION = """<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{0}" initial="idle">
<ros_action_{1} name="go" action_name="/go" type="a/Go"/>
<state id="idle"/></ascxml>"""


def of_example(name: str) -> dict[str, Rights]:
    return {
        found.name: found for found in rights_of(read_checked([EXAMPLES / name / "system.xml"]))
    }


def allowed(section: dict, name: str, message: str, flow: str = "ingress") -> set[str]:
    granted = {
        rule
        for policy in section["policies"]
        if name in policy["subjects"]
        for rule in policy["rules"]
    }
    return {
        key
        for rule in section["rules"]
        if rule["id"] in granted and message in rule["messages"] and flow in rule["flows"]
        for key in rule["key_exprs"]
    }


def test_a_node_has_the_channels_of_its_model() -> None:
    found = of_example("lab_tour")["BatteryLevelSkill"]
    assert found.role is Role.NODE
    assert found.subscribes == ("/BatteryComponent/level",)
    assert found.serves == ("/BatteryLevelSkill/tick",)
    assert found.publishes == found.calls == ()


def test_the_policy_calls_what_its_leaves_are_ticked_by_and_publishes_what_its_plugins_do() -> None:
    tour, cell = of_example("lab_tour")["policy"], of_example("sorting_cell")["policy"]
    assert {"/BatteryLevelSkill/tick", "/GoToPoiSkill/tick", "/GoToPoiSkill/halt"} <= set(
        tour.calls
    )
    assert tour.publishes == (TICKS_CHANNEL,)
    assert {"/plain_events/grip", "/plain_events/release"} <= set(cell.publishes)


def test_an_action_is_its_parts(tmp_path: Path) -> None:
    types = tmp_path / "interfaces" / "a" / "action"
    types.mkdir(parents=True)
    (types / "Go.action").write_text("int32 to\n---\nint32 at\n---\nint32 left\n")
    for name, end in (("Server", "server"), ("Client", "client")):
        (tmp_path / f"{name}.ascxml").write_text(ACTION.format(name, end))
    found = {each.name: each for each in rights_of(read_checked([tmp_path]))}
    services = tuple(f"/go/_action/{part}" for part in ("send_goal", "cancel_goal", "get_result"))
    server, client = found["Server"], found["Client"]
    assert server.serves == client.calls == services
    assert server.publishes == ("/go/_action/feedback", "/go/_action/status")
    assert server.keeps_last == {"/go/_action/status"}
    assert client.subscribes == ("/go/_action/feedback",)


def test_the_rules_allow_each_its_own_and_the_router_what_anybody_may() -> None:
    section = access_control(
        [
            Rights(name="A", role=Role.NODE, publishes=("/a",), serves=("/s",)),
            Rights(name="observer", role=Role.OBSERVER),
            Rights(name="router", role=Role.ROUTER),
        ],
        "robot1",
    )
    assert section["enabled"]
    assert section["default_permission"] == "deny"
    assert allowed(section, "A", "put") == {"robot1/a", "robot1/s/_service_event"}
    assert allowed(section, "A", "declare_queryable") == {"robot1/s", "robot1/@m2c/answer/*/A"}
    assert "robot1/@m2c/node/*/A/*" in allowed(section, "A", "liveliness_token")
    assert allowed(section, "observer", "put") == set()
    assert allowed(section, "observer", "liveliness_token") == set()
    assert allowed(section, "observer", "put", "egress") == {"robot1/**"}
    assert allowed(section, "router", "put") == allowed(section, "A", "put")
    for message in ("put", "delete"):
        assert not any("*" in key for key in allowed(section, "A", message))


@pytest.mark.parametrize("name", ["router", "ca", "x" * 65])
def test_a_node_that_cannot_have_a_certificate_of_its_name_is_refused(
    tmp_path: Path, name: str
) -> None:
    system = read_checked([System(tmp_path).path])
    renamed = msgspec.structs.replace(system.nodes[0], name=name)
    with pytest.raises(RightsError, match=name):
        rights_of(msgspec.structs.replace(system, nodes=(renamed, *system.nodes[1:])))


DEPLOYED = """<deployment>
<process name="brain"><node name="policy"/><node name="LevelSkill"/></process>
<process name="MoveSkill"><node name="MoveSkill"/></process></deployment>"""


def test_a_process_of_the_deployment_may_do_what_its_nodes_may(tmp_path: Path) -> None:
    system = System(tmp_path / "lab")
    system.path.write_text(system.path.read_text().replace("</roaml>", f"{DEPLOYED}</roaml>"))
    processes = rights_of(read_checked([system.path]))
    assert [found.name for found in processes if found.role is Role.PROCESS] == ["brain"]
    section = access_control(processes)
    for message in ("put", "declare_queryable", "query", "liveliness_token"):
        of_nodes = [allowed(section, name, message) for name in ("policy", "LevelSkill")]
        assert allowed(section, "brain", message) == set.union(*of_nodes)
    assert "MoveSkill/tick" not in allowed(section, "brain", "declare_queryable")


@pytest.mark.parametrize("name", ["LevelSkill", "m2c_run", "ca", "router"])
def test_a_process_has_the_name_of_no_other_certificate(tmp_path: Path, name: str) -> None:
    system = System(tmp_path / "lab")
    text = DEPLOYED.replace("brain", name)
    system.path.write_text(system.path.read_text().replace("</roaml>", f"{text}</roaml>"))
    with pytest.raises(RightsError, match=f"a process of the deployment is named {name}"):
        rights_of(read_checked([system.path]))
