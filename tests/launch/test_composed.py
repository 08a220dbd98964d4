"""Nodes that share a process: which do, and that each is what it would be alone."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from m2c.launch.description import LaunchDescription, Package
from m2c.launch.grouping import grouped
from m2c.launch.process import STOP_TIMEOUT_S, Module, NodeProcess
from tests.launch.system import IMPATIENT, LIMIT_S, PATIENCE_S, Run, System


def described(nodes: int, called: int = 0, policy: bool = True) -> LaunchDescription:
    names = [f"N{number}" for number in range(nodes)]
    packages = tuple(Package(name, name.lower(), name.lower()) for name in names)
    root = Package("policy", "p", "p") if policy else None
    return LaunchDescription(1, "s", 5.0, packages, root, tuple(names[:called]))


@given(
    st.integers(0, 60),
    st.integers(0, 60),
    st.none() | st.integers(1, 20),
    st.booleans(),
    st.sets(st.integers(0, 60)),
)
def test_each_runs_once_and_in_at_most_so_many_processes(
    nodes: int, called: int, processes: int | None, policy: bool, apart: set[int]
) -> None:
    description = described(nodes, called, policy)
    alone = [f"N{number}" for number in apart if number < nodes]
    groups = grouped(description, processes, alone)
    running = [package.name for group in groups for package in group.packages]
    assert sorted(running) == sorted(
        [*(node.name for node in description.nodes), *(["policy"] if policy else [])]
    )
    assert all(group.packages for group in groups)
    assert len({group.name for group in groups}) == len(groups)
    if processes is None:
        assert all(len(group.packages) == 1 for group in groups)
    else:
        assert len(groups) <= processes + len(alone)
    assert all(len(group.packages) == 1 for group in groups if group.name in alone)


def test_what_a_tick_calls_is_in_the_policy_s_process_and_the_others_are_dealt_out() -> None:
    groups = grouped(described(10, called=4), 3)
    assert [[package.name for package in group.packages] for group in groups] == [
        ["N0", "N1", "N2", "N3", "policy"],
        ["N4", "N5", "N6"],
        ["N7", "N8", "N9"],
    ]
    assert [group.name for group in groups] == ["process 1", "process 2", "process 3"]


@pytest.mark.zenoh
def test_a_process_of_several_nodes_that_is_killed_is_named_with_them(system: System) -> None:
    run = Run(system.path, "--processes", 1)
    run.until("tick ")
    (process,) = run.children().values()
    os.kill(process, signal.SIGKILL)
    assert run.end() == 1
    assert run.lines[-1] == (
        "process 1 (with LevelSkill, MoveSkill, policy) was killed by SIGKILL; everything was stopped. "
        "It had printed nothing."
    )


def broken(folder: Path) -> Path:
    """The generated system, in which MoveSkill raises when it is ticked."""
    node = folder / "move_skill" / "move_skill" / "machine.py"
    text = node.read_text()
    assert "status=2" in text
    node.write_text(text.replace("status=2", "status=2 // 0", 1))
    return folder


@pytest.mark.zenoh
@pytest.mark.parametrize("first", ["LevelSkill", "MoveSkill"])
def test_a_node_that_dies_of_an_error_is_named_whoever_it_shares_a_process_with(
    system: System, first: str
) -> None:
    folder = broken(system.generate())
    if first == "MoveSkill":  # whose connection the others are beside
        launch = json.loads((folder / "launch.json").read_text())
        launch["nodes"].reverse()
        (folder / "launch.json").write_text(json.dumps(launch))
    run = Run(folder, "--processes", 1)
    assert run.end() == 1, run.output
    assert any(
        line.startswith(
            "MoveSkill (in process 1, with LevelSkill, policy) exited with code 1; everything was stopped."
        )
        for line in run.lines
    ), run.output
    assert "ZeroDivisionError" in run.output
    assert " MoveSkill | CRITICAL MoveSkill: it died" in run.output


@pytest.mark.zenoh
def test_a_composed_run_is_watched_as_any(system: System) -> None:
    run = Run(system.path, "--processes", 1, "--monitor", "--ticks", 100)
    assert run.end() == 0, run.output
    assert "0 violations" in run.output
    for name in ("LevelSkill", "MoveSkill", "policy"):
        assert any(line.split("|")[-1].split()[:2] == [name, "conforming"] for line in run.lines), (
            run.output
        )
    assert run.output.count("MoveSkill | INFO MoveSkill: halted: Move") == 1


@pytest.mark.parametrize("wrong", ["0", "-1", "two", "", "1e3", "1001"])
def test_a_number_of_processes_that_is_none_is_refused(system: System, wrong: str) -> None:
    run = Run(system.path, "--processes", wrong)
    assert run.end() == 2
    assert "is neither a number from 1 to 1000 nor 'each'" in run.output


def deployed_system(system: System, processes: str) -> Path:
    file = system.folder / "deployment.xml"
    file.write_text(f"<deployment>{processes}</deployment>")
    return file


TWO_HOSTS = (
    '<process name="brain" host="robot" priority="3"><node name="LevelSkill"/><node name="policy"/></process>'
    '<process name="arm" host="base"><node name="MoveSkill"/></process>'
)


@pytest.mark.zenoh
def test_a_deployment_says_which_processes_there_are_and_how_urgent_each_is(system: System) -> None:
    run = Run(system.path, "--deployment", deployed_system(system, TWO_HOSTS))
    run.until("tick ")
    nice = {name: os.getpriority(os.PRIO_PROCESS, pid) for name, pid in run.children().items()}
    assert nice == {"policy": 3, "MoveSkill": os.getpriority(os.PRIO_PROCESS, 0)}
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output


@pytest.mark.zenoh
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--host", "robo"], "has no such host; did you mean robot?"),
        (["--host", "robot", "--processes", "2"], "it excludes --deployment and --host"),
    ],
)
def test_a_host_that_nobody_is_is_refused(system: System, options: list[str], said: str) -> None:
    run = Run(system.path, "--deployment", deployed_system(system, TWO_HOSTS), *options)
    assert run.end() == 2
    assert said in run.output


@pytest.mark.zenoh
def test_a_deployment_that_forgets_a_node_is_refused_with_its_place(system: System) -> None:
    file = deployed_system(system, TWO_HOSTS.replace('<node name="LevelSkill"/>', ""))
    run = Run(system.path, "--deployment", file)
    assert run.end() == 2
    assert f"{file}:1:1: error: <deployment>: it gives no process to LevelSkill" in run.output


@pytest.mark.zenoh
@pytest.mark.parametrize("processes", ["1", "each"])
def test_a_policy_that_has_ended_before_its_nodes_are_heard_of_has_ticked(
    system: System, processes: str
) -> None:
    deaf = (
        "import runpy, sys\n"
        "from transports.zenoh.transport import ZenohTransport\n"
        "ZenohTransport.watch_nodes = lambda transport, handler: None\n"
        "del sys.argv[0]\n"
        "runpy.run_path(sys.argv[0], run_name='__main__')\n"
    )
    run = Run(
        *(system.path, "--processes", processes, "--ticks", 3),
        inside=[sys.executable, "-c", deaf],
    )
    assert run.end() == 0, run.output
    said = [line for line in run.lines if "|" not in line]
    assert said[1] == "2 nodes are up"
    assert [line.split()[:2] for line in said if line.startswith("tick ")] == [
        ["tick", str(number)] for number in (1, 2, 3)
    ]
    assert said[-1] == "stopped after 3 ticks; all nodes have ended"


HANGS = """
import time as _time
def _hang():
    print("hanging", flush=True)
    while True:
        {how}
