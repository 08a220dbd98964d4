"""In what order things are measured: in rounds, each with every configuration once, at random."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")


def rounds(items: Sequence[Item], count: int, seed: int) -> Iterator[tuple[int, Item]]:
    """``items`` in ``count`` rounds, shuffled anew in each, with the number of the round.

    What slows the machine down for a while so hits all of them alike, and nobody always comes after
    the same other one.
    """
    draw = random.Random(seed)
    for number in range(count):
        for item in draw.sample(list(items), len(items)):
            yield number, item
