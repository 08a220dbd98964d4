"""Rates and latencies per channel, in bounded memory."""

from __future__ import annotations

from collections import deque

import msgspec

from m2c.printable import printable
from moon.tap.action_parts import label
from moon.tap.stream import Line

WINDOW = 1024
"""Round trips kept per channel: quantiles are those of the last thousand."""

RATE_WINDOW_S = 10
"""A rate is that of the last ten seconds, so that it falls when a channel falls silent."""

_NS = 10**9


class Row(msgspec.Struct, frozen=True):
    """What was seen on one channel.

    Attributes:
        channel: its name; for a part of an action, ``<action> (<part>)``.
        count: messages, or requests.
        rate_hz: of them, in the last :data:`RATE_WINDOW_S`; None before the second one.
        p50_us, p99_us: median and 99th percentile of the round trips; None if there was none.
        failed: calls without a response.
    """

    channel: str
    count: int
    rate_hz: float | None
    p50_us: float | None
    p99_us: float | None
    failed: int


class ChannelStatistics:
    """What was seen on one channel, as it comes."""

    def __init__(self) -> None:
        self.count = 0
        self.failures = 0
        self._first_ns = 0
        self._seconds: deque[list[int]] = deque(maxlen=RATE_WINDOW_S)  # [second, how many in it]
        self._trips_us: deque[float] = deque(maxlen=WINDOW)

    def add(self, line: Line) -> None:
        """Count one line."""
        if line.kind in ("message", "request"):
            if not self.count:
                self._first_ns = line.received_ns
            self.count += 1
            second = line.received_ns // _NS
            if self._seconds and self._seconds[-1][0] >= second:
                self._seconds[-1][1] += 1
            else:
                self._seconds.append([second, 1])
        if line.round_trip_us is not None and not line.error:
            self._trips_us.append(line.round_trip_us)
        self.failures += bool(line.error)

    def rate_hz(self, now_ns: int) -> float | None:
        """Messages or requests a second, in the window that ends ``now_ns`` (the tap's clock)."""
        if self.count < 2:
            return None
        oldest = now_ns // _NS - RATE_WINDOW_S + 1
        counted = sum(number for second, number in self._seconds if second >= oldest)
        if self._first_ns >= oldest * _NS:  # n messages since the first: n - 1 periods
            span_ns, counted = now_ns - self._first_ns, counted - 1
        else:
            span_ns = now_ns - oldest * _NS
        return counted * _NS / span_ns if span_ns > 0 else None

    def latency_us(self, quantile: float) -> float | None:
        """The ``quantile`` (0 to 1) of the round trips in the window; None if there is none."""
        if not self._trips_us:
            return None
        ordered = sorted(self._trips_us)
        return ordered[min(int(quantile * len(ordered)), len(ordered) - 1)]


class Statistics:
    """All channels."""

    def __init__(self) -> None:
        self._channels: dict[str, ChannelStatistics] = {}

    def add(self, line: Line) -> None:
        """Count one line."""
        self._channels.setdefault(line.channel, ChannelStatistics()).add(line)

    def rows(self, now_ns: int) -> list[Row]:
        """A row for each channel, by name; ``now_ns`` is the tap's clock."""
        return [
            Row(
                label(channel),
                found.count,
                found.rate_hz(now_ns),
                found.latency_us(0.5),
                found.latency_us(0.99),
                found.failures,
            )
            for channel, found in sorted(self._channels.items())
        ]


HEADER = ("channel", "count", "rate [1/s]", "p50 [µs]", "p99 [µs]", "failed")


def cells(row: Row) -> tuple[str, ...]:
    """``row`` as the texts of its cells, in the order of :data:`HEADER`."""
    return (
        printable(row.channel),
        str(row.count),
        _number(row.rate_hz, "{:.1f}"),
        _number(row.p50_us, "{:.0f}"),
        _number(row.p99_us, "{:.0f}"),
        str(row.failed or ""),
    )


def _number(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)


def table(rows: list[Row]) -> list[str]:
    """The statistics as aligned lines of text."""
    texts = [HEADER, *(cells(row) for row in rows)]
    widths = [max(len(text[column]) for text in texts) for column in range(len(HEADER))]
    return [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(text, widths, strict=True))
        ).rstrip()
        for text in texts
    ]
