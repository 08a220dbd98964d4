"""What is true of a run: what its properties and its machines are, given everything that happened."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from m2c.model.machine import Machine
from m2c.model.system import System
from moon.monitor.departures import Departures
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
        is_broken: whether it was, for all of these, and for who found the nodes last; when first (ns), else 0.
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
        departures = Departures(items, awaited=("every node",))
        self._late = tuple(it for it in departures.properties if it.name in departures.beginning)
        """Those that begin once all nodes were found: what has to happen in time."""
        self._started = tuple(departures.started(START_NS))
        self._channels = PropertySet(items).channels()
        self._completed: dict[tuple[int, str], Property] = {}
        """By which property it is, and the values that its states have before they are published."""

    def of(
        self, seen: Sequence[Observation], end_ns: int, found_ns: int, begin_ns: int = START_NS
    ) -> dict[str, PropertyTruth]:
        """What is true of each property of a run.

        Args:
            seen: everything that happened, in order.
            end_ns: when the run ended.
            found_ns: by then a monitor that misses nothing has found all nodes (ns).
            begin_ns: when it began.
        """
        if not self._items:
            return {}
        end_ns = max([end_ns, *(one.stamp_ns for one in seen[-1:])])  # several then differ by a ns
        may_be: dict[str, int] = {}
        broken: dict[str, list[int]] = {item.name: [] for item in self._items}
        """Of each property, since when it is broken by each view; 0: it is not."""
        for view in self._views(seen):
            completed = self._broken(self._items, view, (begin_ns, end_ns), broken)
            may_be |= completed
            late = [item for item in self._late if completed.get(item.name)]
            if late:
                self._broken(late, _with(self._started, view, found_ns), (begin_ns, end_ns), broken)
        return {
            name: PropertyTruth(name in may_be, max(since) if all(since) else 0)
            for name, since in broken.items()
        }

    def _broken(
        self,
        items: Sequence[Property],
        seen: Sequence[Observation],
        run_ns: tuple[int, int],
        found: dict[str, list[int]],
    ) -> dict[str, int]:
        """Since when each of ``items`` is broken, if states had a value before; ``found`` gets it, and without."""
        with_first = [self._with_first_values(item, seen) for item in items]
        completed = _broken(with_first, seen, run_ns)
        is_same = all(one is item for one, item in zip(with_first, items, strict=True))
        for since in (completed,) if is_same else (completed, _broken(items, seen, run_ns)):
            for item in items:
                found[item.name].append(since.get(item.name, 0))
        return completed

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
        return self._completed.setdefault((id(item), values), made)


def _with(
    made: Sequence[Observation], seen: Sequence[Observation], stamp_ns: int
) -> list[Observation]:
    """``seen`` and, in its place, ``made`` at ``stamp_ns``."""
    stamped = (msgspec.structs.replace(one, stamp_ns=stamp_ns) for one in made)
    return sorted((*stamped, *seen), key=lambda one: one.stamp_ns)


def _broken(
    items: Sequence[Property], seen: Iterable[Observation], run_ns: tuple[int, int]
) -> dict[str, int]:
    """Since when each property is broken, of those that are, in a run from when to when (ns)."""
    begin_ns, end_ns = run_ns
    monitors = PropertySet(items)
    changes = list(monitors.advance(begin_ns - 1))
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
