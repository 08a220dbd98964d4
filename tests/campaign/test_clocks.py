"""Clocks of hosts that are set by less than anything takes: two machines whose delays and answers show it."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.verdict import Outcome
from tests.campaign.circumstances import Circumstances
from tests.campaign.plans import PROPERTY_FILE
from tests.campaign.trial import Prepared, said_of, try_one
from transports.simulated import Conditions, HostClock, Rules

HEAD = '<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="{first}">'
SERVER = """
  <ros_service_server name="ask" service_name="/ask" type="small/Ask"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <state id="idle">
    <ros_service_handle_request name="ask" target="busy">
      <assign location="n" expr="_req.number"/>
      <ros_service_send_response name="ask"><field name="value" expr="n"/></ros_service_send_response>
      <send event="later" delay="120ms"/>
    </ros_service_handle_request>
  </state>
  <state id="busy">
    <transition event="later" target="idle">
      <ros_topic_publish name="out"><field name="data" expr="n"/></ros_topic_publish>
    </transition>
  </state>
</ascxml>"""
ASKER = """
  <ros_service_client name="ask" service_name="/ask" type="small/Ask"/>
  <ros_topic_subscriber name="out" topic="/out" type="std_msgs/Int32"/>
  <ros_topic_publisher name="echo" topic="/echo" type="std_msgs/Int32"/>
  <ros_time_rate name="now" rate_hz="3"/>
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <state id="asking">
    <ros_rate_callback name="now">
      <assign location="n" expr="n + 1"/>
      <ros_service_send_request name="ask"><field name="number" expr="n"/></ros_service_send_request>
    </ros_rate_callback>
    <ros_service_handle_response name="ask" target="asking"/>
    <ros_topic_callback name="out">
      <ros_topic_publish name="echo"><field name="data" expr="_msg.data"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
</ascxml>"""
SYSTEM = """<roaml>
  <node_models>
    <input type="node-ascxml" src="./Server.ascxml"/><input type="node-ascxml" src="./Asker.ascxml"/>
  </node_models>
  <interfaces><input type="ros-interfaces" src="./interfaces"/></interfaces>
</roaml>"""


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    folder: Path = tmp_path_factory.mktemp("clocks")
    types = folder / "interfaces" / "small" / "srv" / "Ask.srv"
    types.parent.mkdir(parents=True)
    types.write_text("int32 number\n---\nint32 value\n")
    for name, first, text in (("Server", "idle", SERVER), ("Asker", "asking", ASKER)):
        (folder / f"{name}.ascxml").write_text(HEAD.format(name=name, first=first) + text)
    system = folder / "system.xml"
    system.write_text(SYSTEM)
    return Prepared(system)


WHERE = [("Server",), ("Asker",), ("Server", "monitor"), ("monitor",), ("Server", "Asker")]


@pytest.mark.parametrize("rules", list(Rules))
@pytest.mark.parametrize("by_s", [-0.15, -0.09, -0.04, 0.04, 0.09, 0.3])
@pytest.mark.parametrize("there", WHERE, ids="+".join)
def test_nobody_is_accused_by_a_clock_that_is_set(
    prepared: Prepared, there: tuple[str, ...], by_s: float, rules: Rules
) -> None:
    made = Circumstances(
        Conditions(
            delay_s=(0.0, 0.002),
            tap_delay_s=(0.0, 0.002),
            hosts=dict.fromkeys(there, "robot"),
            clocks=(HostClock("robot", steps=((2.04, by_s),)),),
            rules=rules,
        ),
        seconds=5.0,
    )
    assert try_one(prepared, 1, made).failures == ()


@pytest.mark.parametrize("rules", list(Rules))
@pytest.mark.parametrize("by_s", [-0.0099, -0.005, -0.0012, 0.0012, 0.0099])
@pytest.mark.parametrize("there", WHERE, ids="+".join)
def test_nobody_is_accused_by_a_clock_that_is_set_by_little_while_something_waits(
    prepared: Prepared, there: tuple[str, ...], by_s: float, rules: Rules
) -> None:
    """By no more than clocks differ anyway: it does not show."""
    for at_s in (2.02, 2.1, 2.15, 2.25, 2.4, 2.5):
        made = Circumstances(
            Conditions(
                delay_s=(0.0, 0.02),
                tap_delay_s=(0.0, 0.02),
                hosts=dict.fromkeys(there, "robot"),
                clocks=(HostClock("robot", steps=((at_s, by_s),)),),
                rules=rules,
            ),
            seconds=3.5,
        )
        assert try_one(prepared, 1, made).failures == (), at_s


@pytest.mark.parametrize("rules", list(Rules))
@pytest.mark.parametrize("delay_s", [0.002, 0.045])
@pytest.mark.parametrize("rate", [-0.08, -0.02, -0.005, 0.005, 0.02])
@pytest.mark.parametrize("there", WHERE, ids="+".join)
def test_nobody_is_accused_by_a_clock_that_is_slewed(
    prepared: Prepared, there: tuple[str, ...], rate: float, delay_s: float, rules: Rules
) -> None:
    """Chrony slews by up to 8 % until a clock is right (chrony.conf(5), maxslewrate)."""
    steps = tuple((round(0.1 * number, 1), round(0.1 * rate, 4)) for number in range(5, 60))
    made = Circumstances(
        Conditions(
            delay_s=(0.0, delay_s),
            tap_delay_s=(0.0, delay_s),
            hosts=dict.fromkeys(there, "robot"),
            clocks=(HostClock("robot", steps=steps),),
            rules=rules,
        ),
        seconds=6.0,
    )
    assert try_one(prepared, 1, made).failures == ()


PROPERTIES = """
ports:
  asked: {service: /ask, on: request}
  told: {service: /ask, on: response}
  out: {topic: /out}
  echo: {topic: /echo}
