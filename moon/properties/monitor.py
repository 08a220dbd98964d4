"""Monitors: properties in, observations in, verdicts out.

Time only moves forward. :meth:`PropertySet.observe` and :meth:`PropertySet.advance` raise
:class:`TimeOrderError` for an instant that has passed, and nothing changes. Observations with equal
stamps are taken in the order given, each with effect; an event and anything else of the same stamp
are simultaneous. ``advance(t)`` says that everything stamped up to ``t`` has been given: what was due
by then is decided, so that a response that never comes is reported at its deadline.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from m2c.model.system import System
from moon.properties.files.interfaces import Interfaces
from moon.properties.formula import Formula
from moon.properties.group_plan import plans_of
from moon.properties.monitor_group import (
    REMEMBERED_CHANGES,
    MonitorGroup,
    Snapshot,
    UnknownAtom,
)
from moon.properties.network import NEVER
from moon.properties.predicates import ANY_CHANNEL, PortGroup, PredicateError
from moon.properties.property import Property, Verdict
from moon.properties.syntax import parse_formula
from transports.interface import Observation, ObservationKind

__all__ = ["PredicateError", "PropertyMonitor", "PropertySet", "TimeOrderError"]


class TimeOrderError(ValueError):
    """An observation is older than what was already decided, or its stamp is no time."""


class PropertySet:
    """Monitors many properties at once, sharing what they have in common.

    Properties that wait for the same states share one network; each begins when the states that it
    uses are known.

    Args:
        properties: what to monitor; names must differ.
        remembered: so many changes of each predicate are remembered, to explain a violation.

    Raises:
        ValueError: two properties have one name.
        PredicateError: a predicate that cannot be evaluated.
    """

    def __init__(
        self, properties: Iterable[Property], remembered: int = REMEMBERED_CHANGES
    ) -> None:
        self.properties = tuple(properties)
        names = [item.name for item in self.properties]
        if len(set(names)) != len(names):
            raise ValueError("two properties have the same name")
        self.groups = [MonitorGroup(plan, remembered) for plan in plans_of(self.properties)]
        self._tables: dict[
            str, dict[ObservationKind, list[tuple[MonitorGroup, Any, PortGroup]]]
        ] = {}
        self._sealed = -1
        self._earliest = 0
        """The least stamp that is not too late."""

    @classmethod
    def from_files(cls, *paths: Path | str, system: System | None = None) -> PropertySet:
        """The properties of property files.

        Args:
            paths: property files, ``.yaml``, ``.yml`` or ``.xml``.
            system: the models with whose channels and types the properties must agree; None: they are
                not compared with any.

        Raises:
            ModelError: something in a file is wrong, or a property is declared twice.
        """
        from moon.properties.files import load_properties

        interfaces = None if system is None else Interfaces(system.library, system)
        return cls(load_properties(*map(Path, paths), interfaces=interfaces))

    @classmethod
    def from_text(
        cls, text: str, *, name: str = "<text>", system: System | None = None
    ) -> PropertySet:
        """The properties of ``text``, the contents of a property file (YAML, or XML if it begins with ``<``).

        Args:
            text: the contents.
            name: what findings call it instead of a file's path.
            system: the models with whose channels and types the properties must agree; None: they are
                not compared with any.

        Raises:
            ModelError: something in ``text`` is wrong.
        """
        from moon.properties.files import parse_properties

        interfaces = None if system is None else Interfaces(system.library, system)
        return cls(parse_properties(text, name, interfaces))

    def observe(self, observation: Observation) -> Sequence[tuple[str, Verdict]]:
        """Take ``observation`` in; returns the properties whose verdict changed, with the verdict.

        Raises:
            TimeOrderError: its stamp lies before the last one, or not after the last ``advance``.
        """
        taken: Any = observation  # its stamp need not be one
        stamp = taken.stamp_ns
        if stamp.__class__ is not int or stamp < self._earliest:
            self._refuse(stamp)
        self._earliest = stamp
        try:
            entries = self._tables[observation.channel][observation.kind]
        except KeyError:
            entries = self._route(observation.channel, observation.kind)
        found: list[tuple[str, Verdict]] = []
        for group, handler, ports in entries:
            if not group.plain:
                found += group.observe(ports, observation)
                continue
            if group.heap[0][0] < stamp:
                found += group.catch_up(stamp - 1)
            try:
                handler(stamp, observation.data, observation)
            except UnknownAtom:
                found += group.observe(ports, observation)
            else:
                if group.changed:
                    found += group.report()
        return found

    def _refuse(self, stamp: Any) -> NoReturn:
        if stamp.__class__ is not int or stamp < 0:
            raise TimeOrderError(f"{stamp!r} is not a stamp in ns")
        raise TimeOrderError(f"an observation of {stamp} ns is too late at {self._latest()} ns")

    def _latest(self) -> int:
        """The instant before which nothing is taken any more; of what has not begun, too."""
        return max([self.sealed_ns, *(group.reached for group in self.groups)])

    def advance(self, now_ns: int) -> Sequence[tuple[str, Verdict]]:
        """Nothing more with a stamp up to ``now_ns`` will come; returns the changed verdicts.

        Properties that wait for no state begin here, if nothing was observed before.

        Raises:
            TimeOrderError: ``now_ns`` has passed.
        """
        if now_ns.__class__ is not int or now_ns < self.now_ns or now_ns < self._sealed:
            raise TimeOrderError(f"cannot advance to {now_ns!r}: it is already {self.now_ns} ns")
        self._sealed = now_ns
        self._earliest = now_ns + 1
        return [change for group in self.groups for change in group.advance(now_ns)]

    def lose(self, channel: str, from_ns: int, until_ns: int) -> Sequence[tuple[str, Verdict]]:
        """Messages of ``channel`` stamped in ``[from_ns, until_ns)`` were lost.

        Whatever depends on them is inconclusive until it no longer matters. It may be reported at any time:
        what else was observed at those instants counts, before the report and after it. Best is before
        anything stamped ``from_ns`` or later: of what has passed by then no more is left than what
        holds whatever was lost, and a verdict that rested on it is withdrawn, even if it was final.

        Args:
            channel: where they were sent.
            from_ns: the earliest stamp they may have.
            until_ns: the stamp from which on nothing was lost; equal to ``from_ns`` if nothing was.

        Returns:
            The changed verdicts.

        Raises:
            TimeOrderError: ``until_ns`` is before ``from_ns``, or one of them is no time.
        """
        for stamp in (from_ns, until_ns):
            if stamp.__class__ is not int or stamp < 0:
                raise TimeOrderError(f"{stamp!r} is not a stamp in ns")
        if from_ns > until_ns:
            raise TimeOrderError(f"a loss in [{from_ns}, {until_ns}) has no beginning")
        return [
            change for group in self.groups for change in group.lose(channel, from_ns, until_ns)
        ]

    def next_deadline(self) -> int | None:
        """The earliest instant (ns) at which a verdict can change with no further observation.

        No verdict changes by itself before it; at it, call ``advance``.
        """
        instant = min((group.next_deadline() for group in self.groups), default=NEVER)
        return instant if instant < NEVER else None

    @property
    def sealed_ns(self) -> int:
        """Nothing stamped up to here is taken any more; -1 at first."""
        return max(self._sealed, self.now_ns)

    @property
    def is_certain(self) -> bool:
        """Whether nothing that matters is unknown (what is only waited for does not count)."""
        return all(group.plain or group.started < 0 for group in self.groups)

    @property
    def now_ns(self) -> int:
        """The latest instant up to which anything is known; -1 before the first."""
        return max((group.now for group in self.groups), default=-1)

    def verdicts(self) -> dict[str, Verdict]:
        """The verdict of every property."""
        pairs = [
            pair for group in self.groups for pair in zip(group.names, group.verdicts, strict=True)
        ]
        order = {item.name: place for place, item in enumerate(self.properties)}
        return dict(sorted(pairs, key=lambda pair: order[pair[0]]))

    def snapshot(self) -> tuple[Snapshot, ...]:
        """Where the monitors stand, for :meth:`restore`."""
        return tuple(group.snapshot() for group in self.groups)

    def restore(self, snapshot: Sequence[Snapshot]) -> None:
        """Go to where ``snapshot`` was taken, by this set or (if certain) by one of the same properties."""
        for group, state in zip(self.groups, snapshot, strict=True):
            group.restore(state)
        self._sealed = max((group.sealed for group in self.groups), default=-1)
        self._earliest = max(self._sealed + 1, self._latest())

    def listen_as(self, other: PropertySet) -> None:
        """Take the same end of every call as ``other``, a set of the same properties, does."""
        self._tables.clear()
        for channel, table in other._tables.items():
            for kind in table:
                self._route(channel, kind)

    def channels(self) -> frozenset[str]:
        """The channels that matter; ``*`` if any may."""
        return frozenset(ports.channel for group in self.groups for ports in group.binding.groups)

    def _route(
        self, channel: str, kind: ObservationKind
    ) -> list[tuple[MonitorGroup, Any, PortGroup]]:
        """Who takes observations of this channel and kind from now on.

        A call is observed at up to two ends; the end that is observed first counts from then on.
        """
        table = self._tables.setdefault(channel, {})
        entries = []
        for group in self.groups:
            for ports in group.binding.groups:
                if ports.channel == ANY_CHANNEL:
                    entries.append((group, group.handlers[ports.name], ports))
                elif ports.channel == channel and kind in ports.kinds:
                    rivals = [other for other in ports.kinds if other != kind and table.get(other)]
                    if not rivals:
                        entries.append((group, group.handlers[ports.name], ports))
        table[kind] = entries
        return entries


class PropertyMonitor:
    """Monitors one property, or one formula over fields of messages on any channel.

    Args:
        formula: a property, a formula or a formula's text (``historically {level > 30}``, where
            ``level`` is a field of some message).

    Raises:
        FormulaError: the text is not a formula.
        PredicateError: a predicate that cannot be evaluated.
    """

    def __init__(self, formula: Property | Formula | str) -> None:
        if isinstance(formula, str):
            formula = parse_formula(formula)
        self.property = formula if isinstance(formula, Property) else Property("property", formula)
        self._set = PropertySet([self.property])
        self._group = self._set.groups[0]

    @property
    def verdict(self) -> Verdict:
        """The verdict now."""
        return self._group.verdicts[0]

    def observe(self, observation: Observation) -> Verdict:
        """Take ``observation`` in; the verdict after it.

        Raises:
            TimeOrderError: its stamp lies before the last one, or not after the last ``advance``.
        """
        self._set.observe(observation)
        return self._group.verdicts[0]

    def advance(self, now_ns: int) -> Verdict:
        """Nothing more with a stamp up to ``now_ns`` will come; the verdict then.

        Raises:
            TimeOrderError: ``now_ns`` has passed.
        """
        self._set.advance(now_ns)
        return self._group.verdicts[0]

    def lose(self, channel: str, from_ns: int, until_ns: int) -> Verdict:
        """Messages of ``channel`` stamped in ``[from_ns, until_ns)`` were lost (:meth:`PropertySet.lose`).

        Raises:
            TimeOrderError: ``until_ns`` is before ``from_ns``, or one of them is no time.
        """
        self._set.lose(channel, from_ns, until_ns)
        return self._group.verdicts[0]

    def next_deadline(self) -> int | None:
        """The earliest instant (ns) at which the verdict can change with no further observation."""
        return self._set.next_deadline()
