"""Random numbers of a simulated run."""

from __future__ import annotations

from collections.abc import Callable
from random import Random


def draws_of(seed: int, node: str) -> Callable[[], float]:
    """What ``node`` draws its random numbers from (0 ≤ x < 1), in a run with this ``seed``.

    It depends on these two alone: neither another node nor another run changes what a node draws.
    """
    return Random(f"{seed} {node}").random
