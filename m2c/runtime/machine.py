"""What a generated ``machine.py`` imports: names of its faults and of event matching."""

from __future__ import annotations

from typing import Any

from m2c.model.durations import parse_duration
from m2c.model.macrostep import ERROR_EXECUTION, MAX_STEPS, matches
from m2c.runtime.conversion import ExecutionError, to_double, to_string

MAX_DELAY_S = 2**63 // 10**9
"""Timers count nanoseconds in 64 bits: 292 years."""


class EndlessLoopError(Exception):
    """Eventless transitions and internal events follow each other without end."""

    def __init__(self, state: str) -> None:
        super().__init__(
            f"an endless loop: more than {MAX_STEPS} eventless transitions and internal events follow each "
            f"other, last in state `{state}`; the machine was left there"
        )
        self.state = state


def seconds(value: Any) -> float:
    """Seconds of a ``delayexpr``: a time such as ``'5s'``, or a number of milliseconds.

    Raises:
        ExecutionError: it is neither, or longer than ``MAX_DELAY_S``.
    """
    parsed: float | None
    if isinstance(value, int | float) and not isinstance(value, bool):
        parsed = to_double(value) / 1000
    else:
        parsed = parse_duration(to_string(value))
    if parsed is None or not parsed <= MAX_DELAY_S:
        raise ExecutionError(f"`{to_string(value)}` is not a time such as 5s or 200ms")
    return parsed


__all__ = [
    "ERROR_EXECUTION",
    "MAX_STEPS",
    "EndlessLoopError",
    "ExecutionError",
    "matches",
    "seconds",
]
