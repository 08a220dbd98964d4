"""A goal whose server dies, or does not answer: its client takes that once, and is judged by it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

import m2c
from m2c.check import check_system
from m2c.cli import main
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

LATE = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.15))
HANDLER = """<ros_action_handle_error name="act" target="over">
    <ros_topic_publish name="/over"><field name="data" expr="10 + _event.goal_id"/></ros_topic_publish>
  </ros_action_handle_error>"""
CLIENT = """<{root} xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Client" initial="resting">
<ros_action_client name="act" action_name="/do" type="t/Do"/>
<ros_topic_publisher topic="/over" type="std_msgs/Int32"/>
<state id="resting"><transition after="0.5s" target="asking"/></state>
<state id="asking"><onentry>
    <ros_action_send_goal name="act"><field name="n" expr="3"/></ros_action_send_goal>
  </onentry>
  <ros_action_handle_goal_response name="act" accept="waiting" reject="refused"/>
  {asking}
</state>
<state id="waiting">
  <ros_action_handle_success_result name="act" target="over">
    <ros_topic_publish name="/over"><field name="data" expr="1"/></ros_topic_publish>
  </ros_action_handle_success_result>
  <ros_action_handle_aborted_result name="act" target="over"/>
  {waiting}
</state>
<state id="refused"><onentry>
  <ros_topic_publish name="/over"><field name="data" expr="-1"/></ros_topic_publish>
</onentry><transition after="0.5s" target="asking"/></state>
<state id="over"><transition after="1s" target="asking"/></state>
</{root}>"""
SERVER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Server" initial="free">
<datamodel><data id="goal" type="int64" expr="0"/></datamodel>
<ros_action_server name="act" action_name="/do" type="t/Do"/>
<state id="free"><ros_action_handle_goal name="act" target="busy">
  <assign location="goal" expr="_action.goal_id"/>{accept}
</ros_action_handle_goal></state>
<state id="busy"><transition after="{after}" target="free">
  <ros_action_succeed name="act" goal_id="goal"/>
</transition></state>
</scxml>"""
ACCEPT = '<ros_action_accept_goal name="act" goal_id="_action.goal_id"/>'


def system_of(
    folder: Path,
    *,
    root: str = "scxml",
    asking: str = HANDLER,
    waiting: str = HANDLER,
    server: str = SERVER.format(accept=ACCEPT, after="2s"),
) -> System:
    (folder / "interfaces/t/action").mkdir(parents=True, exist_ok=True)
    (folder / "interfaces/t/action/Do.action").write_text("int32 n\n---\n---\n")
    (folder / f"Client.{root}").write_text(CLIENT.format(root=root, asking=asking, waiting=waiting))
    (folder / "Server.scxml").write_text(server)
    log = DiagnosticLog()
    system = load([folder / f"Client.{root}", folder / "Server.scxml"], log)
    assert system is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    return system


class Run:
    """A run of ``system``, judged by ``expected``; ``dies`` is when its server does (s)."""

    def __init__(
        self, system: System, dies: float | None, *, expected: System | None = None, seed: int = 0
    ) -> None:
        judged = expected or system
        world = SimulatedWorld(seed, LATE)
        self.monitor = ModelMonitor(judged.nodes, judged.library)
        self.verdicts: list[Verdict] = []
        self.over: list[int] = []
        listener = SimulatedTransport(world, "listener")
        for name in self.monitor.oracles:
            self.monitor.node_started(name, world.now_ns)
        listener.tap([], self._hear)
        listener.every(0.02, lambda: self.verdicts.extend(self.monitor.advance(world.now_ns)))
        simulated = m2c.simulate(system, world)
        if dies is not None:
            simulated.run(dies)
            world.crash("Server")
        simulated.run(12.0)
        world.run_for(2.0)
        world.close()

    def _hear(self, observation: Observation) -> None:
        if observation.channel == "/over" and observation.kind is ObservationKind.MESSAGE:
            self.over.append(observation.data["data"])
        self.verdicts.extend(self.monitor.feed(observation))

    @property
    def client(self) -> Outcome:
        return self.monitor.oracles["Client"].outcome


