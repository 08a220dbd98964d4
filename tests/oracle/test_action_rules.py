"""What goals may do, at the server and at the oracle: both hear the same random requests and agree."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.runtime.messages import message_class
from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome
from transports.actions import CancelRequest, GoalId, GoalInfo, Time, parts_of, rules, server
from transports.actions.rules import Act, CancelScope, Phase
from transports.interface import Action, CallResult, Topic
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

ENDS = ("succeed", "aborted", "canceled")
HEAD = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Server" initial="idle">
<ros_action_server name="act" action_name="/do" type="t/Do"/>
<ros_topic_subscriber topic="/command" type="std_msgs/Int32MultiArray" name="command"/>
<ros_topic_publisher topic="/told" type="std_msgs/Int32" name="told"/>
<datamodel><data id="mode" type="int32" expr="0"/></datamodel>"""


def end(how: str, goal: str, value: str) -> str:
    return f'<ros_action_{how} name="act" goal_id="{goal}"><field name="n" expr="{value}"/></ros_action_{how}>'


SERVER = f"""{HEAD}<state id="idle">
<ros_action_handle_goal name="act" cond="_goal.n &gt; 0">
  <if cond="_goal.n == 1"><ros_action_reject_goal name="act" goal_id="_event.goal_id"/>
  <elseif cond="_goal.n &gt; 2"/><ros_action_accept_goal name="act" goal_id="_event.goal_id"/>
    <if cond="_goal.n == 3">{end("succeed", "_event.goal_id", "7")}</if>
  </if>
</ros_action_handle_goal>
<ros_action_handle_cancel name="act">
  <ros_topic_publish name="told"><field name="data" expr="_event.goal_id"/></ros_topic_publish>
  <if cond="mode == 1">{end("canceled", "_event.goal_id", "1")}
  <elseif cond="mode == 2"/>{end("canceled", "_event.goal_id + 1", "2")}
  <elseif cond="mode == 3"/>{end("succeed", "_event.goal_id - 1", "3")}</if>
</ros_action_handle_cancel>
<ros_topic_callback name="command">
  <if cond="_msg.data[0] == 0"><assign location="mode" expr="_msg.data[1]"/>
  <elseif cond="_msg.data[0] == 1"/><ros_action_accept_goal name="act" goal_id="_msg.data[1]"/>
  <elseif cond="_msg.data[0] == 2"/><ros_action_reject_goal name="act" goal_id="_msg.data[1]"/>
  <elseif cond="_msg.data[0] == 3"/>
    <ros_action_feedback name="act" goal_id="_msg.data[1]"><field name="n" expr="5"/></ros_action_feedback>
  <elseif cond="_msg.data[0] == 4"/>{end("succeed", "_msg.data[1]", "_msg.data[1]")}
  <elseif cond="_msg.data[0] == 5"/>{end("aborted", "_msg.data[1]", "8")}
  <elseif cond="_msg.data[0] == 6"/>{end("canceled", "_msg.data[1]", "9")}</if>
</ros_topic_callback>
</state></scxml>"""
ACTION = "int32 n\n---\nint32 n\n---\nint32 n\n"
ACCEPTED = 4
"""A goal that is accepted at once, and goes on."""


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> tuple[System, Program]:
    """The server, and its code."""
    folder = tmp_path_factory.mktemp("served")
    path = folder / "interfaces" / "t" / "action" / "Do.action"
    path.parent.mkdir(parents=True)
    path.write_text(ACTION)
    (folder / "Server.scxml").write_text(SERVER)
    log = DiagnosticLog()
    system = load([folder], log)
    assert system is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    return system, compile_system(system)


