"""How ``m2c run`` ends, whatever ends it: nothing of it is left, and who ended badly is named."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from moon.recording.entries import Ending
from moon.recording.reader import open_recording
from tests.launch.system import IMPATIENT, LIMIT_S, M2C, PATIENCE_S, Run, System
from transports.stop_signals import AGAIN_S
from transports.watchdog import EXIT_CODE

pytestmark = [pytest.mark.zenoh]


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
    run = Run(system.path, "--processes", "each")
    run.until("tick ")
    children = run.children()
    assert sorted(children) == ["LevelSkill", "MoveSkill", "policy"]
    os.kill(children["MoveSkill"], signal.SIGKILL)
    assert run.end() == 1
    assert run.lines[-1] == (
        "MoveSkill was killed by SIGKILL; everything was stopped. It had printed nothing."
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
import signal
def wait_for_ever():
    while True:
        signal.pause()
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("deaf", flush=True)
wait_for_ever()
"""


def with_a_deaf_node(system: System, inside: Sequence[str] = ()) -> Run:
    broken = system.folder / "broken" / "broken"
    broken.mkdir(parents=True)
    (broken / "__main__.py").write_text(DEAF)
    replaced = ("--replace", f"MoveSkill={broken.parent}")
    run = Run(system.generate(), *replaced, "--processes", "each", inside=inside)
    run.until("deaf")
    return run


def test_a_node_that_does_not_end_is_killed_and_says_where_it_stood(system: System) -> None:
    run = with_a_deaf_node(system, IMPATIENT)
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 1, run.output
    said = run.lines.index(
        f"MoveSkill did not end in {PATIENCE_S:g} s and was killed when everything was stopped. "
        "Its last lines:"
    )
    assert any("in wait_for_ever" in line for line in run.lines[said:]), run.output
    assert run.lines[-1] == "stopped before all nodes were up; not all nodes have ended well"


def test_a_second_signal_kills_who_has_not_ended(system: System) -> None:
    run = with_a_deaf_node(system)
    children = run.children()
    first, deaf = (os.pidfd_open(children[name]) for name in ("LevelSkill", "MoveSkill"))
    with open(first, "rb", buffering=0), open(deaf, "rb", buffering=0):
        run.process.send_signal(signal.SIGINT)
        assert select.select([first], [], [], LIMIT_S)[0]
        assert not select.select([deaf], [], [], AGAIN_S)[0]
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    assert run.lines[-1] == (
        "stopped before all nodes were up; nodes that had not ended yet were killed"
    )


HELD_AS_IT_CLOSES = """
import ctypes, runpy, sys
from m2c.launch import deployed
from transports.zenoh.transport import ZenohTransport
close = ZenohTransport.close
def close_and_hold(transport):
    close(transport)
    ctypes.PyDLL(None).pause()  # called with the interpreter's lock in hand, and never returns
ZenohTransport.close = close_and_hold
deployed.CLOSE_TIMEOUT_S = 0.5
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


def test_a_launcher_whose_middleware_does_not_return_says_so_and_ends(system: System) -> None:
    run = Run(system.path, "--ticks", 3, inside=[sys.executable, "-c", HELD_AS_IT_CLOSES])
    assert run.end() == EXIT_CODE, run.output
    assert run.lines[-2] == "stopped after 3 ticks; all nodes have ended"
    assert run.lines[-1].endswith(
        ": closing the connection takes longer than 0.5 s; the process is ended"
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_everything_and_is_no_fault(system: System, number: signal.Signals) -> None:
    run = Run(system.path, "--processes", "each")
    run.until("tick ")
    children = run.children()
    assert len(children) == 3
    run.process.send_signal(number)
    assert run.end() == 0, run.output
    assert re.search(r"stopped after \d+ ticks?; all nodes have ended", run.output)
    assert "halted: Move" in run.output
    assert all(gone(pid) for pid in children.values())


def test_a_run_that_timeout_ends_ends_in_order(system: System) -> None:
    run = Run(system.path, "--processes", "each")
    run.until("tick ")
    children = run.children()
    for _ in range(2):  # timeout(1) tells the process that it has started, and its process group
        run.process.send_signal(signal.SIGTERM)
    assert run.end() == 0, run.output
    assert re.fullmatch(r"stopped after \d+ ticks?; all nodes have ended", run.lines[-1])
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


SLOW_TO_END = """
import atexit
import time

import m2c

atexit.register(time.sleep, 1.0)


class Listener(m2c.Node):
    pass


NODE_CLASS = Listener
"""
OFTEN = """
ports:
  told: {topic: /t}
properties:
  - {id: often, pattern: recurrence, of: told, within: 700 ms}
  - {id: once, pattern: recurrence, of: told, after: told, within: 700 ms}
"""
"""Ten times a second, by the model."""


@pytest.mark.slow
def test_what_recurs_need_not_while_nodes_are_ended(talk: Path, tmp_path: Path) -> None:
    """One of them needs a second to end, and the monitor is ended after it."""
    listener, properties = tmp_path / "listener.py", tmp_path / "often.yaml"
    listener.write_text(SLOW_TO_END)
    properties.write_text(OFTEN)
    recording = tmp_path / "run.mcap"
    monitor = f"--monitor=--properties {properties}"
    run = Run(talk, monitor, "--record", recording, "--replace", f"Listener={listener}")
    run.until("often  conforming", "linked to 2 nodes")
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    assert "2 properties: 2 conforming" in run.output
    checked = subprocess.run(
        [str(M2C.with_name("moon")), "check", str(recording), str(talk), "--properties", str(properties)],
        capture_output=True, text=True, timeout=LIMIT_S, check=False,
    )  # fmt: skip
    assert "2 properties: 2 conforming" in checked.stdout, checked.stdout + checked.stderr
    entries = open_recording(recording).entries()
    assert any(isinstance(entry, Ending) for entry in entries)
