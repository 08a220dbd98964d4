"""``m2c run`` as people start it: real processes on real Zenoh."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import pytest

pytestmark = [pytest.mark.zenoh]

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

MOVING = '<Action ID="A" name="Move" interface="ROS2SERVICE"/>'
LOW = '<Condition ID="C" name="Level" interface="ROS2SERVICE"/>'


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
            '<input type="bt-plugin-ros-scxml" src="Invert.scxml"/></behavior_tree>'
            '<node_models><input type="ros-scxml" src="LevelSkill.scxml"/>'
            '<input type="ros-scxml" src="MoveSkill.scxml"/></node_models>'
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


@pytest.fixture
def system(tmp_path: Path) -> System:
    return System(tmp_path / "lab")


def free_endpoint() -> str:
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def router(endpoint: str) -> Iterator[None]:
    """A Zenoh router, as ``zenohd --listen endpoint`` is one."""
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config):
        yield


class Run:
    """A running ``m2c run``; its output is read line by line."""

    started: ClassVar[list[Run]] = []

    def __init__(self, *arguments: object, endpoint: str | None = "") -> None:
        self.lines: list[str] = []
        meeting = [] if endpoint is None else ["--endpoint", endpoint or free_endpoint()]
        self.process = subprocess.Popen(
            [str(M2C), "run", *map(str, arguments), *meeting],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._watchdog = threading.Timer(LIMIT_S, self.process.kill)
        self._watchdog.start()
        self.started.append(self)

    def until(self, text: str) -> str:
        """The next line with ``text`` in it."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())
            if text in line:
                return self.lines[-1]
        raise AssertionError(f"no line with {text!r}:\n" + "\n".join(self.lines))

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


@pytest.fixture(autouse=True)
def _nothing_is_left_running() -> Iterator[None]:
    yield
    while Run.started:
        run = Run.started.pop()
        if run.process.poll() is None:
            run.process.terminate()
            run.end()


