"""Delays of SCXML: CSS2 time values such as ``5s``, ``200ms``, ``1.5s``, and what a ``delayexpr`` gives."""

from __future__ import annotations

import re
from typing import Any

from m2c.language.conversion import ExecutionError, to_double, to_string

_DURATION = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(ms|s|m|h|d)\s*\Z", re.ASCII)
_SECONDS = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
MAX_DELAY_S = 2**63 // 10**9
"""Timers count nanoseconds in 64 bits: 292 years."""


def parse_duration(text: str) -> float | None:
    """Seconds of ``text``; None if it is not a time (W3C SCXML section 6.2.4)."""
    match = _DURATION.match(text)
    return float(match[1]) * _SECONDS[match[2]] if match else None


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
