"""The points of the growth experiments: all blocks of one point together, and where the cost begins."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

import msgspec

from examples.overhead import sample
from examples.overhead.schedule import same_rounds

EXPERIMENTS = ("taps", "skills", "rate", "payload")


class Run(msgspec.Struct, frozen=True):
    """One block of one point.

    Attributes:
        x: the point.
        watchers: how many watched; 0 for the block that the others are compared with.
        micros: how long each tick took; failed ones are among them.
        lag_ms, lag_p99_ms: from an event to the slowest watcher; None if not known.
        processor: processor time of all watchers, in seconds a second.
        busy: how much of the machine was busy, 0 to 1.
    """

    experiment: str
    transport: str
    rate_hz: float
    x: float
    round: int
    watchers: int
    micros: list[float]
    failures: int
    reasons: tuple[str, ...]
    ticks_per_s: float
    processor: float
    busy: float
    lag_ms: float | None = None
    lag_p99_ms: float | None = None
    heard: int = 0


class Point(msgspec.Struct, frozen=True):
    """All blocks of one point.

    Attributes:
        alone, watched: how long a tick took, in µs.
        ratio: watched to alone, in the same rounds.
        ticks_per_s: watched.
        lag_ms, lag_p99_ms: medians of the blocks.
    """

    experiment: str
    transport: str
    rate_hz: float
    x: float
    alone: sample.Distribution
    watched: sample.Distribution
    ratio: sample.Estimate
    ticks_per_s: float
    processor: float
    busy: float
    lag_ms: float | None
    lag_p99_ms: float | None
    failures: int


class Knee(msgspec.Struct, frozen=True):
    """Where the cost begins to grow, and what was short there; ``x`` is None if nowhere."""

    experiment: str
    transport: str
    rate_hz: float
    x: float | None
    why: str


def points(runs: Sequence[Run]) -> list[Point]:
    """The points in the order of experiments, transports, rates, x."""
    keys = dict.fromkeys((r.experiment, r.transport, _rate_of(r), r.x) for r in runs)
    found = []
    for experiment, transport, rate_hz, x in sorted(
        keys, key=lambda key: (EXPERIMENTS.index(key[0]), key[1] != "zenoh", key[2], _place(*key))
    ):
        own = [
            run
            for run in runs
            if (run.experiment, run.transport, _rate_of(run), run.x)
            == (experiment, transport, rate_hz, x)
        ]
        watched = [run for run in own if run.watchers or experiment == "taps"]
        alone = [
            run
            for run in (own if experiment != "taps" else runs)
            if not run.watchers
            and (run.experiment, run.transport, _rate_of(run)) == (experiment, transport, rate_hz)
        ]
        if pairs := same_rounds(alone, watched):
            unwatched, seen = zip(*pairs, strict=True)
            found.append(_point(experiment, transport, rate_hz, x, unwatched, seen))
    return found


def _rate_of(run: Run) -> float:
    """By rate there is one series, in which the rate is the point."""
    return -1.0 if run.experiment == "rate" else run.rate_hz


def _place(experiment: str, _: str, __: float, x: float) -> float:
    """Saturation comes after all rates."""
    return float("inf") if experiment == "rate" and not x else x


def _point(
    experiment: str,
    transport: str,
    rate_hz: float,
    x: float,
    alone: Sequence[Run],
    watched: Sequence[Run],
) -> Point:
    lags = [run.lag_ms for run in watched if run.lag_ms is not None]
    worst = [run.lag_p99_ms for run in watched if run.lag_p99_ms is not None]
    return Point(
        experiment,
        transport,
        rate_hz,
        x,
        sample.distribution([run.micros for run in alone]),
        sample.distribution([run.micros for run in watched]),
        sample.ratio([run.micros for run in watched], [run.micros for run in alone]),
        statistics.median(run.ticks_per_s for run in watched),
        statistics.fmean(run.processor for run in watched),
        statistics.fmean(run.busy for run in watched),
        statistics.median(lags) if lags else None,
        statistics.median(worst) if worst else None,
        sum(run.failures for run in (*alone, *watched)),
    )


DEAR = 1.25
"""A cost of a quarter, beyond doubt, is where it begins to matter."""
LATE_MS = 100.0
"""Half of the monitor's latency bound."""
FULL = 0.9


def knee(found: Sequence[Point]) -> Knee:
    """The first of ``found`` (one series, x ascending) at which the cost or the lag matters.

    It matters where the whole interval of the ratio is above 1.25, or the lag's 99th percentile above
    half of the monitor's latency bound.
    """
    first = found[0]
    base = (first.experiment, first.transport, first.rate_hz)
    for point in found:
        late = (point.lag_p99_ms or point.lag_ms or 0.0) > LATE_MS
        if point.ratio.low > DEAR or late:
            what = f"a tick costs {point.ratio.value:.2f} times"
            if late:
                what = f"the watcher is {point.lag_p99_ms or point.lag_ms:.0f} ms behind"
            limit = _limit(point)
            return Knee(*base, point.x, f"{what}; {limit}")
    return Knee(*base, None, "no knee in what was measured")


def _limit(point: Point) -> str:
    if point.busy >= FULL:
        return f"the machine is full ({point.busy:.0%} busy)"
    if point.processor >= FULL:
        return f"the watchers use {point.processor:.1f} cores"
    return f"neither the machine ({point.busy:.0%} busy) nor a watcher is full"


def series(found: Sequence[Point]) -> list[list[Point]]:
    """The points by experiment, transport and rate."""
    by_key: dict[tuple[str, str, float], list[Point]] = {}
    for point in found:
        by_key.setdefault((point.experiment, point.transport, point.rate_hz), []).append(point)
    return list(by_key.values())
