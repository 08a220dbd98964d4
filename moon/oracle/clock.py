"""The time of all oracles of one monitor: who has nothing to do when it passes is not asked."""

from __future__ import annotations


class Clock:
    """How far time has passed for the oracles that share it.

    Attributes:
        settled: all that happened until then (ns) has been heard.
        wake: until this is settled (ns), time alone changes nothing for any of them; or earlier.
    """

    __slots__ = ("settled", "wake")

    def __init__(self) -> None:
        self.settled = 0
        self.wake = 0
