"""In what order things are measured: in rounds, each with every configuration once, at random."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class OfRound(Protocol):
    """What was measured in one round."""

    @property
    def round(self) -> int:
        """Its number."""
        ...


Part = TypeVar("Part", bound=OfRound)


def rounds(items: Sequence[Item], count: int, seed: int) -> Iterator[tuple[int, Item]]:
    """``items`` in ``count`` rounds, shuffled anew in each, with the number of the round.

    What slows the machine down for a while so hits all of them alike, and nobody always comes after
    the same other one.
    """
    draw = random.Random(seed)
    for number in range(count):
        for item in draw.sample(list(items), len(items)):
            yield number, item


def same_rounds(found: Sequence[Part], others: Sequence[Part]) -> list[tuple[Part, Part]]:
    """What is of the same round in both, in the order of rounds; each has one of a round at most."""
    there = {item.round: item for item in others}
    pairs = [(item, there[item.round]) for item in found if item.round in there]
    return sorted(pairs, key=lambda pair: pair[0].round)
