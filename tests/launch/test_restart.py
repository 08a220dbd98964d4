"""``m2c run --restart on-failure``: a node that dies is started again, and nobody else has to be."""

from __future__ import annotations

import os
import signal
import sys

import pytest

from m2c.launch.restarts import MOST_RESTARTS, WITHIN_S, Restarts
from tests.launch.system import Run, System

FICKLE = """
import pathlib, runpy, signal, sys
marker = pathlib.Path(__file__).with_name("was_here")
if marker.exists():
    print("second thoughts", flush=True)
    signal.pause()
marker.touch()
sys.path.insert(0, {folder!r})
del sys.argv[0]
sys.argv.insert(0, "move_skill")
runpy.run_module("move_skill", run_name="__main__", alter_sys=True)
"""
"""A node that comes up once, and not again."""
HASTY = """
import runpy, sys
from m2c.launch import system
system.START_TIMEOUT_S = {seconds}
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""``m2c`` for whose nodes less time is enough."""


def kill(run: Run, node: str) -> int:
    """Kill ``node``, and wait until the tree fails at it and goes on; the process that took its place."""
    before = run.children()[node]
    os.kill(before, signal.SIGKILL)
    run.until(f"{node} was killed by SIGKILL; it is started again.", "Move no")
    run.until("Move ..")
    after = run.children()[node]
    assert after != before
    return after


@pytest.mark.zenoh
@pytest.mark.slow
def test_a_node_that_is_killed_is_started_again_and_monitored_from_its_start(
    system: System,
) -> None:
    run = Run(system.path, "--restart", "on-failure", "--monitor")
    run.until("Move ..")
    found = "moon | linked to 3 nodes"
    if not any(found in line for line in run.lines):  # it has to know whom it sees again
        run.until(found)
    others = {name: pid for name, pid in run.children().items() if name != "MoveSkill"}
    again, processes = "moon | MoveSkill has started again", set()
    for number in range(1, 4):
        processes.add(kill(run, "MoveSkill"))
        if sum(again in line for line in run.lines) < number:  # nobody waits for a monitor
            run.until(again)
    assert len(processes) == 3
    assert others.items() <= run.children().items()
    run.process.send_signal(signal.SIGINT)
    assert run.end() == 0, run.output
    said = [line.partition("moon | ")[2] for line in run.lines if "moon | " in line]
    assert said.count("MoveSkill has started again") == 3, run.output
    of_it = [line for line in said if "MoveSkill" in line]
    assert not [line for line in of_it if "inconclusive" in line or "middle" in line], run.output
    assert any(line.startswith("0 violations") for line in said), run.output
    assert "leaf Move: /MoveSkill/tick: no response: no node serves it" in run.output
    assert run.lines[-1].endswith("all nodes have ended")


@pytest.mark.zenoh
@pytest.mark.slow
def test_a_node_that_dies_again_and_again_stops_everything(system: System) -> None:
    run = Run(system.path, "--restart", "on-failure")
    run.until("Move ..")
    for _ in range(MOST_RESTARTS):
        kill(run, "MoveSkill")
    os.kill(run.children()["MoveSkill"], signal.SIGKILL)
    assert run.end() == 1, run.output
    assert run.lines[-1] == (
        "MoveSkill was killed by SIGKILL, started again 5 times in a minute before; "
        "everything was stopped. It had printed nothing."
    )


@pytest.mark.zenoh
def test_a_node_that_was_told_to_end_is_not_started_again(system: System) -> None:
    run = Run(system.path, "--restart", "on-failure")
    run.until("Move ..")
    os.kill(run.children()["MoveSkill"], signal.SIGTERM)
    assert run.end() == 1, run.output
    assert (
        "MoveSkill exited with code 0; everything was stopped. It had printed nothing." in run.lines
    )


@pytest.mark.zenoh
def test_a_node_that_dies_while_starting_is_not_started_again(system: System) -> None:
    broken = system.folder / "broken" / "broken"
    broken.mkdir(parents=True)
    (broken / "__main__.py").write_text('import sys\nsys.exit("the motor does not answer")\n')
    run = Run(
        *(system.generate(), "--replace", f"MoveSkill={broken.parent}", "--restart", "on-failure")
    )
    assert run.end() == 1
    assert run.lines[-2:] == [
        "MoveSkill exited with code 1; everything was stopped. Its last lines:",
        "  the motor does not answer",
    ]


@pytest.mark.zenoh
@pytest.mark.slow
def test_a_node_that_does_not_come_up_again_stops_everything(system: System) -> None:
    generated = system.generate()
    fickle = system.folder / "fickle" / "fickle"
    fickle.mkdir(parents=True)
    text = FICKLE.format(folder=str(generated / "move_skill"))
    (fickle / "__main__.py").write_text(text)
    run = Run(
        *(generated, "--replace", f"MoveSkill={fickle.parent}", "--restart", "on-failure"),
        inside=[sys.executable, "-c", HASTY.format(seconds=8)],
    )
    run.until("Move ..")
    os.kill(run.children()["MoveSkill"], signal.SIGKILL)
    assert run.end() == 1, run.output
    assert run.lines[-2:] == [
        "MoveSkill was started again and is not up after 8 s; everything was stopped. Its last lines:",
        "  second thoughts",
    ]


def test_in_virtual_time_nothing_dies(system: System) -> None:
    run = Run(*(system.path, "--transport", "simulated", "--restart", "on-failure"), endpoint=None)
    assert run.end() == 2
    assert run.lines == ["error: --transport simulated: --restart is for a middleware"]


def test_only_restarts_of_the_last_minute_count_and_each_node_has_its_own() -> None:
    restarts = Restarts()
    for second in range(MOST_RESTARTS):
        assert restarts.start("A", second)
    assert not restarts.start("A", MOST_RESTARTS)
    assert restarts.start("B", MOST_RESTARTS)
    assert restarts.start("A", WITHIN_S + 0.5)
    assert not restarts.start("A", WITHIN_S + 0.6)
