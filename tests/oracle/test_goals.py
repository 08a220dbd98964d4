"""Goals that a machine sends, whatever is received of them first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from moon.oracle.bounds import LINKED_NS
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from transports.interface import Observation, ObservationKind

MS = 1_000_000
START = 1_000_000 * MS
CHANNEL = "/do/_action/send_goal"
CLIENT = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Client" initial="asking">
<ros_action_client name="act" action_name="/do" type="t/Do"/>
<ros_topic_subscriber topic="/go" type="std_msgs/Int32"/>
<ros_topic_publisher topic="/rejected" type="std_msgs/Int32"/>
<state id="asking"><onentry><ros_action_send_goal name="act"/></onentry>
  <ros_action_handle_goal_response name="act" accept="asking" reject="waiting"/>
</state>
<state id="waiting">
  <onentry><ros_topic_publish name="/rejected"><field name="data" expr="1"/></ros_topic_publish></onentry>
  <ros_topic_callback name="/go" target="asking"/>
</state></scxml>"""


@pytest.fixture
def system(tmp_path: Path) -> System:
    (tmp_path / "interfaces/t/action").mkdir(parents=True)
    (tmp_path / "interfaces/t/action/Do.action").write_text("---\n---\n")
    (tmp_path / "Client.scxml").write_text(CLIENT)
    log = DiagnosticLog()
    system = load([tmp_path], log)
    assert system is not None, log.diagnostics
    return system


class Watched:
    """The client's oracle; what is seen is received 100 ms later, in the order of the calls."""

    def __init__(self, system: System) -> None:
        (machine,) = system.nodes
        self.oracle = Oracle(machine, system.library, "Client")
        self.oracle.start(START)
        self.said: list[Outcome] = []

    def see(self, at_ms: int, channel: str, kind: ObservationKind, **more: Any) -> None:
        stamp = START + at_ms * MS
        source = more.pop("source", "Client")
        seen = Observation(
            stamp_ns=stamp, received_ns=stamp + 100 * MS, channel=channel, kind=kind, type_name="",
            data=more.pop("data", None), source=source, **more,
        )  # fmt: skip
        self.said += [verdict.outcome for verdict in self.oracle.feed(seen)]

    def goal(self, at_ms: int, call: int, nobody_is_first: bool) -> None:
        """A goal that is sent, and that nobody serves."""
        goal = {"goal_id": {"uuid": [call] * 16}, "goal": {}}
        parts = [
            (at_ms, ObservationKind.REQUEST_SENT, {"data": goal}),
            (at_ms + 1, ObservationKind.RESPONSE_RECEIVED, {"error": "unavailable: nobody"}),
        ]
        for at, kind, more in reversed(parts) if nobody_is_first else parts:
            self.see(at, CHANNEL, kind, client="Client", call=call, **more)

    def end(self, at_ms: int) -> list[Outcome]:
        self.said += [verdict.outcome for verdict in self.oracle.advance(START + at_ms * MS)]
        return self.said


@pytest.mark.parametrize("nobody_is_first", [False, True])
def test_a_goal_that_nobody_serves_is_rejected_whichever_is_received_first(
    system: System, nobody_is_first: bool
) -> None:
    watched = Watched(system)
    watched.goal(10, 1, nobody_is_first)
    watched.see(12, "/rejected", ObservationKind.MESSAGE, data={"data": 1})
    assert watched.end(800) == []
    assert watched.oracle.outcome is Outcome.CONFORMING


@pytest.mark.parametrize(
    ("published_ms", "is_linked_at_once", "outcomes"),
    [(2000, True, [Outcome.VIOLATED]), (2000, False, []), (5500, False, [Outcome.VIOLATED])],
)
def test_a_message_may_be_missed_until_the_middleware_has_linked_a_node_that_starts(
    system: System, published_ms: int, is_linked_at_once: bool, outcomes: list[Outcome]
) -> None:
    """On ROS 2, where a node that starts is found channel by channel; it does not go on with a goal."""
    watched = Watched(system)
    if not is_linked_at_once:
        watched.oracle.listen(START + LINKED_NS)
    watched.goal(10, 1, nobody_is_first=False)
    watched.see(12, "/rejected", ObservationKind.MESSAGE, data={"data": 1})
    for number, at_ms in enumerate((published_ms, published_ms + 5000)):
        watched.see(
            at_ms,
            "/go",
            ObservationKind.MESSAGE,
            data={"data": 1},
            source="other",
            sequence=number,
        )
        if not number:
            watched.end(published_ms + 4000)
    said = [outcome for outcome in watched.end(published_ms + 5100) if outcome is Outcome.VIOLATED]
    assert said == outcomes
