"""Threads of an action server in virtual time, with the oracle watching: whose goal it is and which thread's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog, load
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome
from transports.interface import ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{}" initial="idle">'
SERVER = (
    HEAD.format("Server")
    + """
<ros_action_server name="act" action_name="/do" type="t/Do"/>
<ros_topic_publisher topic="/freed" type="std_msgs/Int32"/>
<ros_action_thread name="act" n_threads="3" initial="ready">
  <datamodel><data id="goal" type="int64"/><data id="me" type="int64"/></datamodel>
  <state id="ready"><ros_action_handle_thread_start name="act" target="done">
    <assign location="goal" expr="{root}.goal_id"/><assign location="me" expr="{root}.thread_id"/>
  </ros_action_handle_thread_start></state>
  <state id="done"><transition target="ready">
    <ros_action_succeed name="act" goal_id="goal"><field name="n" expr="me"/></ros_action_succeed>
    <ros_action_thread_free name="act"/>
  </transition></state>
</ros_action_thread>
<datamodel><data id="next" type="int64" expr="2"/></datamodel>
<state id="idle">
  <ros_action_handle_goal name="act">
    <ros_action_accept_goal name="act" goal_id="{root}.goal_id"/>
    <ros_action_start_thread name="act" goal_id="{root}.goal_id" thread_id="next">
      <field name="n" expr="_goal.n"/>
    </ros_action_start_thread>
  </ros_action_handle_goal>
  <ros_action_handle_thread_free name="act" cond="{root}.thread_id &gt; 0">
    <assign location="next" expr="{root}.thread_id - 1"/>
    <ros_topic_publish name="/freed"><field name="data" expr="{root}.thread_id"/></ros_topic_publish>
  </ros_action_handle_thread_free>
</state></scxml>"""
)
CLIENT = (
    HEAD.format("Client")
    + """
<ros_action_client name="act" action_name="do" type="t/Do"/>
<ros_topic_publisher topic="/got" type="std_msgs/Int32MultiArray"/>
<datamodel><data id="goal" type="int64"/></datamodel>
<state id="idle"><onentry>
  <ros_action_send_goal name="act"><field name="n" expr="1"/></ros_action_send_goal></onentry>
  <ros_action_handle_goal_response name="act" accept="sent" reject="idle">
    <assign location="goal" expr="_event.data.goal_id"/>
  </ros_action_handle_goal_response>
</state>
<state id="sent">
  <ros_action_handle_success_result name="act" cond="_event.data.goal_id == goal" target="rest">
    <ros_topic_publish name="/got">
      <field name="data" expr="[_event.data.n, _event.data.goal_id, _event.data.code]"/>
    </ros_topic_publish>
  </ros_action_handle_success_result>
</state>
<state id="rest"><transition after="200ms" target="idle"/></state></scxml>"""
)
ACTION = "int32 n\n---\nint32 n\n---\nint32 n\n"


def ran(
    folder: Path,
    server: str,
    action: str = ACTION,
    client: str = CLIENT,
    instead: str = "",
    seconds: float = 0.9,
) -> tuple[dict[str, list[Any]], list[Any]]:
    """What was published by topic, and the violations that the oracles of both nodes saw.

    ``instead``: the server that runs in the place of ``server``, whose model the oracle has.
    """
    path = folder / "interfaces" / "t" / "action" / "Do.action"
    path.parent.mkdir(parents=True)
    path.write_text(action)
    (folder / "Server.scxml").write_text(server)
    (folder / "Client.scxml").write_text(client)
    log = DiagnosticLog()
    system = load([folder], log)
    assert system is not None, log.diagnostics
    check_system(system, log)
    assert not log.has_errors, log.diagnostics
    world = SimulatedWorld(seed=1)
    monitor = ModelMonitor(system.nodes, system.library, synchronised=True)
    verdicts: list[Any] = []
    published: dict[str, list[Any]] = {"/freed": [], "/got": []}

    def hear(observation: Any) -> None:
        verdicts.extend(monitor.feed(observation))
        if observation.kind is ObservationKind.MESSAGE and observation.channel in published:
            published[observation.channel].append(observation.data["data"])

    for oracle in monitor.oracles.values():
        oracle.start(world.now_ns)
    listener = SimulatedTransport(world, "listener")
    listener.tap([], hear)
    listener.every(0.02, lambda: verdicts.extend(monitor.advance(world.now_ns)))
    program = compile_system(system)
    if instead:
        (folder / "Server.scxml").write_text(instead)
        other = load([folder], log)
        assert other is not None, log.diagnostics
        program = compile_system(other)
    SimulatedRun(program, world).run(seconds)
    world.close()
    return published, [item for item in verdicts if item.outcome is Outcome.VIOLATED]


@pytest.mark.parametrize("root", ["_event", "_event.data"])
def test_event_data_has_the_goal_and_the_thread_by_either_name(root: str, tmp_path: Path) -> None:
    published, violations = ran(tmp_path, SERVER.replace("{root}", root))
    assert published["/freed"] == [2, 1]
    assert published["/got"][:3] == [[2, 1, 4], [1, 2, 4], [0, 3, 4]]
    assert violations == []


def test_a_field_of_the_goal_itself_is_that_field(tmp_path: Path) -> None:
    action = f"int32 thread_id\n{ACTION}"
    server = SERVER.replace("{root}", "_event").replace(
        'location="me" expr="_event.thread_id"', 'location="me" expr="_event.data.thread_id"'
    )
    published, violations = ran(tmp_path, server, action)
    assert [sent[0] for sent in published["/got"][:3]] == [0, 0, 0]
    assert violations == []


STOPPED = (
    HEAD.format("Server")
    + """
