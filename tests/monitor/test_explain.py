"""What ``moon explain`` says of models."""

from __future__ import annotations

from pathlib import Path

from m2c.diagnostics import DiagnosticLog
from m2c.model import load
from moon.explain.observables import Observables, observables
from moon.explain.report import report
from tests.monitor.hand_driven import write_models

LAB_TOUR = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="M" initial="{0}">'


def explained(folder: Path, text: str) -> Observables:
    """The model ``text``, explained."""
    path = write_models(folder).with_name("M.scxml")
    path.write_text(text)
    log = DiagnosticLog()
    system = load([path], log)
    assert system is not None
    assert not log.has_errors, log.diagnostics
    (machine,) = system.nodes
    return observables(machine)


def whys(found: Observables) -> dict[str, str]:
    return {item.what: item.why for item in found.unchecked}


def test_inputs_and_outputs_come_from_the_interfaces(tmp_path) -> None:
    write_models(tmp_path)
    log = DiagnosticLog()
    system = load([tmp_path / "Level.scxml"], log)
    assert system is not None
    found = observables(system.nodes[0])
    assert [(i.what, i.channel, i.type_name) for i in found.inputs] == [
        ("request", "/Level/tick", "t/srv/Tick"),
        ("message", "/battery", "t/msg/Level"),
    ]
    assert found.inputs[0].stamped_by.startswith("its node")
    assert found.inputs[1].stamped_by.startswith("its publisher")
    ((what, channel, deadline, places),) = [
        (o.what, o.channel, o.deadline_s, o.places) for o in found.outputs
    ]
    assert (what, channel, deadline) == ("response", "/Level/tick", 1.0)
    assert [place.rsplit(":", 2)[1] for place in places] == ["10"]
    assert found.transitions == 2
    assert whys(found) == {
        "idle: message /battery": "nothing leaves the process (level is set): "
        "it shows in what is sent later"
    }


def test_timers_are_told_with_their_periods_and_tolerance(tmp_path) -> None:
    found = explained(
        tmp_path,
        HEAD.format("a")
        + """
<ros_time_rate name="beat" rate_hz="4"/>
<ros_topic_publisher name="out" topic="/out" type="t/Level"/>
<state id="a">
  <ros_rate_callback name="beat">
    <ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish>
    <send event="later" delay="2s"/>
  </ros_rate_callback>
  <transition after="5s" target="b"/>
  <transition event="later"><log label="later"/></transition>
</state>
<state id="b"/>
</scxml>""",
    )
    assert [(t.what, t.name, t.period_s) for t in found.timers] == [
        ("rate", "beat", 0.25),
        ("after", "a", 5.0),
        ("delayed event", "later", 2.0),
    ]
    assert all(timer.tolerance_s == 0.2 for timer in found.timers)
    told = whys(found)
    assert told["log later"] == "logs are not observed"
    assert told["a: internal later"].startswith("it only logs")


def test_what_is_random_is_told(tmp_path) -> None:
    found = explained(
        tmp_path,
        HEAD.format("a")
        + """
<ros_service_server service_name="/s" type="t/Tick"/>
<state id="a">
  <ros_service_handle_request name="/s" cond="Math.random() &gt; 0.5" target="b">
    <ros_service_send_response name="/s">
      <field name="status" expr="Math.floor(Math.random() * 3)"/>
    </ros_service_send_response>
  </ros_service_handle_request>
  <ros_service_handle_request name="/s"/>
</state>
<state id="b">
  <transition><target id="a" prob="0.5"/><target id="b" prob="0.5"/></transition>
</state>
</scxml>""",
    )
    said = [item.why for item in found.unchecked]
    assert "its condition is random: taken and not taken are both right" in said
    assert "a value is drawn at random: any that can be drawn is right" in said
    assert "its target is chosen at random: a or b are both right" in said


def test_what_nothing_reads_cannot_be_checked(tmp_path) -> None:
    found = explained(
        tmp_path,
        HEAD.format("a")
        + """
<datamodel><data id="x" type="int32" expr="0"/></datamodel>
<ros_topic_subscriber topic="/battery" type="t/Level"/>
<state id="a">
  <ros_topic_callback name="/battery"><assign location="x" expr="_msg.data"/></ros_topic_callback>
</state>
</scxml>""",
    )
    assert whys(found)["a: message /battery"] == "it sets only x, which nothing reads"


def test_outputs_that_a_model_never_sends_are_said_to_be_violations(tmp_path) -> None:
    found = explained(
        tmp_path,
        HEAD.format("a")
        + '<ros_topic_publisher topic="/out" type="t/Level"/><state id="a"/></scxml>',
    )
    (output,) = found.outputs
    assert output.places == ()
    assert any("never: any is a violation" in line for line in report(found))