class Asking:
    """A client that sends whatever requests it likes, and the monitor that watches the server."""

    def __init__(self, served: tuple[System, Program], seed: int, joins_s: float = 0.0) -> None:
        system, program = served
        conditions = Conditions(delay_s=(0.0, 0.004), tap_delay_s=(0.0, 0.01))
        self.world = world = SimulatedWorld(seed, conditions)
        self._started_ns = world.now_ns
        synchronised = not joins_s
        self.monitor = ModelMonitor(system.nodes, system.library, synchronised=synchronised)
        self.said: list[Any] = []
        if joins_s:
            world.schedule(round(joins_s * 1e9), self._listen, None)
        else:
            for node in self.monitor.oracles:
                self.monitor.node_started(node, world.now_ns)
            self._listen(None)
        kind = system.library.action("t/Do")
        goal, feedback, result = map(message_class, (kind.goal, kind.feedback, kind.result))
        self.goal_class = goal
        self.parts = parts = parts_of(Action("/do", "t/action/Do", goal, feedback, result))
        self.node = node = SimulatedTransport(world, "client")
        self._send, self._cancel, self._result = map(
            node.client, (parts.send_goal, parts.cancel_goal, parts.get_result)
        )
        message = system.library.message("std_msgs/Int32MultiArray")
        assert message is not None
        self._command_class = message_class(message)
        topic = Topic("/command", "std_msgs/msg/Int32MultiArray", self._command_class)
        self._command = node.publisher(topic)
        self.answers: list[CallResult] = []
        self.stamps: dict[int, Time] = {}
        self.newest = 1
        node.announce()
        self.run = SimulatedRun(program, world)

    def _listen(self, _: object) -> None:
        listener = SimulatedTransport(self.world, "listener")
        listener.tap([], lambda seen: self.said.extend(self.monitor.feed(seen)))
        listener.every(0.02, lambda: self.said.extend(self.monitor.advance(self.world.now_ns)))
        if self.world.now_ns > self._started_ns:
            for node in self.monitor.oracles:
                self.monitor.node_found(node, self.world.now_ns)

    def goal(self, number: int, order: int) -> None:
        """Send a goal of which ``number`` is the id."""

        def answered(result: CallResult) -> None:
            if result.response is not None and result.response.accepted:
                self.stamps[number] = result.response.stamp

        request = self.parts.send_goal.request(identified(number), self.goal_class(n=order))
        self._send.call(request, answered, 5.0)

    def cancel(self, number: int, stamp: Time) -> None:
        """Ask to cancel; 0: no id."""
        info = GoalInfo(identified(number), stamp)
        self._cancel.call(CancelRequest(info), self.answers.append, 5.0)

    def result(self, number: int) -> None:
        """Ask for a result."""
        request = self.parts.get_result.request(identified(number))
        self._result.call(request, self.answers.append, 30.0)

    def command(self, what: int, argument: int) -> None:
        """Have the server do something with a goal."""
        self._command.publish(self._command_class(data=[what, argument]))

    def expect_conforming(self) -> None:
        """Nothing was said against the server, and all that it did is explained."""
        violations = [item.reason for item in self.said if item.outcome is Outcome.VIOLATED]
        assert violations == []
        (oracle,) = self.monitor.oracles.values()
        assert oracle.outcome is Outcome.CONFORMING


def identified(number: int) -> GoalId:
    return GoalId([0] * 15 + [number])


def some_stamp(asking: Asking, draw: Random) -> Time:
    """None, that of a goal, or one beside it."""
    if not asking.stamps or draw.random() < 0.4:
        return Time()
    stamp = asking.stamps[draw.choice(list(asking.stamps))]
    return Time(stamp.sec, max(0, stamp.nanosec + draw.choice((-1, 0, 0, 1))))


def act_at_random(asking: Asking, draw: Random, repeats: bool) -> None:
    """One request, or one command; ``repeats``: ids of goals are used again."""
    number = (
        draw.randint(1, 9) if repeats else draw.randint(max(1, asking.newest - 4), asking.newest)
    )
    match draw.randint(0, 7):
        case 0 | 1 | 2:
            asking.newest += 1
            asking.goal(number if repeats else asking.newest, draw.choice((0, 1, 2, 3, 4, 4, 4)))
        case 3:
            asking.cancel(draw.choice((0, number)), some_stamp(asking, draw))
        case 4:
            asking.result(number)
        case 5:
            asking.command(0, draw.randint(0, 3))
        case _:
            asking.command(draw.randint(1, 6), draw.randint(1, 14))