"""


def hanging(folder: Path, how: str) -> Path:
    """The generated system, in which MoveSkill does not come back from its first tick."""
    node = folder / "move_skill" / "move_skill" / "machine.py"
    text = node.read_text()
    assert "status=2" in text
    node.write_text(text.replace("status=2", "status=_hang()", 1) + HANGS.format(how=how))
    return folder


@pytest.mark.zenoh
@pytest.mark.parametrize("how", ["_time.sleep(3600)", "pass"], ids=["waits", "loops"])
@pytest.mark.parametrize("first", ["LevelSkill", "MoveSkill"])
def test_a_node_that_hangs_is_named_and_says_where_whoever_it_shares_a_process_with(
    system: System, first: str, how: str
) -> None:
    folder = hanging(system.generate(), how)
    if first == "MoveSkill":  # which runs on the main thread then
        launch = json.loads((folder / "launch.json").read_text())
        launch["nodes"].reverse()
        (folder / "launch.json").write_text(json.dumps(launch))
    run = Run(folder, "--processes", 1, inside=IMPATIENT)
    run.until("hanging")
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 1, run.output
    who = "MoveSkill (in process 1, with LevelSkill, policy)"
    said = [
        line.startswith(f"{who} did not end in {PATIENCE_S:g} s and was killed")
        for line in run.lines
    ]
    assert any(said), run.output
    assert any("in _hang" in line for line in run.lines[said.index(True) :]), run.output


SLOW = """
import os, signal, time
def say_where(*_):
    time.sleep(1.5)
    print("here", flush=True)
    os._exit(1)
signal.signal(signal.SIGQUIT, say_where)
print("up", flush=True)
while True:
    signal.pause()
"""


def test_who_takes_its_time_to_say_where_it_stands_is_heard_out(tmp_path: Path) -> None:
    """As it does on a machine that is busy."""
    (tmp_path / "slow.py").write_text(SLOW)
    up = threading.Event()
    process = NodeProcess("Slow", Module("slow", [tmp_path]), lambda *_: up.set(), lambda *_: None)
    assert up.wait(LIMIT_S)
    assert process.finish(time.monotonic()) == f"did not end in {STOP_TIMEOUT_S:g} s and was killed"
    assert process.last_lines[-1] == "here"


@pytest.mark.zenoh
@pytest.mark.parametrize("count", [1, "each"])
def test_a_process_that_somebody_asks_to_end_ends_the_run_and_is_named(
    system: System, count: int | str
) -> None:
    run = Run(system.path, "--processes", count)
    run.until("tick ")
    children = run.children()
    os.kill(children["LevelSkill"] if count == "each" else children.popitem()[1], signal.SIGTERM)
    assert run.end() == 1, run.output
    who = "process 1 (with LevelSkill, MoveSkill, policy)" if count == 1 else "LevelSkill"
    assert f"{who} was asked to end by SIGTERM, which m2c run did not send" in run.lines
    assert any(
        line.startswith(f"{who} exited with code 0; everything was stopped.") for line in run.lines
    ), run.output


@pytest.mark.zenoh
def test_a_policy_that_somebody_asks_to_end_ends_the_run_and_is_named(system: System) -> None:
    run = Run(system.path, "--processes", "each")
    run.until("tick ")
    os.kill(run.children()["policy"], signal.SIGTERM)
    assert run.end() == 1, run.output
    assert "policy was asked to end by SIGTERM, which m2c run did not send" in run.lines
