"""A node that is started again under its name: what is of one of its lives is not taken for another's."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.oracle.confirmation import Losses, Publishers
from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from moon.verdict import Outcome
from tests.oracle.test_taken_messages import Probe
from transports.interface import Observation, ObservationKind

MS = 1_000_000
START = 1_000_000 * MS
SENT, RECEIVED = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
ANSWERED = ObservationKind.RESPONSE_SENT
MESSAGE = ObservationKind.MESSAGE
SERVER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Server" initial="idle">
<datamodel><data id="order" type="int32" expr="0"/><data id="goal" type="int64" expr="0"/></datamodel>
<ros_action_server name="act" action_name="/do" type="t/Do"/>
<ros_topic_subscriber topic="/end" type="std_msgs/Int32"/>
<state id="idle">
  <ros_action_handle_goal name="act" target="busy"><assign location="order" expr="_goal.order"/>
    <assign location="goal" expr="_action.goal_id"/><ros_action_accept_goal name="act" goal_id="goal"/></ros_action_handle_goal>
</state>
<state id="busy">
  <ros_action_handle_goal name="act" target="busy"><ros_action_reject_goal name="act" goal_id="_action.goal_id"/></ros_action_handle_goal>
  <ros_topic_callback name="/end" target="idle">
    <ros_action_succeed name="act" goal_id="goal"><field name="order" expr="order"/></ros_action_succeed>
  </ros_topic_callback>
</state></scxml>"""


@pytest.fixture
def system(tmp_path: Path) -> System:
    (tmp_path / "interfaces/t/action").mkdir(parents=True)
    (tmp_path / "interfaces/t/action/Do.action").write_text("int32 order\n---\nint32 order\n---\n")
    (tmp_path / "Server.scxml").write_text(SERVER)
    log = DiagnosticLog()
    system = load([tmp_path], log)
    assert system is not None, log.diagnostics
    return system


class Served:
    """The oracle of an action server, whose node numbers all that it reports."""

    def __init__(self, system: System, lives_are_known: bool) -> None:
        (machine,) = system.nodes
        self.oracle = Oracle(
            machine, system.library, "Server", shared=Shared(losses=Losses(possible=False))
        )
        self.oracle.start(START, whole=True)
        self.said: list[Outcome] = []
        self._lives_are_known = lives_are_known
        self._order = 0
        self._now = START

    def see(self, part: str, kind: ObservationKind, data: Any, **more: Any) -> None:
        self._now += 5 * MS
        channel = part if part.startswith("/") else f"/do/_action/{part}"
        if more.setdefault("source", "Server") == "Server":
            more["order"] = self._order
            self._order += 1
        if not self._lives_are_known:
            more.pop("client_life", None)
        seen = Observation(
            stamp_ns=self._now, received_ns=self._now + MS, channel=channel, kind=kind, type_name="", data=data,
            **more,
        )  # fmt: skip
        self.said += [verdict.outcome for verdict in self.oracle.feed(seen)]

    def goal(self, order: int, call: int, life: int) -> None:
        """A goal that the server accepts, and the request for its result."""
        who = {"client": "Client", "client_life": life}
        identity = {"uuid": [order] * 16}
        goal = {"goal_id": identity, "goal": {"order": order}}
        self.see("send_goal", RECEIVED, goal, call=call, **who)
        accepted = {"accepted": True, "stamp": {"sec": 0, "nanosec": 0}}
        self.see("send_goal", ANSWERED, accepted, call=call, **who)
        self.see("get_result", RECEIVED, {"goal_id": identity}, call=call + 1, **who)

    def end(self, order: int) -> None:
        """The goal is told to end, and ends."""
        self.see("/end", MESSAGE, {"data": 1}, source="other")
        self._now += 250 * MS
        entry = {"goal_info": {"goal_id": {"uuid": [order] * 16}}, "status": 4}
        self.see("status", MESSAGE, {"status_list": [entry]})

    def result(self, order: int, call: int, life: int) -> None:
        who = {"client": "Client", "client_life": life}
        data = {"status": 4, "result": {"order": order}}
        self.see("get_result", ANSWERED, data, call=call, **who)

    def later(self) -> list[Outcome]:
        self._now += 3000 * MS
        self.said += [verdict.outcome for verdict in self.oracle.advance(self._now)]
        return [outcome for outcome in self.said if outcome is not Outcome.CONFORMING]


@pytest.mark.parametrize("lives_are_known", [True, False])
@pytest.mark.parametrize("first_first", [True, False])
def test_both_lives_of_a_client_may_wait_for_results_with_the_same_number(
    system: System, lives_are_known: bool, first_first: bool
) -> None:
    """It was killed while its goal ran; the server ends that, and then the goal of its next life."""
    served = Served(system, lives_are_known)
    served.goal(7, 1, life=1)
    served.end(7)
    served.goal(9, 1, life=2)
    if first_first:
        served.result(7, 2, life=1)
    served.end(9)
    served.result(9, 2, life=2)
    if not first_first:
        served.result(7, 2, life=1)
    said = served.later()
    assert Outcome.VIOLATED not in said
    if lives_are_known:
        assert said == []


def test_a_wrong_result_is_found_though_its_client_has_started_again(system: System) -> None:
    served = Served(system, lives_are_known=True)
    served.goal(7, 1, life=1)
    served.end(7)
    served.goal(9, 1, life=2)
    served.result(9, 2, life=1)  # of the other goal
    assert Outcome.VIOLATED in served.later()


# --- messages ---------------------------------------------------------------------------------------


