"""Figures: SVG and PNG, with intervals, told apart by hatching and markers and so legible in grey."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from examples.overhead import growth_points, sample
from examples.overhead.results import Results
from examples.overhead.table3 import PAPER, SERIES, Cell
from examples.overhead.wording import amount, name_of, rate

STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "0.88",
    "svg.fonttype": "none",
    "svg.hashsalt": "overhead",  # the same figures give the same bytes
    "hatch.linewidth": 0.6,
}
BARS = (
    ("none", "no monitor", "1.0", ""),
    ("both", "passive", "0.75", "///"),
    ("both-in-process", "in the middle, in-process", "0.5", "xxx"),
    ("both-websocket", "in the middle, WebSocket", "0.15", ""),
)
"""Configuration, label, grey, hatching."""
MARKERS = ("o", "s", "^", "D")


def draw(results: Results, folder: Path) -> list[Path]:
    """Write every figure that there are results for into ``folder``; the files."""
    import matplotlib as mpl

    mpl.use("agg")
    found = results.cells
    written: list[Path] = []
    with mpl.rc_context(STYLE):
        for transport in dict.fromkeys(cell.transport for cell in found):
            figure = _table3([cell for cell in found if cell.transport == transport])
            written += _save(figure, folder / f"overhead-table3-{transport}")
        for experiment in growth_points.EXPERIMENTS:
            own = [
                line
                for line in growth_points.series(results.points)
                if line[0].experiment == experiment
            ]
            if own:
                written += _save(_growth(own), folder / f"overhead-{experiment}")
    return written


def _save(figure: Any, stem: Path) -> list[Path]:
    from matplotlib import pyplot

    paths = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    figure.savefig(paths[0], bbox_inches="tight", metadata={"Date": None})
    figure.savefig(paths[1], bbox_inches="tight", dpi=150)
    pyplot.close(figure)
    return paths


def _errors(values: Sequence[sample.Estimate]) -> list[list[float]]:
    """Distances from the value to both ends of its interval; a median may lie at an end."""
    return [
        [max(item.value - item.low, 0.0) for item in values],
        [max(item.high - item.value, 0.0) for item in values],
    ]


def _table3(found: Sequence[Cell]) -> Any:
    from matplotlib import pyplot

    rates = list(dict.fromkeys(cell.rate_hz for cell in found))
    figure, axes = pyplot.subplots(
        1, len(rates), figsize=(4.6 * len(rates), 3.4), sharey=True, squeeze=False
    )
    for axis, rate_hz in zip(axes[0], rates, strict=True):
        by_name = {(c.configuration, c.series): c for c in found if c.rate_hz == rate_hz}
        bars = [bar for bar in BARS if (bar[0], SERIES[0]) in by_name]
        width = 0.8 / len(bars)
        for place, (name, label, grey, hatch) in enumerate(bars):
            own = [by_name[name, series].micros.p50 for series in SERIES]
            axis.bar(
                [x + (place - (len(bars) - 1) / 2) * width for x in range(len(SERIES))],
                [item.value for item in own],
                width,
                yerr=_errors(own),
                label=label,
                color=grey,
                hatch=hatch,
                edgecolor="black",
                linewidth=0.6,
                error_kw={"elinewidth": 0.8, "capsize": 1.5},
            )
        for x, series in enumerate(SERIES):
            for what, marker in (("none", "_"), ("both", "x")):
                axis.plot(
                    x,
                    PAPER[series][what],
                    marker,
                    color="black",
                    markersize=9,
                    label={"none": "paper, no monitor", "both": "paper, all monitors"}[what]
                    if not x
                    else None,
                )
        axis.set_yscale("log")
        axis.set_xticks(range(len(SERIES)), SERIES, rotation=20)
        axis.set_title(f"{name_of(found[0].transport)}, {rate(rate_hz)}", fontsize=10)
    axes[0][0].set_ylabel("tick, median [µs], with 95 % interval")
    handles, labels = axes[0][-1].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncols=3, bbox_to_anchor=(0.5, -0.16), frameon=False
    )
    return figure


STEPS = ("rate", "payload")
_AXES = {
    "taps": "taps",
    "skills": "monitored skills",
    "rate": "ticks of the tree a second",
    "payload": "answer [bytes]",
}


def _growth(lines: Sequence[Sequence[growth_points.Point]]) -> Any:
    """Tick latency relative to unwatched, above the watchers' processor time and lag."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(11, 3))
    experiment = lines[0][0].experiment
    for line, marker in zip(lines, MARKERS, strict=False):
        label = name_of(line[0].transport)
        if experiment != "rate":
            label += f", {rate(line[0].rate_hz)}"
        xs = [_place(point, line) for point in line]
        style = {"marker": marker, "color": "black", "markersize": 4, "linewidth": 0.9}
        style |= {"markerfacecolor": "white" if line[0].transport == "ros2" else "black"}
        own = [point.ratio for point in line]
        axes[0].errorbar(
            xs, [item.value for item in own], _errors(own), label=label, capsize=2, **style
        )
        axes[1].plot(xs, [point.processor for point in line], label=label, **style)
        late = [(x, point.lag_ms) for x, point in zip(xs, line, strict=True) if point.lag_ms]
        axes[2].plot([x for x, _ in late], [value for _, value in late], label=label, **style)
    for axis, title in zip(
        axes,
        ("tick, times unwatched", "watchers, processor time [cores]", "lag, median [ms]"),
        strict=True,
    ):
        axis.set_title(title, fontsize=10)
        axis.set_xlabel(_AXES[experiment])
        axis.set_ylim(bottom=0)
        if experiment in STEPS:
            longest = max(lines, key=len)
            axis.set_xticks(range(len(longest)), [_tick(point) for point in longest], rotation=30)
    axes[0].axhline(1.0, color="0.5", linewidth=0.8, linestyle="--")
    axes[0].legend(frameon=False, fontsize=8)
    return figure


def _place(point: growth_points.Point, points: Sequence[growth_points.Point]) -> float:
    """Rates and sizes stand side by side, however far apart; saturation comes last."""
    return list(points).index(point) if point.experiment in STEPS else point.x


def _tick(point: growth_points.Point) -> str:
    if point.experiment == "rate":
        return "max" if not point.x else f"{point.x:g}"
    return amount(point.experiment, point.x)
