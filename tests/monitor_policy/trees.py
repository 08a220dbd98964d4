"""Trees drawn at random, over the lab tour's leaves."""

from __future__ import annotations

from random import Random

from tests.monitor_policy.scripted import ACTIONS, CONDITIONS, HALTED, leaf

PLAIN = ("Sequence", "ReactiveSequence", "Fallback", "ReactiveFallback")
DECORATORS = ("Inverter", "ForceSuccess", "ForceFailure")
CONTROLS_THAT_REMEMBER = (
    "Parallel",
    'Parallel success_count="1" failure_count="1"',
    "SequenceWithMemory",
    "AsyncSequence",
    "WhileDoElse",
)
DECORATORS_THAT_REMEMBER = (
    'Repeat num_cycles="3"',
    'RetryUntilSuccessful num_attempts="3"',
    "KeepRunningUntilFailure",
    "RunOnce",
    'ForceSuccess _skipIf="1 == 1"',
    'Timeout msec="700"',
    'Delay delay_msec="500"',
)

DEEPEST = 3


def random_tree(draw: Random, remembering: bool = False, depth: int = 0) -> str:
    """A tree; ``remembering``: with nodes that remember more than what is RUNNING, or that wait."""

    def children(count: int) -> str:
        return "".join(random_tree(draw, remembering, depth + 1) for _ in range(count))

    def node(tag: str, count: int) -> str:
        return f"<{tag}>{children(count)}</{tag.split(maxsplit=1)[0]}>"

    kind = draw.random()
    if depth >= DEEPEST or kind < 0.25 + 0.1 * depth:
        return leaf(draw.choice(CONDITIONS + ACTIONS + HALTED))
    if kind < 0.7:
        return node(draw.choice(PLAIN), draw.randint(2, 4))
    if kind < 0.8:
        return node(draw.choice(DECORATORS), 1)
    if kind < 0.85:
        return node("IfThenElse", 3)
    if not remembering:
        return leaf(draw.choice(CONDITIONS))
    if kind < 0.88:
        return '<Sleep msec="450"/>'
    if kind < 0.94:
        return node(draw.choice(CONTROLS_THAT_REMEMBER), 3)
    return node(draw.choice(DECORATORS_THAT_REMEMBER), 1)
