"""Random small systems in which a machine takes inputs of every kind, and recordings of their runs.

``Probe`` hears two topics, a plain event, feedback and results of goals that it sends, responses to
its calls, and requests; what it publishes and answers depends on each. The other nodes send it that.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from random import Random

import msgspec

from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.oracle.bounds import Bounds
from moon.recording.definitions import Definitions
from moon.recording.entries import Answered, Entry
from moon.recording.reader import open_recording
from moon.recording.writer import RecordingWriter
from moon.run import Run
from moon.sources.on_time import received_on_time
from moon.sources.played import Player
from moon.sources.recorded import RecordedConnection, RecordedRun
from moon.sources.source import Outputs
from moon.verdict import Verdict
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

BEFORE_S = 0.01
"""The nodes begin to connect so long after the monitor listens."""
SECONDS = 2.0

HEAD = '<ascxml xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="{first}">'
COUNTER = (
    HEAD
    + """
  <ros_topic_publisher name="number" topic="/number" type="std_msgs/Int32"/>
  <ros_topic_publisher name="mode" topic="/mode" type="std_msgs/Int32"/>
  <ros_time_rate name="count" rate_hz="{rate}"/>
  <datamodel><data id="n" type="int32" expr="0"/></datamodel>
  <state id="counting">
    <ros_rate_callback name="count">
      <assign location="n" expr="n + 1"/>
      <if cond="n % {rarely} == 0">
        <ros_topic_publish name="mode"><field name="data" expr="n % 7"/></ros_topic_publish>
        <elseif cond="n % 2 == 0"/>
        <send event="told"><param name="what" expr="n % 5"/></send>
        <else/>
        <ros_topic_publish name="number"><field name="data" expr="n"/></ros_topic_publish>
      </if>
    </ros_rate_callback>
  </state>
</ascxml>"""
)
WORKER = (
    HEAD
    + """
  <ros_action_server name="work" action_name="/work" type="small/Work"/>
  <ros_service_server name="ask" service_name="/worker/ask" type="small/Ask"/>
  <ros_time_rate name="step" rate_hz="{rate}"/>
  <datamodel>
    <data id="goal" type="int32" expr="0"/><data id="left" type="int32" expr="0"/><data id="done" type="int32" expr="0"/>
  </datamodel>
  <state id="idle">
    <ros_action_handle_goal name="work" target="working">
      <assign location="goal" expr="_action.goal_id"/>
      <assign location="left" expr="_goal.size"/>
      <ros_action_accept_goal name="work" goal_id="_action.goal_id"/>
    </ros_action_handle_goal>
    <ros_service_handle_request name="ask">
      <ros_service_send_response name="ask"><field name="value" expr="done"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
  <state id="working">
    <ros_action_handle_cancel name="work" target="idle">
      <ros_action_canceled name="work" goal_id="goal"><field name="sum" expr="-1"/></ros_action_canceled>
    </ros_action_handle_cancel>
    <ros_rate_callback name="step" cond="left &gt; 0">
      <assign location="left" expr="left - 1"/>
      <ros_action_feedback name="work" goal_id="goal"><field name="left" expr="left"/></ros_action_feedback>
    </ros_rate_callback>
    <ros_rate_callback name="step" target="idle">
      <assign location="done" expr="done + 1"/>
      <ros_action_succeed name="work" goal_id="goal"><field name="sum" expr="done"/></ros_action_succeed>
    </ros_rate_callback>
    <ros_service_handle_request name="ask">
      <ros_service_send_response name="ask"><field name="value" expr="100 + left"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</ascxml>"""
)
ASKER = (
    HEAD
    + """
  <ros_service_client name="probe" service_name="/probe/ask" type="small/Ask"/>
  <ros_time_rate name="now" rate_hz="{rate}"/>
  <state id="asking">
    <ros_rate_callback name="now" target="waiting">
      <ros_service_send_request name="probe"><field name="number" expr="1"/></ros_service_send_request>
    </ros_rate_callback>
  </state>
  <state id="waiting">
    <ros_service_handle_response name="probe" target="asking"/>
    <ros_service_handle_error name="probe" target="asking"/>
  </state>
