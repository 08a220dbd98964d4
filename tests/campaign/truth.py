"""What is true of a run: what its properties and its machines are, given everything that happened."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import msgspec

from m2c.model.machine import Machine
from m2c.model.system import System
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.properties.monitor import PropertySet
from moon.properties.property import Port, Property, Status
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, ObservationKind
from transports.simulated.world import START_NS

_TAKEN = ObservationKind.MESSAGE_TAKEN
_ENDS = (
    (ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED),
    (ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED),
)
"""A property counts a call once, at the end of which something was received first."""
_LOOK_NS = 20_000_000
"""A node is known to have done nothing more at least so often."""


class PropertyTruth(msgspec.Struct, frozen=True):
    """Of one property.

    Attributes:
        may_be_broken: whether it was, for who sees one end of calls or the other, and whatever the values of
            states were before anybody published them.
        is_broken: whether it was, for all of these; when first (ns), else 0.
    """

    may_be_broken: bool
    is_broken: int


def of_properties(
    items: Sequence[Property], seen: Sequence[Observation], end_ns: int
) -> dict[str, PropertyTruth]:
    """What is true of each property of a run.

    Args:
        items: the properties.
        seen: everything that happened, in order.
        end_ns: when the run ended.
    """
    known: list[dict[str, int]] = []
    """By each view, since when each property is broken."""
    completed: list[dict[str, int]] = []
    for view in _views(seen):
        known.append(_broken(items, view, end_ns))
        completed.append(_broken([_completed(item, view) for item in items], view, end_ns))
    return {
        item.name: PropertyTruth(
            any(item.name in broken for broken in completed),
            max(broken[item.name] for broken in (*known, *completed))
            if all(item.name in broken for broken in (*known, *completed))
            else 0,
        )
        for item in items
    }


def _views(seen: Iterable[Observation]) -> Iterator[list[Observation]]:
    told = [one for one in seen if one.kind is not _TAKEN]
    for request in _ENDS[0]:
        for response in _ENDS[1]:
            hidden = {*_ENDS[0], *_ENDS[1]} - {request, response}
            yield [one for one in told if one.kind not in hidden]


def _broken(items: Sequence[Property], seen: Iterable[Observation], end_ns: int) -> dict[str, int]:
    if not items:
        return {}
    monitors = PropertySet(items)
    changes = list(monitors.advance(START_NS - 1))
    last_ns = START_NS
    for one in seen:
        changes += monitors.observe(one)
        last_ns = one.stamp_ns
    changes += monitors.advance(max(end_ns, last_ns))  # several at the last instant differ by a ns
    broken: dict[str, int] = {}
    for name, verdict in changes:
        if verdict.status is Status.FALSE:
            broken.setdefault(name, verdict.since_ns)
    return broken


def _completed(item: Property, seen: Sequence[Observation]) -> Property:
    """``item`` with states that always had the value that was published first: they may have had it."""
    return msgspec.structs.replace(
        item, ports=tuple(_with_first(port, seen) for port in item.ports)
    )


def _with_first(port: Port, seen: Sequence[Observation]) -> Port:
    if port.event or port.initial is not msgspec.UNSET:
        return port
    for one in seen:
        if one.channel == port.channel and one.kind in port.kinds:
            value = _value(one.data, port.path)
            return msgspec.structs.replace(port, initial=value)
    return port


def _value(data: Any, path: Sequence[str]) -> Any:
    for part in path:
        if not isinstance(data, dict) or part not in data:
            return msgspec.UNSET
        data = data[part]
    return data


def is_violated(
    machine: Machine, system: System, seen: Sequence[Observation], bounds: Bounds, end_ns: int
) -> bool:
    """Whether everything that happened shows that ``machine``'s node is not it."""
    oracle = Oracle(machine, system.library, machine.name, bounds)
    oracle.start(START_NS)
    told: list[Verdict] = []
    own, looked_ns = 0, START_NS
    for one in seen:
        if one.stamp_ns > looked_ns + _LOOK_NS:
            looked_ns = one.stamp_ns - 1
            told += oracle.reported(own, looked_ns, looked_ns)
            told += oracle.advance(looked_ns)
        if one.source == machine.name:
            own = one.order + 1
        if one.source == machine.name or oracle.channels.concerns(
            one.channel, one.source, one.kind
        ):
            told += oracle.feed(one)
    told += oracle.reported(own, end_ns, end_ns)
    told += oracle.advance(end_ns)
    return any(verdict.outcome is Outcome.VIOLATED for verdict in told)
