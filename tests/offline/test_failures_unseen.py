"""In another's recording no error of a call shows: its client gave up, and goes on, unseen."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model.system import System
from tests.campaign.bags import Bag
from tests.offline.from_bags import accused_in, loaded, run_of
from tests.oracle.test_failed_goals import HANDLER, system_of
from tests.oracle.test_failed_goals import SERVER as GOAL_SERVER
from transports.interface import ObservationKind

MESSAGE = ObservationKind.MESSAGE
CALLER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Client" initial="resting">
<ros_service_client name="ask" service_name="/ask" type="std_srvs/SetBool"/>
<ros_topic_publisher topic="/over" type="std_msgs/Int32"/>
<state id="resting"><transition after="0.5s" target="asking"/></state>
<state id="asking">
  <onentry><ros_service_send_request name="ask"><field name="data" expr="true"/></ros_service_send_request></onentry>
  <ros_service_handle_response name="ask" target="resting"/>
  <ros_service_handle_error name="ask" target="resting">
    <ros_topic_publish name="/over"><field name="data" expr="{told}"/></ros_topic_publish>
  </ros_service_handle_error>
</state>
</scxml>"""
SERVER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Server" initial="on">
<datamodel><data id="asked" type="int32" expr="0"/></datamodel>
<ros_service_server name="ask" service_name="/ask" type="std_srvs/SetBool"/>
<state id="on"><ros_service_handle_request name="ask">
  <assign location="asked" expr="asked + 1"/>
  <if cond="asked != 3"><ros_service_send_response name="ask">
    <field name="success" expr="true"/>
  </ros_service_send_response></if>
</ros_service_handle_request></state>
</scxml>"""


def written(folder: Path, told: int = 1, caller: str = CALLER) -> tuple[Path, ...]:
    folder.mkdir(exist_ok=True)
    (folder / "Client.scxml").write_text(caller.format(told=told))
    (folder / "Server.scxml").write_text(SERVER)
    return folder / "Client.scxml", folder / "Server.scxml"


def accused(folder: Path, expected: tuple[Path, ...]) -> set[str]:
    """Who is in a run in which the third request is not answered, from a bag."""
    return accused_of(folder, loaded(written(folder)), expected, 1)


def accused_of(folder: Path, system: System, expected: tuple[Path, ...], over: int) -> set[str]:
    """Who is in a run of ``system``, from a bag; ``over``: what its client publishes first."""
    seen = run_of(system, 15.0)
    told = [one.data["data"] for one in seen if (one.channel, one.kind) == ("/over", MESSAGE)]
    assert told[0] == over
    bag = Bag()
    return accused_in(folder / "bag.mcap", bag, bag.recorded(seen), system, expected)


def test_a_client_that_gave_up_is_not_accused(tmp_path: Path) -> None:
    assert accused(tmp_path, written(tmp_path / "same")) == set()


@pytest.mark.parametrize("told", [2, 0])
def test_a_client_that_does_not_go_on_as_its_model_does_is(tmp_path: Path, told: int) -> None:
    assert accused(tmp_path, written(tmp_path / "other", told)) == {"Client"}


@pytest.mark.parametrize(
    ("told", "said"),
    [("10 + _event.goal_id", set()), ("77", {"Client"})],
    ids=["as modelled", "not"],
)
def test_so_it_is_with_a_goal(tmp_path: Path, told: str, said: set[str]) -> None:
    silent = GOAL_SERVER.format(accept="<log label='no'/>", after="90s").replace(
        '<ros_action_succeed name="act" goal_id="goal"/>', ""
    )
    silent = silent.replace(
        '<ros_action_handle_goal name="act" target="busy">', '<ros_action_handle_goal name="act">'
    )
    (tmp_path / "other").mkdir()
    system_of(
        tmp_path / "other", asking=HANDLER.replace("10 + _event.goal_id", told), server=silent
    )
    expected = (tmp_path / "other/Client.scxml", tmp_path / "other/Server.scxml")
    (tmp_path / "run").mkdir()
    system = system_of(tmp_path / "run", server=silent)
    assert accused_of(tmp_path / "run", system, expected, 11) == said


def test_a_client_that_does_nothing_with_its_answers_is(tmp_path: Path) -> None:
    tells = '<ros_topic_publish name="/over"><field name="data" expr="7"/></ros_topic_publish>'
    other = CALLER.replace(
        'name="ask" target="resting"/>',
        f'name="ask" target="resting">{tells}</ros_service_handle_response>',
    )
    assert accused(tmp_path, written(tmp_path / "other", caller=other)) == {"Client"}
