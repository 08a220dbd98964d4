"""Figures in words."""

from __future__ import annotations

from examples.overhead.sample import Estimate


def micros(value: float) -> str:
    """Microseconds without decimals, thousands apart."""
    return f"{value:,.0f}"


def ratio(found: Estimate) -> str:
    """A ratio and its interval."""
    return f"{found.value:.2f} ({found.low:.2f}–{found.high:.2f})"


def rate(rate_hz: float) -> str:
    """A rate of ticks of the tree."""
    if not rate_hz:
        return "saturated"
    return f"{rate_hz:g} tick{'' if rate_hz == 1 else 's'}/s"


def lag(p50: float | None, p99: float | None) -> str:
    """How late a watcher is, in ms."""
    if p50 is None:
        return "–"
    return f"{p50:.1f}" if p99 is None else f"{p50:.1f} / {p99:.1f}"


def amount(experiment: str, x: float) -> str:
    """The place of a point, with its unit."""
    if experiment == "rate":
        return rate(x)
    if experiment == "payload":
        for size, unit in ((1 << 20, "MB"), (1 << 10, "KB")):
            if x >= size:
                return f"{x / size:g} {unit}"
        return f"{x:g} B"
    return f"{x:g}"


def spread(found: Estimate) -> str:
    """A figure without decimals, and its interval."""
    return f"{found.value:,.0f} ({found.low:,.0f}–{found.high:,.0f})"


def name_of(transport: str) -> str:
    """A transport as people write it."""
    return {"zenoh": "Zenoh", "ros2": "ROS 2"}[transport]