</ascxml>"""
)
SYSTEM = """<roaml>
  <node_models>{inputs}</node_models>
  <interfaces><input type="ros-interfaces" src="./interfaces"/></interfaces>
</roaml>"""
INTERFACES = {
    "action/Work.action": "int32 size\n---\nint32 sum\n---\nint32 left\n",
    "srv/Ask.srv": "int32 number\n---\nint32 value\n",
}


def _probe(draw: Random) -> str:
    """A machine that takes inputs of every kind; which of them make a difference is drawn."""
    matters = {
        name: draw.random() < 0.75 for name in ("number", "mode", "told", "left", "result", "asked")
    }
    at_once = draw.choice(("", "number", "told", "left", "mode"))
    publish = '<ros_topic_publish name="out"><field name="data" expr="total"/></ros_topic_publish>'

    def add(name: str, value: str) -> str:
        text = (
            f'<assign location="total" expr="total * 3 % 1009 + {value}"/>' if matters[name] else ""
        )
        return text + (publish if name == at_once else "")

    shared = f"""
    <ros_topic_callback name="number">{add("number", "_msg.data")}</ros_topic_callback>
    <ros_topic_callback name="mode">{add("mode", "_msg.data")}</ros_topic_callback>
    <transition event="told">{add("told", "_event.data.what")}</transition>
    <ros_service_handle_request name="asked">
      <ros_service_send_response name="asked"><field name="value" expr="total"/></ros_service_send_response>
    </ros_service_handle_request>
    <ros_service_handle_response name="worker">{add("asked", "_res.value")}</ros_service_handle_response>
    <ros_action_handle_feedback name="work">{add("left", "_feedback.left")}</ros_action_handle_feedback>"""
    size = draw.randint(1, 4)
    cancels = draw.random() < 0.4
    every = f"{publish if draw.random() < 0.7 else ''}"
    ask = (
        '<ros_service_send_request name="worker"><field name="number" expr="total"/></ros_service_send_request>'
        if draw.random() < 0.7
        else ""
    )
    cancel = '<ros_action_send_cancel name="work"/>' if cancels else ""
    send = f'<ros_action_send_goal name="work"><field name="size" expr="{size}"/></ros_action_send_goal>'
    return f"""{HEAD.format(name="Probe", first="idle")}
  <ros_topic_subscriber name="number" topic="/number" type="std_msgs/Int32"/>
  <ros_topic_subscriber name="mode" topic="/mode" type="std_msgs/Int32"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <ros_service_server name="asked" service_name="/probe/ask" type="small/Ask"/>
  <ros_service_client name="worker" service_name="/worker/ask" type="small/Ask"/>
  <ros_action_client name="work" action_name="/work" type="small/Work"/>
  <ros_time_rate name="tick" rate_hz="{draw.choice((4, 7, 10))}"/>
  <datamodel><data id="total" type="int32" expr="0"/><data id="ticks" type="int32" expr="0"/></datamodel>
  <state id="idle">
    <ros_rate_callback name="tick" target="sent">{send}{every}</ros_rate_callback>{shared}
  </state>
  <state id="sent">
    <ros_action_handle_goal_response name="work" accept="running" reject="idle"/>{shared}
  </state>
  <state id="running">
    <onentry><assign location="ticks" expr="0"/></onentry>
    <ros_rate_callback name="tick" cond="ticks &gt; 2">{cancel}{every}</ros_rate_callback>
    <ros_rate_callback name="tick"><assign location="ticks" expr="ticks + 1"/>{ask}{every}</ros_rate_callback>
    <ros_action_handle_success_result name="work" target="idle">
      {add("result", "_wrapped_result.result.sum")}
    </ros_action_handle_success_result>
    <ros_action_handle_canceled_result name="work" target="idle"/>
    <ros_action_handle_aborted_result name="work" target="idle"/>{shared}
  </state>