properties:
  - {id: told, pattern: precedence, cause: asked, effect: told}
  - {id: first, pattern: precedence, cause: out, effect: echo}
  - {id: soon, pattern: response, request: out, response: echo, within: 100 ms}
  - {id: asked, pattern: recurrence, of: asked, within: 400 ms}
  - {id: late, pattern: response, request: asked, response: out, within: 60 ms}
  - {id: never, pattern: absence, of: echo}
  - {id: in_time, pattern: response, request: asked, response: out, within: 123 ms}
"""
PROPERTY_NAMES = {"told", "first", "soon", "asked", "late", "never", "in_time"}
BROKEN = {"late", "never"}
"""/out comes 120 ms after the request."""


def _violated(
    prepared: Prepared, there: tuple[str, ...], clock: HostClock, rules: Rules, delay_s: float
) -> set[str]:
    """The properties that are violated in six seconds, with the nodes ``there`` on a host of that clock."""
    conditions = Conditions(
        delay_s=(0.0, delay_s),
        tap_delay_s=(0.0, delay_s),
        hosts=dict.fromkeys(there, "robot"),
        clocks=(clock,),
        rules=rules,
    )
    file = prepared.path.parent / PROPERTY_FILE
    file.write_text(PROPERTIES)
    try:
        found = said_of(Prepared(prepared.path), 1, Circumstances(conditions, seconds=6.0))
    finally:
        file.unlink()
    assert not {one.node for one in found} - PROPERTY_NAMES - {"Server", "Asker"}
    return {one.node for one in found if one.outcome is Outcome.VIOLATED}


@pytest.mark.parametrize("rules", list(Rules))
@pytest.mark.parametrize("ahead_s", [-0.009, -0.005, -0.001, 0.0, 0.001, 0.005, 0.009])
@pytest.mark.parametrize("there", WHERE, ids="+".join)
def test_a_property_of_several_nodes_is_violated_whatever_clocks_differ_by_or_not_at_all(
    prepared: Prepared, there: tuple[str, ...], ahead_s: float, rules: Rules
) -> None:
    """NTP keeps hosts within some milliseconds of one another."""
    assert _violated(prepared, there, HostClock("robot", ahead_s), rules, 0.0005) == BROKEN


@pytest.mark.parametrize("rules", list(Rules))
@pytest.mark.parametrize("by_s", [-0.009, 0.009])
@pytest.mark.parametrize("there", [it for it in WHERE if "monitor" not in it], ids="+".join)
def test_a_duration_is_not_too_long_by_a_clock_that_is_set_meanwhile(
    prepared: Prepared, there: tuple[str, ...], by_s: float, rules: Rules
) -> None:
    """Each request is answered by /out within 123 ms, and not before 117."""
    steps = tuple((0.4 + at / 3, by_s * (1 - at % 2 * 2)) for at in range(12))
    assert _violated(prepared, there, HostClock("robot", steps=steps), rules, 0.002) == BROKEN
