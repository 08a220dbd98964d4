"""A plot as an SVG element of the page, which brings the style; it needs no script."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from markupsafe import Markup

from m2c.draw.svg import clean, group, line, number, text
from moon.report.plots import Plot, Series, as_number, words

_WIDTH, _LEFT, _RIGHT = 480.0, 52.0, 472.0
_HEADING, _LINE_HEIGHT, _MARKS_HEIGHT, _GAP, _AXIS = 16.0, 72.0, 18.0, 8.0, 18.0
_TEXT_WIDTH = 60.0
"""A value that is written beside its mark takes so much."""
_MAX_WORDS = 40
_MAX_MARKS = 200
"""Marks that are drawn in one row: more would touch."""


def drawn(plot: Plot, zero_ns: int) -> Markup:
    """``plot`` with times from ``zero_ns``, the page's beginning; all text in it is escaped."""
    return _Drawing(plot, zero_ns).svg()


class _Drawing:
    def __init__(self, plot: Plot, zero_ns: int) -> None:
        self._plot = plot
        self._zero_ns = zero_ns
        self._parts: list[str] = []
        self._y = 0.0

    def svg(self) -> Markup:
        """The whole element."""
        for series in self._plot.series:
            self._panel(series)
        bottom = self._y
        self._parts += self._violation(bottom) + self._axis(bottom)
        size = f'viewBox="0 0 {number(_WIDTH)} {number(bottom + _AXIS)}"'
        names = ", ".join(series.name for series in self._plot.series)
        return Markup(
            f'<svg {size} role="img"><title>{clean(f"{names} over time")}</title>'
            f"{''.join(self._parts)}</svg>"
        )

    def _x(self, stamp_ns: int) -> float:
        part = (stamp_ns - self._plot.start_ns) / (self._plot.end_ns - self._plot.start_ns)
        return _LEFT + min(max(part, 0.0), 1.0) * (_RIGHT - _LEFT)

    def _time(self, stamp_ns: int) -> str:
        return f"{(stamp_ns - self._zero_ns) / 1e9:+,.3f} s"

    def _panel(self, series: Series) -> None:
        about = f"{_short(series.name)} ({_short(series.channel)})"
        self._parts.append(text(_LEFT, self._y + 12, about, "name"))
        self._y += _HEADING
        heights = [as_number(value) for _, value in series.points]
        is_line = not series.event and bool(heights) and None not in heights
        height = _LINE_HEIGHT if is_line else _MARKS_HEIGHT
        top, self._y = self._y, self._y + height + _GAP
        size = f'width="{number(_RIGHT - _LEFT)}" height="{number(height)}"'
        self._parts.append(f'<rect class="field" x="{number(_LEFT)}" y="{number(top)}" {size}/>')
        if is_line:
            stamps = [stamp for stamp, _ in series.points]
            self._line(series, stamps, [item for item in heights if item is not None], top)
        else:
            self._marks(series.points, top)

    def _line(
        self, series: Series, stamps: Sequence[int], heights: Sequence[float], top: float
    ) -> None:
        limits = [limit.at for limit in series.limits]
        low, high = min(*heights, *limits, heights[0]), max(*heights, *limits, heights[0])
        for value, y in ((high, top + 9), (low, top + _LINE_HEIGHT)):
            self._parts.append(text(_LEFT - 4, y, f"{value:g}", anchor="end"))
            if low == high:
                break
        span = high - low or 1.0
        bottom = top + _LINE_HEIGHT - 4

        def y_of(value: float) -> float:
            return bottom - (value - low) / span * (_LINE_HEIGHT - 8)

        for limit in series.limits:
            y = y_of(limit.at)
            self._parts.append(
                line(f"M{number(_LEFT)},{number(y)} H{number(_RIGHT)}", "limit")
                + text(_RIGHT - 3, max(y - 3, top + 9), _short(limit.text), "limit-text", "end")
            )
        self._parts.append(
            line(_steps([self._x(stamp) for stamp in stamps], list(map(y_of, heights))), "value")
        )

    def _marks(self, points: Sequence[tuple[int, Any]], top: float) -> None:
        if not points:
            self._parts.append(text(_LEFT + 4, top + 13, "nothing was received"))
        free = _LEFT
        for stamp, value in points[-_MAX_MARKS:]:
            x = self._x(stamp)
            place = f"M{number(x)},{number(top + 2)} V{number(top + _MARKS_HEIGHT - 2)}"
            label = "" if value is True else _short(words(value))
            mark = line(place, "event")
            if label and x >= free and x + _TEXT_WIDTH <= _RIGHT:
                mark += text(x + 3, top + 13, label if len(label) < 10 else f"{label[:9]}…")
                free = x + _TEXT_WIDTH
            title = f"{self._time(stamp)}  {label}".rstrip()
            self._parts.append(group([mark], title=title))

    def _violation(self, bottom: float) -> list[str]:
        since, at = self._x(self._plot.since_ns), self._x(self._plot.at_ns)
        size = f'width="{number(at - since)}" height="{number(bottom - _HEADING)}"'
        return [
            f'<rect class="span" x="{number(since)}" y="{number(_HEADING)}" {size}/>',
            line(f"M{number(at)},{number(_HEADING)} V{number(bottom)}", "at"),
        ]

    def _axis(self, bottom: float) -> list[str]:
        y = bottom + 12
        return [
            text(_LEFT, y, self._time(self._plot.start_ns)),
            text(self._x(self._plot.at_ns), y, self._time(self._plot.at_ns), "at-text", "end"),
        ]


def _steps(xs: Sequence[float], ys: Sequence[float]) -> str:
    """A line of steps; of the values that share a pixel the first, the extremes and the last."""
    path: list[str] = []
    place = 0
    while place < len(xs):
        end = place + 1
        while end < len(xs) and int(xs[end]) == int(xs[place]):
            end += 1
        pixel = ys[place:end]
        chosen = pixel if len(pixel) <= 4 else (pixel[0], min(pixel), max(pixel), pixel[-1])
        start = f"H{number(xs[place])}" if path else f"M{number(xs[place])},{number(pixel[0])}"
        path.append(start + "".join(f"V{number(y)}" for y in chosen))
        place = end
    return f"{''.join(path)}H{number(_RIGHT)}"


def _short(label: str) -> str:
    return label if len(label) <= _MAX_WORDS else f"{label[: _MAX_WORDS - 1]}…"
