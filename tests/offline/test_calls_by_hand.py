"""A call that somebody makes by hand is of no node of the models, whoever else calls that by its model."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.campaign.bags import Bag
from tests.offline.from_bags import accused_in, loaded, run_of

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="{}" initial="on">'
ASK = '<ros_service_client name="ask" service_name="/ask" type="std_srvs/SetBool"/>'
SEND = """<ros_service_send_request name="ask">
  <field name="data" expr="{}"/>
</ros_service_send_request>"""
BEAT = """<ros_time_rate name="beat" rate_hz="1"/>
<state id="on"><ros_rate_callback name="beat">{}</ros_rate_callback></state></scxml>"""
GO = """<ros_topic_subscriber name="go" topic="/go" type="std_msgs/Empty"/>
<state id="on"><ros_topic_callback name="go">{}</ros_topic_callback></state></scxml>"""
SAYS = '<ros_topic_publisher name="said" topic="/said" type="std_msgs/Int32"/>'
SAY = '<ros_topic_publish name="said"><field name="data" expr="1"/></ros_topic_publish>'
ACTS = '<ros_action_client name="act" action_name="/act" type="example_interfaces/Fibonacci"/>'
START = """<ros_action_send_goal name="act"><field name="order" expr="3"/></ros_action_send_goal>"""
CANCEL = '<ros_action_send_cancel name="act" goal_id="0"/>'
SERVER = f"""{HEAD.format("Server")}
<ros_service_server name="ask" service_name="/ask" type="std_srvs/SetBool"/>
<ros_action_server name="act" action_name="/act" type="example_interfaces/Fibonacci"/>
<state id="on">
  <ros_service_handle_request name="ask"><ros_service_send_response name="ask">
    <field name="success" expr="true"/>
  </ros_service_send_response></ros_service_handle_request>
  <ros_action_handle_goal name="act"><ros_action_reject_goal name="act" goal_id="_event.goal_id"/>
  </ros_action_handle_goal>
</state></scxml>"""


def accused(folder: Path, hand: str, client: str, run: str = "") -> set[str]:
    """Who is, in a bag of a run of ``hand``, a server, and a client that does as ``client``, or as ``run`` does."""
    files = {"Server": SERVER, "Hand": HEAD.format("Hand") + hand, "Client": run or client}
    for name, text in files.items():
        (folder / f"{name}.scxml").write_text(
            text if name != "Client" else HEAD.format(name) + text
        )
    system = loaded(tuple(folder / f"{name}.scxml" for name in files if name != "Hand" or hand))
    (folder / "models").mkdir()
    expected = folder / "models/Client.scxml", folder / "Server.scxml"
    expected[0].write_text(HEAD.format("Client") + client)
    bag = Bag()
    seen = bag.recorded(run_of(system, 6.0))
    assert len(seen) > 4
    return accused_in(folder / "bag.mcap", bag, seen, system, expected)


@pytest.mark.parametrize(
    "client",
    [ASK + GO.format(""), ASK + GO.format(SEND.format("true"))],
    ids=["never calls it", "has not called it yet"],
)
def test_a_service_may_be_called_by_hand(tmp_path: Path, client: str) -> None:
    assert accused(tmp_path, ASK + BEAT.format(SEND.format("false")), client) == set()


@pytest.mark.parametrize("does", ["", START, CANCEL])
def test_a_goal_may_be_sent_by_hand(tmp_path: Path, does: str) -> None:
    assert accused(tmp_path, ACTS + BEAT.format(START), ACTS + GO.format(does)) == set()


def test_a_message_may_be_published_by_hand_where_no_node_does(tmp_path: Path) -> None:
    assert accused(tmp_path, SAYS + BEAT.format(SAY), SAYS + GO.format("")) == set()


def test_a_call_of_who_has_called_as_it_should_is_its_own(tmp_path: Path) -> None:
    """Its fourth is another than its model makes."""
    counting = (
        '<datamodel><data id="n" type="int32" expr="0"/></datamodel>'
        + ASK
        + BEAT.format('<assign location="n" expr="n + 1"/>' + SEND.format("n {} 4"))
    )
    model, run = counting.format("&lt; 99 || n == "), counting.format("!= ")
    assert accused(tmp_path, "", model, run) == {"Client"}
