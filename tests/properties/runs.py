"""Running a property over ticks: observations with every predicate's value, one a tick or fewer."""

from __future__ import annotations

from moon.properties.formula import Formula
from moon.properties.monitor import PropertyMonitor
from moon.properties.property import Property, Verdict
from tests.properties.direct import Trace
from transports.interface import Observation, ObservationKind


def seen(t: int, /, channel: str = "/x", kind=ObservationKind.MESSAGE, **data) -> Observation:
    return Observation(
        stamp_ns=t,
        received_ns=t,
        channel=channel,
        kind=kind,
        type_name="test/msg/Any",
        data=data,
        source="robot",
    )


def run(formula: Formula | Property, trace: Trace, sparse: bool = False) -> list[Verdict]:
    """The verdict at every tick; ``sparse``: ticks that change nothing are not observed."""
    monitor = PropertyMonitor(formula)
    verdicts = []
    for t, values in enumerate(trace):
        if sparse and t and values == trace[t - 1]:
            verdicts.append(monitor.advance(t))
        else:
            verdicts.append(monitor.observe(seen(t, **values)))
    return verdicts
