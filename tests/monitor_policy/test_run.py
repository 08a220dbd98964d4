"""Runs of one policy do not meddle with each other."""

from __future__ import annotations

import gc
from typing import Any

import pytest

from moon.policy.run import BEGIN, AskKind, TreeRun, Trees
from tests.monitor_policy.scripted import leaf, tree

BODY = f"<ReactiveSequence>{leaf('BatteryLevel')}{leaf('GoToPoi')}</ReactiveSequence>"


def on_the_way(trees: Trees) -> TreeRun:
    """A run at the end of its first tick, in which the robot began to go."""
    run = TreeRun(trees)
    for answer in (BEGIN, "SUCCESS", "RUNNING"):
        run.step(answer)
    assert run.running
    return run


def test_a_run_that_is_thrown_away_on_the_thread_of_another_does_not_halt_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Garbage is collected wherever it is noticed; a tree that goes halts itself."""
    trees = Trees(tree(BODY), frozenset(), records=True)
    other = on_the_way(trees)
    garbage: list[Any] = [on_the_way(trees)]
    garbage[0].close()
    garbage.append(garbage)
    tick_leaf = TreeRun.tick_leaf
    found = []

    def collecting(run: TreeRun, *arguments: Any) -> str:
        found.append(gc.collect())
        return tick_leaf(run, *arguments)

    monkeypatch.setattr(TreeRun, "tick_leaf", collecting)
    gc.collect()
    gc.disable()
    try:
        del garbage
        ask = other.step(BEGIN)
    finally:
        gc.enable()
    assert found[0]
    assert ask.kind is AskKind.TICK
    assert ask.channel == "/BatteryLevelSkill/tick"
    assert other.running
    assert other.step("FAILURE").kind is AskKind.HALT
    other.close()