</ascxml>"""


def write(folder: Path, seed: int) -> Path:
    """The random system ``seed``, as files in ``folder``; the system file."""
    draw = Random(seed)
    for name, text in INTERFACES.items():
        path = folder / "interfaces" / "small" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    models = {
        "Probe": _probe(draw),
        "Counter": COUNTER.format(
            name="Counter",
            first="counting",
            rate=draw.choice((5, 9, 14)),
            rarely=draw.randint(3, 5),
        ),
        "Worker": WORKER.format(name="Worker", first="idle", rate=draw.choice((5, 9, 14))),
        "Asker": ASKER.format(name="Asker", first="asking", rate=draw.choice((3, 8))),
    }
    for name, text in models.items():
        (folder / f"{name}.ascxml").write_text(text)
    inputs = "".join(f'<input type="node-ascxml" src="./{name}.ascxml"/>' for name in models)
    path = folder / "system.xml"
    path.write_text(SYSTEM.format(inputs=inputs))
    return path


class SmallRun(msgspec.Struct, frozen=True):
    """A recorded run of a small system in which nothing is wrong.

    Attributes:
        subject: the system.
        entries: the recording.
        verdicts: what its monitor said.
    """

    subject: Monitored
    entries: tuple[Entry, ...]
    verdicts: tuple[Verdict, ...]


class _Kept:
    def __init__(self) -> None:
        self.verdicts: list[Verdict] = []

    def take(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)


def run(folder: Path, seed: int, seconds: float = SECONDS) -> SmallRun:
    """Write the random system ``seed`` to ``folder``, and run it, monitored and recorded."""
    models = write(folder, seed)
    subject = read_subject(Subject((models,), (), (), (), (), Bounds()))
    draw = Random(f"conditions {seed}")
    longest_s = draw.choice((0.0005, 0.005, 0.03))
    conditions = Conditions(delay_s=(0.0, longest_s), tap_delay_s=(0.0, longest_s))
    world = SimulatedWorld(seed, conditions)
    path = folder / "run.mcap"
    writer = RecordingWriter(path, Definitions(subject.system.library))
    connection = RecordedConnection(SimulatedTransport(world, "monitor"), writer.add, "simulated")
    recorded, kept = RecordedRun(connection, writer), _Kept()
    watch = Run(connection, subject, Outputs([recorded, kept]))
    watch.start()
    world.run_for(BEFORE_S)
    nodes = SimulatedRun(compile_system(subject.system), world)
    nodes.run(seconds)
    recorded.flush()
    assert watch.listener is not None
    recorded.end(watch.listener.problems())
    writer.close()
    world.close()
    entries = tuple(open_recording(path, subject.system.library).entries())
    return SmallRun(subject, entries, tuple(kept.verdicts))


# --- what else a middleware may tell of it ---------------------------------------------------------


def per_channel(entries: tuple[Entry, ...]) -> tuple[Entry, ...]:
    """As on ROS 2: numbered per source and channel only, and nobody reports what he takes or can be asked."""
    return tuple(
        msgspec.structs.replace(entry, order=-1) if isinstance(entry, Observation) else entry
        for entry in entries
        if not isinstance(entry, Answered)
        and not (isinstance(entry, Observation) and entry.kind is ObservationKind.MESSAGE_TAKEN)
    )


def ordered_only(entries: tuple[Entry, ...]) -> tuple[Entry, ...]:
    """All that a node reports is numbered in order, but not what it takes."""
    seen = [entry for entry in entries if isinstance(entry, Observation)]
    orders: dict[str, list[int]] = {}
    for item in seen:
        if item.kind is not ObservationKind.MESSAGE_TAKEN:
            orders.setdefault(item.source, []).append(item.order)
    places = {
        source: {o: n for n, o in enumerate(sorted(known))} for source, known in orders.items()
    }
    return tuple(
        msgspec.structs.replace(entry, order=places[entry.source][entry.order])
        if isinstance(entry, Observation)
        else entry
        for entry in entries
        if not isinstance(entry, Answered)
        and not (isinstance(entry, Observation) and entry.kind is ObservationKind.MESSAGE_TAKEN)
    )


def judged(subject: Monitored, entries: Sequence[Entry]) -> list[Verdict]:
    """What a monitor of ``subject`` says of ``entries``."""
    player, kept = Player(subject.bounds.latency), _Kept()
    watch = Run(player, subject, Outputs([kept]))
    for number, entry in enumerate(received_on_time(entries)):
        if number == 0:
            player.start(entry, watch.start)
        player.play(entry)
    player.finish()
    return kept.verdicts
