"""``m2c run`` as people start it: real processes on real Zenoh."""

from __future__ import annotations

import contextlib
import os
import pty
import re
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator

import msgspec
import pytest

from m2c.policy.runner import TreeTick
from tests.launch.system import LEVEL, LIMIT_S, LOW, M2C, MOVE, Run, System
from tests.monitor.processes import free_endpoint
from transports.zenoh_link.session import open_session

pytestmark = [pytest.mark.zenoh]


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
    run = Run(source, "--replace", f"Door={path}")
    assert run.end() == 2
    assert run.lines == ["error: lab has no node Door; known: MoveSkill, LevelSkill"]


@pytest.mark.parametrize("processes", [1, "each"])
def test_what_nodes_print_is_kept_and_a_silent_leaf_is_given_up(
    system: System, processes: object
) -> None:
    logs = system.folder / "logs"
    silent = system.folder / "silent.scxml"
    answer = r"<ros_service_send_response.*</ros_service_send_response>"
    silent.write_text(re.sub(answer, "", LEVEL, flags=re.DOTALL))
    options = ["--log-dir", logs, "--log-level", "warning", "--tick-timeout", 0.2]
    run = Run(
        *(system.path, "--ticks", 2, "--processes", processes),
        *("--replace", f"LevelSkill={silent}", *options),
    )
    assert run.end() == 0, run.output
    printed = [line.partition(" | ")[2] for line in run.lines if line.startswith("    policy | ")]
    assert any("no answer within the time limit" in line for line in printed), run.output
    kept = (logs / "policy.log").read_text().splitlines()
    assert [line.split(" ", 2)[2] for line in kept] == printed  # without their times
    quiet = Run(system.path, "--ticks", 1, "--log-dir", logs, "--log-level", "error")
    assert quiet.end() == 0, quiet.output
    assert (logs / "policy.log").read_text().splitlines() == kept


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
    assert run.lines[0].startswith(
        f"error: cannot reach {endpoint} within 5 s: is a node or router "
    )
    assert run.lines[0].endswith("Address already in use (os error 98)]")


def test_a_system_that_is_running_there_already_is_one_error(system: System) -> None:
    endpoint = free_endpoint()
    first = Run(system.path, endpoint=endpoint)
    first.until("tick ")
    second = Run(system.path, endpoint=endpoint)
    assert second.end() == 2, second.output
    assert re.fullmatch(
        rf"error: (LevelSkill|MoveSkill|policy) is up already at {endpoint}: is the system running\? "
        "Another one needs a --namespace of its own",
        second.lines[-1],
    )
    first.process.send_signal(signal.SIGINT)
    assert first.end() == 0, first.output


def test_a_system_may_be_started_in_parts(system: System) -> None:
    endpoint = free_endpoint()
    parts = [Run(system.path, "--only", "MoveSkill", endpoint=endpoint)]
    parts[0].until("1 node is up")
    parts.append(Run(system.path, "--without", "MoveSkill", "--ticks", 3, endpoint=endpoint))
    assert parts[1].end() == 0, parts[1].output
    assert "tick    3  RUNNING  Level ok  Move .." in parts[1].output
    parts[0].process.send_signal(signal.SIGINT)
    assert parts[0].end() == 0, parts[0].output


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


def test_ticks_are_those_of_its_own_policy_whatever_the_middleware_brings(system: System) -> None:
    """What the launcher subscribes to may come late, not at all, or from another system."""
    endpoint = free_endpoint()
    run = Run(system.path, "--ticks", 3, "--rate", 5, endpoint=endpoint)
    run.until("nodes are up")
    stranger = open_session({"endpoint": endpoint})
    forged = msgspec.msgpack.encode(TreeTick(99, "SUCCESS"))
    encoding = "application/msgpack;m2c/msg/TreeTick"
    is_over = threading.Event()

    def forge() -> None:
        while not is_over.wait(0.001):
            stranger.put("policy/ticks", forged, encoding=encoding)

    forger = threading.Thread(target=forge)
    forger.start()
    try:
        assert run.end() == 0, run.output
    finally:
        is_over.set()
        forger.join()
        stranger.close()
    assert [line.split()[1] for line in run.lines if line.startswith("tick ")] == ["1", "2", "3"]
    assert run.lines[-1] == "stopped after 3 ticks; all nodes have ended"


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