<ros_action_server name="act" action_name="/do" type="t/Do"/>
<ros_topic_subscriber topic="/stop" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/freed" type="std_msgs/Int32"/>
<ros_action_thread name="act" n_threads="2" initial="ready">
  <datamodel><data id="goal" type="int64"/><data id="me" type="int64"/></datamodel>
  <state id="ready"><ros_action_handle_thread_start name="act" target="busy">
    <assign location="goal" expr="_event.goal_id"/><assign location="me" expr="_event.thread_id"/>
  </ros_action_handle_thread_start></state>
  <state id="busy"><ros_topic_callback name="/stop" cond="_msg.data &gt; 5" target="ready">
    <ros_action_succeed name="act" goal_id="goal"><field name="n" expr="_msg.data + me"/></ros_action_succeed>
  </ros_topic_callback></state>
</ros_action_thread>
<datamodel><data id="next" type="int64" expr="0"/></datamodel>
<state id="idle">
  <ros_action_handle_goal name="act">
    <ros_action_accept_goal name="act" goal_id="_event.goal_id"/>
    <ros_action_start_thread name="act" goal_id="_event.goal_id" thread_id="next"/>
    <assign location="next" expr="1 - next"/>
  </ros_action_handle_goal>
  <ros_topic_callback name="/stop">
    <ros_topic_publish name="/freed"><field name="data" expr="_msg.data"/></ros_topic_publish>
  </ros_topic_callback>
</state></scxml>"""
)
STOPPING = (
    HEAD.format("Client")
    + """
<ros_action_client name="act" action_name="/do" type="t/Do"/>
<ros_topic_publisher topic="/stop" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/got" type="std_msgs/Int32MultiArray"/>
<datamodel><data id="sent" type="int32" expr="0"/></datamodel>
<state id="idle">
  <onentry><ros_action_send_goal name="act"/><assign location="sent" expr="sent + 1"/></onentry>
  <ros_action_handle_goal_response name="act" accept="next" reject="idle"/>
</state>
<state id="next">
  <transition cond="sent &lt; 2" target="idle"/><transition after="100ms" target="soon"/>
</state>
<state id="soon">
  <onentry><ros_topic_publish name="/stop"><field name="data" expr="5"/></ros_topic_publish></onentry>
  <transition after="100ms" target="now"/>
</state>
<state id="now">
  <onentry><ros_topic_publish name="/stop"><field name="data" expr="20"/></ros_topic_publish></onentry>
  <ros_action_handle_success_result name="act">
    <ros_topic_publish name="/got"><field name="data" expr="[_wrapped_result.result.n]"/></ros_topic_publish>
  </ros_action_handle_success_result>
  <transition after="1500ms" target="later"/>
</state>
<state id="later">
  <onentry><ros_topic_publish name="/stop"><field name="data" expr="5"/></ros_topic_publish></onentry>
</state></scxml>"""
)


def test_a_message_reaches_the_machine_and_each_of_its_threads(tmp_path: Path) -> None:
    published, violations = ran(tmp_path, STOPPED, client=STOPPING)
    assert published["/freed"] == [5, 20]
    assert sorted(published["/got"]) == [[20], [21]]
    assert violations == []


def test_a_message_that_only_threads_take_reaches_them(tmp_path: Path) -> None:
    begin, end = STOPPED.rindex("  <ros_topic_callback"), STOPPED.rindex("</state></scxml>")
    published, violations = ran(tmp_path, STOPPED[:begin] + STOPPED[end:], client=STOPPING)
    assert sorted(published["/got"]) == [[20], [21]]
    assert violations == []


@pytest.mark.parametrize(
    "change", [("&gt; 5", "&gt; 50"), ("&gt; 5", "&gt; 4"), ("_msg.data + me", "_msg.data")]
)
def test_a_thread_that_takes_a_message_otherwise_than_its_model_is_found(
    change: tuple[str, str], tmp_path: Path
) -> None:
    _, violations = ran(
        tmp_path, STOPPED, client=STOPPING, instead=STOPPED.replace(*change), seconds=3.0
    )
    assert {item.node for item in violations} == {"Server"}


DELAYING = (
    HEAD.format("Server")
    + """
