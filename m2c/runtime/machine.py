"""What a generated ``machine.py`` imports: names of its faults and of event matching."""

from __future__ import annotations

from typing import Any

from m2c.model.durations import parse_duration
from m2c.runtime.conversion import ExecutionError, to_double, to_string

MAX_DELAY_S = 2**63 // 10**9
"""Timers count nanoseconds in 64 bits: 292 years."""


class EndlessLoopError(Exception):
    """Eventless transitions follow each other without end."""

    def __init__(self, state: str) -> None:
        super().__init__(
            f"endless eventless transitions, last in state `{state}`; the machine was left there"
        )


def matches(name: str, descriptor: str) -> bool:
    """Whether event ``name`` is ``descriptor`` or begins with its tokens (W3C SCXML 3.12.1)."""
    return name == descriptor or name.startswith(f"{descriptor}.") or not descriptor


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


__all__ = ["EndlessLoopError", "ExecutionError", "matches", "seconds"]