PLUGIN = (
    HEAD.format("wait")
    + """
<bt_declare_port_in key="service" type="string"/>
<ros_service_client name="asked" service_name="/s" type="t/Tick"/>
<ros_topic_publisher name="out" type="t/Level"><topic><bt_get_input key="service"/></topic>
</ros_topic_publisher>
<state id="wait">
  <bt_tick target="wait">
    <ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish>
    <bt_return_status status="SUCCESS"/>
  </bt_tick>
</state>
</scxml>"""
)


def test_a_plugin_says_that_it_is_not_monitored_and_what_is_known_only_at_run_time(
    tmp_path,
) -> None:
    path = write_models(tmp_path).with_name("M.scxml")
    path.write_text(PLUGIN)
    log = DiagnosticLog()
    system = load([path], log)
    assert system is not None
    assert not log.has_errors, log.diagnostics
    found = observables(system.nodes[0], plugin=True)
    assert not found.monitored
    told = whys(found)
    assert "runs inside the policy's process" in told["the whole plugin"]
    assert told["publisher out"] == (
        "its channel is the value of port `service`, known only at run time"
    )
    assert told["wait: tree's tick"] == "all that it sends goes to channels known only at run time"
    assert told["return status"].startswith("the status goes to the behaviour tree")


def test_every_transition_of_the_lab_tour_sends_or_is_told(tmp_path) -> None:
    log = DiagnosticLog()
    system = load([LAB_TOUR], log)
    assert system is not None
    for machine in system.nodes:
        found = observables(machine)
        assert found.monitored
        assert found.inputs or found.timers
        assert found.outputs
        assert all(place.rsplit(":", 2)[0] for output in found.outputs for place in output.places)
        assert "\n".join(report(found)).startswith(f"{machine.name}  ")


NESTED = (
    HEAD.format("off")
    + """
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<ros_topic_subscriber name="go" topic="/go" type="std_msgs/Empty"/>
<ros_topic_subscriber name="stop" topic="/stop" type="std_msgs/Empty"/>
<ros_topic_publisher name="out" topic="/out" type="t/Level"/>
<state id="off"><ros_topic_callback name="go" target="last"/></state>
<state id="on">
  <history id="last"><transition target="slow"/></history>
  <onentry><log label="on"/></onentry>
  <ros_topic_callback name="stop" target="off"/>
  <ros_topic_callback name="go"><send event="later" delay="1s"/></ros_topic_callback>
  <transition after="5s" target="fast" type="internal"/>
  <transition event="later"><assign location="n" expr="n + 1"/></transition>
  <state id="slow"><transition cond="n &gt; 3" target="fast"/></state>
  <state id="fast" initial="down">
    <onexit><ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish></onexit>
    <state id="up"/>
    <state id="down"><transition after="1s" target="up"/></state>
  </state>
</state>
</scxml>"""
)


def test_a_transition_of_a_compound_state_is_told_once_and_as_its(tmp_path) -> None:
    found = explained(tmp_path, NESTED)
    sets = "nothing leaves the process ({0}): it shows in what is sent later"
    assert found.transitions == 7
    assert [(item.what, item.why.format()) for item in found.unchecked] == [
        ("off: message go", sets.format("the state becomes on/fast/down or on/slow")),
        ("on: message stop in on/slow", sets.format("the state becomes off; history_last is set")),
        ("on: message go", sets.format("later is sent to itself")),
        ("on: after 5 s in on/slow", sets.format("the state becomes on/fast/down")),
        ("on: internal later", sets.format("n is set")),
        ("on/slow: eventless transition", sets.format("the state becomes on/fast/down")),
        ("on/fast/down: after 1 s", sets.format("the state becomes on/fast/up")),
        ("log on", "logs are not observed"),
    ]
    assert [(timer.what, timer.name) for timer in found.timers] == [
        ("after", "on"),
        ("after", "on/fast/down"),
        ("delayed event", "later"),
    ]
    ((place,),) = [item.places for item in found.outputs]
    assert place.rsplit(":", 2)[1] == "16"


def test_states_in_which_a_transition_is_hidden_are_counted_where_they_are_many(tmp_path) -> None:
    plain = "".join(f'<state id="s{number}"/>' for number in range(7))
    text = HEAD.format("s0") + (
        '<ros_topic_subscriber name="go" topic="/go" type="std_msgs/Empty"/>'
        '<ros_topic_publisher name="out" topic="/out" type="std_msgs/Empty"/><state id="on">'
        '<history id="last"><transition target="s0"/></history>'
        f'<ros_topic_callback name="go" target="off"/>{plain}'
        '<state id="loud"><onexit><ros_topic_publish name="out"/></onexit></state></state>'
        '<state id="off"><ros_topic_callback name="go" target="last"/></state></scxml>'
    )
    found = whys(explained(tmp_path, text))
    assert list(found) == ["on: message go in 7 of 8 states", "off: message go"]
    assert "the state becomes one of 8 states" in found["off: message go"]
