"""Every probability of the generator, in one table."""

from __future__ import annotations

from random import Random
from typing import TypeVar

_T = TypeVar("_T")

CHANCE = {
    # what a machine has
    "deferred answer": 0.3,
    "threads": 0.5,
    "handler missing": 0.04,
    "pulse missing": 0.5,
    "handler with condition": 0.35,
    "only with condition": 0.25,
    "condition fails": 0.35,
    "handler leads to a state": 0.4,
    "content on entry": 0.4,
    "content on exit": 0.25,
    "eventless transition": 0.12,
    "delayed transition": 0.25,
    "targets by probability": 0.5,
    "draws at random": 0.25,
    "chain of raised events": 0.2,
    "final state": 0.15,
    "may fail": 0.4,
    "handles errors": 0.5,
    "handles lost goals": 0.7,
    "wildcard": 0.1,
    "declared by child elements": 0.15,
    "named by channel": 0.3,
    "short attribute": 0.2,
    "bounds": 0.1,
    # what a system has
    "policy": 0.85,
    "scripted node": 0.1,
    "best effort": 0.04,
    "ascxml": 0.4,
    "plain": 0.6,
    "properties": 0.95,
}

STATEMENTS = {
    "assign": 5,
    "element": 2,
    "member": 2,
    "append": 2,
    "resize": 1,
    "if": 3,
    "log": 2,
    "fail": 2,
    "emit": 4,
    "cancel": 1,
}
"""Kinds of statements."""

COMPONENTS = {"service": 4, "action": 3, "topic": 4, "event": 3}
"""What the components of a system offer."""

CHAINS = {3: 4, 40: 4, 300: 3, 480: 1, 600: 2, 10**6: 1}
"""How many events raise each other; the last is over the step limit."""

CONTROLS = {
    "Sequence": 5,
    "Fallback": 4,
    "SequenceWithMemory": 2,
    "ReactiveSequence": 3,
    "ReactiveFallback": 3,
    "Parallel": 3,
    "ParallelAll": 1,
    "AsyncSequence": 1,
    "AsyncFallback": 1,
    "IfThenElse": 2,
    "WhileDoElse": 2,
}
DECORATORS = {
    "Inverter": 3,
    "ForceSuccess": 3,
    "ForceFailure": 1,
    "RetryUntilSuccessful": 4,
    "Repeat": 3,
    "Delay": 2,
    "Timeout": 6,
    "KeepRunningUntilFailure": 1,
    "RunOnce": 1,
    "SubTree": 3,
    "plugin": 3,
    "Precondition": 2,
    "Switch2": 2,
    "Switch3": 1,
    "Switch4": 1,
    "Switch5": 1,
    "Switch6": 1,
    "LoopInt": 1,
    "LoopDouble": 1,
    "LoopBool": 1,
    "LoopString": 1,
    "SkipUnlessUpdated": 1,
    "WaitValueUpdate": 1,
    "BlackboardCheckInt": 1,
}
NAV2_CONTROLS = {
    "PipelineSequence": 4,
    "NonblockingSequence": 2,
    "PersistentSequence": 2,
    "RoundRobin": 3,
    "RecoveryNode": 5,
    "TryCatch": 3,
}
NAV2_DECORATORS = {"RateController": 8, "SingleTrigger": 4}
"""Nodes that m2c itself runs, where a system has any: those of Nav2, and ``TryCatch``."""
FILLERS = {
    "Sleep": 2,
    "Script": 2,
    "SetBlackboard": 2,
    "UnsetBlackboard": 1,
    "WasEntryUpdated": 1,
    "AlwaysSuccess": 2,
    "AlwaysFailure": 2,
    "test": 5,
}
SCRIPTS = {
    "_skipIf": "level > 4",
    "_successIf": "level > 5",
    "_failureIf": "level > 5",
    "_while": "level < 6",
    "_onSuccess": "other := 1",
    "_onFailure": "other := 2",
    "_post": "other := 3",
}
"""Attributes that every node of a tree may have."""


def happens(draw: Random, what: str) -> bool:
    """Whether something of :data:`CHANCE` is so."""
    return draw.random() < CHANCE[what]


def pick(draw: Random, table: dict[_T, int]) -> _T:
    """One of ``table``, by its weight."""
    return draw.choices(list(table), list(table.values()))[0]
