"""Machines that talk by plain events: generated, run, recorded, and watched by the model oracle."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import m2c
import moon
from m2c.cli import main
from m2c.rosidl.build import build_once
from m2c.runtime.messages import message_class
from tests.launch.system import Run
from tests.monitor.processes import Process
from tests.transports.ros2_network import have_ticks, own_domain
from transports import Observation, SimulatedWorld, Topic

HEAD = '<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{0}" initial="{1}">'
PING = (
    HEAD.format("Ping", "begin")
    + """
<datamodel><data id="round" type="int16" expr="0"/></datamodel>
<state id="begin"><transition after="1s" target="play"/></state>
<state id="play">
  <onentry>
    <send event="ping"><param name="round" expr="round"/><param name="list" expr="[round, 7]"/></send>
  </onentry>
  <transition event="pong" cond="_event.data.round &gt; round" target="rest">
    <assign location="round" expr="_event.data.round"/>
    <log label="round" expr="round"/>
  </transition>
  <transition after="2s" target="rest"/>
</state>
<state id="rest"><transition after="100ms" target="play"/></state>
</ascxml>"""
)
PONG = (
    HEAD.format("Pong", "wait")
    + """
<state id="wait">
  <transition event="ping">
    <send event="pong"><param name="round" expr="_event.data.round + 1"/></send>
    <send event="heard.pong"/>
  </transition>
</state>
</ascxml>"""
)
SCORE = (
    HEAD.format("{0}", "wait")
    + """
<datamodel><data id="total" type="int32" expr="0"/><data id="beats" type="int32" expr="0"/></datamodel>
<state id="wait">
  <transition event="ping">
    <assign location="total" expr="total + _event.data.list[1]"/>
    <send event="total"><param name="value" expr="total"/><param name="of" expr="'{0}'"/></send>
  </transition>
  <transition event="heard"><assign location="beats" expr="beats + 1"/></transition>
  <transition event="total" cond="_event.data.of != '{0}'">
    <send event="seen"><param name="value" expr="_event.data.value"/><param name="beats" expr="beats"/></send>
  </transition>
</state>
</ascxml>"""
)


COUNTED = """
ports:
  round: {topic: /plain_events/pong, field: round}
properties:
  - {id: Counted, formula: "historically {round >= 1}"}
"""


def write(folder: Path, **changed: str) -> Path:
    """Ping and Pong, and two that count the pings and hear each other's sums; the system file."""
    models = {"Ping": PING, "Pong": PONG, **{name: SCORE.format(name) for name in ("Home", "Away")}}
    for name, text in {**models, **changed}.items():
        (folder / f"{name}.ascxml").write_text(text)
    inputs = "".join(f'<input type="node-ascxml" src="{name}.ascxml"/>' for name in models)
    system = folder / "system.xml"
    system.write_text(f"<roaml><node_models>{inputs}</node_models></roaml>")
    return system


def simulated(
    path: Path, nodes: Path | None = None, seconds: float = 3.0
) -> tuple[list[moon.Verdict], dict[str, list[Any]]]:
    """What the monitor of the system in ``path`` says of ``nodes`` (its own by default), and what was sent."""
    world = SimulatedWorld(seed=3)
    system = m2c.read_system(path)
    verdicts: list[moon.Verdict] = []
    moon.Monitor(world.connect("monitor"), system, on_verdict=verdicts.append).start()
    heard: dict[str, list[Any]] = {}
    listener = world.connect("listener")
    for kind in system.library.defined():
        event = next(
            item.event
            for node in system.nodes
            for item in node.interfaces
            if item.type_name == kind.name
        )
        channel = f"/plain_events/{event.replace('.', '/')}"
        topic = Topic(channel, kind.name, message_class(kind))
        listener.subscribe(topic, heard.setdefault(event, []).append)
    world.run_for(0.01)
    m2c.simulate(m2c.read_system(nodes or path), world).run(seconds)
    return verdicts, heard


def outcomes(verdicts: list[moon.Verdict]) -> dict[str, str]:
    return {verdict.node: str(verdict.outcome) for verdict in verdicts}


def test_machines_hear_each_other_and_conform_to_their_models(tmp_path: Path) -> None:
    verdicts, heard = simulated(write(tmp_path))
    assert [message.round for message in heard["ping"]] == list(range(len(heard["ping"])))
    assert len(heard["ping"]) > 15
    assert [message.round for message in heard["pong"]] == list(range(1, len(heard["pong"]) + 1))
    assert {tuple(message.list[1:]) for message in heard["ping"]} == {(7,)}
    # three take each ping: Pong and both that count; these hear one another, and not themselves
    assert len(heard["heard.pong"]) == len(heard["ping"])
    sums = [7 * number for number in range(1, len(heard["ping"]) + 1)]
    for name in ("Home", "Away"):
        assert [item.value for item in heard["total"] if item.of == name] == sums
    assert sorted(item.value for item in heard["seen"]) == sorted([*sums, *sums])
    assert heard["seen"][-1].beats > 15
    assert outcomes(verdicts) == dict.fromkeys(("Ping", "Pong", "Home", "Away"), "conforming")


