"""The values that a property is about, over the time that led to a violation of it.

What a port's value was is taken from the observations, as the monitor took it. A number is a line of steps
with the limits that predicates set it; an event, a text, anything else is a mark for each.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import msgspec

from m2c.language.expressions import Binary, Expression, Literal, Logical, Unary, Variable
from m2c.language.text import expression_text
from moon.monitor.status import PROPERTY
from moon.properties.predicates import ANY_CHANNEL, UNKNOWN_ERRORS, bind, value_of
from moon.properties.property import Port, Property
from moon.recording.entries import ReportedVerdict
from moon.wording import compact
from transports.interface import Observation, ObservationKind

MAX_POINTS = 50_000
"""Values kept of one port."""
_MOST = 1e300
"""A larger number is not drawn: differences of such are not finite."""
_BEFORE_NS = 1_000_000_000
"""So much is shown before what led to a violation, and after it."""


class Limit(msgspec.Struct, frozen=True):
    """A number to which a predicate compares a value, and the comparison as it is written."""

    at: float
    text: str


class Series(msgspec.Struct, frozen=True):
    """A port's values within a window.

    Attributes:
        name: the port's.
        channel: where it is received.
        points: (ns, value), in order; the first may be from before the window. Of an event the value is True.
        event: whether a value lasts only an instant.
        limits: of its numbers.
    """

    name: str
    channel: str
    points: Sequence[tuple[int, Any]]
    event: bool
    limits: tuple[Limit, ...]


class Plot(msgspec.Struct, frozen=True):
    """What is drawn for one violation: each port's values from ``start_ns`` to ``end_ns``.

    It came about from ``since_ns`` on, and was one at ``at_ns``.
    """

    start_ns: int
    since_ns: int
    end_ns: int
    at_ns: int
    series: tuple[Series, ...]


class _Kept:
    """The values of one port, around the violations of its property."""

    def __init__(self, port: Port, counts: Callable[[Any], bool] | None, limits: tuple[Limit, ...]):
        self.port = port
        self.limits = limits
        self._counts = counts
        self._first_kind: ObservationKind | None = None
        self._points: list[tuple[int, Any]] = []
        self._before: tuple[int, Any] | None = None

    def take(self, seen: Observation, is_near: bool) -> None:
        port = self.port
        if seen.kind is ObservationKind.MESSAGE_TAKEN:
            return
        if port.kinds and seen.kind not in port.kinds:
            return
        if port.kinds and port.kinds[0].startswith("response") and seen.error:
            return
        self._first_kind = self._first_kind or seen.kind
        if port.kinds and seen.kind is not self._first_kind:
            return  # the other end of the same call
        try:
            if self._counts is not None:
                if not self._counts(seen.data):
                    return
                value: Any = True
            else:
                value = value_of(port, seen.data)
        except UNKNOWN_ERRORS:
            return
        point = (seen.stamp_ns, value)
        if not is_near:
            self._before = point
            return
        if self._before is not None and not port.event:
            self._points.append(self._before)
        self._before = None
        if len(self._points) < MAX_POINTS:
            self._points.append(point)

    def within(self, start_ns: int, end_ns: int) -> Series:
        """What was received from ``start_ns`` to ``end_ns``, and of a value that lasts the one before."""
        self._points.sort(key=_stamp)
        first = bisect_right(self._points, start_ns - 1, key=_stamp)
        end = bisect_right(self._points, end_ns, key=_stamp)
        if not self.port.event and first:
            first -= 1
        points = self._points[first:end]
        if not points and self._before is not None and not self.port.event:
            points = [self._before] if self._before[0] <= end_ns else []
        port = self.port
        return Series(port.name, port.channel, points, port.event, self.limits)


class Plots:
    """Collects what is to be plotted.

    Args:
        properties: that were checked.
        violations: those that the page shows.
    """

    def __init__(
        self, properties: Iterable[Property], violations: Iterable[ReportedVerdict]
    ) -> None:
        self._violated: dict[str, list[tuple[int, int]]] = {}
        for reported in violations:
            if reported.verdict.kind != PROPERTY:
                continue
            self._violated.setdefault(reported.verdict.node, []).append(_window(reported))
        self._kept: dict[str, list[_Kept]] = {}
        self._by_channel: dict[str, list[tuple[str, _Kept]]] = {}
        for item in properties:
            if item.name not in self._violated:
                continue
            self._violated[item.name] = _merged(self._violated[item.name])
            kept = self._kept[item.name] = _ports_of(item)
            for one in kept:
                self._by_channel.setdefault(one.port.channel, []).append((item.name, one))

    def take(self, seen: Observation) -> None:
        """Keep what ``seen`` says of a port, if it is near a violation."""
        for channel in (seen.channel, ANY_CHANNEL):
            for name, kept in self._by_channel.get(channel, ()):
                kept.take(seen, _is_in(self._violated[name], seen.stamp_ns))

    def of(self, reported: ReportedVerdict) -> Plot | None:
        """What is drawn for a violation; None: it is of no property that is known, or has no values."""
        kept = self._kept.get(reported.verdict.node)
        if not kept or reported.verdict.kind != PROPERTY:
            return None
        start_ns, end_ns = _window(reported)
        series = tuple(one.within(start_ns, end_ns) for one in kept)
        return Plot(start_ns, start_ns + _BEFORE_NS, end_ns, reported.verdict.stamp_ns, series)


def _window(reported: ReportedVerdict) -> tuple[int, int]:
    """From when to when a violation's values are shown (ns)."""
    verdict = reported.verdict
    why = verdict.explanation
    since_ns = min([verdict.stamp_ns, *(item.stamp_ns for item in (why.evidence if why else ()))])
    return since_ns - _BEFORE_NS, verdict.stamp_ns + _BEFORE_NS


