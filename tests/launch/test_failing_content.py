"""Whole runs of machines of which something fails, or never ends: monitored, nodes live and conform."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.launch.system import HEAD
from tests.launch.test_simulated import code, run

pytestmark = pytest.mark.slow

TOPICS = """<ros_topic_subscriber topic="/level" type="std_msgs/Int32" name="level"/>
<ros_topic_publisher topic="/out" type="std_msgs/Int32" name="out"/>"""
DRIVER = (
    HEAD.format("Driver", "s")
    + """<ros_topic_publisher topic="/level" type="std_msgs/Int32" name="level"/>
<ros_service_client service_name="/ask" type="std_srvs/SetBool" name="ask"/>
<ros_time_rate name="beat" rate_hz="2"/><ros_time_rate name="call" rate_hz="1.3"/>
<state id="s">
  <ros_rate_callback name="beat"><ros_topic_publish name="level"><field name="data" expr="5"/></ros_topic_publish>
  </ros_rate_callback>
  <ros_rate_callback name="call"><ros_service_send_request name="ask"><field name="data" expr="true"/>
  </ros_service_send_request></ros_rate_callback>
  <ros_service_handle_response name="ask"><log label="answer" expr="_res.message"/></ros_service_handle_response>
</state></scxml>"""
)
OUT = '<ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish>'
FAILING = 'cond="list[9].x == 1"'
LIST = '<datamodel><data id="list" expr="[1]"/><data id="n" type="int32" expr="0"/></datamodel>'
SERVER = '<ros_service_server service_name="/ask" type="std_srvs/SetBool" name="ask"/>'
ANSWER = """<ros_service_send_response name="ask"><field name="success" expr="true"/>
<field name="message" expr="'{}'"/></ros_service_send_response>"""

MACHINES = {
    "a condition on a message fails": f"""{TOPICS}{LIST}<state id="s">
        <ros_topic_callback name="level" {FAILING} target="s"/>
        <transition event="error.execution">{OUT}</transition></state>""",
    "a condition on a request fails, and what handles that answers it": f"""{TOPICS}{SERVER}{LIST}<state id="s">
        <ros_service_handle_request name="ask" {FAILING}/>
        <transition event="error.execution">{ANSWER.format("sorry")}</transition></state>""",
    "a condition on a request fails, and nothing answers it": f"""{TOPICS}{SERVER}{LIST}<state id="s">
        <ros_service_handle_request name="ask" {FAILING}/>
        <ros_topic_callback name="level">{ANSWER.format("late")}{OUT}</ros_topic_callback>
        <transition event="error.*" target="s">{OUT}</transition></state>""",
    "a condition on a request fails, and what handles that never ends": f"""{TOPICS}{SERVER}{LIST}<state id="s">
        <ros_service_handle_request name="ask" {FAILING}/>
        <ros_topic_callback name="level">{ANSWER.format("late")}{OUT}</ros_topic_callback>
        <transition event="error.*"><raise event="error.execution"/></transition></state>""",
    "what handles a failed condition changes the state": f"""{TOPICS}{LIST}<state id="s">
        <ros_topic_callback name="level" {FAILING}/><transition event="error" target="t"/></state>
        <state id="t"><ros_topic_callback name="level" target="s">{OUT}</ros_topic_callback></state>""",
    "a condition without an event fails": f"""{TOPICS}{LIST}<state id="s">
        <transition cond="n == 1 &amp;&amp; list[9].x == 1" target="s"/>
        <ros_topic_callback name="level"><assign location="n" expr="1"/></ros_topic_callback>
        <transition event="error.execution"><assign location="n" expr="2"/>{OUT}</transition></state>""",
}


def write(folder: Path, content: str) -> Path:
    """A system of the driver and of the machine ``P``."""
    (folder / "Driver.scxml").write_text(DRIVER)
    (folder / "P.scxml").write_text(f"{HEAD.format('P', 's')}{content}</scxml>")
    path = folder / "system.xml"
    path.write_text(
        """<roaml><node_models><input type="ros-scxml" src="./P.scxml"/>
        <input type="ros-scxml" src="./Driver.scxml"/></node_models></roaml>"""
    )
    return path


@pytest.mark.parametrize("name", MACHINES)
def test_generated_code_of_what_fails_conforms_to_its_model(tmp_path: Path, name: str) -> None:
    made = run(write(tmp_path, MACHINES[name]), "--for", 6, "--monitor")
    assert code(made) == 0, made.output
    assert "0 violations" in made.output, made.output
    assert "2 machines: 2 conforming" in made.output, made.output


CHAIN = f"""{TOPICS}{LIST}<state id="s">
<ros_topic_callback name="level"><assign location="n" expr="0"/><raise event="again"/></ros_topic_callback>
<transition event="again" {{}}><assign location="n" expr="n + 1"/><raise event="again"/></transition>
<transition event="again"><log label="chain" expr="n"/>{OUT}</transition></state>"""


def test_six_hundred_events_that_raise_one_another_are_all_taken(tmp_path: Path) -> None:
    path = write(tmp_path, CHAIN.format('cond="n &lt; 600"'))
    made = run(path, "--for", 3, "--monitor")
    assert code(made) == 0, made.output
    assert "chain: 600" in made.output
    assert "2 machines: 2 conforming" in made.output, made.output


@pytest.mark.parametrize(
    "content",
    [
        CHAIN.format('cond="true"'),
        f"""{TOPICS}<state id="s"><ros_topic_callback name="level" target="t"/></state>
        <state id="t"><onentry><raise event="a"/></onentry><transition event="a" target="t"/></state>""",
        f"""{TOPICS}<state id="s"><onentry><raise event="a"/></onentry>
        <transition event="a"><raise event="a"/></transition></state>""",
        f"""{TOPICS}{LIST}<state id="s"><transition cond="n == 0" target="t"/></state>
        <state id="t"><transition cond="n == 0" target="s"/></state>""",
    ],
    ids=["raised by itself", "on entry", "from the start on", "without events"],
)
def test_an_endless_loop_is_reported_once_and_the_node_lives(tmp_path: Path, content: str) -> None:
    made = run(write(tmp_path, content), "--for", 6, "--monitor")
    assert code(made) == 0, made.output
    (line,) = [line for line in made.lines if "ERROR" in line and " P: " in line]
    assert "an endless loop: more than 1000 eventless transitions and internal events" in line
    assert "2 machines: 2 conforming" in made.output, made.output
