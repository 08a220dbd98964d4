"""A goal that its client cancels before it is accepted, and a monitor that comes later: the request leaves then."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome
from transports.simulated import SimulatedTransport, SimulatedWorld

CLIENT = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Client" initial="on">
  <datamodel><data id="sent" type="int64" expr="0"/></datamodel>
  <ros_action_client name="act" action_name="/do" type="t/Do"/>
  <ros_topic_publisher topic="/over" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="0.5"/>
  <state id="on">
    <ros_rate_callback name="beat">
      <ros_action_send_goal name="act"><field name="n" expr="3"/></ros_action_send_goal>
      <assign location="sent" expr="sent + 1"/>
      {cancel}
    </ros_rate_callback>
    <ros_action_handle_canceled_result name="act">
      <ros_topic_publish name="/over"><field name="data" expr="{code}"/></ros_topic_publish>
    </ros_action_handle_canceled_result>
  </state>
</scxml>
"""
SERVER = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Server" initial="free">
  <datamodel><data id="goal" type="int64" expr="0"/></datamodel>
  <ros_action_server name="act" action_name="/do" type="t/Do"/>
  <state id="free">
    <ros_action_handle_goal name="act" target="asked">
      <assign location="goal" expr="_action.goal_id"/>
    </ros_action_handle_goal>
  </state>
  <state id="asked"><transition after="0.8s" target="busy">
    <ros_action_accept_goal name="act" goal_id="goal"/>
  </transition></state>
  <state id="busy"><ros_action_handle_cancel name="act" target="free">
    <ros_action_canceled name="act" goal_id="goal"/>
  </ros_action_handle_cancel></state>
</scxml>
"""
CANCELS = {
    "the goal of that number": '<ros_action_send_cancel name="act" goal_id="sent"/>',
    "the last goal": '<ros_action_send_cancel name="act"/>',
}


def system_of(folder: Path, cancel: str, code: int, server: str = SERVER) -> System:
    path = folder / "interfaces/t/action/Do.action"
    path.parent.mkdir(parents=True)
    path.write_text("int32 n\n---\n---\n")
    (folder / "Client.scxml").write_text(CLIENT.format(cancel=cancel, code=code))
    (folder / "Server.scxml").write_text(server)
    log = DiagnosticLog()
    system = load([folder], log)
    assert system is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    return system


def accused(
    folder: Path, cancel: str, joins_s: float, code: int = 1, server: str = SERVER
) -> set[str]:
    """The nodes that a monitor says are violated which joins after ``joins_s``; ``code``: what runs publishes."""
    system = system_of(folder / "model", cancel, 1, server)
    program = compile_system(system_of(folder / "run", cancel, code, server))
    world = SimulatedWorld(seed=1)
    monitor = ModelMonitor(system.nodes, system.library, synchronised=False)
    run = SimulatedRun(program, world)
    run.run(joins_s)
    said = []
    listener = SimulatedTransport(world, "listener")
    listener.tap([], lambda observation: said.extend(monitor.feed(observation)))
    listener.every(0.02, lambda: said.extend(monitor.advance(world.now_ns)))
    for node in monitor.oracles:
        monitor.node_found(node, world.now_ns)
    run.run(20.0)
    world.close()
    return {verdict.node for verdict in said if verdict.outcome is Outcome.VIOLATED}


@pytest.mark.parametrize("cancel", CANCELS.values(), ids=CANCELS)
@pytest.mark.parametrize("joins_s", [3.4, 4.4], ids=["before it is sent", "before it is accepted"])
def test_who_joins_accuses_nobody(tmp_path: Path, cancel: str, joins_s: float) -> None:
    assert accused(tmp_path, cancel, joins_s) == set()


@pytest.mark.parametrize("cancel", CANCELS.values(), ids=CANCELS)
def test_who_joins_finds_a_fault_after_it(tmp_path: Path, cancel: str) -> None:
    assert accused(tmp_path, cancel, 4.4, code=2) == {"Client"}


def test_a_goal_that_was_seen_to_be_accepted_runs_whatever_its_server_calls_it(
    tmp_path: Path,
) -> None:
    """The server counts its goals, and the monitor does not know how many there were."""
    server = SERVER.replace('expr="_action.goal_id"', 'expr="goal + 1"')
    cancel = CANCELS["the last goal"]
    assert accused(tmp_path, cancel, 3.4, server=server) == set()
