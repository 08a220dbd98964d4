"""Whether two runs of the comparison say the same: of which figures the intervals have nothing in common.

Ratios and the bytes that a node sends are compared; how long a tick takes, or a node's processor time, is
the machine's mood. Where both runs measure the same, two intervals of 95 % miss each other about once in
two hundred times.
"""

from __future__ import annotations

from collections.abc import Mapping

from examples.overhead import node_cost
from examples.overhead.results import Results
from examples.overhead.sample import Estimate
from examples.overhead.tables import Table
from examples.overhead.wording import amount, name_of, rate, ratio, spread


def figures(found: Results) -> dict[str, Estimate]:
    """What is compared, by a name that says what it is."""
    named: dict[str, Estimate] = {}
    for cell in found.cells:
        if cell.configuration != "none":
            place = f"{name_of(cell.transport)}, {rate(cell.rate_hz)}"
            named[f"{place}, {cell.series}, {cell.configuration}"] = cell.ratio
    for point in found.points:
        place = f"{name_of(point.transport)}, {point.experiment}"
        if point.experiment != "rate":
            place += f" at {rate(point.rate_hz)}"
        named[f"{place}: {amount(point.experiment, point.x)}"] = point.ratio
    for cost in node_cost.costs(found.windows):
        state = "tapped" if cost.tapped else "untapped"
        place = f"{name_of(cost.transport)}, {rate(cost.rate_hz)}, {node_cost.NODE} {state}"
        named[f"{place}, bytes/tick"] = cost.sent
    for (transport, rate_hz), estimate in node_cost.dearer(found.windows).items():
        place = f"{name_of(transport)}, {rate(rate_hz)}, {node_cost.NODE}"
        named[f"{place}, processor time tapped to untapped"] = estimate
    return named


def agreement(one: Results, other: Results) -> Table:
    """The figures of both runs whose intervals have nothing in common, and how many have."""
    ours, theirs = figures(one), figures(other)
    common = [name for name in ours if name in theirs]
    apart = [name for name in common if not overlap(ours[name], theirs[name])]
    return Table(
        f"This run and that of {other.began} UTC",
        ("apart", "this run", "the other"),
        tuple((name, _said(name, ours), _said(name, theirs)) for name in apart),
        f"{len(common) - len(apart)} of {len(common)} intervals overlap.",
    )


def overlap(one: Estimate, other: Estimate) -> bool:
    """Whether two intervals have a value in common."""
    return one.low <= other.high and other.low <= one.high


def _said(name: str, found: Mapping[str, Estimate]) -> str:
    return (spread if name.endswith("/tick") else ratio)(found[name])
