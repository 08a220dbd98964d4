"""A system of two skills in a folder, and ``m2c run`` of it as a process."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from tests.monitor.processes import free_endpoint

M2C = Path(sys.executable).parent / "m2c"
LIMIT_S = 60.0
"""After so long a run is killed, and its test fails."""

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{0}" initial="{1}">'

LEVEL = (
    HEAD.format("LevelSkill", "idle")
    + """
<ros_service_server service_name="/LevelSkill/tick" type="t/TickCondition"/>
<state id="idle">
  <ros_service_handle_request name="/LevelSkill/tick" target="idle">
    <ros_service_send_response name="/LevelSkill/tick">
      <field name="status" expr="{status}"/>
    </ros_service_send_response>
  </ros_service_handle_request>
</state>
</scxml>"""
)

MOVE = (
    HEAD.format("MoveSkill", "idle")
    + """
<ros_service_server service_name="/MoveSkill/tick" type="t/TickAction"/>
<ros_service_server service_name="/MoveSkill/halt" type="t/HaltAction"/>
<state id="idle">
  <ros_service_handle_request name="/MoveSkill/tick" target="idle">
    <ros_service_send_response name="/MoveSkill/tick">
      <field name="status" expr="2"/>
    </ros_service_send_response>
  </ros_service_handle_request>
  <ros_service_handle_request name="/MoveSkill/halt" target="idle">
    <log label="halted" expr="'Move'"/>
    <ros_service_send_response name="/MoveSkill/halt">
      <field name="is_ok" expr="true"/>
    </ros_service_send_response>
  </ros_service_handle_request>
</state>
</scxml>"""
)

INVERT = (
    HEAD.format("Invert", "wait")
    + """
<bt_declare_port_in key="expected" type="int32"/>
<bt_declare_port_out key="seen" type="int32"/>
<datamodel><data id="expected" type="int32" expr="0"/></datamodel>
<state id="wait"><bt_tick target="ticked"/></state>
<state id="ticked">
  <onentry>
    <assign location="expected"><expr><bt_get_input key="expected"/></expr></assign>
    <bt_tick_child id="0"/>
  </onentry>
  <bt_child_status id="0" cond="_bt.status == FAILURE" target="wait">
    <bt_set_output key="seen" expr="expected + 1"/>
    <bt_return_status status="SUCCESS"/>
  </bt_child_status>
  <bt_child_status id="0" target="wait"><bt_return_status status="FAILURE"/></bt_child_status>
</state>
</scxml>"""
)

TALKER = (
    HEAD.format("Talker", "a")
    + """<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<ros_topic_publisher topic="/t" type="std_msgs/Int32"/>
<ros_time_rate rate_hz="10" name="clock"/>
<state id="a"><ros_rate_callback name="clock" target="a">
  <assign location="n" expr="n + 1"/>
  <ros_topic_publish name="/t"><field name="data" expr="n"/></ros_topic_publish>
</ros_rate_callback></state></scxml>"""
)
LISTENER = (
    HEAD.format("Listener", "a")
    + """<ros_topic_subscriber topic="/t" type="std_msgs/Int32"/>
<state id="a"><ros_topic_callback name="/t" target="a"><log label="got" expr="_msg.data"/>
</ros_topic_callback></state></scxml>"""
)

MOVING = '<Action ID="A" name="Move" interface="ROS2SERVICE"/>'
LOW = '<Condition ID="C" name="Level" interface="ROS2SERVICE"/>'


PATIENCE_S = 2.0
IMPATIENT = [
    sys.executable,
    "-c",
    f"""
import runpy, sys
from m2c.launch import process
process.STOP_TIMEOUT_S = {PATIENCE_S}
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
""",
]
"""By which ``m2c run`` is run that kills what has not ended after ``PATIENCE_S``."""


class System:
    """A system of two skills, written into a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        types = folder / "interfaces" / "t" / "srv"
        types.mkdir(parents=True)
        for name, text in (
            ("TickCondition", "---\nint8 status\n"),
            ("TickAction", "---\nint8 status\n"),
            ("HaltAction", "---\nbool is_ok\n"),
        ):
            (types / f"{name}.srv").write_text(text)
        (folder / "LevelSkill.scxml").write_text(LEVEL.replace("{status}", "0"))
        (folder / "MoveSkill.scxml").write_text(MOVE)
        (folder / "Invert.scxml").write_text(INVERT)
        self.path = folder / "system.xml"
        self.write(f"<ReactiveSequence>{LOW}{MOVING}</ReactiveSequence>")

    def write(self, tree: str) -> None:
        (self.folder / "policy.xml").write_text(
            f'<root><BehaviorTree ID="M">{tree}</BehaviorTree></root>'
        )
        self.path.write_text(
            '<roaml><parameters><bt_tick_rate value="50"/></parameters><behavior_tree>'
            '<input type="bt.cpp-xml" src="policy.xml"/>'
            '<input type="bt-plugin-ascxml" src="Invert.scxml"/></behavior_tree>'
            '<node_models><input type="node-ascxml" src="LevelSkill.scxml"/>'
            '<input type="node-ascxml" src="MoveSkill.scxml"/></node_models>'
            '<interfaces><input type="ros-interfaces" src="interfaces"/></interfaces></roaml>'
        )

    def generate(self) -> Path:
        output = self.folder / "generated"
        subprocess.run(
            [str(M2C), "generate", str(self.path), "-o", str(output)],
            check=True,
            capture_output=True,
            timeout=LIMIT_S,
        )
        return output


class Run:
    """A running ``m2c run``; its output is read line by line."""

    started: ClassVar[list[Run]] = []

    def __init__(
        self, *arguments: object, endpoint: str | None = "", inside: Sequence[str] = ()
    ) -> None:
        self.lines: list[str] = []
        meeting = [] if endpoint is None else ["--endpoint", endpoint or free_endpoint()]
        self.process = subprocess.Popen(
            [*inside, str(M2C), "run", *map(str, arguments), *meeting],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._watchdog = threading.Timer(LIMIT_S, self.process.kill)
        self._watchdog.start()
        self.started.append(self)

    def until(self, *texts: str) -> str:
        """Read on until each of ``texts`` stood in a line, in whatever order; the line that was the last to come."""
        assert self.process.stdout is not None
        missing = set(texts)
        for line in self.process.stdout:
            self.lines.append(line.rstrip())
            if any(text in line for text in missing):
                missing -= {text for text in missing if text in line}
                if not missing:
                    return self.lines[-1]
        raise AssertionError(f"no line with {sorted(missing)}:\n" + "\n".join(self.lines))

    def end(self) -> int:
        """Read on to the end; the exit code."""
        assert self.process.stdout is not None
        self.lines += [line.rstrip() for line in self.process.stdout]
        code = self.process.wait(LIMIT_S)
        self._watchdog.cancel()
        return code

    def children(self) -> dict[str, int]:
        """Process id per node name."""
        found = {}
        pid = self.process.pid
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            words = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
            name = words[words.index("--node-name") + 1] if "--node-name" in words else "policy"
            found[name] = int(child)
        return found

    @property
    def output(self) -> str:
        return "\n".join(self.lines)
