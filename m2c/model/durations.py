"""CSS2 time values, as SCXML writes delays: ``5s``, ``200ms``, ``1.5s``."""

from __future__ import annotations

import re

_DURATION = re.compile(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(ms|s|m|h|d)\s*\Z")
_SECONDS = {"ms": 0.001, "s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


def parse_duration(text: str) -> float | None:
    """Seconds of ``text``; None if it is not a time (W3C SCXML section 6.2.4)."""
    match = _DURATION.match(text)
    return float(match[1]) * _SECONDS[match[2]] if match else None