def test_an_event_that_the_model_does_not_send_so_is_a_violation(tmp_path: Path) -> None:
    path = write(tmp_path)
    wrong = tmp_path / "wrong"
    wrong.mkdir()
    verdicts, _ = simulated(path, write(wrong, Pong=PONG.replace("+ 1", "+ 2")))
    assert outcomes(verdicts)["Pong"] == "violated"
    (found,) = [verdict for verdict in verdicts if verdict.outcome == "violated"][:1]
    assert "/plain_events/pong" in found.reason
    assert outcomes(verdicts)["Ping"] == "conforming"


def test_what_the_transport_brings_back_to_its_sender_is_taken(tmp_path: Path) -> None:
    echo = PONG.replace(
        "</state>", '<transition event="heard"><send event="me"/></transition></state>'
    )
    verdicts, heard = simulated(write(tmp_path, Pong=echo))
    assert len(heard["me"]) == len(heard["heard.pong"]) > 15
    assert outcomes(verdicts)["Pong"] == "conforming"


ASK = (
    HEAD.format("Ask", "idle")
    + """
<state id="idle"><bt_tick target="asked"><send event="ask"/><bt_return_status status="RUNNING"/></bt_tick></state>
<state id="asked">
  <bt_tick><bt_return_status status="RUNNING"/></bt_tick>
  <transition event="reply" cond="_event.data.ok" target="done"/>
</state>
<state id="done"><bt_tick target="idle"><bt_return_status status="SUCCESS"/></bt_tick></state>
</ascxml>"""
)
REPLY = (
    HEAD.format("Reply", "wait")
    + """
<state id="wait">
  <transition event="ask"><send event="reply"><param name="ok" expr="true"/></send></transition>
</state>
</ascxml>"""
)


def test_a_plugin_of_the_policy_and_a_node_hear_each_other(tmp_path: Path) -> None:
    (tmp_path / "Ask.ascxml").write_text(ASK)
    (tmp_path / "Reply.ascxml").write_text(REPLY)
    (tmp_path / "policy.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">'
        '<Action ID="Ask" name="Ask"/></BehaviorTree></root>'
    )
    path = tmp_path / "system.xml"
    path.write_text(
        '<roaml><parameters><bt_tick_rate value="10"/></parameters><behavior_tree>'
        '<input type="bt.cpp-xml" src="policy.xml"/>'
        '<input type="bt-plugin-ascxml" src="Ask.ascxml"/></behavior_tree>'
        '<node_models><input type="node-ascxml" src="Reply.ascxml"/></node_models></roaml>'
    )
    system = m2c.read_system(path)
    assert m2c.check(system) == []
    world = SimulatedWorld(seed=3)
    verdicts: list[moon.Verdict] = []
    moon.Monitor(world.connect("monitor"), system, on_verdict=verdicts.append).start()
    world.run_for(0.01)
    run = m2c.simulate(system, world)
    run.run(2.0)
    statuses = [str(tick.status) for tick in run.ticks]
    assert statuses[:6] == ["RUNNING", "SUCCESS"] * 3
    assert outcomes(verdicts)["Reply"] == "conforming"
    assert "violated" not in outcomes(verdicts).values()


def test_the_wiring_shows_who_sends_events_to_whom(tmp_path: Path) -> None:
    drawn = tmp_path / "wiring.mmd"
    result = CliRunner().invoke(main, ["draw", str(write(tmp_path)), "-o", str(drawn)])
    assert result.exit_code == 0, result.output
    lines = drawn.read_text().splitlines()
    assert lines[lines.index("flowchart LR") + 1 :] == [
        '  n0["Ping<br/>topic ping"]',
        '  n1["Pong<br/>topic /plain_events/pong<br/>topic heard/pong"]',
        '  n2["Home<br/>topic total<br/>topic seen"]',
        '  n3["Away<br/>topic total<br/>topic seen"]',
        '  n1 -.->|"/plain_events/pong"| n0',
        '  n0 -.->|"ping"| n1',
        '  n0 -.->|"ping"| n2',
        '  n1 -.->|"heard/pong"| n2',
        '  n3 -.->|"total"| n2',
        '  n0 -.->|"ping"| n3',
        '  n1 -.->|"heard/pong"| n3',
        '  n2 -.->|"total"| n3',
    ]


def test_the_types_of_events_are_generated_as_an_interface_package(tmp_path: Path) -> None:
    path = write(tmp_path)
    m2c.generate(m2c.read_system(path), tmp_path / "zenoh")
    made = tmp_path / "zenoh" / "plain_events"
    assert {file.name for file in made.rglob("*.*")} == {
        "HeardPong.msg", "Ping.msg", "Pong.msg", "Seen.msg", "Total.msg",
    }  # fmt: skip
    assert (made / "msg" / "Ping.msg").read_text().splitlines()[1:] == [
        "int16 round",
        "int64[] list",
    ]
    m2c.generate(m2c.read_system(path), tmp_path / "ros2", transport="ros2")
    made = tmp_path / "ros2" / "plain_events"
    assert '  "msg/HeardPong.msg"' in (made / "CMakeLists.txt").read_text()
    assert "<name>plain_events</name>" in (made / "package.xml").read_text()


