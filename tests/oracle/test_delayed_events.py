"""A machine that sends itself events, and a monitor that comes later: what was sent before still arrives."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.verdict import Verdict
from transports.simulated import SimulatedTransport, SimulatedWorld

MODEL = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe" initial="a">
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="1"/>
  <state id="a">
    <onentry>{send}</onentry>
    <ros_rate_callback name="beat">
      <ros_topic_publish name="out"><field name="data" expr="1"/></ros_topic_publish>
    </ros_rate_callback>
    <transition event="over" target="b"/>
  </state>
  <state id="b">
    <ros_rate_callback name="beat">
      <ros_topic_publish name="out"><field name="data" expr="2"/></ros_topic_publish>
    </ros_rate_callback>
  </state>
</scxml>
"""


IGNORED = MODEL.replace(
    '<transition event="over" target="b"/>', '<transition after="1s" target="b"/>'
).replace(
    """  </state>
</scxml>""",
    """    <transition event="over" target="c"/>
  </state>
  <state id="c">
    <ros_rate_callback name="beat">
      <ros_topic_publish name="out"><field name="data" expr="2"/></ros_topic_publish>
      <ros_topic_publish name="out"><field name="data" expr="9"/></ros_topic_publish>
    </ros_rate_callback>
  </state>
</scxml>""",
)
"""What comes in its first state has no effect; in the second, it has."""


def complaints(
    folder: Path, send: str, joins_s: float, fault: str = "", model: str = MODEL, sends: str = ""
) -> list[Verdict]:
    """Violations, certain or not, of a monitor that joins after ``joins_s``.

    ``fault``: what the node publishes in its second state; ``sends``: what it has in place of ``send``.
    """
    (folder / "Probe.scxml").write_text(model.format(send=send))
    log = DiagnosticLog()
    system = load([folder], log)
    assert system is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    program = compile_system(system)
    if fault or sends:
        wrong = folder / "wrong"
        wrong.mkdir()
        text = model.format(send=sends or send).replace('expr="2"', f'expr="{fault or 2}"')
        (wrong / "Probe.scxml").write_text(text)
        other = load([wrong], log)
        assert other is not None
        program = compile_system(other)
    world = SimulatedWorld(seed=1)
    monitor = ModelMonitor(system.nodes, system.library, synchronised=not joins_s)
    said: list[Verdict] = []
    run = SimulatedRun(program, world)
    run.run(joins_s)
    listener = SimulatedTransport(world, "listener")
    listener.tap([], lambda observation: said.extend(monitor.feed(observation)))
    listener.every(0.02, lambda: said.extend(monitor.advance(world.now_ns)))
    if joins_s:
        monitor.node_found("Probe", world.now_ns)
    else:
        monitor.node_started("Probe", world.now_ns)
    run.run(20.0)
    world.close()
    return [verdict for verdict in said if "expected" in verdict.reason]


DRAWN = {
    "drawn": ("2500 + Math.random() * 3000", ""),
    "drawn, with an id": ("2500 + Math.random() * 3000", ' id="s"'),
    "drawn, perhaps none": ("Math.random() * 5500", ""),
    "one of two": ("Math.random() &lt; 0.5 ? 2500 : 5500", ""),
}


@pytest.mark.parametrize(("delay", "more"), DRAWN.values(), ids=DRAWN)
@pytest.mark.parametrize(("comes_ms", "is_right"), [(2500, True), (5500, True), (8500, False)])
def test_what_may_come_at_any_time_within_comes_then(
    tmp_path: Path, delay: str, more: str, comes_ms: int, is_right: bool
) -> None:
    """Another's node: it sends at a time that its model only bounds."""
    model = MODEL.replace("{send}", '<send event="over"' + more + ' delayexpr="{send}"/>')
    found = complaints(tmp_path, delay, 0, model=model, sends=str(comes_ms))
    assert (not found) == is_right, found


SENDS = {
    "one": '<send event="over" delay="7s"/>',
    "two": '<send event="over" delay="7s" id="s"/><send event="over" delay="9s" id="s"/>',
    "by an expression": '<send event="over" delayexpr="7000 + n"/>',
}


@pytest.mark.parametrize("send", SENDS.values(), ids=SENDS)
@pytest.mark.parametrize("joins_s", [1.5, 4.2])
def test_what_was_sent_before_the_monitor_came_arrives(
    tmp_path: Path, send: str, joins_s: float
) -> None:
    assert complaints(tmp_path, send, joins_s) == []


@pytest.mark.parametrize("send", SENDS.values(), ids=SENDS)
def test_a_fault_after_it_is_found(tmp_path: Path, send: str) -> None:
    assert complaints(tmp_path, send, 1.5, fault="3")


@pytest.mark.parametrize("delay_ms", [300, 700, 850, 950, 990, 1010, 1050, 1500])
def test_what_came_in_a_state_in_which_it_has_no_effect_does_not_come_again(
    tmp_path: Path, delay_ms: int
) -> None:
    send = f'<send event="over" delay="{delay_ms}ms"/>'
    assert complaints(tmp_path, send, 0.0, model=IGNORED) == []


@pytest.mark.parametrize("delay_ms", [300, 950, 1050, 1500])
def test_a_fault_after_something_had_no_effect_is_found(tmp_path: Path, delay_ms: int) -> None:
    send = f'<send event="over" delay="{delay_ms}ms"/>'
    assert complaints(tmp_path, send, 0.0, fault="3", model=IGNORED)
