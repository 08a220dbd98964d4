"""What a violation says of state and data: those before the step that is wrong."""

from __future__ import annotations

from typing import Any

import pytest

from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Explanation, Outcome
from tests.oracle.machines import library, read
from transports.interface import Observation, ObservationKind

MS = 1_000_000
START = 10**9 * 1_790_000_000
MESSAGE = ObservationKind.MESSAGE
RECEIVED, ANSWERED = ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT

COUNTER = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="idle">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <state id="idle">
    <ros_topic_callback name="/in" target="busy"><assign location="n" expr="n + _msg.data"/></ros_topic_callback>
    <ros_service_handle_request name="/Probe/ask" target="asked">
      <assign location="n" expr="n + 1"/>
      <ros_service_send_response name="/Probe/ask">
        <field name="value" expr="n"/><field name="ok" expr="true"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
  <state id="asked">
    <ros_service_handle_request name="/Probe/ask" target="idle">
      <ros_service_send_response name="/Probe/ask">
        <field name="value" expr="n"/><field name="ok" expr="true"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
  <state id="busy">
    <transition target="done"><assign location="n" expr="n * 2"/></transition>
  </state>
  <state id="done">
    <onentry>
      <ros_topic_publish name="/out"><field name="data" expr="n"/></ros_topic_publish>
      <ros_topic_publish name="/out"><field name="data" expr="n + 1"/></ros_topic_publish>
    </onentry>
    <transition cond="n &gt; 100" target="idle"/>
  </state>
</scxml>"""
"""Counts in a step that answers; another goes on through states without events and publishes there."""


class Run:
    """The counter's oracle, told each thing when it happens."""

    def __init__(self, model: str = COUNTER) -> None:
        self.oracle = Oracle(read(model), library(), bounds=Bounds())
        self.oracle.start(START, whole=True)
        self.now = START
        self.explained: list[Explanation] = []

    def hear(self, kind: ObservationKind, channel: str, data: Any, call: int = -1) -> None:
        self.now += MS
        seen = Observation(
            stamp_ns=self.now, received_ns=self.now, channel=channel, kind=kind, type_name="",
            data=data, source="somebody" if channel == "/in" else "Probe",
            client="somebody" if call >= 0 else "", call=call,
        )  # fmt: skip
        self._note(self.oracle.feed(seen))

    def call(self, number: int, value: int | None) -> None:
        """A request, and its answer (None: there is none)."""
        self.hear(RECEIVED, "/Probe/ask", {"value": 0}, number)
        if value is not None:
            self.hear(ANSWERED, "/Probe/ask", {"value": value, "ok": True}, number)

    def out(self, value: int, channel: str = "/out") -> None:
        self.hear(MESSAGE, channel, {"data": value})

    def violation(self) -> Explanation:
        """What is said of the first violation, once time has passed."""
        for _ in range(40):
            self.now += 100 * MS
            self._note(self.oracle.advance(self.now))
        return self.explained[0]

    def _note(self, verdicts: list[Any]) -> None:
        for verdict in verdicts:
            if verdict.outcome is Outcome.VIOLATED:
                self.explained.append(verdict.explanation)


def test_an_output_with_a_wrong_value_is_explained_by_the_state_before_its_step() -> None:
    run = Run()
    run.call(1, 1)
    run.call(2, 1)
    run.call(3, 7)
    why = run.violation()
    assert why.expected == ("response on /Probe/ask {value: 2, ok: true} to somebody",)
    assert why.states == ("idle (n=1)",)  # after the step: asked (n=2)


POSE = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="s">
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/pose" type="geometry_msgs/Pose"/>
  <state id="s"><ros_topic_callback name="/in"><ros_topic_publish name="/pose">
    <field name="position.x" expr="_msg.data"/><field name="orientation.w" expr="1"/>
  </ros_topic_publish></ros_topic_callback></state>
</scxml>"""


def test_the_field_that_differs_comes_first_in_a_message_of_several_lines() -> None:
    run = Run(POSE)
    run.hear(MESSAGE, "/in", {"data": 5})
    zeros = dict.fromkeys("xyz", 0.0)
    pose = {"position": {**zeros, "x": 5.0}, "orientation": {**zeros, "w": 0.5}}
    run.hear(MESSAGE, "/pose", pose)
    why = run.violation()
    whole = "{position: {x: 5, y: 0, z: 0}, orientation: {x: 0, y: 0, z: 0, w: %s}}"
    assert why.expected == (f"message on /pose orientation.w: 1 in {whole % 1}",)
    assert why.observed == f"message on /pose orientation.w: 0.5 in {whole % 0.5}"


def test_a_missing_output_is_explained_by_the_state_before_its_step() -> None:
    run = Run()
    run.call(1, 1)
    run.call(2, 1)
    run.call(3, None)
    why = run.violation()
    assert why.observed == "nothing in time"
    assert why.states == ("idle (n=1)",)


def test_an_undeclared_output_is_explained_by_the_state_in_which_it_came() -> None:
    run = Run()
    run.call(1, 1)
    run.out(5, "/elsewhere")
    why = run.violation()
    assert why.expected == ("nothing to be sent",)
    assert why.states == ("asked (n=1)",)


def test_an_undeclared_output_in_place_of_an_owed_one_is_explained_by_the_state_before() -> None:
    run = Run()
    run.call(1, None)
    run.out(5, "/elsewhere")
    why = run.violation()
    assert why.states == ("idle (n=0)",)


@pytest.mark.parametrize("sent", [(3,), (6, 9)])
def test_an_output_in_an_eventless_chain_is_explained_by_the_state_before_the_chain(
    sent: tuple[int, ...],
) -> None:
    run = Run()
    run.hear(MESSAGE, "/in", {"data": 3})
    for value in sent:
        run.out(value)
    why = run.violation()
    owed = 6 if sent == (3,) else 7
    assert f"message on /out {{data: {owed}}}" in why.expected
    assert "idle (n=0)" in why.states
    assert not any("busy" in state or "n=6" in state for state in why.states)


def test_a_missing_output_of_an_eventless_chain_is_explained_by_the_state_before_it() -> None:
    run = Run()
    run.hear(MESSAGE, "/in", {"data": 3})
    run.out(6)
    why = run.violation()
    assert why.expected == ("message on /out {data: 7}",)
    assert why.states == ("idle (n=0)",)


FORGETS = """<scxml xmlns="http://www.w3.org/2005/07/scxml" datamodel="ecmascript" name="Probe" initial="left">
  <ros_topic_subscriber topic="/in" type="std_msgs/Int32"/>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <state id="left">
    <ros_topic_callback name="/in" target="right"/>
    <ros_service_handle_request name="/Probe/ask" target="end">ANSWER</ros_service_handle_request>
  </state>
  <state id="right">
    <ros_service_handle_request name="/Probe/ask" target="end">ANSWER</ros_service_handle_request>
  </state>
  <state id="end"/>
</scxml>""".replace(
    "ANSWER",
    '<ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/>'
    '<field name="ok" expr="true"/></ros_service_send_response>',
)


def test_each_state_from_which_the_step_may_have_been_taken_is_told() -> None:
    run = Run(FORGETS)
    run.hear(MESSAGE, "/in", {"data": 3})  # perhaps taken before the request, perhaps after
    run.call(1, 9)
    assert set(run.violation().states) == {"left", "right"}