@pytest.mark.parametrize("root", ["scxml", "ascxml"])
@pytest.mark.parametrize("seed", range(6))
def test_a_goal_whose_server_dies_fails_once(tmp_path: Path, root: str, seed: int) -> None:
    run = Run(system_of(tmp_path, root=root), 1.2 + 0.1 * seed, seed=seed)
    assert run.over[0] == 11  # the first goal was accepted, and is over
    assert run.over[1:] == list(range(12, 12 + len(run.over) - 1))  # nobody serves the others
    assert len(run.over) > 3
    assert run.client is Outcome.CONFORMING
    assert not [v for v in run.verdicts if v.machine == "Client"]


def test_a_goal_that_is_not_answered_fails(tmp_path: Path) -> None:
    silent = SERVER.format(accept="<log label='no'/>", after="90s").replace(
        '<ros_action_succeed name="act" goal_id="goal"/>', ""
    )
    run = Run(system_of(tmp_path, server=silent), None)
    assert run.over[:1] == [11]
    assert run.client is Outcome.CONFORMING


def test_without_a_handler_a_failed_goal_counts_as_rejected(tmp_path: Path) -> None:
    run = Run(system_of(tmp_path, asking="", waiting=""), 1.5)
    assert run.over == []  # it was accepted: it waits for ever
    assert run.client is Outcome.CONFORMING
    run = Run(system_of(tmp_path, asking="", waiting=""), 0.2)
    assert set(run.over) == {-1}
    assert run.client is Outcome.CONFORMING


def test_who_does_not_take_a_failed_goal_as_its_model_does_is_violated(tmp_path: Path) -> None:
    expected = system_of(tmp_path)
    for waiting in (
        HANDLER.replace("10 +", "20 +"),
        '<ros_action_handle_error name="act" target="over"/>',
        HANDLER.replace('target="over"', 'target="refused"'),
    ):
        other = system_of(tmp_path, waiting=waiting)
        run = Run(other, 1.5, expected=expected)
        assert run.client is Outcome.VIOLATED, waiting
    # one that does nothing at all from then on may be lost; here nobody asks its node
    run = Run(system_of(tmp_path, waiting=""), 1.5, expected=expected)
    assert run.client is Outcome.INCONCLUSIVE
    assert "expected" in run.monitor.oracles["Client"].verdict().reason


def test_who_has_no_handler_must_not_go_on(tmp_path: Path) -> None:
    expected = system_of(tmp_path, asking="", waiting="")
    run = Run(system_of(tmp_path), 1.5, expected=expected)
    assert run.client is Outcome.VIOLATED


def test_the_reason_names_the_failed_goal(tmp_path: Path) -> None:
    expected = system_of(tmp_path)
    run = Run(system_of(tmp_path, waiting=HANDLER.replace("10 +", "20 +")), 1.5, expected=expected)
    first = next(v for v in run.verdicts if v.outcome is Outcome.VIOLATED)
    assert first.explanation is not None
    assert any("failed goal" in item.text for item in first.explanation.evidence)


@pytest.mark.parametrize(
    ("asking", "waiting", "states"),
    [
        (HANDLER, HANDLER, []),
        ("", "", ["waiting"]),
        ("", HANDLER, ["asking"]),
        (HANDLER, "", ["waiting"]),
        ("", '<transition after="5s" target="over"/>', []),
    ],
)
def test_the_check_warns_of_states_that_would_wait_for_ever(
    tmp_path: Path, asking: str, waiting: str, states: list[str]
) -> None:
    log = DiagnosticLog()
    check_system(system_of(tmp_path, asking=asking, waiting=waiting), log)
    found = [d.message for d in log.diagnostics if d.rule == "goal-failure-unhandled"]
    assert [re.findall(r"state `(\w+)`", message)[0] for message in found] == states


def test_it_is_drawn_and_converted(tmp_path: Path) -> None:
    system_of(tmp_path)
    model, picture = str(tmp_path / "Client.scxml"), tmp_path / "client.mmd"
    drawn = CliRunner().invoke(main, ["draw", model, "-o", str(picture)])
    assert drawn.exit_code == 0, drawn.output
    assert "goal failed" in picture.read_text()
    for dialect in ("ascxml", "hl-scxml"):
        target = tmp_path / dialect
        interfaces = str(tmp_path / "interfaces")
        done = CliRunner().invoke(
            main,
            ["convert", model, "-o", str(target), "--to", dialect, "--interfaces", interfaces],
        )
        assert done.exit_code == 0, done.output
        (written,) = target.rglob("Client.*")
        assert "<ros_action_handle_error" in written.read_text()