def _merged(windows: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    found: list[tuple[int, int]] = []
    for start, end in sorted(windows):
        if found and start <= found[-1][1]:
            found[-1] = (found[-1][0], max(end, found[-1][1]))
        else:
            found.append((start, end))
    return found


def _is_in(windows: Sequence[tuple[int, int]], stamp_ns: int) -> bool:
    place = bisect_right(windows, (stamp_ns, math.inf))
    return place > 0 and stamp_ns <= windows[place - 1][1]


def _ports_of(item: Property) -> list[_Kept]:
    binding = bind([item.formula], item.ports)
    limits: dict[str, dict[Limit, None]] = {}
    for text, atom in binding.atoms.items():
        if text not in binding.events:
            for name, limit in _limits(atom.expression, binding.ports):
                limits.setdefault(name, {})[limit] = None
    declared = [port.name for port in item.ports if port.name in binding.ports]
    return [
        _Kept(binding.ports[name], binding.conditions.get(name), tuple(limits.get(name, ())))
        for name in dict.fromkeys((*declared, *binding.ports))
    ]


_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}


def _limits(expression: Expression, ports: Mapping[str, Port]) -> Iterable[tuple[str, Limit]]:
    """The comparisons of a port with a number in ``expression``."""
    match expression:
        case Unary(operator="!", operand=operand):
            yield from _limits(operand, ports)
        case Logical(left=left, right=right):
            yield from _limits(left, ports)
            yield from _limits(right, ports)
        case Binary(operator=operator, left=left, right=Variable(name=name)) if name in ports:
            if (number := _number(left)) is not None:
                mirrored = Binary(_MIRRORED.get(operator, operator), Variable(name), left)  # type: ignore[arg-type]
                yield name, Limit(number, expression_text(mirrored))
        case Binary(left=Variable(name=name), right=right) if name in ports:
            if (number := _number(right)) is not None:
                yield name, Limit(number, expression_text(expression))
        case _:
            pass


def _number(expression: Expression) -> float | None:
    match expression:
        case Literal(value=bool()):
            return None
        case Literal(value=int() | float() as value):
            return as_number(value)
        case Unary(operator="-", operand=operand):
            number = _number(operand)
            return None if number is None else -number
        case _:
            return None


def as_number(value: Any) -> float | None:
    """``value`` where it can be drawn as a height; truth is 0 or 1."""
    if isinstance(value, int | float) and -_MOST < value < _MOST:
        return float(value)
    return None


def words(value: Any) -> str:
    """``value`` in a few words."""
    return value if isinstance(value, str) else compact(value)


def _stamp(point: tuple[int, Any]) -> int:
    return point[0]
