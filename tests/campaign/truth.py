"""What is true of a run: what its properties and its machines are, given everything that happened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from m2c.model.machine import Machine
from m2c.model.system import System
from moon.oracle.bounds import LINKED_NS, Bounds
from moon.oracle.oracle import Oracle
from moon.properties.monitor import PropertySet
from moon.properties.predicates import ANY_CHANNEL
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
_GOT = (_TAKEN, ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_RECEIVED)
"""What a node reports that it did not send."""
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


class TrueProperties:
    """Some properties, for any number of runs.

    Args:
        items: the properties.
    """

    def __init__(self, items: Sequence[Property]) -> None:
        self._items = items
        self._channels = PropertySet(items).channels()
        self._completed: dict[tuple[str, str], Property] = {}
        """By name, and the values that its states have before they are published."""

    def of(self, seen: Sequence[Observation], end_ns: int) -> dict[str, PropertyTruth]:
        """What is true of each property of a run.

        Args:
            seen: everything that happened, in order.
            end_ns: when the run ended.
        """
        if not self._items:
            return {}
        end_ns = max([end_ns, *(one.stamp_ns for one in seen[-1:])])  # several then differ by a ns
        broken: list[dict[str, int]] = []
        """By each view, since when each property is broken."""
        completed: list[dict[str, int]] = []
        for view in self._views(seen):
            items = [self._with_first_values(item, view) for item in self._items]
            completed.append(_broken(items, view, end_ns))
            is_same = all(one is item for one, item in zip(items, self._items, strict=True))
            broken.append(completed[-1] if is_same else _broken(self._items, view, end_ns))
        return {item.name: _judged(item.name, broken, completed) for item in self._items}

    def _views(self, seen: Iterable[Observation]) -> list[list[Observation]]:
        """What is seen on the properties' channels by who sees one end of calls or the other."""
        told = [one for one in seen if one.kind is not _TAKEN and self._listens_to(one.channel)]
        views: dict[tuple[int, ...], list[Observation]] = {}
        for request in _ENDS[0]:
            for response in _ENDS[1]:
                hidden = {*_ENDS[0], *_ENDS[1]} - {request, response}
                view = [one for one in told if one.kind not in hidden]
                views[tuple(map(id, view))] = view
        return list(views.values())

    def _listens_to(self, channel: str) -> bool:
        return channel in self._channels or ANY_CHANNEL in self._channels

    def _with_first_values(self, item: Property, seen: Sequence[Observation]) -> Property:
        """``item`` with states that always had the value that was published first: they may have had it."""
        ports = tuple(_with_first(port, seen) for port in item.ports)
        if all(new is port for new, port in zip(ports, item.ports, strict=True)):
            return item
        values = repr([port.initial for port in ports])
        made = msgspec.structs.replace(item, ports=ports)
        return self._completed.setdefault((item.name, values), made)


def _judged(
    name: str, broken: Sequence[dict[str, int]], completed: Sequence[dict[str, int]]
) -> PropertyTruth:
    everywhere = [since[name] for since in (*broken, *completed) if name in since]
    is_broken = len(everywhere) == len(broken) + len(completed)
    return PropertyTruth(
        any(name in since for since in completed), max(everywhere) if is_broken else 0
    )


def _broken(items: Sequence[Property], seen: Iterable[Observation], end_ns: int) -> dict[str, int]:
    """Since when each property is broken, of those that are."""
    monitors = PropertySet(items)
    changes = list(monitors.advance(START_NS - 1))
    for one in seen:
        changes += monitors.observe(one)
    changes += monitors.advance(end_ns)
    broken: dict[str, int] = {}
    for name, verdict in changes:
        if verdict.status is Status.FALSE:
            broken.setdefault(name, verdict.since_ns)
    return broken


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


def occurrences(found: Iterable[Verdict], since_ns: int, apart_ns: int) -> list[int]:
    """When (ns) a fault showed after ``since_ns``: what is found within ``apart_ns`` of one time is no other.

    What is found right after a violation may only follow from how the oracle went on after it.
    """
    times: list[int] = []
    for verdict in found:
        if verdict.stamp_ns > (times[-1] + apart_ns if times else since_ns):
            times.append(verdict.stamp_ns)
    return times


def may_have_ended(machine: Machine, seen: Iterable[Observation], since_ns: int) -> bool:
    """Whether ``machine``, found at ``since_ns``, may be in a state that it never leaves, by what its node sent.

    From there it sends nothing: who did not see it before cannot tell a node that should send something from it.
    """
    ends = any(not state.transitions for state in machine.states)
    sent = (one for one in seen if one.source == machine.name and one.kind not in _GOT)
    return ends and all(one.stamp_ns <= since_ns for one in sent)


def violations(
    machine: Machine, system: System, seen: Sequence[Observation], bounds: Bounds, end_ns: int
) -> list[Verdict]:
    """Each time at which everything that happened shows that ``machine``'s node is not it, in order.

    Calls of the first seconds that their clients gave up show nothing: they may not have found it yet.
    """
    given_up = {
        (one.channel, one.client, one.call)
        for one in seen
        if one.error and one.stamp_ns < START_NS + LINKED_NS
    }
    seen = [one for one in seen if (one.channel, one.client, one.call) not in given_up]
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
    return [verdict for verdict in told if verdict.outcome is Outcome.VIOLATED]