<ros_action_server name="act" action_name="/do" type="t/Do"/>
<ros_topic_publisher topic="/freed" type="std_msgs/Int32"/>
<ros_action_thread name="act" n_threads="2" initial="ready">
  <datamodel><data id="goal" type="int64"/><data id="me" type="int64"/></datamodel>
  <state id="ready"><ros_action_handle_thread_start name="act" target="busy">
    <assign location="goal" expr="_action.goal_id"/><assign location="me" expr="_event.thread_id"/>
  </ros_action_handle_thread_start></state>
  <state id="busy">{how}</state>
  <state id="done"><transition target="ready">
    <ros_action_succeed name="act" goal_id="goal"><field name="n" expr="me"/></ros_action_succeed>
    <ros_action_thread_free name="act"/>
  </transition></state>
</ros_action_thread>
<datamodel><data id="next" type="int64" expr="0"/></datamodel>
<state id="idle">
  <ros_action_handle_goal name="act">
    <ros_action_accept_goal name="act" goal_id="_action.goal_id"/>
    <ros_action_start_thread name="act" goal_id="_action.goal_id" thread_id="next"/>
    <assign location="next" expr="1 - next"/>
  </ros_action_handle_goal>
  {own}
</state></scxml>"""
)
TWO_GOALS = (
    HEAD.format("Client")
    + """
<ros_action_client name="act" action_name="do" type="t/Do"/>
<ros_topic_publisher topic="/got" type="std_msgs/Int32MultiArray"/>
<state id="idle"><onentry>
  <ros_action_send_goal name="act"/><ros_action_send_goal name="act"/></onentry>
  <ros_action_handle_success_result name="act"><ros_topic_publish name="/got">
    <field name="data" expr="[_wrapped_result.result.n]"/></ros_topic_publish>
  </ros_action_handle_success_result>
</state></scxml>"""
)
AFTER = '<transition after="{}" target="done"/>'
SENT = '<onentry><send event="over" delay="{}"/></onentry><transition event="over" target="done"/>'
CANCELLED = """<onentry><send event="over" delay="{}" id="s"/>
  <if cond="me == 1"><cancel sendid="s"/><send event="over" delay="{}"/></if></onentry>
  <transition event="over" target="done"/>"""


@pytest.mark.parametrize("how", [AFTER, SENT, CANCELLED], ids=["after", "send", "cancel"])
@pytest.mark.parametrize("own", ["", AFTER.replace("done", "idle").format("70ms")], ids=["", "own"])
def test_each_thread_has_delays_of_its_own(tmp_path: Path, how: str, own: str) -> None:
    text = DELAYING.format(how=how.replace("{}", "300ms"), own=own)
    published, violations = ran(tmp_path, text, client=TWO_GOALS)
    assert sorted(published["/got"]) == [[0], [1]], "one thread's delay is another's"
    assert violations == []


FREE = '<ros_action_thread_free name="act"/>'
MINE = '<send event="mine"/>'
SAYS = '<ros_topic_publish name="/freed"><field name="data" expr="{}"/></ros_topic_publish>'


@pytest.mark.parametrize("order", [(FREE, MINE), (MINE, FREE), (MINE, FREE, MINE)])
def test_what_a_thread_sends_itself_comes_in_order_with_what_it_tells_its_machine(
    order: tuple[str, ...], tmp_path: Path
) -> None:
    take = f'<transition event="mine">{SAYS.format(99)}</transition></state>'
    server = SERVER.replace("{root}", "_event").replace(FREE, "".join(order))
    server = server.replace(
        "</ros_action_handle_thread_start></state>", f"</ros_action_handle_thread_start>{take}"
    )
    published, violations = ran(tmp_path, server)
    assert published["/freed"][: len(order)] == [2 if item == FREE else 99 for item in order]
    assert violations == []


START = '<ros_action_start_thread name="act"'


def test_what_a_machine_sends_itself_comes_in_order_with_the_start_of_a_thread(
    tmp_path: Path,
) -> None:
    begins = f'target="done">{SAYS.format(98)}'
    for number, (before, after) in enumerate((("", MINE), (MINE, ""))):
        server = SERVER.replace("{root}", "_event").replace('target="done">', begins, 1)
        server = server.replace(START, f"{before}{START}", 1)
        server = server.replace("</ros_action_start_thread>", f"</ros_action_start_thread>{after}")
        taken = f'<transition event="mine">{SAYS.format(99)}</transition></state></scxml>'
        server = server.replace("</state></scxml>", taken)
        folder = tmp_path / str(number)
        folder.mkdir()
        published, violations = ran(folder, server)
        said = [item for item in published["/freed"] if item > 90][:2]
        assert said == ([98, 99] if after else [99, 98])
        assert violations == []