def gone(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


def test_a_run_of_n_ticks_ends_by_itself_and_halts_what_is_running(system: System) -> None:
    run = Run(system.path, "--ticks", 3, "--rate", 50)
    assert run.end() == 0, run.output
    assert "2 nodes are up" in run.output
    assert "tick    3  RUNNING  Level ok  Move .." in run.output
    assert run.output.endswith("stopped after 3 ticks; all nodes have ended")
    assert run.output.count("MoveSkill | INFO MoveSkill: halted: Move") == 1


def test_a_killed_node_ends_the_run_and_is_named(system: System) -> None:
    run = Run(system.path)
    run.until("tick ")
    children = run.children()
    assert sorted(children) == ["LevelSkill", "MoveSkill", "policy"]
    os.kill(children["MoveSkill"], signal.SIGKILL)
    assert run.end() == 1
    assert run.lines[-1] == (
        "MoveSkill was killed by SIGKILL; everything was stopped. It had said nothing."
    )
    assert all(gone(pid) for pid in children.values())


def test_a_node_that_dies_while_starting_ends_the_run_with_its_last_lines(system: System) -> None:
    broken = system.folder / "broken" / "broken"
    broken.mkdir(parents=True)
    (broken / "__main__.py").write_text('import sys\nsys.exit("the motor does not answer")\n')
    run = Run(system.generate(), "--replace", f"MoveSkill={broken.parent}")
    assert run.end() == 1
    assert run.lines[-2:] == [
        "MoveSkill exited with code 1; everything was stopped. Its last lines:",
        "  the motor does not answer",
    ]


DEAF = """
import signal, time
def wait_for_ever():
    while True:
        time.sleep(60.0)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("deaf", flush=True)
wait_for_ever()
"""


def with_a_deaf_node(system: System) -> Run:
    broken = system.folder / "broken" / "broken"
    broken.mkdir(parents=True)
    (broken / "__main__.py").write_text(DEAF)
    run = Run(system.generate(), "--replace", f"MoveSkill={broken.parent}")
    run.until("deaf")
    return run


def test_a_node_that_does_not_end_is_killed_and_says_where_it_stood(system: System) -> None:
    run = with_a_deaf_node(system)
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 1, run.output
    said = run.lines.index(
        "MoveSkill did not end in 10 s and was killed when everything was stopped. Its last lines:"
    )
    assert any("in wait_for_ever" in line for line in run.lines[said:]), run.output
    assert run.lines[-1] == "stopped before all nodes were up; not all nodes have ended well"


def test_a_second_signal_kills_who_has_not_ended(system: System) -> None:
    run = with_a_deaf_node(system)
    first = os.pidfd_open(run.children()["LevelSkill"])
    run.process.send_signal(signal.SIGINT)
    with open(first, "rb", buffering=0):
        assert select.select([first], [], [], LIMIT_S)[0]
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    assert run.lines[-1] == (
        "stopped before all nodes were up; nodes that had not ended yet were killed"
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_everything_and_is_no_fault(system: System, number: signal.Signals) -> None:
    run = Run(system.path)
    run.until("tick ")
    children = run.children()
    assert len(children) == 3
    run.process.send_signal(number)
    assert run.end() == 0, run.output
    assert re.search(r"stopped after \d+ ticks?; all nodes have ended", run.output)
    assert "halted: Move" in run.output
    assert all(gone(pid) for pid in children.values())


def test_a_signal_while_the_nodes_start_stops_everything(system: System) -> None:
    run = Run(system.generate())
    run.until("starting 2 nodes")
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    assert "stopped before all nodes were up" in run.output


def test_a_killed_launcher_takes_its_nodes_with_it(system: System) -> None:
    run = Run(system.path)
    run.until("tick ")
    watched = [os.pidfd_open(pid) for pid in run.children().values()]
    run.process.kill()
    run.end()
    for descriptor in watched:
        with open(descriptor, "rb", buffering=0):
            assert select.select([descriptor], [], [], LIMIT_S)[0]


@pytest.mark.parametrize("option", ["--only", "--without"])
def test_a_node_that_does_not_exist_is_refused_with_the_nearest_name(
    option: str, system: System
) -> None:
    run = Run(system.generate(), option, "MoveSkil")
    assert run.end() == 2
    assert run.lines == ["error: lab has no node MoveSkil; did you mean MoveSkill?"]


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_replacing_a_node_that_does_not_exist_is_refused(kind: str, system: System) -> None:
    source = system.generate() if kind == "folder" else system.path
    path = system.folder / ("generated" if kind == "folder" else "MoveSkill.scxml")
    run = Run(source, "--replace", f"Mov={path}")
    assert run.end() == 2
    assert run.lines == ["error: lab has no node Mov; known: LevelSkill, MoveSkill"]


def test_a_node_may_be_left_out_and_its_leaf_fails(system: System) -> None:
    run = Run(system.path, "--without", "MoveSkill", "--ticks", 1)
    assert run.end() == 0, run.output
    assert "1 node is up" in run.output
    assert "tick    1  FAILURE  Level ok  Move no" in run.output
    assert "leaf Move: /MoveSkill/tick" in run.output


def test_a_changed_model_runs_in_the_place_of_a_node(system: System) -> None:
    changed = system.folder / "changed.scxml"
    changed.write_text(LEVEL.replace("{status}", "1"))
    run = Run(system.path, "--ticks", 1, "--replace", f"LevelSkill={changed}")
    assert run.end() == 0, run.output
    assert "tick    1  FAILURE  Level no" in run.output


def test_a_changed_package_runs_in_the_place_of_a_node(system: System) -> None:
    generated = system.generate()
    changed = system.folder / "changed"
    (generated / "level_skill").rename(changed)
    machine = changed / "level_skill" / "machine.py"
    text = machine.read_text()
    assert "status=0" in text
    machine.write_text(text.replace("status=0", "status=1"))
    run = Run(generated, "--ticks", 1, "--replace", f"LevelSkill={changed}")
    assert run.end() == 0, run.output
    assert "tick    1  FAILURE  Level no" in run.output


def test_a_replacement_by_a_model_needs_the_system_file(system: System) -> None:
    generated = system.generate()
    model = system.folder / "LevelSkill.scxml"
    run = Run(generated, "--replace", f"LevelSkill={model}")
    assert run.end() == 2
    assert run.lines == [
        f"error: --replace LevelSkill={model}: replacing by a model needs the system file as SYSTEM"
    ]


def test_an_endpoint_in_use_is_one_error(system: System) -> None:
    generated = system.generate()
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        run = Run(generated, endpoint=endpoint)
        assert run.end() == 2
    assert len(run.lines) == 1
    assert run.lines[0].startswith(f"error: cannot listen on {endpoint}: the port is in use")


def test_the_nodes_meet_at_the_router_that_a_zenoh_configuration_names(system: System) -> None:
    endpoint = free_endpoint()
    config = system.folder / "router.json5"
    config.write_text(f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}}}')
    with router(endpoint):
        run = Run(system.path, "--zenoh-config", config, "--ticks", 2, endpoint=None)
        assert run.end() == 0, run.output
    assert f"starting 2 nodes at the endpoints of {config}" in run.output
    assert "tick    2  RUNNING  Level ok  Move .." in run.output
    run = Run(system.path, "--zenoh-config", config, endpoint=None)
    assert run.end() == 2
    assert run.lines[0].startswith("error: cannot reach the endpoints of the configuration")