def test_a_system_without_events_between_machines_has_no_such_package(tmp_path: Path) -> None:
    (tmp_path / "a.ascxml").write_text(HEAD.format("A", "s") + '<state id="s"/></ascxml>')
    files = m2c.generate(m2c.read_system(tmp_path / "a.ascxml"), tmp_path / "out")
    assert not [path for path in files if "plain_events" in path.parts]


@pytest.mark.zenoh
def test_events_travel_on_zenoh_and_are_recorded_and_judged(tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    properties = tmp_path / "properties.yaml"
    properties.write_text(COUNTED)
    run = Run(write(tmp_path), f"--monitor=--properties '{properties}'", "--record", recording)
    _end_after_five_rounds(run)
    check = Process("moon", "check", recording, tmp_path / "system.xml", "--properties", properties)
    with contextlib.closing(check):
        assert check.end() == 0, check.said
    (counted,) = [line for line in check.out if line.startswith("Counted ")]
    assert "conforming" in counted


ROWS = (
    HEAD.format("Rows", "begin")
    + """
<datamodel><data id="rows" type="int32[][]" expr="[[1], [2, 3]]"/></datamodel>
<ros_time_rate name="clock" rate_hz="10"/>
<state id="begin"><transition after="1s" target="go"/></state>
<state id="go"><ros_rate_callback name="clock">
  <send event="rows"><param name="rows" expr="rows"/></send>
</ros_rate_callback></state>
</ascxml>"""
)
LAST = (
    HEAD.format("Last", "wait")
    + """
<datamodel><data id="count" type="int32" expr="0"/></datamodel>
<state id="wait"><transition event="rows" cond="_event.data.rows[1][1] == 3">
  <assign location="count" expr="count + 1"/>
  <log label="round" expr="count"/>
  <send event="last"><param name="value" expr="_event.data.rows[1][1]"/></send>
</transition></state>
</ascxml>"""
)


@pytest.mark.zenoh
def test_arrays_of_arrays_travel_and_can_be_read_from_a_recording(tmp_path: Path) -> None:
    for name, text in (("Rows", ROWS), ("Last", LAST)):
        (tmp_path / f"{name}.ascxml").write_text(text)
    path = tmp_path / "system.xml"
    path.write_text(
        '<roaml><node_models><input type="node-ascxml" src="Rows.ascxml"/>'
        '<input type="node-ascxml" src="Last.ascxml"/></node_models></roaml>'
    )
    recording = tmp_path / "run.mcap"
    run = Run(path, "--record", recording)
    _end_after_five_rounds(run)
    check = Process("moon", "check", recording, path)
    with contextlib.closing(check):
        assert check.end() == 0, check.said
    assert "inconclusive" not in check.said


@pytest.mark.zenoh
def test_a_model_in_a_node_s_place_and_a_node_left_out_keep_the_events(tmp_path: Path) -> None:
    path = write(tmp_path)
    faster = tmp_path / "faster.ascxml"
    faster.write_text(PING.replace("100ms", "50ms").replace('name="Ping"', 'name="Faster"'))
    run = Run(path, "--replace", f"Ping={faster}", "--without", "Home")
    _end_after_five_rounds(run)


@pytest.mark.ros2
@pytest.mark.slow
@pytest.mark.timeout(400)
def test_events_travel_on_ros_2_with_types_that_are_built_for_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    have_ticks(monkeypatch)
    path = write(tmp_path)
    m2c.generate(m2c.read_system(path), tmp_path / "generated")
    built = build_once(tmp_path / "generated" / "plain_events")  # a run has less time in this test
    assert built.packages == ("plain_events",)
    with own_domain():
        recording = tmp_path / "run.mcap"
        run = Run(path, "--transport", "ros2", "--record", recording, endpoint=None)
        run.until("linked to 5 nodes")  # the nodes run before ROS 2 has linked the recorder to them
        for _ in range(20):
            run.until("round: ")
        _end(run)
        assert any("plain_events" in line and "building" in line for line in run.lines)
        for name, value in built.environment({}).items():  # as sourcing its setup script does
            monkeypatch.setenv(name, value, prepend=os.pathsep)
        again = Run(tmp_path / "generated", "--transport", "ros2", endpoint=None)
        _end_after_five_rounds(again)
        assert not any("building" in line for line in again.lines)
    system = m2c.read_system(path)
    entries = moon.Recording.open(recording, system.library).entries()
    seen = [item for item in entries if isinstance(item, Observation)]
    rounds = [item.data["round"] for item in seen if item.channel == "/plain_events/pong"]
    assert rounds
    assert rounds[-1] >= 5
    assert rounds == sorted(set(rounds))


def _end_after_five_rounds(run: Run) -> None:
    run.until("round: 5")
    _end(run)


def _end(run: Run) -> None:
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    assert not [line for line in run.lines if "VIOLATED" in line], run.output