@pytest.mark.parametrize("block", range(6))
def test_server_and_oracle_agree_whatever_is_asked(
    served: tuple[System, Program], block: int
) -> None:
    accepted = 0
    for seed in range(block * 5, block * 5 + 5):
        asking = asked_at_random(served, seed)
        asking.expect_conforming()
        accepted += len(asking.stamps)
    assert accepted > 20


@pytest.mark.parametrize("joins_s", [0.35, 0.7, 1.1])
def test_a_monitor_that_joins_while_goals_run_accuses_nobody(
    served: tuple[System, Program], joins_s: float
) -> None:
    for seed in range(2):
        asking = asked_at_random(served, seed, joins_s)
        violations = [item.reason for item in asking.said if item.outcome is Outcome.VIOLATED]
        assert violations == [], seed


def test_who_joins_takes_the_end_of_an_earlier_goal_for_no_end_of_a_later_one(
    served: tuple[System, Program],
) -> None:
    """Each status message lists the goals that have ended, those of before included."""
    asking = Asking(served, 1, joins_s=1.0)
    later = asking.node.after
    later(0.1, lambda: asking.command(0, 1))
    later(0.2, lambda: asking.goal(1, ACCEPTED))
    later(0.4, lambda: asking.cancel(1, Time()))
    later(0.6, lambda: asking.goal(2, ACCEPTED))
    later(1.5, lambda: asking.cancel(2, Time()))
    later(1.6, lambda: asking.goal(3, ACCEPTED))
    later(2.0, lambda: asking.cancel(3, Time()))
    asking.run.run(3.0)
    asking.world.close()
    assert [item.reason for item in asking.said if item.outcome is Outcome.VIOLATED] == []


def asked_at_random(served: tuple[System, Program], seed: int, joins_s: float = 0.0) -> Asking:
    """A run of sixty requests and commands."""
    asking, draw = Asking(served, seed, joins_s), Random(seed)
    for place in range(60):
        at_s = 0.1 + place * draw.choice((0.01, 0.03))
        asking.node.after(at_s, lambda: act_at_random(asking, draw, not joins_s))
    asking.run.run(3.0)
    asking.world.close()
    return asking


def test_a_cancel_request_up_to_a_stamp_leaves_later_goals_alone(
    served: tuple[System, Program], monkeypatch: pytest.MonkeyPatch
) -> None:
    def ran() -> Asking:
        asking = Asking(served, 1)
        asking.node.after(0.1, lambda: asking.command(0, 1))
        for number in (1, 2, 3):
            asking.node.after(
                0.1 + number / 10, lambda number=number: asking.goal(number, ACCEPTED)
            )
        asking.node.after(0.6, lambda: asking.cancel(0, asking.stamps[2]))
        asking.run.run(2.0)
        asking.world.close()
        return asking

    asking = ran()
    (answer,) = asking.answers
    assert [info.goal_id.uuid[-1] for info in answer.response.goals_canceling] == [1, 2]
    asking.expect_conforming()

    monkeypatch.setattr(server._Goal, "is_in", lambda goal, scope: goal.phase is Phase.RUNNING)
    violations = [item for item in ran().said if item.outcome is Outcome.VIOLATED]
    assert violations, "a server that cancels all goals is not found"


@pytest.mark.parametrize(("ended", "codes"), [(20, {4}), (64, {4}), (70, {4, None})])
def test_late_results_are_kept_as_long_by_the_oracle_as_by_the_server(
    served: tuple[System, Program], ended: int, codes: set[int | None]
) -> None:
    asking = Asking(served, 1)
    for number in range(1, ended + 2):
        asking.node.after(0.1 + number * 0.02, lambda number=number: asking.goal(number, 3))
    for number in range(1, ended + 1):
        asking.node.after(3.0 + number * 0.02, lambda number=number: asking.result(number))
    asking.run.run(6.0)
    asking.expect_conforming()
    assert len(asking.answers) == ended
    given = {answer.response and answer.response.status for answer in asking.answers}
    assert given == codes
    asking.world.close()


