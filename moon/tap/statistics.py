"""Rates and latencies per channel, in bounded memory."""

from __future__ import annotations

from collections import deque

from moon.tap.stream import Line

WINDOW = 1024
"""Latencies and stamps kept per channel: quantiles and rates are those of the last thousand."""


class ChannelStatistics:
    """What was seen on one channel."""

    def __init__(self) -> None:
        self.count = 0
        self.failures = 0
        self._stamps: deque[int] = deque(maxlen=WINDOW)
        self._trips_us: deque[float] = deque(maxlen=WINDOW)

    def add(self, line: Line) -> None:
        """Count one line."""
        if line.kind in ("message", "request"):
            self.count += 1
            self._stamps.append(line.stamp_ns)
        if line.round_trip_us is not None and not line.error:
            self._trips_us.append(line.round_trip_us)
        self.failures += bool(line.error)

    @property
    def rate_hz(self) -> float | None:
        """Messages or requests a second over the window; None before the second one."""
        if len(self._stamps) < 2:
            return None
        span = max(self._stamps) - min(self._stamps)
        return (len(self._stamps) - 1) / (span / 1e9) if span else None

    def latency_us(self, quantile: float) -> float | None:
        """The ``quantile`` (0 to 1) of the round trips in the window; None if there is none."""
        if not self._trips_us:
            return None
        ordered = sorted(self._trips_us)
        return ordered[min(int(quantile * len(ordered)), len(ordered) - 1)]


class Statistics:
    """All channels."""

    def __init__(self) -> None:
        self.channels: dict[str, ChannelStatistics] = {}

    def add(self, line: Line) -> None:
        """Count one line."""
        self.channels.setdefault(line.channel, ChannelStatistics()).add(line)

    def rows(self) -> list[tuple[str, str, str, str, str, str]]:
        """Channel, count, rate, median and 99th percentile of the round trip, failures."""
        return [
            (
                channel,
                str(found.count),
                _number(found.rate_hz, "{:.1f}"),
                _number(found.latency_us(0.5), "{:.0f}"),
                _number(found.latency_us(0.99), "{:.0f}"),
                str(found.failures or ""),
            )
            for channel, found in sorted(self.channels.items())
        ]


def _number(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)


HEADER = ("channel", "count", "rate [1/s]", "p50 [µs]", "p99 [µs]", "failed")


def table(statistics: Statistics) -> list[str]:
    """The statistics as aligned lines of text."""
    rows = [HEADER, *statistics.rows()]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
    return [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
