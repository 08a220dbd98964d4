"""A policy's trees are freed with their judge: a monitor of a fleet makes them for each robot that comes."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

from m2c.model import DiagnosticLog, load
from m2c.policy.program import read_policy
from moon.policy.run import TreeRun, Trees

TOUR = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"


def test_trees_that_nobody_uses_any_more_are_freed() -> None:
    log = DiagnosticLog()
    system = load([TOUR], log)
    assert system is not None
    assert system.policy is not None
    policy = read_policy(system.policy, system, log)
    assert policy is not None
    trees = Trees(policy, frozenset(), records=False)
    run = TreeRun(trees)
    freed = weakref.ref(trees)
    del trees, run
    gc.collect()
    assert freed() is None