def test_a_second_goal_of_one_id_is_rejected_and_nobody_hears_of_it(
    served: tuple[System, Program],
) -> None:
    asking = Asking(served, 1)
    asking.node.after(0.1, lambda: asking.goal(1, ACCEPTED))
    asking.node.after(0.3, lambda: asking.goal(1, ACCEPTED))
    asking.node.after(0.5, lambda: asking.command(4, 1))
    asking.node.after(0.7, lambda: asking.goal(1, ACCEPTED))
    asking.run.run(2.0)
    asking.expect_conforming()
    asking.world.close()


def test_what_a_phase_does_not_allow_leaves_the_goal_as_it_was(
    served: tuple[System, Program],
) -> None:
    asking = Asking(served, 1)
    asking.node.after(0.1, lambda: asking.goal(1, ACCEPTED))
    for place, what in enumerate((2, 6, 1, 3, 4, 4)):  # reject, canceled: not now; then a success
        asking.node.after(0.3 + place / 10, lambda what=what: asking.command(what, 1))
    asking.node.after(1.2, lambda: asking.result(1))
    asking.run.run(2.0)
    asking.expect_conforming()
    (answer,) = asking.answers
    assert answer.response.status == 4
    asking.world.close()


# --- the rules themselves -------------------------------------------------------------------------

ID, OTHER = "0" * 31 + "1", "0" * 31 + "2"
NONE = "0" * 32


@pytest.mark.parametrize(
    ("goal_id", "stamp", "included"),
    [
        (NONE, (0, 0), [True, True, True]),
        (ID, (0, 0), [True, False, False]),
        (NONE, (5, 5), [True, True, False]),
        (ID, (5, 4), [True, False, False]),
        (OTHER, (5, 4), [False, True, False]),
        (OTHER, (4, 9), [False, True, False]),
        (NONE, (5, 6), [True, True, True]),
        (NONE, (0, 1), [False, False, False]),
    ],
)
def test_which_goals_a_cancel_request_means(
    goal_id: str, stamp: tuple[int, int], included: list[bool]
) -> None:
    scope = CancelScope(goal_id, stamp)
    goals = [(ID, (5, 5)), (OTHER, (5, 5)), ("0" * 31 + "3", (5, 6))]
    found = [scope.includes(goal, Phase.RUNNING, accepted) for goal, accepted in goals]
    assert found == included


@pytest.mark.parametrize(
    ("phase", "code"),
    [
        (Phase.NEW, rules.CANCEL_REJECTED),
        (Phase.RUNNING, rules.CANCEL_ACCEPTED),
        (Phase.CANCELING, rules.CANCEL_ACCEPTED),
        (Phase.ENDED, rules.CANCEL_TERMINATED),
    ],
)
def test_how_a_cancel_request_for_one_goal_is_answered(phase: Phase, code: int) -> None:
    scope = CancelScope(ID, (0, 0))
    assert scope.return_code([(ID, phase)]) == code
    assert scope.return_code([(OTHER, phase)]) == rules.CANCEL_UNKNOWN
    assert CancelScope(NONE, (0, 0)).return_code([]) == rules.CANCEL_ACCEPTED


def test_a_goal_whose_acceptance_is_not_known_may_be_meant_by_a_stamp() -> None:
    assert CancelScope(NONE, (5, 5)).includes(ID, Phase.RUNNING, None) is None
    assert CancelScope(NONE, (0, 0)).includes(ID, Phase.RUNNING, None) is True
    assert CancelScope(ID, (5, 5)).includes(ID, Phase.RUNNING, None) is True
    assert CancelScope(NONE, (5, 5)).includes(ID, Phase.ENDED, None) is False


@pytest.mark.parametrize("phase", [Phase.ENDED, Phase.REJECTED])
def test_nothing_can_be_done_with_a_goal_that_is_over(phase: Phase) -> None:
    assert all(rules.after(phase, act) is None for act in Act)
