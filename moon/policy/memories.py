"""All that a plain tree can remember, each with the steps that bring a fresh tree there."""

from __future__ import annotations

from collections import Counter, deque

import msgspec

from moon.policy.remembered import RememberedTree
from moon.policy.run import BEGIN, Ask, AskKind, TreePath

MAX_PLACES = 150
"""Trees with more leaves are not explored: three runs of half a tick for each."""

_ANSWERS = ("SUCCESS", "FAILURE", "RUNNING")

Memory = frozenset[TreePath]


class Memories(msgspec.Struct, frozen=True):
    """What a tree can remember between two ticks.

    Attributes:
        steps: the steps of one tick that leave each memory.
        places: in how many places of the tree each channel is ticked.
        first: what the tree ticks first after each memory, where that can be observed.
    """

    steps: dict[Memory, tuple[str, ...]]
    places: Counter[str]
    first: dict[Memory, Ask]


def memories_of(tree: RememberedTree) -> Memories | None:
    """Explore a plain tree; None if it is too large.

    In one tick of a fresh plain tree, what happens after a leaf is ticked depends on the leaf and its
    status only: all before it in its ancestors is over and forgotten. So following each status of
    each leaf once finds every memory.
    """
    steps: dict[Memory, tuple[str, ...]] = {frozenset(): ()}
    places: Counter[str] = Counter()
    first: dict[Memory, Ask] = {}
    seen: set[tuple[AskKind, TreePath]] = set()
    waiting: deque[tuple[str, ...]] = deque([(BEGIN,)])
    while waiting:
        taken = waiting.popleft()
        run = tree.start()
        run.follow(taken)
        ask = run.ask
        if ask.kind is AskKind.END:
            steps.setdefault(frozenset(run.running), taken)
            continue
        if (ask.kind, ask.place) in seen:
            continue
        if len(seen) >= MAX_PLACES:
            return None
        seen.add((ask.kind, ask.place))
        if ask.kind is AskKind.TICK:
            places[ask.channel] += 1
        answers = _ANSWERS if ask.kind is AskKind.TICK else ask.choices or ("",)
        waiting.extend((*taken, answer) for answer in answers)
    for memory, taken in steps.items():
        run = tree.start()
        run.follow((*taken, BEGIN))
        if run.ask.kind in (AskKind.TICK, AskKind.HALT):
            first[memory] = run.ask
    return Memories(steps, places, first)