def test_a_message_of_the_next_life_is_not_taken_for_one_of_the_last() -> None:
    """The first life's message with that number was not taken when it ended; its data are others."""
    probe = Probe()
    probe.follow()
    said = probe.published(100, 10, 11, sequence=1, life=0)
    probe.published(50, 300, 301, sequence=0, life=8)
    said += probe.took(1, 320, 330, client_life=8)  # its contents are received later than this
    said += probe.sent(10, 321, 330)
    said += probe.published(5, 310, 340, sequence=1, life=8)
    said += probe.passed(1500)
    assert Outcome.VIOLATED not in said


def test_the_last_messages_of_a_publisher_that_was_killed_need_not_have_been_taken() -> None:
    for is_known in (True, False):
        probe = Probe()
        probe.follow()
        said = probe.published(5, 10, 11, sequence=1)
        probe.oracle.sender_changed("other", 0)
        said += probe.published(50, 100, 101, sequence=0, life=9 if is_known else 0)
        said += probe.passed(5000)
        assert Outcome.VIOLATED not in said


def test_what_the_last_life_reported_may_be_received_after_the_first_of_the_next() -> None:
    rng = random.Random(7)
    for _ in range(50):
        probe = Probe()
        first = [(1, number, 10 + 10 * number) for number in range(8)]
        second = [(2, number, 110 + 10 * number) for number in range(8)]
        late = [first.pop(rng.randrange(4, len(first))) for _ in range(2)]
        said: list[Outcome] = []
        now = 0
        for life, number, at in [*first, second[0], *late, *second[1:]]:
            now = max(now, at) + 1
            fields = {"source": "other", "sequence": number, "life": life}
            said += probe.see(MESSAGE, "/in", {"data": 1}, at, now, **fields)
            said += probe.see(MESSAGE, "/out", {"data": 2}, now + 1, now + 2)
        said += probe.passed(3000)
        assert Outcome.VIOLATED not in said


# --- requests ---------------------------------------------------------------------------------------

ASKED = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Probe" initial="idle">
<ros_service_server service_name="/ask" type="std_srvs/Trigger"/>
<state id="idle"><ros_service_handle_request name="/ask" target="idle">
<ros_service_send_response name="/ask"><field name="success" expr="true"/></ros_service_send_response>
</ros_service_handle_request></state></scxml>"""


class Asked:
    """The oracle of a server, of which both ends of its calls are heard."""

    def __init__(self, tmp_path: Path) -> None:
        (tmp_path / "interfaces/std_srvs/srv").mkdir(parents=True)
        (tmp_path / "interfaces/std_srvs/srv/Trigger.srv").write_text("---\nbool success\n")
        (tmp_path / "Probe.scxml").write_text(ASKED)
        log = DiagnosticLog()
        system = load([tmp_path], log)
        assert system is not None, log.diagnostics
        (machine,) = system.nodes
        self.oracle = Oracle(
            machine, system.library,
            shared=Shared(losses=Losses(possible=False), publishers=Publishers({}, ["Client"])),
        )  # fmt: skip
        self.oracle.start(START, whole=True)
        self._orders = 0

    def see(self, kind: ObservationKind, at: int, call: int, **more: Any) -> list[Outcome]:
        source = "Probe" if kind in (RECEIVED, ANSWERED) else "Client"
        if source == "Probe":
            more["order"] = self._orders
            self._orders += 1
        data = {} if kind in (SENT, RECEIVED) else {"success": True}
        stamp = START + at * MS
        seen = Observation(
            stamp_ns=stamp, received_ns=stamp + MS, channel="/ask", kind=kind, type_name="", data=data,
            source=source, client="Client", call=call, **more,
        )  # fmt: skip
        return [verdict.outcome for verdict in self.oracle.feed(seen)]

    def answer(self, at: int, call: int, **more: Any) -> list[Outcome]:
        return self.see(RECEIVED, at, call, **more) + self.see(ANSWERED, at + 1, call, **more)

    def passed(self, at: int) -> list[Outcome]:
        return [verdict.outcome for verdict in self.oracle.advance(START + at * MS)]


@pytest.mark.parametrize(("sender", "server"), [(5, 5), (5, 0), (0, 5), (0, 0)])
def test_the_ends_of_a_call_are_matched_where_one_cannot_tell_the_life(
    sender: int, server: int, tmp_path: Path
) -> None:
    asked = Asked(tmp_path)
    said = asked.see(SENT, 10, 1, client_life=sender) + asked.answer(12, 1, client_life=server)
    said += asked.answer(22, 2, client_life=server) + asked.see(SENT, 20, 2, client_life=sender)
    assert said + asked.passed(3000) == []


def test_a_request_of_the_next_life_is_missed_although_the_last_one_had_that_number(
    tmp_path: Path,
) -> None:
    asked = Asked(tmp_path)
    said = asked.see(SENT, 10, 1, client_life=5) + asked.answer(12, 1, client_life=5)
    said += asked.see(SENT, 500, 1, client_life=6)
    assert said == []
    assert asked.passed(3000) == [Outcome.VIOLATED]


def test_a_request_of_a_client_that_was_killed_may_never_have_left(tmp_path: Path) -> None:
    asked = Asked(tmp_path)
    said = asked.see(SENT, 10, 1, client_life=5) + asked.answer(12, 1, client_life=5)
    said += asked.see(SENT, 500, 2, client_life=5)
    asked.oracle.sender_changed("Client", 0)
    assert said + asked.passed(3000) == []