def test_a_namespace_keeps_two_systems_apart(system: System) -> None:
    generated = system.generate()
    endpoint = free_endpoint()
    config = system.folder / "router.json5"
    config.write_text(f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}}}')
    with router(endpoint):
        runs = [
            Run(generated, "--zenoh-config", config, "--namespace", name, endpoint=None)
            for name in ("left", "right")
        ]
        for run in runs:
            run.until("tick    3  RUNNING  Level ok  Move ..")
        for run in runs:
            run.process.send_signal(signal.SIGINT)
            assert run.end() == 0
            assert "two nodes" not in run.output


def test_two_servers_of_one_service_are_reported(system: System) -> None:
    generated = system.generate()
    run = Run(generated, "--replace", f"LevelSkill={generated / 'move_skill'}")
    line = run.until("two nodes serve /MoveSkill/")
    assert "LevelSkill and MoveSkill" in line or "MoveSkill and LevelSkill" in line
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output


def test_ticks_without_a_policy_are_refused(system: System) -> None:
    run = Run(system.path, "--without", "policy", "--ticks", 5)
    assert run.end() == 2
    assert run.lines == ["error: --ticks 5: the policy is not run, so nothing is ticked"]


def test_a_model_with_an_error_is_reported_and_nothing_is_started(system: System) -> None:
    (system.folder / "MoveSkill.scxml").write_text(MOVE.replace('expr="2"', 'expr="speed"'))
    run = Run(system.path)
    assert run.end() == 2
    assert any("`speed` is not declared" in line for line in run.lines), run.output
    assert "starting" not in run.output


def test_a_plugin_with_a_child_and_ports_runs_on_zenoh(system: System) -> None:
    (system.folder / "LevelSkill.scxml").write_text(LEVEL.replace("{status}", "1"))
    system.write(
        '<Sequence><Script code="wanted:=41"/>'
        f'<Invert expected="{{wanted}}" seen="{{seen}}">{LOW}</Invert>'
        '<ScriptCondition code="seen==42"/></Sequence>'
    )
    run = Run(system.path, "--ticks", 2)
    assert run.end() == 0, run.output
    for number in (1, 2):
        assert f"tick    {number}  SUCCESS  Invert ok  Level no" in run.output


def test_a_script_that_fails_while_ticking_ends_the_run_with_its_reason(system: System) -> None:
    system.write('<Sequence><Script code="n:=\'x\'"/><Script code="m:=n*2"/></Sequence>')
    run = Run(system.path)
    assert run.end() == 1
    assert "policy | error: the tree cannot be ticked: " in run.output
    assert "policy exited with code 1; everything was stopped" in run.output
    assert "Traceback" not in run.output


def test_on_a_terminal_the_tree_is_a_picture_below_the_lines(system: System) -> None:
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [str(M2C), "run", str(system.path), "--ticks", "5", "--endpoint", free_endpoint()],
        stdout=theirs,
        stderr=theirs,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100", "LINES": "40"},
    )
    watchdog = threading.Timer(LIMIT_S, process.kill)
    watchdog.start()
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # EIO: the other end is closed
        while part := os.read(ours, 65536):
            shown += part
    os.close(ours)
    assert process.wait(LIMIT_S) == 0
    watchdog.cancel()
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())
    last = text.rpartition("tick 5")[2]
    assert re.search(r"RUNNING  [\d.]+ ticks/s", last), text
    assert re.search(r"── Level  SUCCESS  [\d.]+ ms", last), text
    assert re.search(r"── Move  RUNNING  [\d.]+ ms", last), text
    assert "MoveSkill | INFO MoveSkill: halted: Move" in text
    assert "tick    1" not in text
