"""Virtual time that keeps to real time."""

from __future__ import annotations

import time
from collections.abc import Callable

_NS = 1e9
_LONGEST_S = 3600.0
"""A longer wait is waited for in parts: it may be longer than what the system's locks take."""


class Pace:
    """How long virtual time has to be held back.

    After a time in which it could not keep up, it passes as fast as it can until it has caught up.

    Args:
        speed: seconds of virtual time in each second of real time, more than 0.
        now_ns: virtual time now.
        clock: real time in seconds, which nobody sets.
    """

    def __init__(
        self, speed: float, now_ns: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._speed = speed
        self._began_ns = now_ns
        self._clock = clock
        self._began_s = clock()

    def left_s(self, due_ns: int) -> float:
        """Seconds of real time until ``due_ns``, at most an hour; 0 or less: it is time."""
        passed_s = self._clock() - self._began_s
        return min((due_ns - self._began_ns) / _NS / self._speed - passed_s, _LONGEST_S)
