"""Runs of one policy do not meddle with each other."""

from __future__ import annotations

import gc
import subprocess
import sys
import weakref
from pathlib import Path
from typing import Any

from moon.policy.run import BEGIN, AskKind, TreeRun, Trees
from tests.monitor_policy.scripted import leaf, tree

BODY = f"<ReactiveSequence>{leaf('BatteryLevel')}{leaf('GoToPoi')}</ReactiveSequence>"


def on_the_way(run: TreeRun) -> TreeRun:
    """A fresh run, led to the end of its first tick, in which the robot begins to go."""
    for answer in (BEGIN, "SUCCESS", "RUNNING"):
        run.step(answer)
    assert run.running
    return run


class Collecting(TreeRun):
    """On its own thread garbage is noticed, in the middle of a tick."""

    def tick_leaf(self, *arguments: Any) -> str:
        gc.collect()
        return super().tick_leaf(*arguments)


def throw_one_away() -> None:
    """On the thread of another; alone in an interpreter, where nobody else collects meanwhile."""
    gc.disable()
    trees = Trees(tree(BODY), frozenset(), records=True)
    other = on_the_way(Collecting(trees))
    garbage: list[Any] = [on_the_way(TreeRun(trees))]
    garbage[0].close()
    thrown_away = weakref.ref(garbage[0])
    garbage.append(garbage)
    del garbage
    assert thrown_away() is not None
    ask = other.step(BEGIN)
    assert thrown_away() is None
    assert ask.kind is AskKind.TICK, ask
    assert ask.channel == "/BatteryLevelSkill/tick"
    assert other.running
    assert other.step("FAILURE").kind is AskKind.HALT
    other.close()


def test_a_run_that_is_thrown_away_on_the_thread_of_another_does_not_halt_that() -> None:
    """Garbage is collected wherever it is noticed; a tree that goes halts itself."""
    done = subprocess.run(
        [sys.executable, "-c", f"import {__name__} as own; own.throw_one_away()"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
