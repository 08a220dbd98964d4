"""Feedback that takes longer than the latency bound: a node that reports when it takes it is judged as of then."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome
from transports.simulated import Conditions, Lost, SimulatedTransport, SimulatedWorld

CLIENT = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Client" initial="on">
  <datamodel><data id="left" type="int32" expr="0"/></datamodel>
  <ros_action_client name="act" action_name="/do" type="t/Do"/>
  <ros_topic_publisher topic="/left" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="2"/>
  <ros_time_rate name="goals" rate_hz="0.4"/>
  <state id="on">
    <ros_rate_callback name="goals"><ros_action_send_goal name="act"/></ros_rate_callback>
    <ros_rate_callback name="beat">
      <ros_topic_publish name="/left"><field name="data" expr="left"/></ros_topic_publish>
    </ros_rate_callback>
    <ros_action_handle_goal_response name="act" accept="on" reject="on"/>
    <ros_action_handle_feedback name="act"><assign location="left" expr="{left}"/></ros_action_handle_feedback>
    <ros_action_handle_success_result name="act"/>
  </state>
</scxml>
"""
SERVER = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Server" initial="free">
  <datamodel><data id="goal" type="int64" expr="0"/><data id="left" type="int32" expr="0"/></datamodel>
  <ros_action_server name="act" action_name="/do" type="t/Do"/>
  <ros_time_rate name="step" rate_hz="3"/>
  <state id="free">
    <ros_action_handle_goal name="act" target="busy">
      <assign location="goal" expr="_action.goal_id"/>
      <assign location="left" expr="4"/>
      <ros_action_accept_goal name="act" goal_id="goal"/>
      <ros_action_feedback name="act" goal_id="goal"><field name="left" expr="5"/></ros_action_feedback>
    </ros_action_handle_goal>
  </state>
  <state id="busy">
    <ros_rate_callback name="step" cond="left &gt; 0">
      <ros_action_feedback name="act" goal_id="goal"><field name="left" expr="left"/></ros_action_feedback>
      <assign location="left" expr="left - 1"/>
    </ros_rate_callback>
    <ros_rate_callback name="step" target="free"><ros_action_succeed name="act" goal_id="goal"/></ros_rate_callback>
  </state>
</scxml>
"""
FIRST = Lost("Server", "/do/_action/feedback", 2, "Client")


def system_of(folder: Path, left: str) -> System:
    path = folder / "interfaces/t/action/Do.action"
    path.parent.mkdir(parents=True)
    path.write_text("---\n---\nint32 left\n")
    (folder / "Client.scxml").write_text(CLIENT.format(left=left))
    (folder / "Server.scxml").write_text(SERVER)
    log = DiagnosticLog()
    system = load([folder], log)
    assert system is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    return system


def accused(
    folder: Path, conditions: Conditions, seed: int, left: str = "_feedback.left"
) -> set[str]:
    """The nodes that are violated in 8 s; ``left``: what the client that runs takes of its feedback."""
    system = system_of(folder / f"model {seed}", "_feedback.left")
    program = compile_system(system_of(folder / f"run {seed}", left))
    world = SimulatedWorld(seed, conditions)
    monitor = ModelMonitor(system.nodes, system.library, synchronised=False)
    said = []
    listener = SimulatedTransport(world, "listener")
    listener.tap([], lambda observation: said.extend(monitor.feed(observation)))
    listener.every(0.02, lambda: said.extend(monitor.advance(world.now_ns)))
    for node, oracle in monitor.oracles.items():
        monitor.node_found(node, world.now_ns)
        oracle.reported(
            0, world.now_ns, world.now_ns
        )  # asked as it starts: it reports what it takes
    SimulatedRun(program, world).run(8.0)
    world.close()
    assert any(oracle.inputs for oracle in monitor.oracles.values())
    return {verdict.node for verdict in said if verdict.outcome is Outcome.VIOLATED}


@pytest.mark.parametrize(
    "conditions",
    [Conditions(delay_s=(0.0, 0.6)), Conditions(delay_s=(0.3, 0.3)), Conditions(lost=(FIRST,))],
    ids=["slow", "later than the bound", "lost"],
)
def test_feedback_that_comes_late_or_never_accuses_nobody(
    conditions: Conditions, tmp_path: Path
) -> None:
    assert not [seed for seed in range(4) if accused(tmp_path, conditions, seed)]


def test_feedback_that_is_taken_for_something_else_is_found(tmp_path: Path) -> None:
    left = "_feedback.left + 1"
    assert accused(tmp_path, Conditions(delay_s=(0.0, 0.6)), 1, left) == {"Client"}
